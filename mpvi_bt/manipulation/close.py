"""Close a door, a drawer or a lid: push its face home with the fist, or bring it home by its bar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.manipulation.course import Course, Start
from mpvi_bt.manipulation.follow import go_along, resistance, take_up, touch
from mpvi_bt.manipulation.open import course_search, sides, swing, then_leave
from mpvi_bt.manipulation.openings import doors_meant, look_from_aside, look_over, moved, panel, thing_meant, upright
from mpvi_bt.manipulation.work import Words, Work
from mpvi_bt.perception.parts import Door
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.motion import Actions, MotionFailure
from mpvi_bt.robot.protocol import Side
from mpvi_bt.robot.solids import Array, Solid

_CLOSED = 0.03  # of its limit
_MOST_DOORS = 8
_FIST_M = 0.012  # the fingertips are that far before the tcp
_SHORT_M = 0.10
_TURNS = (0.5, 0.75, 0.3, 0.9)
_BESIDE_M = 0.09  # from the bar's end, or from its axis, to the middle of the fist
_INSET_M = (0.07, 0.12, 0.2)  # from the free edge
_NEARLY = 0.85  # of the way
_SHUT_M = 0.010
_BEYOND_RAD = 0.03  # the fist goes on that far: arms give way
_UNSURE, _UNSURE_RAD = 0.6, 0.2  # likewise, if the door's place is only seen


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
    thing, places = thing_meant(work, words["object"])
    yield from look_over(work, thing)
    yield from look_from_aside(work, thing)
    for _ in range(_MOST_DOORS):
        ajar = [d for d in doors_meant(work, thing, places) if not is_closed(d)]
        if not ajar:
            return
        yield from _shut(work, thing, ajar[0], tried, words.get("hand"))
        yield from look_over(work, thing)
        left = [d for d in doors_meant(work, thing, places) if not is_closed(d)]
        if len(left) >= len(ajar):
            raise MotionFailure("not_closed")


def is_closed(door: Door) -> bool:
    """Whether it is closed."""
    return door.position < _CLOSED * door.limit


def _shut(work: Work, thing: str, door: Door, tried: list[Array], hand: str | None) -> Actions:
    if upright(door):
        # How far it stands open is only seen: the fist goes on until it feels the door shut.
        courses = pushes(door, _BEYOND_RAD if work.sight is None else _UNSURE_RAD)
        for side in sides(work, door, thing, hand):
            search = course_search(work, thing, door, side, tried)
            start = search.start(courses)
            if start is None:
                continue
            tried.append(start.base)
            yield from _push_home(work, courses[start.course], start, side, search.other)
            return
    if door.bar is None:
        raise MotionFailure("no_stance")
    yield from swing(work, thing, door, [0.0], tried, hand)


def _push_home(work: Work, course: Course, start: Start, side: Side, idle: Side | None) -> Actions:
    motion = work.motion

    def shut(x: float) -> bool:  # a shut door resists; to go on pushing would only shove the robot back
        nearly = _NEARLY if work.sight is None else _UNSURE
        return x > nearly and resistance(motion, side) > _SHUT_M

    def push() -> Actions:
        yield from touch(work, course, side)
        yield from go_along(motion, course, side, start.torso_after, shut)

    yield from motion.grip(side, -1.0, 0.3)
    yield from take_up(work, start, side, idle)
    yield from then_leave(work, side, push())


def pushes(door: Door, beyond_rad: float = 0.03) -> list[Course]:
    """Ways to push an upright door shut with the fist, on its outer face near the free edge, clear of its bar.

    Args:
        door: As it stands.
        beyond_rad: How far beyond the closed door the fist goes if nothing stops it: arms give way.
    """
    face, shut = panel(door), moved(door, -door.position)
    axes, half = face.T[:3, :3], face.half_m
    up = int(np.abs(door.axis @ axes).argmax())
    through = int(np.argmin(np.where(np.arange(3) == up, np.inf, half)))
    wide = 3 - up - through
    center = face.T[:3, 3]
    away = axes[:, wide] * np.sign(float((center - door.origin) @ axes[:, wide]))  # from the hinge to the free edge
    # Opening moves the free edge toward the outer side.
    outer = np.cross(door.axis, away)
    outward = axes[:, through] * np.sign(float(axes[:, through] @ outer))
    rise = axes[:, up] * np.sign(axes[2, up])
    out = []
    for inset in _INSET_M:
        for height, bias in _heights(door, center, rise, float(half[up])):
            point = center + away * (half[wide] - inset) + rise * height + outward * half[through]
            if inset >= half[wide] * 1.5:
                continue
            if door.bar is not None and _near_bar(door, point):
                continue
            for turn in _TURNS:
                for flip in (1.0, -1.0):
                    straight = kin.hand_rotation(-(shut[:3, :3] @ outward), flip * np.cross(rise, outward))
                    cost = 1.5 * abs(turn - 0.5) + 3.0 * (inset - _INSET_M[0]) + bias
                    out.append(_push(door, point, straight, turn, beyond_rad, cost))
    return out


def _heights(door: Door, center: Array, rise: Array, half: float) -> list[tuple[float, float]]:
    """Heights [m] on the panel, from its middle, with their costs: beyond the bar's ends first."""
    at, reach = 0.0, 0.0
    if door.bar is not None:
        at, reach = float((door.bar.center - center) @ rise), door.bar.length_m / 2 + _BESIDE_M
    wanted = [at + reach, at - reach, at + reach + 0.1, at - reach - 0.1, at, 0.0]
    return [(h, 0.1 * k) for k, h in enumerate(dict.fromkeys(wanted)) if abs(h) < half - 0.04]


def _near_bar(door: Door, point: Array) -> bool:
    bar = door.bar
    assert bar is not None
    off = point - bar.center
    beyond = max(0.0, abs(float(off @ bar.axis)) - bar.length_m / 2)
    flat = off - bar.axis * float(off @ bar.axis) - bar.outward * float(off @ bar.outward)
    return bool(np.hypot(beyond, max(0.0, float(np.linalg.norm(flat)) - 0.06)) < _BESIDE_M - 0.03)


def _push(door: Door, point: Array, straight: Array, turn: float, beyond: float, cost: float) -> Course:
    start = door.position

    def hand(x: float) -> Array:
        at = start - (start + beyond) * x
        R = Rotation.from_rotvec(door.axis * turn * at).as_matrix() @ straight
        T = moved(door, at - start)
        return kin.transform(R, T[:3, :3] @ point + T[:3, 3] - _FIST_M * R[:, 2])

    def carry(x: float) -> Array:
        R = kin.rot_z(-float(np.sign(door.axis[2])) * turn * (start + beyond) * x)
        return kin.transform(R, (hand(x)[:3, 3] - R @ hand(0.0)[:3, 3]) * [1.0, 1.0, 0.0])

    def moving(x: float) -> Sequence[Solid]:
        T = moved(door, -start * x)
        return [s.moved(T) for s in door.solids]

    before = hand(0.0)
    before[:3, 3] -= _SHORT_M * before[:3, 2]
    return Course(before, hand, carry, moving, float(np.arctan2(before[1, 2], before[0, 2])), cost)
