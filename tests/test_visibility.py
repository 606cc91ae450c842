"""Laws of what a look at the floor adds to the visibility map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.finding.scene.visibility import VisibilityMap
from mpvi_bt.ground.robot.protocol import CameraImage
from tests.depth_pictures import FOV_RAD, Box, picture, walls
from tests.navigation_maps import put_box, two_rooms

SEEDS = st.integers(0, 2**32 - 1)
RES = 0.05


def cluttered(seed: int, things: int = 12, cells: int = 60) -> OccupancyMap:
    """A square room with boxes of one to six cells each way."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((cells, cells), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    for row, column, height, width in zip(
        *rng.integers(0, cells, (2, things)), *rng.integers(1, 7, (2, things)), strict=True
    ):
        occupied[row : row + height, column : column + width] = True
    return OccupancyMap(occupied, np.zeros(occupied.shape, np.int16), ("room",), RES, np.array([-1.0, 2.0]))


def looked(
    grid_map: OccupancyMap, xy: NDArray[np.float64], yaw: float, fov: float, reach_m: float
) -> NDArray[np.bool_]:
    """The cells that a look shows whose depth hides nothing."""
    view = VisibilityMap(grid_map, reach_m)
    view.update(flat_picture(xy, yaw, fov), grid_map.occupied)
    return view.seen


def flat_picture(xy: NDArray[np.float64], yaw: float, fov: float) -> CameraImage:
    """A picture taken 10 cm above the floor, level, that measures nothing nearer than 100 m."""
    image = picture((0.0, 0.0, 0.0), scale=0.25)
    height, width = image.depth.shape
    focal = width / 2 / np.tan(fov / 2)
    forward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([np.cross(forward, [0, 0, 1]), [0, 0, -1], forward], 1)
    T[:3, 3] = *xy, 0.10
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return replace(image, depth=np.full_like(image.depth, 100.0), K=K, T_world_camera=T)


