"""The field of what has not been seen to be free, from depth pictures."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from mpvi_bt.finding.scene.field import CELL_M, Field, FineField, View, distance_to
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.protocol import CameraImage

SIZE = (120, 160)
K = np.array([[130.0, 0, 80], [0, 130.0, 60], [0, 0, 1]])
# A camera 1 m up at the origin that looks along +x: optical z to the front, x to the right, y down.
FORWARD = kin.transform(kin.LINK_TO_OPTICAL, (0.0, 0.0, 1.0))


def picture(depth: Array, T: Array = FORWARD, through: NDArray[np.bool_] | None = None) -> View:
    image = CameraImage("head", np.zeros((*SIZE, 3), np.uint8), depth.astype(np.float32), None, {}, K, T)
    return View(image, np.zeros(SIZE, bool) if through is None else through)


def wall(distance: float) -> Array:
    return np.full(SIZE, distance)


MIDDLE = np.array([1.0, 0.0])


def at(field: Field, *p: float) -> float:
    return float(field.distance(np.array(p)))


def test_what_is_before_a_surface_is_free_and_what_is_behind_it_is_not() -> None:
    """Before a wall at 1 m there is room up to the wall; behind it all counts as solid."""
    field = Field([picture(wall(1.0))], MIDDLE)
    assert at(field, 0.5, 0, 1) == pytest.approx(0.5, abs=2 * CELL_M)
    assert at(field, 1.02, 0, 1) == 0.0
    assert at(field, 1.5, 0, 1) == 0.0


def test_another_view_may_free_what_one_hides() -> None:
    """A cell hidden in one picture and seen to be free in another is free, in whichever order they come."""
    beyond = pose((2.5, 0.0, 0.0), np.pi) @ FORWARD  # looks back from behind the wall
    views = [picture(wall(1.0)), picture(wall(1.4), beyond)]
    for order in (views, views[::-1]):
        field = Field(order, MIDDLE)
        assert at(field, 1.8, 0, 1) > 0.2
        assert at(field, 1.05, 0, 1) < 2 * CELL_M


def test_what_was_seen_before_counts_where_nothing_is_in_view() -> None:
    """An earlier picture's wall stands where no later one looks; what a later one sees to be free is free."""
    behind = pose((0.0, 0.0, 0.0), np.pi) @ FORWARD
    earlier, now = picture(wall(1.0)), picture(wall(1.0), behind)
    for thick in (0.04, 9.0):
        field = Field([now], np.zeros(2), thick_m=thick, before=[earlier])
        assert at(field, 1.03, 0, 1) == 0.0
        assert at(field, -1.03, 0, 1) == 0.0
        assert at(field, 1.5, 0, 1) > 0.2  # that it hid something then is no reason to fear it now
    assert at(Field([picture(wall(1.5))], np.zeros(2), before=[earlier]), 1.03, 0, 1) > 0.2


def test_what_nobody_looked_at_is_taken_for_free() -> None:
    """Behind the camera and outside of the field there is nothing in the way."""
    field = Field([picture(wall(0.6))], MIDDLE)
    assert at(field, -0.3, 0, 1) > 0.3
    assert at(field, 40.0, 0, 1) == 9.0
    assert at(Field([], MIDDLE), 1, 0, 1) == 9.0


def test_pixels_to_look_through_tell_nothing_of_what_is_behind() -> None:
    """Behind the robot's own arm nothing is blocked; before it is free all the same. A hole tells nothing at all."""
    every = np.ones(SIZE, bool)
    field = Field([picture(wall(0.5), through=every)], MIDDLE)
    assert at(field, 0.8, 0, 1) == 9.0
    both = Field([picture(wall(0.4)), picture(wall(1.2), through=every)], MIDDLE)
    assert at(both, 0.8, 0, 1) > 0.2
    assert at(Field([picture(wall(0.0))], MIDDLE), 0.8, 0, 1) == 9.0


def test_it_turns_with_the_frame_that_it_is_seen_from() -> None:
    """The distance of a point is the same in whichever frame point and field are given."""
    field = Field([picture(wall(1.0))], MIDDLE)
    T = pose((0.3, -0.2, 0.0), 0.7)
    rng = np.random.default_rng(0)
    p = rng.uniform([-0.3, -1, 0.1], [1.5, 1, 1.7], (200, 3))
    seen = (p - T[:3, 3]) @ T[:3, :3]
    np.testing.assert_allclose(field.seen_from(T).distance(seen), field.distance(p), atol=CELL_M)
    np.testing.assert_array_equal(field.distance(p.reshape(10, 20, 3)).ravel(), field.distance(p))


def test_distances_are_those_of_an_exact_transform() -> None:
    """The compiled transform agrees with scipy's on random cells."""
    rng = np.random.default_rng(1)
    for share in (0.001, 0.02, 0.5):
        blocked = rng.random((31, 17, 23)) < share
        blocked[3, 4, 5] = True
        np.testing.assert_allclose(distance_to(blocked), distance_transform_edt(~blocked), rtol=1e-5)
        np.testing.assert_allclose(distance_to(blocked[3]), distance_transform_edt(~blocked[3]), rtol=1e-5)
    assert (distance_to(np.zeros((5, 6, 7), bool)) > 900).all()


def test_a_finer_field_can_only_add_room_and_only_within_itself() -> None:
    """The larger distance counts; the finer field's no farther than its border, and what is outside is the other's."""
    coarse = Field([picture(wall(1.0))], MIDDLE)
    fine = Field([picture(wall(1.0))], np.array([0.9, 0.0, 1.0]), (0.4, 0.4, 0.4), 0.01, 0.005)
    p = np.random.default_rng(0).uniform([0.3, -0.6, 0.4], [1.2, 0.6, 1.6], (500, 3))
    border = 0.2 - np.abs(p - [0.9, 0.0, 1.0]).max(1)
    known = np.where(border > 0, np.minimum(fine.distance(p), border), 0.0)
    both = FineField(coarse, fine).distance(p)
    np.testing.assert_allclose(both, np.maximum(coarse.distance(p), known), atol=1e-12)
    assert (both > coarse.distance(p)).any()
    aside = p[border <= 0]
    np.testing.assert_array_equal(FineField(coarse, fine).distance(aside), coarse.distance(aside))
