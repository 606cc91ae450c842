"""Kettles and the like: round things with a handle on one side and a spout on another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class Handles:
    """Parts that stand out of a round thing, such as a handle or a spout.

    Our choice, by kettles, cups and pans.
    """

    trials: int = 60  # circles through three points that are tried
    radius_m: tuple[float, float] = (0.02, 0.055)  # least and largest radius of a round part for a hand [m]
    off_m: float = 0.004  # largest distance of a point of its side from the circle, beside the grain of the picture [m]
    round: float = 0.65  # least part of the visible side that follows the circle [ratio]
    share: tuple[float, float] = (0.02, 0.35)  # least and largest part of all points that stand out [ratio]
    long_m: float = 0.07  # largest standoff of such a part [m]
    half_rad: float = 0.6  # largest spread to either side of its bearing [rad]
    sides: int = 2  # most bearings
    least: int = 5  # least points of each bearing


_HANDLE = Handles()


def stand_out(points: Array, top: float, grain: float) -> list[NDArray[np.bool_]]:
    """Find the points (n, 3) of a round thing's handle, and those of its spout, if it has any.

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
    off = _HANDLE.off_m + grain
    rng = np.random.default_rng(0)
    best, found = 0, None
    for a, b, c in side[rng.integers(0, len(side), (_HANDLE.trials, 3))]:
        A = 2 * np.array([b - a, c - a])
        (p, q), (r, s) = A
        if abs(p * s - q * r) < 1e-8:
            continue
        u, v = matmul(b, b) - matmul(a, a), matmul(c, c) - matmul(a, a)
        middle = np.array([s * u - q * v, p * v - r * u]) / (p * s - q * r)
        radius = float(norm(a - middle))
        if _HANDLE.radius_m[0] < radius < _HANDLE.radius_m[1]:
            on = int((np.abs(norm(side - middle, axis=1) - radius) < off).sum())
            if on > best:
                best, found = on, (middle, radius)
    if found is None or best < _HANDLE.round * len(side):
        return []
    middle, radius = found
    away = points[:, :2] - middle
    out = norm(away, axis=1) - radius
    left = out > 1.5 * off
    if not _HANDLE.share[0] < left.mean() < _HANDLE.share[1] or out.max() > _HANDLE.long_m or out.max() < 3 * off:
        return []
    bearing, parts = np.arctan2(away[:, 1], away[:, 0]), []
    for _ in range(_HANDLE.sides):
        if left.sum() < _HANDLE.least:
            break
        farthest = bearing[np.where(left, out, -np.inf).argmax()]
        part = left & (np.abs(kin.wrap(bearing - farthest)) < _HANDLE.half_rad)
        parts.append(part)
        left = left & ~part
    return parts if left.sum() < _HANDLE.least else []
