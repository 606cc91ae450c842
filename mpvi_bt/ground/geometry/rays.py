"""Boxes, cylinders and spheres: which of them a ray passes through, and how far a point is from one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid

_PARALLEL = 1e-12


def interval(solid: Solid, start: Array, direction: Array) -> tuple[float, float] | None:
    """Where the line start + t * direction is inside the solid, as (t_in, t_out); None if it misses.

    Args:
        solid: Posed in the frame of the ray.
        start: (3,) [m].
        direction: (3,) of length 1, so that t is in meters; t may be negative.
    """
    R, p = solid.T[:3, :3], solid.T[:3, 3]
    s, d, h = matmul(R.T, start - p), matmul(R.T, direction), solid.half_m
    if solid.kind == "sphere":
        return _quadratic(s, d, h[0])
    if solid.kind == "box":
        return _slabs(s, d, h, (0, 1, 2))
    side, caps = _quadratic(s[:2], d[:2], h[0]), _slabs(s, d, h, (2,))
    if side is None or caps is None:
        return None
    enter, leave = max(side[0], caps[0]), min(side[1], caps[1])
    return (enter, leave) if enter <= leave else None


def crosses(solids: Iterable[Solid], start: Array, direction: Array, length_m: float) -> bool:
    """Whether the segment of `length_m` meets any of the solids; one that begins inside a solid meets it."""
    for solid in solids:
        span = interval(solid, start, direction)
        if span is not None and span[1] >= 0.0 and span[0] <= length_m:
            return True
    return False


def within(solid: Solid, point: Array) -> bool:
    """Whether the (3,) point is in the solid, its surface included."""
    local = np.abs(matmul(solid.T[:3, :3].T, point - solid.T[:3, 3]))
    if solid.kind == "sphere":
        return bool(norm(local) <= solid.half_m[0])
    if solid.kind == "cylinder":
        return bool(np.hypot(local[0], local[1]) <= solid.half_m[0] and local[2] <= solid.half_m[2])
    return bool(np.all(local <= solid.half_m))


def distance(solid: Solid, p: Array) -> float:
    """Distance [m] of a point (3,) to a solid, both in one frame; 0 or less inside."""
    local = np.abs(matmul(kin.inverse(solid.T)[:3, :3], p - solid.T[:3, 3])) - solid.half_m
    if solid.kind == "sphere":
        return float(norm(p - solid.T[:3, 3]) - solid.half_m[0])
    if solid.kind == "cylinder":
        q = matmul(solid.T[:3, :3].T, p - solid.T[:3, 3])
        local = np.array([np.hypot(q[0], q[1]) - solid.half_m[0], abs(q[2]) - solid.half_m[2]])
    return float(norm(np.maximum(local, 0)) + min(0.0, local.max()))


def _slabs(s: Array, d: Array, h: Array, axes: tuple[int, ...]) -> tuple[float, float] | None:
    enter, leave = -np.inf, np.inf
    for i in axes:
        if abs(d[i]) < _PARALLEL:
            if abs(s[i]) > h[i]:
                return None
            continue
        a, b = sorted(((-h[i] - s[i]) / d[i], (h[i] - s[i]) / d[i]))
        enter, leave = max(enter, a), min(leave, b)
    return (float(enter), float(leave)) if enter <= leave else None


def _quadratic(s: Array, d: Array, radius: float) -> tuple[float, float] | None:
    """Where |s + t d| <= radius."""
    a, b, c = float(matmul(d, d)), float(matmul(s, d)), float(matmul(s, s)) - radius**2
    if a < _PARALLEL:
        return (-np.inf, np.inf) if c <= 0.0 else None
    root = b * b - a * c
    if root < 0.0:
        return None
    half = float(np.sqrt(root))
    return (-b - half) / a, (-b + half) / a
