"""Detections placed in the world, and whether a picture would show a thing at a place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.finding.perception.localize import locate
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.phrases import normalize

# All our choice.
_SAME = 0.7  # detections by different phrases that overlap so far (intersection over union) are of one thing
_AS_GOOD = 0.7  # a phrase whose score is a smaller part of the best one's is not what the thing is
_EDGE_PX = 2  # a box that comes so near to the picture's edge is cut by it
_PLAIN_PX = 40  # a thing that covers fewer pixels may be overlooked
_IN_PICTURE = 0.8  # of it
_IN_SIGHT = 0.7  # of that
# What is so much nearer than a thing hides it, and more by so wide an angle, as joints and odometry are off.
_BEFORE_M, _OFF_RAD = 0.03, 0.01
_RAYS = 12  # across and down


@dataclass
class Looks:
    """How a thing was seen so far.

    Attributes:
        near_m: The shortest range that it was wholly seen from where it is; None if it was let go there, unseen.
        px_m3: Its pixels times the cube of its depth, in the look where that was most. The pixels of no thing become
            fewer faster than with that cube, which is how what lies flat on a floor shrinks.
    """

    near_m: float | None = None
    px_m3: float = 0.0


@dataclass(frozen=True, eq=False)
class LocatedDetection:
    """One detected thing, placed in the world.

    Attributes:
        phrases: That name it, normalized, the surest first.
        score: Of the surest.
        lowest, highest: (3,) corners of the box about what is seen of it, in the world [m].
        range_m: From the camera to the middle of that box.
        px_m3: How many pixels show it, times the cube of its depth.
        cut: Whether the picture's edge cuts it, so that there may be more of it.
    """

    phrases: tuple[str, ...]
    score: float
    lowest: Array
    highest: Array
    range_m: float
    px_m3: float
    cut: bool


def locate_detections(image: CameraImage, found: Sequence[Detection]) -> tuple[list[LocatedDetection], list[Detection]]:
    """Things with their places, and detections without a known place.

    Two detections by one phrase are always two things; detections by different phrases of the same pixels are one.
    The order is the same whatever the order of the detections.
    """
    groups: list[list[Detection]] = []
    for detection in sorted(found, key=_rank):
        phrase = normalize(detection.phrase)
        shares = [(_overlap(g[0], detection), g) for g in groups if phrase not in [normalize(d.phrase) for d in g]]
        share, group = max(shares, key=lambda pair: pair[0], default=(0.0, []))
        if share >= _SAME:
            group.append(detection)
        else:
            groups.append([detection])
    seen, unplaced = [], []
    for group in groups:
        best = group[0]
        place = locate(best, image)
        if place is None or not np.isfinite([place.lowest, place.highest]).all():
            unplaced += group
            continue
        names = tuple(normalize(d.phrase) for d in group if d.score >= _AS_GOOD * best.score)
        ahead = (place.lowest + place.highest) / 2 - image.T_world_camera[:3, 3]
        px_m3 = place.pixels * float(matmul(ahead, image.T_world_camera[:3, 2])) ** 3
        range_m, cut = float(norm(ahead)), _cut(best.box, image)
        seen.append(LocatedDetection(names, best.score, place.lowest, place.highest, range_m, px_m3, cut))
    return seen, unplaced


def shows(image: CameraImage, lowest: Array, highest: Array, looks: Looks) -> bool:
    """Whether a picture would show a thing that fills a box in the world: near enough, in view, nothing before it.

    Args:
        image: The picture.
        lowest, highest: (3,) corners of the box [m].
        looks: How the thing was seen so far: who saw it from a range need not see it from a longer one.
    """
    depth_m = float(matmul((lowest + highest) / 2 - image.T_world_camera[:3, 3], image.T_world_camera[:3, 2]))
    if depth_m <= 0 or looks.px_m3 < _PLAIN_PX * depth_m**3:
        return False
    if (pixels := _projected(image, lowest, highest)) is None:
        return False
    height, width = image.depth.shape
    low, high = np.clip(pixels, 0, [width, height])
    if np.prod(high - low) < _IN_PICTURE * np.prod(pixels[1] - pixels[0]):
        return False
    u, v = np.meshgrid(*(np.linspace(a, b, _RAYS + 2)[1:-1] for a, b in zip(low, high, strict=True)))
    K, T = image.K, image.T_world_camera
    rays = matmul(np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], -1), T[:3, :3].T)
    rays = np.where(np.abs(rays) < 1e-9, 1e-9, rays)  # a ray's z before the camera is 1: steps along it are depths
    ends = np.stack([(lowest - T[:3, 3]) / rays, (highest - T[:3, 3]) / rays])
    enter, leave = ends.min(0).max(-1), ends.max(0).min(-1)
    meets = enter <= leave
    depth = image.depth[np.minimum(v.astype(int), height - 1), np.minimum(u.astype(int), width - 1)]
    clear = (depth > 0) & (depth > enter - _BEFORE_M - _OFF_RAD * enter)
    return bool(meets.any() and clear[meets].mean() >= _IN_SIGHT)


def middle_in_sight(image: CameraImage, lowest: Array, highest: Array) -> bool:
    """Whether the middle of a box in the world is in a picture that measures nothing before the box there."""
    T = kin.inverse(image.T_world_camera)
    x, y, z = matmul(T[:3, :3], (lowest + highest) / 2) + T[:3, 3]
    if z < 0.05:
        return False
    u, v = image.K[0, 0] * x / z + image.K[0, 2], image.K[1, 1] * y / z + image.K[1, 2]
    height, width = image.depth.shape
    if not (0 <= u < width and 0 <= v < height):
        return False
    before = z - float(norm(highest - lowest)) / 2 - _BEFORE_M - _OFF_RAD * z
    return bool(image.depth[int(v), int(u)] > max(before, 0.0))


def covers(detection: Detection, image: CameraImage, lowest: Array, highest: Array) -> bool:
    """Whether the middle of a box in the world appears within the box of a detection."""
    pixels = _projected(image, lowest, highest)
    if pixels is None:
        return False
    middle = pixels.mean(0)
    return bool((middle >= detection.box[:2]).all() and (middle <= detection.box[2:]).all())


def _projected(image: CameraImage, lowest: Array, highest: Array) -> Array | None:
    """(2, 2) lowest and highest u, v [px] of a box in the world; None if any of it is beside or behind the camera."""
    corners = np.stack(np.meshgrid(*zip(lowest, highest, strict=True)), -1).reshape(-1, 3)
    T = kin.inverse(image.T_world_camera)
    p = matmul(corners, T[:3, :3].T) + T[:3, 3]
    if p[:, 2].min() < 0.05:
        return None
    uv = p[:, :2] / p[:, 2:] * [image.K[0, 0], image.K[1, 1]] + image.K[:2, 2]
    return np.stack([uv.min(0), uv.max(0)])


def _rank(detection: Detection) -> tuple[object, ...]:
    size = 0 if detection.mask is None else int(detection.mask.sum())
    return (-detection.score, normalize(detection.phrase), *np.asarray(detection.box).tolist(), size)


def _overlap(a: Detection, b: Detection) -> float:
    """Intersection over union, of masks if both have one."""
    low, high = np.maximum(a.box[:2], b.box[:2]), np.minimum(a.box[2:], b.box[2:])
    if (high <= low).any():
        return 0.0
    if a.mask is not None and b.mask is not None:
        return float((a.mask & b.mask).sum() / max(int((a.mask | b.mask).sum()), 1))
    both = float(np.prod(high - low))
    return both / (float(np.prod(a.box[2:] - a.box[:2]) + np.prod(b.box[2:] - b.box[:2])) - both)


def _cut(box: NDArray[np.intp], image: CameraImage) -> bool:
    height, width = image.depth.shape
    return bool((box[:2] < _EDGE_PX).any() or (box[2:] > np.array([width, height]) - _EDGE_PX).any())
