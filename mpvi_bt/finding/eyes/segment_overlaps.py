"""Segments beside what the renderer labels: how much they share, and which are right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.eyes.picture_file import LabeledPicture
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage

OVERLAP = 0.5  # of the union, that a segment shares with a thing of its kind; as usual for detectors


def overlaps(labels: NDArray[np.int32], count: int, truth: NDArray[np.uint8], things: int) -> Array:
    """(count, things) the part of their union that segments and things share, both counted from 1 in their images."""
    pairs = labels.astype(np.int64) * (things + 1) + truth
    both = np.bincount(pairs.ravel(), minlength=(count + 1) * (things + 1)).reshape(count + 1, things + 1)
    area, true_area = both.sum(1)[1:], both.sum(0)[1:]
    both = both[1:, 1:]
    return np.asarray(both / np.maximum(area[:, None] + true_area[None] - both, 1))


def right_ones(labels: NDArray[np.int32], kinds: Sequence[str], picture: LabeledPicture) -> NDArray[np.bool_]:
    """(N,) whether each segment shares enough with a thing of its kind."""
    shared = overlaps(labels, len(kinds), picture.labels, len(picture.kinds))
    alike = np.array(kinds)[:, None] == np.array(picture.kinds)[None] if kinds and picture.kinds else False
    return np.asarray(((shared >= OVERLAP) & alike).any(1))


def without_labels(picture: LabeledPicture) -> CameraImage:
    """What a camera would give."""
    return CameraImage(picture.camera, picture.rgb, picture.depth, None, {}, picture.K, picture.T_world_camera)
