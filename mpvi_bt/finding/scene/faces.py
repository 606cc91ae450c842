"""Free places on the level faces that pictures show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.scene.several_views import View
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array

_SPOT_M = 0.02  # grid of free places; our choice: finer than fingers are thick


def room(
    views: Sequence[View],
    hidden: Sequence[NDArray[np.bool_]],
    top: float,
    radius_m: float,
    height_m: float,
    near: Array,
) -> list[tuple[float, Array]]:
    """Places (3,) with room for an upright cylinder on a level face, each with a cost.

    Args:
        views: Pictures of the thing that has the face.
        hidden: (H, W) bool of each: pixels of the robot and what it holds, which stand in nobody's way.
        top: Height of the face [m].
        radius_m: Of the cylinder.
        height_m: Likewise.
        near: (2,) near places cost less, and those with room to spare.
    """
    own = np.concatenate([f.of(m) for f, m in views])
    face = own[np.abs(own[:, 2] - top) < 0.012, :2]
    if len(face) < 40:
        return []
    low = face.min(0) - 0.1
    size = np.ceil((face.max(0) + 0.1 - low) / _SPOT_M).astype(int) + 1
    free = np.zeros(size, bool)
    free[tuple(((face - low) / _SPOT_M).astype(int).T)] = True
    free = ndimage.binary_closing(free, np.ones((3, 3), bool))
    for (frame, _), mine in zip(views, hidden, strict=True):
        others = frame.points[frame.measured & ~mine]
        others = others[(others[:, 2] > top + 0.012) & (others[:, 2] < top + height_m), :2]
        cells = np.floor((others - low) / _SPOT_M).astype(int)
        cells = cells[((cells >= 0) & (cells < size)).all(1)]
        free[tuple(cells.T)] = False
    room = ndimage.distance_transform_edt(free) * _SPOT_M - _SPOT_M / 2
    cells = np.argwhere(room > radius_m)
    places = low + (cells + 0.5) * _SPOT_M
    cost = norm(places - near, axis=1) - 0.5 * np.minimum(room[tuple(cells.T)], 0.2)
    return [(float(cost[k]), np.array([*places[k], top])) for k in _spread(places, np.argsort(cost))]


def _spread(places: Array, order: NDArray[np.intp]) -> list[int]:
    """The best places, a hand's breadth apart."""
    kept: list[int] = []
    for k in order:
        if all(norm(places[k] - places[j]) > 0.08 for j in kept):
            kept.append(int(k))
        if len(kept) >= 8:
            break
    return kept
