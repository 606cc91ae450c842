"""Kettles and the like: what is round, but for a handle that stands out to one side, and a spout to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.solids import Array

_TRIALS = 60  # of circles through three points
_RADIUS_M = (0.02, 0.055)  # of what a hand goes around
_OFF_M = 0.004  # from the circle that a point of its side is at the most, and so much more by the grain of the picture
_ROUND = 0.65  # at least so much of what is seen from the side bends with the circle
_SHARE = (0.02, 0.35)  # of all points stand out
_LONG_M, _HALF_RAD = 0.07, 0.6  # so far at the most, and no more than so far to either side of a bearing,
_SIDES, _LEAST = 2, 5  # of which there are so many at the most, each with so many points at least


def stand_out(points: Array, top: float, grain: float) -> list[NDArray[np.bool_]]:
    """Which points (n, 3) of a round thing belong to its handle, and which to its spout, if it has any.

    Our choice: taken as one with them, the body is wider than a hand opens.

    Args:
        points: Of what stands upright, in the world.
        top: Its height there [m].
        grain: How far points are off by noise [m].

    Returns:
        A mask (n,) for each; none where nothing stands out, or what is left is not round.
    """
    side = points[points[:, 2] < top - 0.01, :2]
    if len(side) < 40:
        return []
    off = _OFF_M + grain
    rng = np.random.default_rng(0)
    best, found = 0, None
    for a, b, c in side[rng.integers(0, len(side), (_TRIALS, 3))]:
        A = 2 * np.array([b - a, c - a])
        (p, q), (r, s) = A
        if abs(p * s - q * r) < 1e-8:
            continue
        u, v = matmul(b, b) - matmul(a, a), matmul(c, c) - matmul(a, a)
        middle = np.array([s * u - q * v, p * v - r * u]) / (p * s - q * r)
        radius = float(norm(a - middle))
        if _RADIUS_M[0] < radius < _RADIUS_M[1]:
            on = int((np.abs(norm(side - middle, axis=1) - radius) < off).sum())
            if on > best:
                best, found = on, (middle, radius)
    if found is None or best < _ROUND * len(side):
        return []
    middle, radius = found
    away = points[:, :2] - middle
    out = norm(away, axis=1) - radius
    left = out > 1.5 * off
    if not _SHARE[0] < left.mean() < _SHARE[1] or out.max() > _LONG_M or out.max() < 3 * off:
        return []
    bearing, parts = np.arctan2(away[:, 1], away[:, 0]), []
    for _ in range(_SIDES):
        if left.sum() < _LEAST:
            break
        farthest = bearing[np.where(left, out, -np.inf).argmax()]
        part = left & (np.abs(kin.wrap(bearing - farthest)) < _HALF_RAD)
        parts.append(part)
        left = left & ~part
    return parts if left.sum() < _LEAST else []
