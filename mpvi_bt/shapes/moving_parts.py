"""Parts of things that hands work on: bars to hold, doors, lids and drawers to open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.solids import Array, Solid


@dataclass(frozen=True)
class PartSizes:
    """What is taken for the sizes of doors, lids and drawers that are only seen from outside.

    Our choice: those of kitchen furniture.

    Attributes:
        panel_m: Thickness of a front [m].
        upright_rad: How far doors and lids open [rad]; one that stands wider open opens as far as that.
        flap_rad: Likewise doors that swing about a level hinge [rad].
        slide_m: Likewise drawers [m].
        deep_m: What shows behind a door once it is open, at the most [m].
    """

    panel_m: float = 0.018
    upright_rad: float = 1.6
    flap_rad: float = 1.3
    slide_m: float = 0.32
    deep_m: float = 0.6


PART = PartSizes()


class Bar(Protocol):
    """A bar that a hand can close around, in the world frame [m]; `mpvi_bt.things.description.Handle` is one."""

    @property
    def center(self) -> Array:
        """(3,) middle of the bar."""
        ...

    @property
    def axis(self) -> Array:
        """(3,) unit vector along it."""
        ...

    @property
    def outward(self) -> Array:
        """(3,) unit vector to its free side."""
        ...

    @property
    def length_m(self) -> float:
        """Free length of the bar."""
        ...


@dataclass(frozen=True, eq=False)
class Door:
    """A part of a thing that opens: a hinged door, a lid, a drawer.

    Attributes:
        name: Of the part, such as "door" or "drawer_2".
        kind: A hinge turns [rad], a slide shifts [m].
        origin: (3,) a point on the hinge's axis, or any on the slide's, in the world.
        axis: (3,) unit vector in the world: positive motion about or along it opens.
        position: How far it is open [rad or m].
        limit: How far it opens [rad or m].
        bar: What to hold it by, where it is now; None if it has no handle.
        solids: The moving part as it stands now, in the world.
    """

    name: str
    kind: Literal["hinge", "slide"]
    origin: Array
    axis: Array
    position: float
    limit: float
    bar: Bar | None
    solids: Sequence[Solid]


def to_and_behind(door: Door) -> Solid:
    """The box, in the world, that a closed door's panel may pass through as it opens, and that one sees into then."""
    panel = max(door.solids, key=lambda s: float(np.sort(s.half_m)[1:].prod()))
    arm = panel.T[:3, 3] - door.origin
    if door.kind == "slide":
        out, reach = door.axis, door.limit
    else:
        arm = arm - door.axis * matmul(door.axis, arm)
        out, reach = np.cross(door.axis, arm) / norm(arm), 2 * float(norm(arm))
    k, half, T = int(np.abs(matmul(out, panel.T[:3, :3])).argmax()), panel.half_m.copy(), panel.T.copy()
    half[k] = (reach + PART.deep_m) / 2
    T[:3, 3] += out * (reach - PART.deep_m) / 2
    return Solid("box", half, T)
