"""Pixel to world: by mask, by box, and where depth is wrong or missing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.finding.perception.localize import locate, pixels
from mpvi_bt.ground.errors import DetectorError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from tests.depth_pictures import Box, picture

THING: Box = ((1.9, -0.1, 0.8), (2.1, 0.1, 1.1))  # before the robot, 20 cm wide and deep, 30 cm high
POSE = (0.0, 0.0, 0.0)


def mask_of(image: CameraImage, box: Box) -> NDArray[np.bool_]:
    points = image.points_world()
    with np.errstate(invalid="ignore"):
        return np.asarray(((points > np.array(box[0]) - 1e-3) & (points < np.array(box[1]) + 1e-3)).all(-1))


def found(mask: NDArray[np.bool_], masked: bool = True) -> Detection:
    rows, columns = np.nonzero(mask)
    box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
    return Detection("box", 1.0, box, mask if masked else None)


def center(box: Box) -> Array:
    return np.mean(box, axis=0)


@given(st.floats(1.2, 4.0), st.floats(-0.3, 0.3), st.floats(0.3, 1.2), st.floats(0.1, 0.4), st.floats(-3.1, 3.1))
def test_a_mask_is_located_within_half_its_thickness(x: float, y: float, z: float, size: float, yaw: float) -> None:
    """From any pose: the extent is that of the faces that are seen, to a pixel or two."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    low = np.array([x, y * x, z])
    image = picture(POSE, [(tuple(low), tuple(low + size))])
    mask = mask_of(image, (tuple(low), tuple(low + size)))
    if mask.sum() < 60:
        return
    T = np.eye(4)
    T[:3, :3] = turn
    where = locate(found(mask), replace(image, T_world_camera=T @ image.T_world_camera))
    assert where is not None
    corners = np.array([turn @ (low + size * np.array(c)) for c in np.ndindex(2, 2, 2)])
    pixel = 2.5 * float(np.linalg.norm(low)) / image.K[0, 0]
    assert (where.lowest > corners.min(0) - pixel).all()
    assert (where.highest < corners.max(0) + pixel).all()
    assert np.linalg.norm(where.center - turn @ (low + size / 2)) < size * np.sqrt(3) / 2 + pixel
    assert where.pixels == mask.sum()


def test_a_box_is_located_by_its_center_at_the_median_depth() -> None:
    """As the paper has it (Navigation appendix); its extent holds the center and is about that of the thing."""
    image = picture(POSE, [THING])
    detection = found(mask_of(image, THING), masked=False)
    left, top, right, bottom = detection.box
    z = float(np.median(image.depth[top:bottom, left:right]))
    u, v = (left + right) / 2, (top + bottom) / 2
    p = np.array([(u - image.K[0, 2]) / image.K[0, 0] * z, (v - image.K[1, 2]) / image.K[1, 1] * z, z, 1.0])
    where = locate(detection, image)
    assert where is not None
    np.testing.assert_allclose(where.center, (image.T_world_camera @ p)[:3])
    assert np.linalg.norm(where.center - center(THING)) < 0.15
    assert (where.lowest <= where.center).all()
    assert (where.center <= where.highest).all()
    assert np.abs(np.stack([where.lowest, where.highest]) - THING).max() < 0.2


@pytest.mark.parametrize("masked", [True, False])
def test_what_lies_behind_does_not_count(masked: bool) -> None:
    """A mask whose edge is two pixels off, and a box, hold a part of the wall behind."""
    wall: Box = ((4.0, -3.0, 0.0), (4.1, 3.0, 2.5))
    image = picture(POSE, [THING, wall])
    shifted = np.roll(mask_of(image, THING), (2, 2), (0, 1))
    where = locate(found(shifted, masked), image)
    assert where is not None
    assert np.linalg.norm(where.center - center(THING)) < 0.15
    assert where.highest[0] < 2.3


def test_a_thing_that_is_all_rim_is_located_all_the_same() -> None:
    """A pole that is two pixels wide, from top to bottom."""
    pole: Box = ((2.0, -0.01, 0.1), (2.02, 0.01, 1.6))
    image = picture(POSE, [pole, ((5.0, -3.0, 0.0), (5.1, 3.0, 2.5))])
    where = locate(found(mask_of(image, pole)), image)
    assert where is not None
    assert np.ptp([where.lowest, where.highest], axis=0)[2] > 1.2
    assert np.linalg.norm(where.center[:2] - [2.0, 0.0]) < 0.02


