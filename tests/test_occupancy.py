"""Laws of what depth pictures do to the map that the base drives by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.finding.navigation.frontiers import frontier
from mpvi_bt.finding.scene.occupancy import Occupancy
from mpvi_bt.ground.geometry import kinematics as kin
from tests.depth_pictures import Box, picture, walls
from tests.navigation_maps import two_rooms

SEEDS = st.integers(0, 2**32 - 1)
CRATE: Box = ((2.0, 1.8, 0.0), (2.3, 2.2, 0.4))
POSE = (0.7, 2.0, 0.0)


def box_cells(occupancy: Occupancy, box: Box) -> np.ndarray:
    """(H, W) bool: cells whose center is under a box."""
    rows, columns = np.indices(occupancy.known.shape)
    x = occupancy.map.origin_m[0] + (columns + 0.5) * occupancy.map.resolution_m
    y = occupancy.map.origin_m[1] + (rows + 0.5) * occupancy.map.resolution_m
    return (x > box[0][0]) & (x < box[1][0]) & (y > box[0][1]) & (y < box[1][1])


def test_a_thing_that_the_map_lacks_is_added_where_it_is() -> None:
    """Cells of a crate that the picture shows become occupied, and none farther than a cell from it."""
    house = two_rooms()
    occupancy = Occupancy.prior(house)
    assert occupancy.update(picture(POSE, [*walls(house), CRATE]))
    new = occupancy.map.occupied & ~house.occupied
    grown = ((1.94, 1.74, 0), (2.36, 2.26, 0))
    assert new[box_cells(occupancy, CRATE)].mean() > 0.9  # seen from above
    assert not new[~box_cells(occupancy, grown)].any()
    assert occupancy.known.all()
    assert not house.occupied[house.cell((2.1, 2.0))], "the given map is not written to"


def test_what_a_picture_shows_stands_as_high_as_it_was_seen_and_nowhere_beside() -> None:
    """A crate stands from the floor to its top; floor that was seen, and what was not, is as empty as what is off it.

    With a prior map its walls stand, too, though no picture tells how high they are.
    """
    house, heights = two_rooms(), np.array([0.02, 0.2, 0.38, 0.5])
    for occupancy in (Occupancy.unknown(POSE[:2]), Occupancy.prior(house)):
        occupancy.update(picture(POSE, [*walls(house), CRATE]))
        stands = occupancy.standing(np.array([1.5, 2.12, 3.0, 99.0]), np.array([2.0, -99.0]), heights)
        assert stands.shape == (4, 2, 4)
        assert stands[1, 0].tolist() == [True, True, True, False]
        assert stands.sum() == 3
    row, column = np.argwhere(house.occupied)[0]
    x, y = house.center(row, column)
    for occupancy, known in ((Occupancy.prior(house), True), (Occupancy.unknown(POSE[:2]), False)):
        assert occupancy.standing(np.array([x]), np.array([y]), heights)[0, 0].tolist() == [known, known, False, False]


def test_a_house_as_mapped_changes_nothing() -> None:
    """With a prior map and nothing else in the house no picture changes the map."""
    house = two_rooms()
    occupancy = Occupancy.prior(house)
    for yaw in np.arange(8) * np.pi / 4:
        assert not occupancy.update(picture((2.0, 2.0, float(yaw)), walls(house), 0.5))
    assert occupancy.map is house


def test_what_is_gone_is_cleared_once_seen_through_and_not_before() -> None:
    """A crate that was taken away stays on the map until a picture shows what is behind its place."""
    house = two_rooms()
    occupancy = Occupancy.prior(house)
    occupancy.update(picture(POSE, [*walls(house), CRATE]))
    assert not occupancy.update(picture((*POSE[:2], np.pi), walls(house)))  # looking away
    hidden: Box = ((1.3, 1.5, 0.0), (1.4, 2.5, 1.5))
    occupancy.update(picture(POSE, [*walls(house), hidden]))
    assert occupancy.map.occupied[box_cells(occupancy, CRATE)].mean() > 0.9
    assert occupancy.update(picture(POSE, walls(house)))
    np.testing.assert_array_equal(occupancy.map.occupied, house.occupied)


def test_a_chair_of_the_map_is_cleared_where_it_was_pushed_away_and_not_where_it_stands() -> None:
    """Walls stay; the chair's new place is added. One that stands as mapped stays, also where only its feet hide."""
    bare, chair = two_rooms(), ((2.0, 1.8, 0.0), (2.4, 2.2, 0.45))
    house = replace(bare, occupied=bare.occupied | box_cells(Occupancy.prior(bare), chair))
    pushed: Box = ((2.6, 1.8, 0.0), (3.0, 2.2, 0.45))
    for now, (at, other) in ((chair, (chair, pushed)), (pushed, (pushed, chair))):
        occupancy = Occupancy.prior(house, bare.occupied)
        np.testing.assert_array_equal(occupancy.map.occupied, house.occupied)
        for x in (0.7, 1.1, 1.4):
            occupancy.update(picture((x, 2.0, 0.0), [*walls(bare), now]))
        assert occupancy.map.occupied[box_cells(occupancy, at)].mean() > 0.9
        assert not occupancy.map.occupied[box_cells(occupancy, other)].any()
        assert occupancy.map.occupied[bare.occupied].all()


