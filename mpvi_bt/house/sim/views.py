"""Camera poses from which a house looks well. Optical frames: x right, y down, z forward."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.layout.house import House


def look_at(eye: Array | tuple[float, float, float], target: Array | tuple[float, float, float]) -> Array:
    """(4, 4) camera at `eye` that looks at `target` [m], optical frame to world, upright; straight down is allowed."""
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    forward = (target - eye) / norm(target - eye)
    up = np.array([0.0, 0, 1]) if abs(forward[2]) < 0.999 else np.array([0.0, 1, 0])
    right = np.cross(forward, up)
    right /= norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = eye
    return T


def overview(house: House, fov_rad: float = 0.6, aspect: float = 16 / 9, tilt_rad: float = 0.35) -> Array:
    """(4, 4) camera high over the south side that sees the whole house, garden included.

    It is the nearest one of that tilt whose picture holds the house up to the top of its walls.

    Args:
        fov_rad: Vertical field of view.
        aspect: Width over height of the picture.
        tilt_rad: How far it leans from straight down.
    """
    x0, y0, x1, y1 = house.bounds()
    corners = np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (0.0, 2.2)])
    away = np.array([0.0, -np.sin(tilt_rad), np.cos(tilt_rad)])
    limits = np.array([aspect, 1.0]) * np.tan(fov_rad / 2) / 1.03
    low, high = y0 - (y1 - y0), y1 + (y1 - y0)
    for _ in range(40):  # bisect for the target that leaves as much room above as below
        target = np.array([(x0 + x1) / 2, (low + high) / 2, 0.0])
        right, down, forward = look_at(target + away, target)[:3, :3].T
        seen = corners - target
        ahead = matmul(seen, forward)
        wide = float((np.abs(matmul(seen, right)) / limits[0] - ahead).max())
        below, above = ((sign * matmul(seen, down) / limits[1] - ahead).max() for sign in (1, -1))
        distance = max(wide, float(below), float(above))
        down_px, up_px = ((sign * matmul(seen, down) / (distance + ahead)).max() for sign in (1, -1))
        low, high = (low, target[1]) if down_px > up_px else (target[1], high)
    return look_at(target + distance * away, target)
