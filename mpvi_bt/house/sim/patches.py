"""A patch of marks on a floor, such as mud on a patio: a random free place and a size, but no body."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence

import numpy as np
import sapien

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds, pose
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.things.description import PartsOfBody

_SIDE_M = 0.7  # Our choice: a robot sweeps a patch of this side in minutes, all of a garden in hours
_HIGH_M = 0.002
_ROOM_M = 1.2  # around its middle, for the base on every side
_NEAR_M = (3.5, np.inf)  # from what it is to be near; farther only where there is no room so near
_DRAWS = 400


def patch_of(
    floor: str, kind: str, solids: Sequence[Solid], near: Array, obstacles: Callable[[Array, float], list[Solid]]
) -> Thing:
    """A patch of a kind of marks on a floor; it has a place and a size, and no body: nothing meets it.

    Args:
        floor: Its name.
        kind: Of the marks.
        solids: The floor's.
        near: (2,) it is not far from there, if there is room; where exactly, follows from that place [m].
        obstacles: Says what comes within a radius [m] of a place (2,).

    Raises:
        BackendError: There is no room for it.
    """
    low, high = bounds(solids)
    rng = np.random.default_rng(zlib.crc32(f"{floor} {kind} {near.tolist()}".encode()))
    for most_m in np.repeat(_NEAR_M, _DRAWS):
        xy = rng.uniform(low[:2] + _ROOM_M, high[:2] - _ROOM_M)
        if norm(xy - near) < most_m and not obstacles(xy, _ROOM_M):
            parts = PartsOfBody()
            parts.box((0.0, 0.0, _HIGH_M / 2), (_SIDE_M, _SIDE_M, _HIGH_M), (0.0, 0.0, 0.0))
            entity = sapien.Entity()
            entity.set_pose(sapien.Pose(pose((*xy.tolist(), float(high[2])))))
            return Thing(f"{floor}.{kind}", kind, parts.thing(), {"body": entity})
    raise BackendError(f"no room for a patch of {kind} on {floor}")