def test_what_was_taken_away_is_cleared_unseen_and_walls_beside_it_are_not() -> None:
    """With the crate goes all that depth had shown of it, though only its front was known; the wall stays."""
    house = two_rooms()
    crate: Box = ((2.0, 0.06, 0.0), (2.3, 0.46, 0.4))
    occupancy = Occupancy.prior(house)
    occupancy.update(picture((0.7, 0.6, 0.0), [*walls(house), crate]))
    assert occupancy.map.occupied[box_cells(occupancy, crate)].mean() > 0.5
    occupancy.clear(np.array([2.0, 0.06, 0.0]), np.array([2.22, 0.44, 0.4]))
    np.testing.assert_array_equal(occupancy.map.occupied, house.occupied)
    assert occupancy.update(picture((0.7, 0.6, 0.0), [*walls(house), crate])), "it may be set down there again"


def test_the_floor_under_what_overhangs_does_not_clear_it() -> None:
    """A board at 1 m stays occupied although the floor under it is seen in the same and in later pictures."""
    house = two_rooms()
    board: Box = ((2.4, 1.5, 1.0), (2.8, 2.5, 1.05))
    occupancy = Occupancy.prior(house)
    for x in (0.7, 0.9, 1.2):
        occupancy.update(picture((x, 2.0, 0.0), [*walls(house), board]))
        assert occupancy.map.occupied[box_cells(occupancy, board)].mean() > 0.5


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_prior_walls_are_never_cleared(seed: int) -> None:
    """Whatever pictures show, even a house without walls, what the prior map has stays occupied."""
    rng = np.random.default_rng(seed)
    house = two_rooms()
    occupancy = Occupancy.prior(house)
    for _ in range(4):
        x, y, yaw = rng.uniform((0.5, 0.5, -3), (7.5, 3.5, 3))
        occupancy.update(picture((x, y, yaw), [], 0.25))
        noise = picture((x, y, yaw), walls(house), 0.25)
        occupancy.update(replace(noise, depth=rng.uniform(0.3, 6, noise.depth.shape).astype(np.float32)))
        assert occupancy.map.occupied[house.occupied].all()
        assert occupancy.known.all()


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_errors_of_the_pose_do_not_narrow_doorways(seed: int) -> None:
    """Pictures taken up to 5 cm and half a degree off, with noisy depth, add nothing beside walls of the prior map."""
    rng = np.random.default_rng(seed)
    house = two_rooms()
    occupancy = Occupancy.prior(house)
    for yaw in (-0.5, 0.0, 0.5):
        image = picture((2.2, 2.0, yaw), walls(house), 0.5)
        off = kin.base(np.array([*rng.uniform(-0.035, 0.035, 2), rng.uniform(-0.009, 0.009)]))
        depth = image.depth + rng.normal(0, 0.003, image.depth.shape) * image.depth**2
        occupancy.update(replace(image, depth=depth.astype(np.float32), T_world_camera=off @ image.T_world_camera))
    assert (occupancy.map.occupied & ~house.occupied).sum() <= 5


@pytest.mark.parametrize("nothing", [np.nan, np.inf, -np.inf, -1.0, 0.0])
def test_pixels_without_depth_change_nothing(nothing: float) -> None:
    """A picture without depth adds nothing and clears nothing, and nothing becomes known by it."""
    house = two_rooms()
    seen = picture(POSE, [*walls(house), CRATE])
    blank = replace(seen, depth=np.full_like(seen.depth, nothing))
    for occupancy in (Occupancy.prior(house), Occupancy.unknown(POSE[:2], (10, 10))):
        assert not occupancy.update(blank)
        occupancy.update(seen)
        before, known = occupancy.map, occupancy.known.copy()
        assert not occupancy.update(blank)
        assert occupancy.map is before
        np.testing.assert_array_equal(occupancy.known, known)


def test_one_stray_pixel_is_no_obstacle() -> None:
    """A single point in a cell is not believed; a picture that sees through it forgets it."""
    house = two_rooms()
    clear = picture(POSE, walls(house))
    depth = clear.depth.copy()
    depth[130, 160] = 0.8
    occupancy = Occupancy.prior(house)
    assert not occupancy.update(replace(clear, depth=depth))
    assert not occupancy.update(clear)
    assert not occupancy.update(replace(clear, depth=depth))


def test_the_robot_and_what_it_carries_are_no_obstacles() -> None:
    """Points within the circles to ignore are left out."""
    house = two_rooms()
    load: Box = ((1.1, 1.9, 0.6), (1.3, 2.1, 0.8))
    image = picture(POSE, [*walls(house), load])
    assert Occupancy.prior(house).update(image)
    assert not Occupancy.prior(house).update(image, [(0.7, 2.0, 0.35), (1.2, 2.0, 0.2)])