def test_a_long_thing_seen_at_a_slant_stays_whole() -> None:
    """Depth that grows from row to row is no edge: a table is as long as it is, to two rows of pixels."""
    table: Box = ((1.2, -0.4, 0.7), (3.2, 0.4, 0.75))
    image = picture(POSE, [table])
    where = locate(found(mask_of(image, table)), image)
    assert where is not None
    assert where.lowest[0] < 1.35
    assert where.highest[0] > 3.0


@pytest.mark.parametrize("masked", [True, False])
@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, -np.inf, 1e30])
def test_depth_that_is_none_does_not_count(bad: float, masked: bool) -> None:
    """Where half of the pixels have a depth they say it alone; where none has, nobody does."""
    image = picture(POSE, [THING])
    detection = found(mask_of(image, THING), masked)
    rows = slice(detection.box[1], detection.box[3])
    holes = image.depth.copy()
    holes[rows, ::2] = bad
    half, whole = locate(detection, replace(image, depth=holes)), locate(detection, image)
    assert half is not None
    assert whole is not None
    assert half.pixels < whole.pixels
    assert np.abs(np.stack([half.lowest - whole.lowest, half.highest - whole.highest])).max() < 0.03
    holes[:] = bad
    assert locate(detection, replace(image, depth=holes)) is None
    assert pixels(found(mask_of(image, THING), masked=False), replace(image, depth=holes)).sum() == 0


def test_a_picture_from_nowhere_locates_nothing() -> None:
    """A camera pose that is not finite."""
    image = picture(POSE, [THING])
    nowhere = replace(image, T_world_camera=np.full((4, 4), np.nan))
    assert locate(found(mask_of(image, THING)), nowhere) is None
    assert locate(found(mask_of(image, THING), masked=False), nowhere) is None


def test_a_box_is_cut_at_the_edge_of_the_picture() -> None:
    """What is outside counts for nothing, neither for the depth nor for the center."""
    image = picture(POSE, [((1.5, -3.0, 0.0), (1.6, 3.0, 3.0))])
    height = image.depth.shape[0]
    inside = locate(Detection("wall", 1.0, np.array([0, 0, 40, height])), image)
    over = locate(Detection("wall", 1.0, np.array([-60, -9, 40, height + 70])), image)
    assert inside is not None
    assert over is not None
    np.testing.assert_allclose(inside.center, over.center)


@pytest.mark.parametrize(
    "box", [[-9, 0, 0, 5], [5000, 0, 5010, 5], [0, -9, 4, 0], [4, 4, 4, 8], [8, 4, 4, 8], [0, 0, np.nan, 4], [0, 0, 4]]
)
def test_a_box_out_of_the_picture_is_refused(box: list[float]) -> None:
    """With a reason, as is one that is empty or no box at all."""
    given: Any = np.array(box)
    with pytest.raises(DetectorError) as caught:
        locate(Detection("cup", 1.0, given), picture(POSE))
    assert caught.value.reason == "bad_box"
    assert "'cup'" in str(caught.value)


def test_a_mask_of_another_picture_is_refused() -> None:
    """Its size gives it away."""
    with pytest.raises(DetectorError) as caught:
        locate(Detection("cup", 1.0, np.array([0, 0, 4, 4]), np.ones((4, 4), bool)), picture(POSE))
    assert caught.value.reason == "bad_mask"


def test_the_pixels_of_a_box_are_those_of_the_thing() -> None:
    """Most of what is in the box and not of the wall behind; a mask is taken as it is."""
    image = picture(POSE, [THING, ((4.0, -3.0, 0.0), (4.1, 3.0, 2.5))])
    mask = mask_of(image, THING)
    grown = found(mask, masked=False)
    wide = Detection("box", 1.0, grown.box + np.array([-3, -3, 3, 3]))
    own = pixels(wide, image)
    assert (own & mask).sum() / (own | mask).sum() > 0.95
    np.testing.assert_array_equal(pixels(found(mask), image), mask)
