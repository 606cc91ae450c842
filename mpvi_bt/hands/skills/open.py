"""Open a door, a drawer or a lid by its bar."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.shapes.moving_parts import Bar, Door, lid, moved, outward, panel, upright
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.approach import going_around
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.door_views import look_beside, seen_twice, stand_before, stands_as
from mpvi_bt.hands.motion.follow import FOLLOW, back_out, go_along, take_up, touch
from mpvi_bt.hands.motion.viewpoints import look_over
from mpvi_bt.hands.motion.work import LIFTED_M, Words, Work
from mpvi_bt.hands.skills.bar_courses import swings
from mpvi_bt.hands.skills.openings import doors_meant, thing_meant
from mpvi_bt.hands.stance.course import AROUND_M, Course, CourseSearch, CourseStart


@dataclass(frozen=True)
class Opening:
    """How far doors, drawers and lids are opened, and when they are open.

    Our choice: enough to reach in. The widest comes first; there may be no room for it.
    """

    upright_rad: tuple[float, ...] = (1.5, 1.3, 1.1, 0.9)  # openings of doors with an upright hinge [rad]
    # openings of flaps with a hinge below [rad]; any farther the bar is out of reach to close it again
    flap_rad: tuple[float, ...] = (1.2, 1.0)
    # openings of flaps with a hinge above [rad]; above its opening a flap is in nobody's way
    rising_rad: tuple[float, ...] = (1.6, 1.4, 1.2)
    lid_rad: tuple[float, ...] = (1.5, 1.3, 1.1)  # openings of lids on top [rad]; farther, no hand gets behind it
    slide_m: tuple[float, ...] = (0.3, 0.24)  # openings of drawers [m]
    enough: float = 0.8  # part of the least of these, or of a smaller limit, from which a door is open [ratio]
    views: int = 3  # views that have to agree that a door is open already
    same_bar_m: float = 0.06  # a bar seen this close to where it was has not moved [m]
    deep_m: float = 0.3  # depth assumed behind a front of which only the front was seen [m]
    behind_m: float = 0.015  # distance of that room from the middle of the front [m]


_OPEN = Opening()
_BACK_OFF_M = 0.25  # our choice: that the base backs off afterward, so that the arm has room to fold


def open_(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Open what `words["object"]` names: a thing that has one door, or one of its doors, such as its top drawer.

    Of several alike the one is meant that has `words["content"]` in it, if that is said and known.

    Args:
        work: Robot and world.
        words: Of the skill call.
        tried: Base poses that did not do; the one taken is added.

    Raises:
        MotionFailure: "unknown_object", "no_door", "no_handle", "hands_full", "no_stance", "closed_empty", "slipped",
            "not_opened", or a motion's own reason.
    """
    thing, places = thing_meant(work, words["object"], content=words.get("content"))
    yield from look_over(work, thing)
    doors = doors_meant(work, thing, places)
    for _ in range(_OPEN.views):
        if not (open_ := [door for door in doors if is_open(door)]):
            break
        if (yield from seen_twice(work, thing, open_[:1])):
            return
        doors = doors_meant(work, thing, places)
    able = [door for door in doors if door.bar is not None]
    if not able:
        raise MotionFailure("no_handle")
    door = able[0]
    if work.scene.needs_looks and upright(door):
        yield from look_beside(work, door)
        yield from look_over(work, thing)
        door = next((d for d in work.scene.doors(thing) if d.bar is not None and stands_as(d, door)), door)
    to = [min(t, door.limit) for t in targets(door)]
    yield from going_around(work, thing, lambda: swing(work, thing, door, to, tried, words.get("hand")))
    if not work.scene.needs_looks:
        opened = any(is_open(d) for d in work.scene.doors(thing) if d.name == door.name)
    else:  # the hand has felt the bar to the end, and knows better than a look from aside; but not if it is still there
        yield from look_over(work, thing)
        opened = not any(_as_before(d, door) for d in work.scene.doors(thing))
    if not opened:
        raise MotionFailure("not_opened")


def _as_before(now: Door, before: Door) -> bool:
    """Whether a bar is seen where it was, on what is seen to be as it was."""
    if now.bar is None or before.bar is None:
        return False
    same = float(norm(now.bar.center - before.bar.center)) < _OPEN.same_bar_m
    return same and abs(now.position - before.position) < (1 - _OPEN.enough) * before.limit


def targets(door: Door) -> tuple[float, ...]:
    """How far to open it [rad or m], the most first."""
    if door.kind == "slide":
        return _OPEN.slide_m
    if upright(door) or lid(door):
        return _OPEN.upright_rad if upright(door) else _OPEN.lid_rad
    return _OPEN.rising_rad if door.origin[2] > panel(door).T[2, 3] else _OPEN.flap_rad


def is_open(door: Door) -> bool:
    """Whether it is clearly open: enough to take things out."""
    least = min(targets(door)[-1], _OPEN.enough * door.limit)
    return door.position >= _OPEN.enough * least


def swing(
    work: Work, thing: str, door: Door, to: Sequence[float], tried: list[Array], hand: str | None = None
) -> Generator[Array, None, None]:
    """Take a door by its bar, bring it to the first of the positions `to` that can be done, let go, back off, fold.

    Raises:
        MotionFailure: As `open_` says.
    """
    motion, bar = work.motion, door.bar
    assert bar is not None
    for target in to:
        found = _beginning(work, thing, door, bar, target, tried, hand)
        if found is not None:
            break
    else:
        yield from stand_before(work, thing, panel(door).T[:3, 3], outward(door), door)
        raise work.no_stance()
    side, start, course, search = found
    tried.append(start.base)
    yield from motion.grip(side, 1.0, GRIP.ready_s)
    yield from take_up(work, start, side, search.other)
    yield from then_leave(work, side, _lead(work, course, side, start.torso_after))