def test_what_lies_flat_or_hangs_high_is_no_obstacle() -> None:
    """A rug and a lamp high up are passed; what is 10 cm high and near is not."""
    house = two_rooms()
    for low, high, blocks in ((0.0, 0.03, False), (1.7, 1.9, False), (0.0, 0.10, True)):
        thing: Box = ((2.0, 1.8, low), (2.3, 2.2, high))
        assert Occupancy.prior(house).update(picture(POSE, [*walls(house), thing])) == blocks


def test_without_a_map_floor_becomes_known_as_it_is_seen() -> None:
    """At first nothing is known; floor in the picture and the robot's own place become free; walls occupied."""
    house = two_rooms()
    occupancy = Occupancy.unknown(POSE[:2], (20, 20))
    assert occupancy.map.occupied.all()
    assert not occupancy.known.any()
    assert occupancy.update(picture(POSE, walls(house)), [(*POSE[:2], 0.4)])
    map_ = occupancy.map
    assert not map_.occupied[map_.cell(POSE[:2])]
    for x in np.arange(0.7, 3.6, 0.1):  # no gap between the robot and the floor that it sees
        assert not map_.occupied[map_.cell((x, 2.0))]
    assert map_.occupied[map_.cell((0.7, 1.2))]  # beside the robot: not known yet
    assert not occupancy.known[map_.cell((0.7, 1.2))]
    assert map_.occupied[map_.cell((3.97, 3.0))]  # the wall between the rooms
    assert occupancy.known[map_.cell((3.97, 3.0))]
    assert not occupancy.known[map_.cell((4.5, 3.0))]


def test_looking_around_maps_a_room_without_a_map() -> None:
    """After eight looks from two places the room is free but for its border, and the doorway leads on: a frontier."""
    house = two_rooms()
    occupancy = Occupancy.unknown((1.0, 1.0), (20, 20))
    for x, y in ((1.2, 1.2), (2.4, 2.6)):
        for yaw in np.arange(8) * np.pi / 4:
            occupancy.update(picture((x, y, float(yaw)), walls(house), 0.5), [(x, y, 0.4)])
    map_ = occupancy.map
    xs, ys = np.meshgrid(np.arange(0.25, 3.8, 0.05), np.arange(0.25, 3.8, 0.05))
    free = np.array([not map_.occupied[map_.cell(xy)] for xy in np.stack([xs, ys], -1).reshape(-1, 2)])
    assert free.mean() > 0.995
    stands = map_.occupied & occupancy.known
    edge = frontier(~stands, occupancy.known)
    at = np.array([map_.center(r, c) for r, c in np.argwhere(edge)])
    assert len(at)
    assert (at[:, 0] > 4.0).mean() > 0.8  # what is left to know lies through the doorway


def test_a_camera_off_the_map_or_without_a_pose_changes_nothing() -> None:
    """Points outside are dropped, and a pose that is not a number is no pose."""
    occupancy = Occupancy.unknown((0.0, 0.0), (4, 4))
    assert not occupancy.update(picture((50.0, 0.0, 0.0), [CRATE], 0.25))
    image = picture((0.0, 0.0, 0.0), [], 0.25)
    assert not occupancy.update(replace(image, T_world_camera=np.full((4, 4), np.nan)))


def test_maps_keep_their_rooms() -> None:
    """Rooms, resolution and origin are those of the given map; without one there are no rooms."""
    house = two_rooms()
    occupancy = Occupancy.prior(house)
    occupancy.update(picture(POSE, [*walls(house), CRATE]))
    assert occupancy.map.room_at((1.0, 1.0)) == "kitchen"
    assert occupancy.map.resolution_m == house.resolution_m
    assert Occupancy.unknown((0.0, 0.0)).map.room_at((1.0, 1.0)) is None
    assert Occupancy.unknown((3.0, 1.0), (8, 4), 0.1).map.occupied.shape == (40, 80)


@pytest.mark.parametrize("prior", [True, False])
def test_a_restored_map_goes_on_as_the_one_that_was_saved(prior: bool) -> None:
    """What was taken away is cleared by the same pictures, what overhangs by none, and half of a hit still counts."""
    house = two_rooms()
    board: Box = ((2.0, 2.4, 0.9), (2.4, 2.9, 1.0))
    whole, other = (Occupancy.prior(house) if prior else Occupancy.unknown(np.array([4.0, 2.0])) for _ in range(2))
    whole.update(picture(POSE, [*walls(house), CRATE, board], 0.5))
    other.restore({name: cells.copy() for name, cells in whole.save().items()})
    assert np.array_equal(whole.map.occupied, other.map.occupied)
    for pose, boxes in (((0.9, 1.8, 0.1), [board]), ((1.2, 2.1, 0.0), [CRATE]), ((1.2, 2.2, 0.1), [])):
        image = picture(pose, [*walls(house), *boxes], 0.5)
        assert whole.update(image) == other.update(image)
        assert np.array_equal(whole.map.occupied, other.map.occupied)
        assert np.array_equal(whole.known, other.known)
    with pytest.raises(ValueError, match="the map is"):
        other.restore({name: cells[1:] for name, cells in whole.save().items()})
