"""Names of things on a picture of a house."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.recording.labels import Labels, Picture, Rectangle

_SIZE = 0.36  # of letters, as OpenCV counts it: the smallest that is read well
_INK, _PAPER = (24, 26, 32), (255, 255, 255)


def name_things(
    picture: Picture, T_world_camera: Array, fov_rad: float, things: Iterable[tuple[str, Array]]
) -> list[Rectangle]:
    """Write each thing's name at its place; a name that would cover another is left out.

    Args:
        picture: (H, W, 3) RGB, written on in place.
        T_world_camera: (4, 4) optical frame to world.
        fov_rad: Vertical field of view.
        things: What each is called and the (n, 3) corners that it lies between [m], the most important first.

    Returns:
        Where names stand.
    """
    labels = Labels(picture, _SIZE)
    height, width = picture.shape[:2]
    focal_px = height / 2 / np.tan(fov_rad / 2)
    for name, corners in things:
        low, high = corners.min(0), corners.max(0)
        top = np.array([*(low + high)[:2] / 2, high[2]])
        x, y, z = matmul(T_world_camera[:3, :3].T, top - T_world_camera[:3, 3])
        if z <= 0:
            continue
        u, v = round(width / 2 + focal_px * x / z), round(height / 2 + focal_px * y / z)
        (wide, tall), below = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, _SIZE, 1)
        labels.beside((u - wide // 2, v + (tall + below) // 2, u, v + (tall + below) // 2), name, _INK, _PAPER)
    return labels.taken
