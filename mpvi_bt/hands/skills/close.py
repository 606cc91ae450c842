"""Close a door, a drawer or a lid: push its face home with the fist, or bring it home by its bar."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mpvi_bt.finding.shapes.moving_parts import Door, lid, moved, outward, panel, upright
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.approach import going_around
from mpvi_bt.hands.motion.door_views import seen_twice, stand_before, stand_before_front
from mpvi_bt.hands.motion.follow import FOLLOW, go_along, resistance, take_up, touch
from mpvi_bt.hands.motion.viewpoints import look_from_aside, look_over
from mpvi_bt.hands.motion.work import AJAR, Words, Work
from mpvi_bt.hands.skills.open import course_search, sides, swing, then_leave
from mpvi_bt.hands.skills.openings import doors_meant, thing_meant
from mpvi_bt.hands.skills.push_courses import PUSH, pushes
from mpvi_bt.hands.stance.course import Course, CourseStart


@dataclass(frozen=True)
class Shutting:
    """When a door is closed, by sight and by what the pushing fist feels.

    Our choice. If poses are exact, contact only confirms that a door is shut. If they may be off, the fist goes on
    until something stops it.
    """

    doors: int = 8  # most doors that one call closes
    closed: float = 0.03  # a door that is open by less counts as closed [ratio of its limit]
    facing: float = 0.7  # cosine between the outward directions of two fronts on the same side of a thing
    same_m: float = 0.1  # a door whose middle is still this close to where it was has not moved [m]
    nearly: float = 0.85  # if poses are exact, progress of the push from which the door may be shut [ratio]
    exact_m: float = 0.010  # if poses are exact, distance that a shut door holds the fist off its target [m]
    unsure_rad: float = 0.2  # target past the closed position of a hinged door whose pose may be off [rad]
    moving: float = 0.15  # progress from which such a door may be shut [ratio]; it resists as it begins to move, too
    stopped_m: float = 0.02  # distance that such a shut door holds the fist off its target [m]
    stopped_steps: int = 3  # and for this many control steps in a row
    home: float = 0.1  # part of the way left at which a stopped door still counts as closed [ratio]
    aslant: float = 0.6  # sideways part of the fist's retreat, toward the hinge, to keep clear of the bar [tangent]


_SHUT = Shutting()


def close(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Close what `words["object"]` names: all of its doors and drawers that are open, or the one that it says.

    Args:
        work: Robot and world.
        words: Of the skill call.
        tried: Base poses that did not do; those taken are added.

    Raises:
        MotionFailure: "unknown_object", "no_door", "hands_full", "no_stance", "closed_empty", "slipped", "not_closed",
            or a motion's own reason.
    """
    thing, places = thing_meant(work, words["object"], ajar=True)
    yield from look_over(work, thing)
    if not work.scene.doors(thing):  # from within, an open door hides its bar
        if thing in work.ajar:
            yield from stand_before(work, thing, work.scene.pose(thing)[:3, 3], work.ajar[thing])
            yield from look_over(work, thing)
        else:
            yield from look_from_aside(work, thing)
    for _ in range(_SHUT.doors):
        doors = doors_meant(work, thing, places)
        ajar = [d for d in doors if not is_closed(d)]
        if not ajar:
            out = work.ajar.get(thing)
            # What stands open at a right angle looks closed from before its outer face.
            if out is not None and all(matmul(outward(d), out) < _SHUT.facing for d in doors):
                yield from stand_before(work, thing, np.mean([_edge(d) for d in doors], axis=0), out)
                yield from look_over(work, thing)
                continue
            same = yield from seen_twice(work, thing, doors)
            if same and all(is_closed(d) for d in doors_meant(work, thing, places)):  # gaps may show from one side only
                return
            continue
        work.ajar[thing] = matmul(moved(ajar[0], -ajar[0].position)[:3, :3], outward(ajar[0]))
        felt = yield from going_around(
            work, _edge(ajar[0]), partial(_shut, work, thing, ajar[0], tried, words.get("hand"))
        )
        yield from look_over(work, thing)
        left = [d for d in work.scene.doors(thing) if not is_closed(d)]
        # A gap as wide as a finger does not show; a hand that has felt a door stop where it has to be knows better.
        if felt and not any(_wide_open(d) for d in left):
            return
        if len(left) >= len(ajar) and any(norm(_edge(d) - _edge(ajar[0])) < _SHUT.same_m for d in left):
            break
    raise MotionFailure("not_closed")


