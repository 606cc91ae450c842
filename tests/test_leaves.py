"""What stands open, told from points of known fixtures: from the body that it hangs on, without its bar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.finding.shapes import open_leaves as leaves
from mpvi_bt.finding.shapes.fronts import fronts
from mpvi_bt.finding.shapes.moving_parts import moved
from mpvi_bt.finding.shapes.open_leaves import leaf, with_leaf, within_drawer
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills.push_courses import pushes
from tests.small_house import small_world
from tests.test_fronts import EYE, FIXTURES, seen

FROM = np.array([-0.3, 0.1, 1.35])
OPEN = [("left-hinged cabinet", "door", 0.7), ("oven", "door", 0.6), ("drawers", "drawer_3", 0.8)]


@pytest.mark.parametrize(("name", "body", "fraction"), OPEN)
def test_what_stands_open_is_told_without_its_bar(name: str, body: str, fraction: float) -> None:
    """A door, a flap and a drawer are told apart, and how far each is open."""
    world = small_world(thing=FIXTURES[name])
    world.set_opening("thing", body, fraction)
    world.refresh()
    (door,) = (d for d in world.doors("thing") if d.name == body)
    found = leaf(seen(world, 0.002, FROM), FROM)
    assert found is not None
    assert found.door.kind == door.kind
    assert found.door.axis @ door.axis > 0.98
    assert abs(found.door.position - door.position) < (0.1 if door.kind == "hinge" else 0.03)


@pytest.mark.parametrize("name", [n for n in FIXTURES if n != "boot"])
def test_nothing_hangs_on_what_is_closed(name: str) -> None:
    """Closed doors and drawers are not taken for open ones."""
    points = seen(small_world(thing=FIXTURES[name]), 0.002)
    assert all(d.position < 0.1 * d.limit for d in with_leaf(fronts(points, EYE), leaf(points, EYE)))


def test_the_room_in_a_drawer_is_behind_its_face() -> None:
    """It is as long as the drawer is drawn out, and lies within the drawer; a closed drawer, and a door, have none."""
    world = small_world(thing=FIXTURES["drawers"])
    world.set_opening("thing", "drawer_3", 0.8)
    world.refresh()
    found = leaf(seen(world, 0.002, FROM), FROM)
    assert found is not None
    room = within_drawer(found.door)
    assert room is not None
    (low, high), middle = room.aabb(), room.aabb().mean(0)
    true = min((v.aabb() for v in world.volumes("thing")), key=lambda box: abs(float(box.mean(0)[2] - middle[2])))
    assert (low > true[0] - 0.03).all()
    assert (high < true[1] + 0.03).all()
    assert 2 * room.half_m[0] == pytest.approx(found.door.position)
    assert within_drawer(replace(found.door, position=0.0)) is None
    assert within_drawer(replace(found.door, kind="hinge")) is None


@pytest.mark.parametrize(("name", "body", "fraction"), OPEN)
def test_a_fist_pushes_the_outer_face_home(name: str, body: str, fraction: float) -> None:
    """It stays on the face from the touch to the closed door, and pushes inward."""
    world = small_world(thing=FIXTURES[name])
    world.set_opening("thing", body, fraction)
    world.refresh()
    (door,) = (d for d in world.doors("thing") if d.name == body)
    courses = pushes(R1.hand, door, 0.0)
    assert courses
    for course in courses:
        local = [(np.linalg.inv(moved(door, -door.position * x)) @ course.hand(x))[:3, 3] for x in (0.0, 0.5, 1.0)]
        assert np.ptp(local, axis=0).max() < 0.03
        step = course.hand(0.01)[:3, 3] - course.hand(0.0)[:3, 3]
        assert step @ course.hand(0.0)[:3, 2] > 0


@pytest.mark.parametrize("name", ["left-hinged cabinet", "refrigerator"])
def test_a_fist_keeps_clear_of_a_bar_that_is_not_seen(name: str) -> None:
    """Where a door hides its bar, it is pushed farther from the free edge than bars are, or far off their height.

    Beside a wall there may be room for an arm only near the edge.
    """
    world = small_world(thing=FIXTURES[name])
    world.set_opening("thing", "door", 0.7)
    world.refresh()
    (door,) = world.doors("thing")
    assert door.bar is not None
    beyond = []
    for course in pushes(R1.hand, replace(door, bar=None)):
        off = course.hand(0.0)[:3, 3] - door.bar.center
        beyond.append(abs(float(off @ door.bar.axis)) - door.bar.length_m / 2 > 0.05)
        assert beyond[-1] or np.linalg.norm(np.cross(off, door.bar.axis)) > 0.12
    assert any(beyond)
    assert not all(beyond)


def test_spans_are_those_between_percentiles() -> None:
    """What is told fast is to the last bit what numpy tells."""
    rng = np.random.default_rng(0)
    for n in (2, 3, 20, 101, 1000):
        values = rng.normal(size=n)
        assert leaves._span(values) == np.ptp(np.percentile(values, [3, 97]))
