"""What is seen in a vessel and belongs to nothing that is known: it comes along when the vessel is taken up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.collision import Surroundings
from mpvi_bt.robot.solids import Array, Solid

_CELL_M = 0.02
_HEAP_M = 0.15  # what is in a vessel may stick out so far above its rim
_OWN_M = 0.025  # points this near to solids that are known are theirs


def contents(points: Array, room: Solid, known: Sequence[Solid]) -> list[Solid]:
    """What some points show in a room, or standing out of it, as cubes of 2 cm in the world.

    Args:
        points: (n, 3) that pictures show of the surroundings.
        room: Inside a vessel.
        known: The vessel itself, and what is known to be in it.
    """
    low, high = room.aabb()
    points = points[((points > low) & (points < high + [0.0, 0.0, _HEAP_M])).all(1)]
    down = points.copy()
    down[:, 2] = np.minimum(down[:, 2], (low[2] + high[2]) / 2)
    points = points[Surroundings([room]).distance(down) <= 0]
    points = points[Surroundings(known).distance(points) > _OWN_M]
    if not len(points):
        return []
    cells = np.floor((points - low) / _CELL_M).astype(int)
    filled = np.zeros(cells.max(0) + 1, bool)
    filled[tuple(cells.T)] = True
    parts, _ = ndimage.label(filled, np.ones((3, 3, 3)))
    below = np.unique(parts[:, :, : int(np.ceil((high[2] - low[2]) / _CELL_M))])  # what only hangs above is not in it
    half = np.full(3, _CELL_M / 2)
    at = low + (np.argwhere(filled & np.isin(parts, below)) + 0.5) * _CELL_M
    return [Solid("box", half, kin.transform(np.eye(3), p)) for p in at]
