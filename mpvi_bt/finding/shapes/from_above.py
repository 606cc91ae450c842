"""What things cover, seen from above: as wide as they are, not as wide as a square around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid

_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_RING = np.array([(np.cos(a), np.sin(a)) for a in np.arange(12) * np.pi / 6]) / np.cos(np.pi / 12)
_SPACING_M = 0.015  # of samples along an outline; our choice: finer than hands are led


def points(solids: Sequence[Solid]) -> Array:
    """(n, 3) points whose hull contains every solid, in the solids' frame."""
    out = []
    for s in solids:
        if s.kind == "box":
            local = _CORNERS * s.half_m
        elif s.kind == "cylinder":
            rim = _RING * s.half_m[0]
            local = np.concatenate([np.insert(rim, 2, z, axis=1) for z in (-s.half_m[2], s.half_m[2])])
        else:  # seen from any side a ball is a disc
            flat = np.insert(_RING * s.half_m[0], 2, 0.0, axis=1)
            poles = matmul([[0, 0, -1.0], [0, 0, 1.0]], s.T[:3, :3]) * s.half_m
            local = np.concatenate([matmul(flat, s.T[:3, :3]), poles])
        out.append(matmul(local, s.T[:3, :3].T) + s.T[:3, 3])
    return np.concatenate(out)


def outline(solids: Sequence[Solid]) -> Array:
    """(n, 2) places along the convex edge of what solids cover, at most 1.5 cm apart."""
    xy = points(solids)[:, :2]
    corners = xy[ConvexHull(xy).vertices]
    edges = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        n = max(1, int(np.ceil(norm(b - a) / _SPACING_M)))
        edges.append(a + (b - a) * np.arange(n)[:, None] / n)
    return np.concatenate(edges)


def disc(solids: Sequence[Solid]) -> tuple[Array, float]:
    """Middle (2,) and radius [m] of a disc over the solids, seen from above."""
    xy = points(solids)[:, :2]
    middle = (xy.min(0) + xy.max(0)) / 2
    return middle, float(norm(xy - middle, axis=1).max()) * float(np.cos(np.pi / 12))
