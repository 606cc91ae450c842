"""Ways to do something with a hand, and the places and postures from which one of them works."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Load
from mpvi_bt.ground.robot.protocol import Side


@dataclass(frozen=True, eq=False)
class Option:
    """One way to do it, as the hand's waypoints in the world.

    Attributes:
        waypoints: (K, 4, 4) T_world_tcp, in order; a planned arm motion reaches the first, straight lines the others.
        contact: From this waypoint on the hand may touch what it works on.
        cost: Preference.
        run_up_m: The arm takes its first posture that far behind, in the open, and the base drives it straight in; what
            is done leaves the same way.
        load: What the hand has after the contact, in the tcp frame; None if nothing.
        opening_m: Between the fingers while they are open: up to the contact if the hand takes something, from the
            contact on if it lets go; as far as they go if that is less.
    """

    waypoints: Array
    contact: int
    cost: float = 0.0
    run_up_m: float = 0.0
    load: Load | None = None
    opening_m: float = math.inf


@dataclass(frozen=True, eq=False)
class Stance:
    """A place and posture that work.

    Attributes:
        base: (3,) x, y [m], yaw [rad] in the world.
        torso: (4,).
        option: Index of the option that it serves.
        path: Postures (7,) of the arm from where it is to the first waypoint.
        waypoints: (K, 4, 4) T_base_tcp.
        aside: Postures (7,) that bring the other hand, with what it holds, out of the way first.
        level: Postures (7,) of the other arm, if its hand holds something, while the torso moves: they keep it level.
        route: (n, 3) base poses to drive to, one after the other. At the last one the arm takes its posture; where that
            is not `base` the base then drives straight in.
        opening_m: Of the option.
    """

    base: Array
    torso: Array
    option: int
    path: list[Array]
    waypoints: Array
    aside: list[Array]
    level: Mapping[Side, list[Array]]
    route: list[Array]
    opening_m: float

    @property
    def runs_up(self) -> bool:
        """Whether the base drives in with the arm in its posture, and out again."""
        return bool(norm(self.route[-1][:2] - self.base[:2]) > 0.05)


def upright_options(poses: Sequence[tuple[Array, float]], above_m: float, contact: int = 1) -> list[Option]:
    """Options that come down from `above_m` over each pose T_world_tcp (4, 4) with its cost."""
    out = []
    for T, cost in poses:
        high = T.copy()
        high[2, 3] += above_m
        out.append(Option(np.stack([high, T]), contact, cost))
    return out
