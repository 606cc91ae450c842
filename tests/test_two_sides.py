"""Doors that look otherwise than they are: what is done about them is not done at first sight."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mpvi_bt.finding.shapes.moving_parts import Door, moved, outward, panel
from mpvi_bt.ground.geometry.solids import Array, box
from mpvi_bt.ground.robot.motion import Motion, MotionFailure
from mpvi_bt.hands.motion.door_views import seen_twice, stand_before, stand_before_open
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills import close as closing
from mpvi_bt.hands.skills.close import close, is_closed
from mpvi_bt.hands.skills.open import course_search, is_open, open_
from mpvi_bt.hands.skills.push_courses import pushes
from mpvi_bt.hands.stance.course import CourseSearch
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import small_world

CABINET = "{entry: base_cabinet, at: [1.0, 0.0], yaw_deg: 180, shape: {hinge: left}}"
START_Y_M = 0.3
Looks = Callable[[Door, float], Door]  # how a door looks, by where the robot stands


class Deceived(TrueScene):
    """The truth, but for how doors look from where the robot stands. It is looked at all the same."""

    needs_looks, pose_error_m = True, 0.06

    def __init__(self, world: SimWorld, looks: Looks) -> None:
        super().__init__(world)

        def doors(name: str) -> Sequence[Door]:
            y = float(world.robot.proprioception().base_pose[1])
            return [looks(door, y) for door in world.doors(name)]

        self.doors = doors


def _swung(door: Door, by: float) -> Door:
    T = moved(door, by)
    bar = door.bar
    if bar is not None:
        bar = replace(bar, center=T[:3, :3] @ bar.center + T[:3, 3], axis=T[:3, :3] @ bar.axis,
                      outward=T[:3, :3] @ bar.outward)  # type: ignore[type-var]  # fmt: skip
    return replace(door, position=door.position + by, bar=bar, solids=[s.moved(T) for s in door.solids])


def working(world: SimWorld, looks: Looks | None = None) -> Work:
    world.settle(0.3)
    scene = TrueScene(world) if looks is None else Deceived(world, looks)
    images: Any = {"head": None}
    return Work(scene, Motion(world.robot.proprioception()), np.random.default_rng(0), images=images)


def played(world: SimWorld, work: Work, doing: Any) -> Any:
    """Play a motion to its end; what it returns."""
    while True:
        try:
            action = next(doing)
        except StopIteration as end:
            world.refresh()
            return end.value
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()


def cabinet(fraction: float, y: float = START_Y_M) -> SimWorld:
    world = small_world(base=(-0.5, y, 0.0), thing=CABINET)
    world.set_opening("thing", "door", fraction)
    world.refresh()
    return world


def truly(door: Door, y: float) -> Door:
    return door


def otherwise_from_the_start(door: Door, y: float) -> Door:
    """From where the robot starts an open door looks closed, and a closed one open."""
    if abs(y - START_Y_M) > 0.3:
        return door
    return _swung(door, (0.0 if is_open(door) else 1.2) - door.position)


def closed_from_the_start(door: Door, y: float) -> Door:
    """From where the robot starts an open door looks closed."""
    return otherwise_from_the_start(door, y) if is_open(door) else door


def a_front_from_outside(door: Door, y: float) -> Door:
    """From before its outer face an open door looks like a front of its own that is closed."""
    return replace(door, position=0.0) if y > 0.6 else door


@pytest.mark.parametrize("fraction", [0.0, 0.7])
@pytest.mark.parametrize(("looks", "believed"), [(truly, True), (otherwise_from_the_start, False)])
def test_what_looks_otherwise_from_another_side_is_not_believed(fraction: float, looks: Looks, believed: bool) -> None:
    """A door is taken for open or closed by looks if it stands there as it did when seen from elsewhere."""
    world = cabinet(fraction)
    work = working(world, looks)
    assert played(world, work, seen_twice(work, "thing", work.scene.doors("thing"))) is believed
    assert abs(world.robot.proprioception().base_pose[1] - START_Y_M) > 0.3


def test_the_truth_needs_no_second_look() -> None:
    """Who knows how doors stand does not walk around them."""
    world = cabinet(0.7)
    work = working(world)
    doing = seen_twice(work, "thing", work.scene.doors("thing"))
    with pytest.raises(StopIteration) as end:
        next(doing)
    assert end.value.value is True


def test_a_door_that_looks_open_is_opened_all_the_same() -> None:
    """What looks open at first sight, and is not, is found out and opened."""
    world = cabinet(0.0)
    work = working(world, otherwise_from_the_start)
    played(world, work, open_(work, {"object": "cabinet"}, []))
    assert is_open(world.doors("thing")[0])


def test_a_door_that_looks_closed_is_closed_all_the_same() -> None:
    """What looks closed at first sight, and is not, is found out and closed."""
    world = cabinet(0.5)
    work = working(world, closed_from_the_start)
    played(world, work, close(work, {"object": "cabinet"}, []))
    assert is_closed(world.doors("thing")[0])


def test_a_door_that_was_seen_open_is_not_closed_because_it_looks_so_from_outside() -> None:
    """A closed front counts if it looks the way in which the door's front was seen to look before."""
    world = cabinet(0.7, 1.0)
    work = working(world, a_front_from_outside)
    work.ajar["thing"] = np.array([-1.0, 0.0, 0.0])
    played(world, work, close(work, {"object": "cabinet"}, []))
    assert is_closed(world.doors("thing")[0])


