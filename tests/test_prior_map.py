"""The prior map is derived from the solids, and agrees with them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.layout.overlap import penetration
from mpvi_bt.house.layout.prior_map import BAND_M, knowledge, obstacles, prior_map
from mpvi_bt.house.sim.open_doors import OpenDoors
from mpvi_bt.house.sim.world import SimWorld


@pytest.fixture(scope="module")
def house() -> House:
    return load_house()


@pytest.fixture(scope="module")
def map_(house: House) -> OccupancyMap:
    return prior_map(house)


def within(solid: Solid, points: Array) -> NDArray[np.bool_]:
    local = (points - solid.T[:3, 3]) @ solid.T[:3, :3]
    if solid.kind == "box":
        return np.asarray((np.abs(local) <= solid.half_m).all(-1))
    if solid.kind == "sphere":
        return np.asarray(np.linalg.norm(local, axis=-1) <= solid.half_m[0])
    return np.asarray(
        (np.linalg.norm(local[..., :2], axis=-1) <= solid.half_m[0]) & (np.abs(local[..., 2]) <= solid.half_m[2])
    )


def test_what_is_solid_is_occupied(house: House, map_: OccupancyMap) -> None:
    """Every point of a solid between the band's heights lies in an occupied cell."""
    rng = np.random.default_rng(0)
    for solid in obstacles(house):
        low, high = solid.aabb()
        points = rng.uniform(low, high, (40, 3))
        points = points[within(solid, points) & (points[:, 2] > BAND_M[0]) & (points[:, 2] < BAND_M[1])]
        for point in points:
            assert map_.occupied[map_.cell(point)]


def test_what_is_occupied_is_near_something_solid(house: House, map_: OccupancyMap) -> None:
    """Every occupied cell of a room touches the bounding rectangle of some solid."""
    rectangles = np.stack([solid.aabb()[:, :2] for solid in obstacles(house)])
    rows, columns = np.nonzero(map_.occupied & (map_.rooms >= 0))
    centers = map_.origin_m + (np.stack([columns, rows], 1) + 0.5) * map_.resolution_m
    half = map_.resolution_m / 2 + 1e-6
    for center in centers[::7]:
        assert np.any(np.all((rectangles[:, 0] < center + half) & (rectangles[:, 1] > center - half), axis=1))


def test_what_can_be_moved_can_be_left_out(house: House, map_: OccupancyMap) -> None:
    """Without what is loose, less is occupied, and all that is less is under chairs and the like."""
    fixed = prior_map(house, loose=False)
    assert not (fixed.occupied & ~map_.occupied).any()
    rows, columns = np.nonzero(map_.occupied & ~fixed.occupied)
    boxes = [f.extent()[:, :2] for f in house.fixtures.values() if f.entry.mass_kg is not None]
    assert len(rows) > 0
    half = map_.resolution_m
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        center = map_.center(row, column)
        assert any((low - half < center).all() and (center < high + half).all() for low, high in boxes)


def test_doorways_are_free(house: House, map_: OccupancyMap) -> None:
    """The middle of every doorway is free, as is a disk of 0.4 m around it."""
    for doorway in house.doorways:
        for angle in np.linspace(0, 2 * np.pi, 12):
            place = np.array(doorway.at) + 0.4 * np.array([np.cos(angle), np.sin(angle)])
            assert not map_.occupied[map_.cell(place)], doorway


def test_rooms_are_labeled(house: House, map_: OccupancyMap) -> None:
    """The middle of every room has its label, and nothing outside the house has one."""
    for room in house.rooms.values():
        x0, y0, x1, y1 = room.rect
        assert map_.room_at(((x0 + x1) / 2, (y0 + y1) / 2)) == room.name
    assert map_.room_at((100.0, 100.0)) is None
    assert map_.occupied[map_.rooms < 0].all()


@pytest.mark.parametrize(
    ("phrase", "room", "name"),
    [
        ("kitchen", None, "kitchen"),
        ("the living room", None, "living_room"),
        ("fridge", None, "electric_refrigerator_1"),
        ("the refrigerator", "kitchen", "electric_refrigerator_1"),
        ("coffee table", "living room", "coffee_table_1"),
        ("shoe rack", "corridor", "hallstand_1"),
        ("washing machine", None, "washer_1"),
    ],
)
def test_people_find_rooms_and_fixtures(house: House, phrase: str, room: str | None, name: str) -> None:
    """What people call rooms and fixtures finds them in the knowledge base."""
    base = KnowledgeBase({entry.name: entry for entry in knowledge(house)})
    assert base.find(phrase, room)[0].name == name


boxes = st.builds(
    lambda half, center, yaw: Solid("box", np.array(half), pose(np.array(center), yaw)),
    st.tuples(*[st.floats(0.05, 1)] * 3),
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.floats(-3, 3),
)


@given(a=boxes, b=boxes)
def test_penetration_is_symmetric_and_negative_only_without_a_common_point(a: Solid, b: Solid) -> None:
    """Which of two boxes comes first does not matter, and boxes said to be apart have no point in common."""
    depth = penetration(a, b)
    assert depth == pytest.approx(penetration(b, a), abs=1e-9)
    if depth < 0:
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), -1).reshape(-1, 3)
        points = (grid * a.half_m) @ a.T[:3, :3].T + a.T[:3, 3]
        assert not within(b, points).any()


def test_open_doors_are_on_the_map_while_they_stand_open(house: House) -> None:
    """A door that swings out takes floor before its cabinet; shut again, the map is the one of closed doors."""
    closed = prior_map(house)
    world = SimWorld(house, {}, np.array([6.0, 2.5, 0.0]), render=False)
    now = OpenDoors(closed, world)
    assert now() is closed
    world.set_opening("cabinet_1", "door", 0.8)
    opened = now()
    taken = opened.occupied & ~closed.occupied
    assert taken.any()
    assert now() is opened
    leaf = np.stack([solid.aabb()[:, :2] for door in world.doors("cabinet_1") for solid in door.solids])
    cells = np.stack([opened.center(*cell) for cell in np.argwhere(taken)])
    assert (cells > leaf[:, 0].min(0) - 0.1).all()
    assert (cells < leaf[:, 1].max(0) + 0.1).all()
    world.set_opening("cabinet_1", "door", 0.0)
    assert now() is closed
