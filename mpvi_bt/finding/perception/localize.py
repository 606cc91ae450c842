"""Places of detections in the world (Paper, Navigation appendix)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.ground.errors import DetectorError, shown
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage

_FARTHEST_M = 1000.0  # what is farther was not measured
_EXTENT = (1.0, 99.0)  # percentiles: single pixels are often wrong
# Our choice: where the depths of a thing's pixels, in order, have a gap of so much, there is an edge between them. Rows
# of a surface seen at a slant lie farther apart the farther away it is.
_STEP_M, _STEP_PER_M2 = 0.15, 0.01
_RIM_PX, _INNER_PX, _RIM_M = 2, 4, 0.05  # how wide a rim is; what is less is not called inner; its step to inner pixels


@dataclass(frozen=True, eq=False)
class Located:
    """The place of a detection, by its visible part only.

    Attributes:
        center: (3,) its middle in the world [m].
        lowest, highest: (3,) corners of its axis-aligned bounding box in the world [m].
        pixels: How many of its pixels have a depth.
    """

    center: Array
    lowest: Array
    highest: Array
    pixels: int


def locate(detection: Detection, image: CameraImage) -> Located | None:
    """The place of a detection in the world, or None if its pixels have no depth.

    By its mask where there is one: the extent of its pixels, without what its rim caught of other things and what lies
    behind an edge in depth. Else the center of the box at the median depth in the box (Paper, Navigation appendix); the
    extent is that of its `pixels`.

    Raises:
        DetectorError: The mask is not of this picture's size, or the box is not four numbers, or out of the picture.
    """
    own = pixels(detection, image) & measured(image)
    count = int(own.sum())
    if not count:
        return None
    rows, columns = np.nonzero(own if detection.mask is None else _without_rim(detection.mask, own, image))
    u, v, z = columns + 0.5, rows + 0.5, image.depth[rows, columns].astype(float)
    if detection.mask is not None:
        same = _largest_surface(z)
        u, v, z = u[same], v[same], z[same]
    points = in_world(image, u, v, z)
    lowest, highest = percentile(points, _EXTENT)
    center = (lowest + highest) / 2
    if detection.mask is None:
        left, top, right, bottom = _within(detection, image)
        depth = np.array([_median_depth((left, top, right, bottom), image)])
        center = in_world(image, np.array([(left + right) / 2]), np.array([(top + bottom) / 2]), depth)[0]
        lowest, highest = np.minimum(lowest, center), np.maximum(highest, center)
    return Located(center, lowest, highest, count) if np.isfinite([lowest, highest]).all() else None


def pixels(detection: Detection, image: CameraImage) -> NDArray[np.bool_]:
    """(H, W) bool: the mask of a detection; of a mere box, the pixels in it at about the median depth in it.

    Our choice: as near to it as half the larger side of the box; things are about as deep as they are wide or high.

    Raises:
        DetectorError: The mask is not of this picture's size, or the box is not four numbers, or out of the picture.
    """
    if detection.mask is not None:
        if detection.mask.shape != image.depth.shape:
            sizes = f"{detection.mask.shape}, the picture is {image.depth.shape}"
            raise DetectorError("bad_mask", f"the mask of {shown(detection.phrase)} is {sizes}")
        return detection.mask
    left, top, right, bottom = box = _within(detection, image)
    own = np.zeros(image.depth.shape, bool)
    depth = _median_depth(box, image)
    if depth is not None:
        half_m = max((right - left) / image.K[0, 0], (bottom - top) / image.K[1, 1]) * depth / 2
        own[top:bottom, left:right] = np.abs(image.depth[top:bottom, left:right] - depth) <= half_m
    return own & measured(image)


def measured(image: CameraImage) -> NDArray[np.bool_]:
    """(H, W) bool: the pixels with a valid depth. 0, negative, nan and infinite depths are not valid."""
    return np.asarray((image.depth > 0) & (image.depth < _FARTHEST_M))


def _within(detection: Detection, image: CameraImage) -> tuple[int, int, int, int]:
    """The part of a box that is in the picture: left, top, right, bottom [px]."""
    box, (height, width) = np.asarray(detection.box, float), image.depth.shape
    if box.shape != (4,) or not np.isfinite(box).all():
        raise DetectorError(
            "bad_box", f"the box of {shown(detection.phrase)} is {detection.box!r:.60}, not four numbers"
        )
    left, top = max(0, int(np.floor(box[0]))), max(0, int(np.floor(box[1])))
    right, bottom = min(width, int(np.ceil(box[2]))), min(height, int(np.ceil(box[3])))
    if left >= right or top >= bottom:
        raise DetectorError(
            "bad_box", f"the box of {shown(detection.phrase)}, {box.tolist()}, is out of the {width}x{height} picture"
        )
    return left, top, right, bottom


def _median_depth(box: tuple[int, int, int, int], image: CameraImage) -> float | None:
    """Median of the depths in a box [m]; None where nothing was measured."""
    window = slice(box[1], box[3]), slice(box[0], box[2])
    depth = image.depth[window][measured(image)[window]]
    return float(np.median(depth)) if len(depth) else None


def _without_rim(mask: NDArray[np.bool_], own: NDArray[np.bool_], image: CameraImage) -> NDArray[np.bool_]:
    """(H, W) bool: its own measured pixels, those of the mask's rim only if they are about as far as what is within.

    Our choice, measured (docs/detectors.md): masks are off by a pixel or two, and what they catch there of the
    background made small things reach meters far. Of what is too thin to have anything within all pixels count.
    """
    window = tuple(slice(at[0], at[-1] + 1) for axis in (1, 0) for at in [np.flatnonzero(own.any(axis))])
    inside = own[window]
    z = np.where(inside, image.depth[window], 0.0).astype(float)
    for rim_px in range(_RIM_PX, 0, -1):
        inner = inside & ndimage.binary_erosion(mask[window], np.ones((3, 3)), iterations=rim_px)
        if inner.sum() >= _INNER_PX:
            near = {"size": 2 * rim_px + 1, "mode": "constant"}
            nearest = ndimage.minimum_filter(np.where(inner, z, np.inf), cval=np.inf, **near)
            farthest = ndimage.maximum_filter(np.where(inner, z, -np.inf), cval=-np.inf, **near)
            step = _RIM_M + _STEP_PER_M2 * z**2
            kept = np.zeros_like(own)
            kept[window] = inside & (z >= nearest - step) & (z <= farthest + step)
            return kept
    return own


def _largest_surface(z: Array) -> NDArray[np.bool_]:
    """(n,) bool: of depths (n,), those of the largest group without an edge between them."""
    order = np.argsort(z)
    ordered = z[order]
    edges = np.diff(ordered) > _STEP_M + _STEP_PER_M2 * ordered[:-1] ** 2
    group = np.concatenate([[0], np.cumsum(edges)])
    same = np.zeros(len(z), bool)
    same[order] = group == np.bincount(group).argmax()
    return same


def in_world(image: CameraImage, u: NDArray[Any], v: NDArray[Any], z: Array) -> Array:
    """(n, 3) world positions of points of the picture (n,) [px] at depths (n,) [m]."""
    p = np.stack([(u - image.K[0, 2]) / image.K[0, 0] * z, (v - image.K[1, 2]) / image.K[1, 1] * z, z], -1)
    return matmul(p, image.T_world_camera[:3, :3].T) + image.T_world_camera[:3, 3]