@pytest.mark.parametrize("y", [-1.2, 1.2])
def test_it_walks_around_to_before_the_outer_face(y: float) -> None:
    """From either side it ends up where the outer face of an open door is in view and in reach of a course."""
    world = cabinet(0.7, y)
    work = working(world)
    (door,) = world.doors("thing")
    assert played(world, work, stand_before(work, "thing", panel(door).T[:3, 3], outward(door)))
    off = world.robot.proprioception().base_pose[:2] - panel(door).T[:2, 3]
    assert off @ outward(door)[:2] > 0.3
    assert np.linalg.norm(off) < 1.6


@pytest.mark.parametrize("y", [-1.2, 1.2])
def test_it_looks_into_what_stands_open_from_before_its_front(y: float) -> None:
    """From beside a cabinet, where its door or its side is all that is seen, it goes to where one sees into that."""
    world = cabinet(0.7, y)
    work = working(world, truly)
    played(world, work, stand_before_open(work, "thing"))
    (door,) = world.doors("thing")
    front = (moved(door, -door.position) @ panel(door).T[:, 3])[:2]
    ahead, aside = front - world.robot.proprioception().base_pose[:2]  # it looks toward -x
    assert ahead > 0.6
    assert abs(aside) < 0.6 * ahead


def test_without_a_way_to_the_outer_face_of_a_door_it_is_tried_from_the_front(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a wall no base gets between that and an open door; from before the front an arm may reach around it."""
    world = cabinet(0.7)
    work = working(world, truly)
    gone: list[str] = []

    def before(*_: object) -> Generator[Any, None, bool]:
        gone.append("outer face")
        yield from ()
        return False

    def front(*_: object) -> Generator[Any, None, None]:
        gone.append("front")
        yield from ()

    monkeypatch.setattr(closing, "stand_before", before)
    monkeypatch.setattr(closing, "stand_before_front", front)
    monkeypatch.setattr(CourseSearch, "start", lambda *_: None)
    (door,) = world.doors("thing")
    with pytest.raises(MotionFailure, match="no_stance"):
        played(world, work, closing._shut(work, "thing", replace(door, bar=None), [], None))
    assert gone == ["outer face", "front"]


def test_a_course_keeps_clear_of_what_the_base_has_met() -> None:
    """A wall that no picture shows is driven into once, not at every try."""
    world = cabinet(0.5)
    work = working(world, truly)
    (door,) = world.doors("thing")
    found = course_search(work, "thing", door, "right", []).start(pushes(R1.hand, door))
    assert found is not None
    work.motion.bumps.append(box((*found.base[:2], 0.2), (0.04, 0.04, 0.4)))
    other = course_search(work, "thing", door, "right", []).start(pushes(R1.hand, door))
    assert other is None or np.linalg.norm(other.base[:2] - found.base[:2]) > 0.2


def searching(effort: Effort) -> tuple[CourseSearch, Door]:
    world = cabinet(0.5)
    work = working(world)
    work.effort = effort
    (door,) = world.doors("thing")
    return course_search(work, "thing", door, "right", []), door


def test_a_course_search_ends_when_nothing_is_left_to_spend() -> None:
    """What searches may take is counted, and a search that may take nothing finds nothing."""
    search, door = searching(Effort(0.0))
    assert search.start(pushes(R1.hand, door)) is None
    search, door = searching(Effort(100.0))
    found = search.start(pushes(R1.hand, door))
    assert found is not None
    assert search.effort.left < 100.0


def test_a_course_search_goes_on_where_the_last_one_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """What failed from where nothing has changed since fails again: other base poses are examined."""
    begun: list[Array] = []

    def fail(self: CourseSearch, base: Array, *rest: object) -> tuple[None, float]:
        begun.append(base)
        return None, 1.0

    begin = CourseSearch._begin
    monkeypatch.setattr(CourseSearch, "_begin", fail)
    search, door = searching(Effort(100.0))
    for times in (1, 2):
        assert search.start(pushes(R1.hand, door)) is None
        assert len({tuple(base) for base in begun}) == len(begun) == 24 * times
    monkeypatch.setattr(CourseSearch, "_begin", begin)
    search.effort.failed.clear()
    assert search.start(pushes(R1.hand, door)) is not None


def test_a_course_search_is_bounded() -> None:
    """Where no base pose does, a search takes a quarter of what a prompt may take, and asks no course over and over."""
    search, door = searching(Effort(100.0))
    asked = 0

    def never(x: float) -> list[Any]:  # the door is in the way of everything
        return [panel(door), replace(panel(door), half_m=np.array([3.0, 3.0, 3.0]))]

    def counted(carry: Callable[[float], Any]) -> Callable[[float], Any]:
        def asking(x: float) -> Any:
            nonlocal asked
            asked += 1
            return carry(x)

        return asking

    courses = [replace(c, moving=never, carry=counted(c.carry)) for c in pushes(R1.hand, door)[:8]]
    assert search.start(courses) is None
    spent = 100.0 - search.effort.left
    assert 0.0 < spent < 26.0
    assert asked < 200 * len(courses)
