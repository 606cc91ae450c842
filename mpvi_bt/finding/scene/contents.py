"""Unknown contents of a vessel: they move along with the vessel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Surroundings


@dataclass(frozen=True)
class Heap:
    """Contents of a vessel that belong to no known thing.

    Our choice: solids fitted to known things are off by about one cube.
    """

    cell_m: float = 0.02  # edge of the cubes [m]; as fine as depth pictures show from 1 m
    above_m: float = 0.15  # largest height of the contents above the rim [m]
    own_m: float = 0.025  # points this close to the solids of known things belong to those [m]


_HEAP = Heap()


def contents(points: Array, room: Solid, known: Sequence[Solid]) -> list[Solid]:
    """What some points show in a room, or standing out of it, as cubes of 2 cm in the world.

    Args:
        points: (n, 3) that pictures show of the surroundings.
        room: Inside a vessel.
        known: The vessel itself, and what is known to be in it.
    """
    low, high = room.aabb()
    points = points[((points > low) & (points < high + [0.0, 0.0, _HEAP.above_m])).all(1)]
    down = points.copy()
    down[:, 2] = np.minimum(down[:, 2], (low[2] + high[2]) / 2)
    points = points[Surroundings([room]).distance(down) <= 0]
    points = points[Surroundings(known).distance(points) > _HEAP.own_m]
    if not len(points):
        return []
    cells = np.floor((points - low) / _HEAP.cell_m).astype(int)
    filled = np.zeros(cells.max(0) + 1, bool)
    filled[tuple(cells.T)] = True
    parts, _ = ndimage.label(filled, np.ones((3, 3, 3)))
    below = np.unique(
        parts[:, :, : int(np.ceil((high[2] - low[2]) / _HEAP.cell_m))]
    )  # what only hangs above is not in it
    half = np.full(3, _HEAP.cell_m / 2)
    at = low + (np.argwhere(filled & np.isin(parts, below)) + 0.5) * _HEAP.cell_m
    return [Solid("box", half, kin.transform(np.eye(3), p)) for p in at]
