"""What pictures are taken to show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.frames import take
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES, CameraImage, Proprioception
from mpvi_bt.hands.robots import r1

THING = np.s_[20:40, 30:50]
SHIFT_PX = 1
AT_REST = Proprioception(
    np.zeros(3), np.zeros(3), r1.TRAVEL_TORSO, r1.TRAVEL_ARM, {s: np.zeros(7) for s in SIDES},
    dict.fromkeys(SIDES, 0.1), dict.fromkeys(SIDES, 1.0),
)  # fmt: skip


def mask_of(depth: Array) -> NDArray[np.bool_]:
    """The mask of a thing at `THING`, of a detector whose masks lie one pixel to the right."""
    labels = np.zeros(depth.shape, np.int32)
    labels[THING] = 1
    labels = np.roll(labels, SHIFT_PX, axis=1)
    K = np.array([[175.0, 0, 40], [0, 175.0, 30], [0, 0, 1]])
    rgb = np.zeros((*depth.shape, 3), np.uint8)
    image = CameraImage("head", rgb, depth.astype(np.float32), labels, {1: "book"}, K, np.eye(4))
    detector = SegmentationDetector({"book": ("book",)}, least_px=1)
    (shown,) = take(image, AT_REST, detector, ["book"], 0, 0.0).detections
    return shown.mask


def test_what_a_mask_catches_of_a_wall_behind_is_no_part_of_a_thing() -> None:
    """A book stands four centimeters before a wall: of a mask that is off by a pixel only the book is left."""
    depth = np.full((60, 80), 1.04)
    depth[THING] = 1.0
    mask = mask_of(depth)
    assert not mask[:, 50:].any()
    assert mask[20:40, 31:50].all()


def test_a_face_that_is_seen_at_a_slant_stays_whole() -> None:
    """The rows of a face that is seen at a slant lie apart, but belong to it."""
    rows = 1.0 + np.arange(60)[::-1, None] * 0.01
    assert mask_of(np.broadcast_to(rows, (60, 80)).copy()).sum() == 400
