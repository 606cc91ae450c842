"""Crops around segments: what a second look at a movable thing is given to tell its kind by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.eyes.inputs import Planes
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.solids import Array

CROP_PX = 40
CROP_CHANNELS = 8
NUMBERS = 10
# All our choice.
_MARGIN, _MARGIN_PX = 1.25, 4.0  # a crop's side for that of what is seen of the thing
_RELIEF_M = 0.1
_MOST = 3.0


@dataclass(frozen=True, eq=False)
class Crops:
    """Crops of one picture, or of several.

    Attributes:
        planes: (n, CROP_PX, CROP_PX, CROP_CHANNELS) float32: colors; height and depth against the thing's own; how
            level; whether there is depth; the mask.
        numbers: (n, NUMBERS) float32: sizes in meters and pixels, height, how level, how much of its box it fills,
            whether the picture cuts it, how far, the camera's pitch.
    """

    planes: NDArray[np.float32]
    numbers: NDArray[np.float32]


def crops_of(inputs: Planes, depth: NDArray[np.float32], masks: NDArray[np.int32], count: int, K: Array,
             T_world_camera: Array) -> Crops:  # fmt: skip
    """Crops around segments.

    Args:
        inputs: (H, W, CHANNELS) of the picture.
        depth: (H, W) [m].
        masks: (H, W) 0 for none, else the number of a segment, counted from 1; each has pixels.
        count: How many segments.
        K: (3, 3) [px].
        T_world_camera: (4, 4).
    """
    planes = np.zeros((count, CROP_PX, CROP_PX, CROP_CHANNELS), np.float32)
    numbers = np.zeros((count, NUMBERS), np.float32)
    lens = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]], np.float64)
    _crop(inputs, np.ascontiguousarray(depth, np.float32), np.ascontiguousarray(masks, np.int32), lens,
          np.ascontiguousarray(T_world_camera[2], np.float64), planes, numbers)  # fmt: skip
    return Crops(planes, numbers)


def _loops(
    inputs: Planes, depth: NDArray[np.float32], masks: NDArray[np.int32], lens: NDArray[np.float64],
    up: NDArray[np.float64], planes: Planes, numbers: Planes,
) -> None:  # fmt: skip
    """As `crops_of`, into `planes` and `numbers`."""
    h, w = depth.shape
    n = len(planes)
    box = np.zeros((n, 4), np.int64)  # left, top, right, bottom
    box[:, :2] = 1 << 30
    sums = np.zeros((n, 5))  # pixels, pixels with depth, height, depth, level
    for i in range(h):
        for j in range(w):
            k = masks[i, j] - 1
            if k < 0 or k >= n:
                continue
            box[k, 0], box[k, 1] = min(box[k, 0], j), min(box[k, 1], i)
            box[k, 2], box[k, 3] = max(box[k, 2], j + 1), max(box[k, 3], i + 1)
            sums[k, 0] += 1
            d = depth[i, j]
            if d > 0:
                x, y = (j + 0.5 - lens[2]) / lens[0], (i + 0.5 - lens[3]) / lens[1]
                sums[k, 1] += 1
                sums[k, 2] += d * (up[0] * x + up[1] * y + up[2]) + up[3]
                sums[k, 3] += d
                sums[k, 4] += inputs[i, j, 9]
    for k in range(n):
        wide, tall = box[k, 2] - box[k, 0], box[k, 3] - box[k, 1]
        seen = max(sums[k, 1], 1.0)
        height, d0, level = sums[k, 2] / seen, sums[k, 3] / seen, sums[k, 4] / seen
        side = max(wide, tall) * _MARGIN + _MARGIN_PX
        left, top = (box[k, 0] + box[k, 2] - side) / 2, (box[k, 1] + box[k, 3] - side) / 2
        step = side / CROP_PX
        for a in range(CROP_PX):
            i = int(np.floor(top + (a + 0.5) * step))
            if i < 0 or i >= h:
                continue
            y = (i + 0.5 - lens[3]) / lens[1]
            for b in range(CROP_PX):
                j = int(np.floor(left + (b + 0.5) * step))
                if j < 0 or j >= w:
                    continue
                for c in range(3):
                    planes[k, a, b, c] = inputs[i, j, c]
                d = depth[i, j]
                if d > 0:
                    x = (j + 0.5 - lens[2]) / lens[0]
                    z = d * (up[0] * x + up[1] * y + up[2]) + up[3]
                    planes[k, a, b, 3] = min(max((z - height) / _RELIEF_M, -_MOST), _MOST)
                    planes[k, a, b, 4] = min(max((d - d0) / _RELIEF_M, -_MOST), _MOST)
                    planes[k, a, b, 5] = inputs[i, j, 9]
                    planes[k, a, b, 6] = 1.0
                planes[k, a, b, 7] = 1.0 if masks[i, j] == k + 1 else 0.0
        pixel = max(d0, 0.02) / lens[0]
        numbers[k, 0] = np.log(side * pixel / 0.15)
        numbers[k, 1] = np.log(max(wide, 1) * pixel / 0.1)
        numbers[k, 2] = np.log(max(tall, 1) * pixel / 0.1)
        numbers[k, 3] = np.log(max(sums[k, 0], 1.0) / 300)
        numbers[k, 4] = min(max(height, -1.0), 3.0) - 1
        numbers[k, 5] = level
        numbers[k, 6] = sums[k, 0] / max(wide * tall, 1) - 0.6
        numbers[k, 7] = 1.0 if box[k, 0] == 0 or box[k, 1] == 0 or box[k, 2] == w or box[k, 3] == h else 0.0
        numbers[k, 8] = np.log(max(d0, 0.05))
        numbers[k, 9] = up[2]


_crop = compiled_later(_loops)