def _lead(work: Work, course: Course, side: Side, torso_after: Array) -> Actions:
    def lost(x: float) -> bool:
        if not work.gripped(side):
            raise MotionFailure("slipped")
        return False

    yield from touch(work, course, side)
    yield from work.motion.grip(side, -1.0, GRIP.firm_s)
    yield from work.motion.wait(0.15)
    if not work.gripped(side):
        raise MotionFailure("closed_empty")
    yield from go_along(work.motion, course, side, torso_after, lost)


def then_leave(work: Work, side: Side, doing: Actions, aside: Array | None = None) -> Actions:
    """Do something with a hand; then, whether it went well or not, let go, draw the hand back, the base too, and fold.

    Args:
        work: Robot and world.
        side: The hand.
        doing: What it does.
        aside: For a fist, which stays closed until it is folded: (2,) what is added to the unit vector that it draws
            back along, to keep it clear of the bar, which it would take along.

    Raises:
        MotionFailure: As `doing`, or else as the way back.
    """
    motion = work.motion
    failures: list[MotionFailure] = []
    yield from _trying(doing, failures)
    if aside is None:
        yield from motion.grip(side, 1.0, GRIP.empty_s)
    else:
        motion.action[motion.layout.arm[side]] = motion.felt.arm[side]  # presses no more
    away = -matmul(work.base, motion.hand(side))[:2, 2]
    if (length := float(norm(away))) > FOLLOW.level:
        yield from _trying(back_out(motion, away / length + (0.0 if aside is None else aside), FOLLOW.off_m), failures)
    else:
        yield from _trying(_rise_off(work, side), [])
    yaw = motion.felt.base_pose[2]
    yield from _trying(back_out(motion, -np.array([np.cos(yaw), np.sin(yaw)]), _BACK_OFF_M), [])  # as far as it goes
    yield from _trying(settle(work), failures)
    if failures:
        raise failures[0]


def _rise_off(work: Work, side: Side) -> Actions:
    """Raise a hand off the bar of a lid, with the torso where the arm is at its end: it would draw the lid shut."""
    try:
        yield from work.rise(side, shares=(1.0,))
    except MotionFailure as failure:
        if failure.reason != "no_reach":
            raise
        lift = min(work.motion.posture[0] + LIFTED_M, work.motion.robot.trunk.limits[0, 1])
        yield from work.motion.stand(work.motion.bent(lift=lift))


def _trying(doing: Actions, failures: list[MotionFailure]) -> Actions:
    try:
        yield from doing
    except MotionFailure as failure:
        failures.append(failure)


def _beginning(
    work: Work, thing: str, door: Door, bar: Bar, to: float, tried: Sequence[Array], hand: str | None
) -> tuple[Side, CourseStart, Course, CourseSearch] | None:
    courses = swings(door, bar, to)
    for side in sides(work, door, thing, hand):
        search = course_search(work, thing, door, side, tried, bendable=not upright(door) and door.kind == "hinge")
        start = search.start(courses)
        if start is not None:
            return side, start, courses[start.course], search
    return None


def sides(work: Work, door: Door, thing: str, hand: str | None) -> list[Side]:
    """Free hands, the one on the free edge's side of a hinge first: it does not have to reach across."""
    free = work.free_hands(thing, hand)
    if upright(door):
        shut, face = moved(door, -door.position), panel(door)
        toward_edge = matmul(shut[:3, :3], face.T[:3, 3]) + shut[:3, 3] - door.origin
        # A door whose axis points up opens toward someone for whom the free edge lies to the left of the hinge.
        outward = np.cross(door.axis, toward_edge)
        rightward = np.cross([0.0, 0.0, 1.0], outward)
        best: Side = "right" if float(matmul(toward_edge, rightward)) > 0 else "left"
        free.sort(key=lambda s: s != best)
    return free


def course_search(
    work: Work, thing: str, door: Door, side: Side, tried: Sequence[Array], bendable: bool = False
) -> CourseSearch:
    """A search of where to begin a course that leads a door along."""
    inside = set(work.scene.within(thing)) if door.kind == "slide" else set()
    without = work.carried() | inside | {thing}
    at = work.motion.felt.base_pose[:2]
    with work.scene.trusting(remembering=True):  # the way leads back and aside, of which little is in view
        near = work.scene.obstacles(at, AROUND_M, without)
    if not work.scene.needs_looks:
        parts = list(work.scene.solids(thing))
    else:
        parts = [s for d in work.scene.doors(thing) for s in (*d.solids, behind(d))]
    stays = [s for s in parts if not any(_alike(s, moving) for moving in door.solids)]
    held = work.held()
    near = work.with_bumps(near)
    return CourseSearch(
        work.motion,
        side,
        held,
        near,
        parts,
        work.rng,
        list(tried),
        work.effort,
        stays,
        bendable,
        refusals=work.refusals,
    )


def _alike(a: Solid, b: Solid) -> bool:
    return np.allclose(a.T, b.T, atol=1e-4) and np.allclose(a.half_m, b.half_m)


def behind(door: Door) -> Solid:
    """What is taken to be behind a front when it is closed."""
    face = panel(door).moved(moved(door, -door.position))
    through = int(np.argmin(face.half_m))
    half = face.half_m.copy()
    half[through] = _OPEN.deep_m / 2
    T = face.T.copy()
    normal = matmul(moved(door, -door.position)[:3, :3], outward(door))
    T[:3, 3] -= normal * (_OPEN.deep_m / 2 + _OPEN.behind_m)
    return Solid("box", half, T)