def _wide_open(door: Door) -> bool:
    return door.position > AJAR * door.limit


def _edge(door: Door) -> Array:
    """(3,) the middle of what moves."""
    return panel(door).T[:3, 3]


def is_closed(door: Door) -> bool:
    """Whether it is closed."""
    return door.position < _SHUT.closed * door.limit


def _shut(work: Work, thing: str, door: Door, tried: list[Array], hand: str | None) -> Generator[Array, None, bool]:
    """Push a door home, or bring it home by its bar; returns whether it was felt to stop where it has to be."""
    flap = door.kind == "hinge" and not upright(door)
    if work.scene.pose_error_m or upright(door) or lid(door):
        shape = work.motion.robot.hand
        courses, further = pushes(shape, door), pushes(shape, door, _beyond(work, door))
        for heading in _headings(work, door, courses):
            for side in sides(work, door, thing, hand):
                search = course_search(work, thing, door, side, tried, bendable=flap)
                start = search.start([replace(c, heading=heading) for c in courses])
                if start is None:
                    continue
                tried.append(start.base)
                return (yield from _push_home(work, door, further[start.course], start, side, search.other))
    if door.bar is None:
        if not (yield from stand_before(work, thing, _edge(door), outward(door), door)):
            yield from stand_before_front(work, thing, door)  # beside a wall there is no way to its outer face
        raise work.no_stance()
    yield from swing(work, thing, door, [0.0], tried, hand)
    return False


def _headings(work: Work, door: Door, courses: Sequence[Course]) -> list[float]:
    """Ways to look at a door that is to be pushed [rad]: straight onto it, or at a lid from any side, from here first.

    A lid is pushed from above, so that it matters little where the robot stands.
    """
    if not lid(door) or not courses:
        return [course.heading for course in courses[:1]]
    x, y, _ = work.motion.felt.base_pose
    at = _edge(door)
    here = float(np.arctan2(at[1] - y, at[0] - x))
    square = float(np.arctan2(door.axis[1], door.axis[0]))
    return sorted((square + k * np.pi / 2 for k in range(4)), key=lambda heading: abs(float(kin.wrap(heading - here))))


def _beyond(work: Work, door: Door) -> float:
    """How far the fist goes beyond the closed door [rad or m] if nothing stops it."""
    if not work.scene.pose_error_m:
        return PUSH.beyond
    return work.scene.pose_error_m if door.kind == "slide" else _SHUT.unsure_rad


def _push_home(
    work: Work, door: Door, course: Course, start: CourseStart, side: Side, idle: Side | None
) -> Generator[Array, None, bool]:
    motion, way = work.motion, door.position + _beyond(work, door)
    unsure = work.scene.pose_error_m > 0
    held_up, left = 0, door.position

    def shut(x: float) -> bool:  # a shut door resists; to go on pushing would only shove the robot back
        nonlocal held_up, left
        if not unsure:
            return x > _SHUT.nearly and resistance(motion, side) > _SHUT.exact_m
        held_up = held_up + 1 if resistance(motion, side) > _SHUT.stopped_m and x > _SHUT.moving else 0
        left = door.position - way * x
        return held_up >= _SHUT.stopped_steps

    def push() -> Actions:
        yield from touch(work, course, side, until_contact=unsure)
        yield from go_along(motion, course, side, start.torso_after, shut, FOLLOW.pushing if unsure else 1.0)

    yield from motion.grip(side, -1.0, GRIP.empty_s)
    yield from take_up(work, start, side, idle)
    yield from then_leave(work, side, push(), _to_hinge(door))
    return held_up >= _SHUT.stopped_steps and left < _SHUT.home * way


def _to_hinge(door: Door) -> Array:
    """(2,) along a closed door from its free edge, where bars are, to its hinge; zero where none is upright."""
    if not upright(door):
        return np.zeros(2)
    shut = moved(door, -door.position)
    way = (door.origin - matmul(shut[:3, :3], _edge(door)) - shut[:3, 3])[:2]
    return np.asarray(_SHUT.aslant * way / norm(way))