def in_line(occupied: NDArray[np.bool_], a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether densely sampled points between two places (2,) [cells: row, column] are all free."""
    at = np.floor(a + np.linspace(0, 1, 400)[:, None] * (b - a)).astype(int)
    return not occupied[at[:, 0], at[:, 1]].any()


@settings(max_examples=15, deadline=None)
@given(SEEDS, st.floats(-3.1, 3.1))
def test_a_flat_look_shows_what_lies_in_line_of_sight(seed: int, yaw: float) -> None:
    """Free cells in the field of view with a clear line to their center are seen; of others only what shows a part."""
    room, fov, reach = cluttered(seed), 1.5, 1.2
    room.occupied[30, 30] = False
    eye, here = room.center(30, 30), np.array([30.5, 30.5])
    seen = looked(room, eye, yaw, fov, reach)
    assert not (seen & room.occupied).any()
    missed = too_many = 0
    for row, column in np.argwhere(~room.occupied):
        way = room.center(row, column) - eye
        distance = float(np.hypot(*way))
        off = abs((np.arctan2(way[1], way[0]) - yaw + np.pi) % (2 * np.pi) - np.pi)
        cell = np.array([row, column])
        if distance > reach + RES or (distance > RES and off > fov / 2):
            assert not seen[row, column]
        elif seen[row, column] and not in_line(room.occupied, here, cell + 0.5):
            parts = [(i, j) for i in (0.02, 0.5, 0.98) for j in (0.02, 0.5, 0.98)]
            too_many += not any(in_line(room.occupied, here, cell + part) for part in parts)
        elif not seen[row, column] and RES < distance < reach - RES:
            missed += in_line(room.occupied, here, cell + 0.5)
    assert missed <= 0.01 * seen.sum() + 1
    assert too_many <= 0.02 * seen.sum() + 1


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(-3.1, 3.1))
def test_nothing_is_seen_through_a_wall(seed: int, yaw: float) -> None:
    """Behind a closed wall nothing is seen, whether it runs along the rows, the columns or diagonally."""
    rng = np.random.default_rng(seed)
    for kind in range(3):
        occupied = np.zeros((60, 60), bool)
        rows, columns = np.indices(occupied.shape)
        away = (rows - 30, columns - 30, rows + columns - 60)[kind]
        occupied[away == 0] = True
        room = OccupancyMap(occupied, np.zeros(occupied.shape, np.int16), ("room",), RES, np.zeros(2))
        row, column = rng.integers(2, 28, 2)
        seen = looked(room, room.center(int(row), int(column)), yaw, 2.0, 5.0)
        assert not seen[away >= 0].any()


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_sight_is_mutual(seed: int) -> None:
    """Two cells with a clear line between their centers see each other."""
    room = cluttered(seed, 8, 40)
    free = np.argwhere(~room.occupied)
    chosen = free[np.random.default_rng(seed).integers(0, len(free), 12)]
    missed = 0
    for row, column in chosen:
        seen = np.zeros(room.occupied.shape, bool)
        for yaw in (0.0, 2.1, 4.2):
            seen |= looked(room, room.center(row, column), yaw, 2.2, 4.0)
        here = np.array([row, column]) + 0.5
        others = [other for other in chosen if np.abs(other + 0.5 - here).max() > 2]
        missed += sum(not seen[tuple(other)] and in_line(room.occupied, here, other + 0.5) for other in others)
    assert missed <= 2  # of 144, by rays on either side of a corner


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_what_was_seen_stays_seen_and_is_counted_once(seed: int) -> None:
    """Updates only add, say how many cells they added, and add nothing the second time."""
    rng = np.random.default_rng(seed)
    house = two_rooms()
    view = VisibilityMap(house)
    for _ in range(4):
        image = picture((*rng.uniform((0.5, 0.5), (7.5, 3.5)), rng.uniform(-3, 3)), walls(house), 0.25)
        before = view.seen.copy()
        added = view.update(image, house.occupied)
        assert (view.seen >= before).all()
        assert added == view.seen.sum() - before.sum()
        assert view.update(image, house.occupied) == 0


BOX: Box = ((2.0, 1.5, 0.0), (2.4, 2.5, 0.9))


def test_a_thing_that_the_map_lacks_hides_the_floor_behind_it() -> None:
    """With a box before the robot the floor in its shadow is not seen; beside it is; nor is any without the box."""
    house, bare = two_rooms(), VisibilityMap(two_rooms())
    bare.update(picture((0.6, 2.0, 0.0), walls(house)), house.occupied)
    hidden = VisibilityMap(house)
    hidden.update(picture((0.6, 2.0, 0.0), [*walls(house), BOX]), house.occupied)
    behind = np.s_[house.cell((0, 1.8))[0] : house.cell((0, 2.2))[0], house.cell((2.5, 0))[1] : house.cell((3.2, 0))[1]]
    assert bare.seen[behind].all()
    assert not hidden.seen[behind].any()
    assert hidden.seen[house.cell((2.6, 3.0))]
    assert not (hidden.seen & ~bare.seen).any()


def test_what_the_map_has_hides_the_floor_even_if_depth_looks_over_it() -> None:
    """A low table of the map blocks rays: what may lie behind it on the floor was not seen."""
    house = two_rooms()
    put_box(house, (2.0, 1.0), (2.4, 3.0))
    view = VisibilityMap(house)
    view.update(picture((0.6, 2.0, 0.0)), house.occupied)
    assert view.seen[house.cell((1.6, 2.0))]
    assert not view.seen[house.cell((3.0, 2.0))]


@pytest.mark.parametrize("nothing", [np.nan, 0.0, -1.0, np.inf])
def test_pixels_without_depth_show_nothing(nothing: float) -> None:
    """Where depth is missing nothing is learned; where it is there, as much as before."""
    house = two_rooms()
    image = picture((0.6, 2.0, 0.0), walls(house))
    whole, half, none = (VisibilityMap(house) for _ in range(3))
    whole.update(image, house.occupied)
    left = image.depth.copy()
    left[:, : left.shape[1] // 2] = nothing
    half.update(replace(image, depth=left), house.occupied)
    assert none.update(replace(image, depth=np.full_like(left, nothing)), house.occupied) == 0
    assert (half.seen <= whole.seen).all()
    assert 0.4 < half.seen.sum() / whole.seen.sum() < 0.6
    assert not half.seen[house.cell((2.0, 2.5))]
    assert half.seen[house.cell((2.0, 1.5))]


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_a_look_adds_what_was_foretold_in_a_house_as_mapped(seed: int) -> None:
    """Where the map is right, the picture adds at least what `would_see` says, and not much more."""
    rng = np.random.default_rng(seed)
    house = two_rooms()
    pose = np.array([*rng.uniform((0.6, 0.6), (3.4, 3.4)), rng.uniform(-3, 3)])
    view = VisibilityMap(house)
    view.update(picture((7.5, 0.5, 2.0), walls(house)), house.occupied)
    view.seen[:] = False
    image = picture((float(pose[0]), float(pose[1]), float(pose[2])), walls(house), 0.5)
    foretold = view.would_see(image.T_world_camera[:2, 3], float(pose[2]), FOV_RAD, house.occupied)
    assert not view.seen.any()
    added = view.update(image, house.occupied)
    assert foretold <= 1.05 * added + 10
    assert added <= 2 * foretold + 40  # the lower corners of a picture reach farther aside than its middle


def test_the_floor_right_before_the_robot_is_below_the_picture() -> None:
    """The head camera shows the floor from some 0.6 m on; what is nearer neither counts nor is foretold."""
    house = two_rooms()
    view = VisibilityMap(house)
    image = picture((2.0, 2.0, np.pi), walls(house))
    view.update(image, house.occupied)
    eye = image.T_world_camera[:2, 3]
    columns = np.flatnonzero(view.seen[house.cell(eye)[0]])
    assert 0.4 < eye[0] - house.center(0, int(columns[-1]))[0] < 0.9
    assert view.would_see(eye, np.pi, FOV_RAD, house.occupied) <= 40


def test_looks_from_off_the_map_see_nothing() -> None:
    """Outside or without a place there is nothing to see, and no error."""
    house = two_rooms()
    view = VisibilityMap(house)
    for xy in ((-5.0, 2.0), (np.nan, 2.0), (2.0, 1e9)):
        assert view.would_see(np.array(xy), 0.0, FOV_RAD, house.occupied) == 0
    assert view.update(picture((-5.0, 2.0, np.pi)), house.occupied) == 0


def test_occupied_cells_of_another_map_are_refused() -> None:
    """A mask of another shape is a mistake that names both shapes."""
    view = VisibilityMap(two_rooms())
    with pytest.raises(ValueError, match=r"\(3, 3\).*\(80, 160\)"):
        view.would_see(np.array([1.0, 1.0]), 0.0, FOV_RAD, np.zeros((3, 3), bool))


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(-np.pi, np.pi))
def test_no_look_shows_more_than_is_within_reach(seed: int, yaw: float) -> None:
    """The bound that saves looks is one, wherever the camera is."""
    rng = np.random.default_rng(seed)
    view = VisibilityMap(two_rooms(), reach_m=float(rng.uniform(0.5, 4.0)))
    wanted = rng.random(view.seen.shape) < 0.3
    nothing = np.zeros_like(wanted)
    for xy in (rng.uniform([0.0, 0.0], [8.0, 4.0]), np.array([-1.0, 2.0]), np.full(2, np.nan)):
        assert view.would_see(xy, yaw, 2.0, nothing, wanted) <= view.within_reach(xy, wanted)
