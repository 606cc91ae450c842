"""Close a door, a drawer or a lid: push its face home with the fist, or bring it home by its bar."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from mpvi_bt.manipulation.motion.follow import FOLLOW, go_along, resistance, take_up, touch
from mpvi_bt.manipulation.motion.work import AJAR, Words, Work
from mpvi_bt.manipulation.skills.open import course_search, sides, swing, then_leave
from mpvi_bt.manipulation.skills.openings import (
    doors_meant,
    lid,
    look_from_aside,
    look_over,
    moved,
    outward,
    panel,
    seen_twice,
    stand_before,
    stand_before_front,
    thing_meant,
    turned,
    upright,
)
from mpvi_bt.manipulation.stance.course import SHORT_M, Course, Start
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.hand import Hand
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.robot.protocol import Side
from mpvi_bt.robot.solids import Array, Solid
from mpvi_bt.shapes.moving_parts import Door


@dataclass(frozen=True)
class Shutting:
    """When a door is closed, by sight and by what the fist feels that pushes it.

    Our choice. In an exact scene contact only confirms that a door is shut. Where a door is only seen, place and angle
    are off, and the fist goes on until something stops it.

    Attributes:
        doors: Doors that one call closes, at the most.
        closed: A door that is open by less counts as closed [ratio of its limit].
        facing: Cosine between the outward directions of two fronts that are on the same side of a thing.
        same_m: A door whose middle is still this near to where it was has not moved [m].
        nearly: In an exact scene, progress of the push from which the door may be shut [ratio].
        exact_m: There, how far a door that is shut holds the fist off its target [m].
        beyond: There, how far past the closed position that target is [rad or m]: arms give way.
        unsure_rad: For a hinged door that is only seen, how far past the closed position the target is [rad],
        unsure_m: and for a drawer that is only seen [m].
        moving: Progress from which a door that is only seen may be shut [ratio]: it resists as it begins to move, too.
        stopped_m: How far such a door, once shut, holds the fist off its target [m],
        stopped_steps: for so many control steps in a row.
        home: Part of the way that may be left where a door stops that counts as brought home [ratio].
        aslant: Sideways part of the fist's retreat, toward the hinge, to keep clear of the bar [tangent].
    """

    doors: int = 8
    closed: float = 0.03
    facing: float = 0.7
    same_m: float = 0.1
    nearly: float = 0.85
    exact_m: float = 0.010
    beyond: float = 0.03
    unsure_rad: float = 0.2
    unsure_m: float = 0.06
    moving: float = 0.15
    stopped_m: float = 0.02
    stopped_steps: int = 3
    home: float = 0.1
    aslant: float = 0.6


_SHUT = Shutting()


@dataclass(frozen=True)
class PushPoints:
    """Where on a face, and how, the fist pushes it.

    Our choice: near the free edge, where least force is needed, and clear of the bar.

    Attributes:
        inset_m: Distances of the fist from the free edge [m].
        unseen_m: The same where the bar is hidden [m]: farther in than bars are.
        lid_m: The same on a lid, where a finger lies along the face and the palm has to stay beyond the edge [m].
        widest: Largest inset [ratio of half the face's width].
        inset_cost: Cost of each meter of inset beyond the first.
        edge_m: Clearance from the upper and the lower edge [m].
        beside_m: Distance from the end of the bar to the middle of the fist [m],
        spare_m: which may be less by this [m]
        across_m: and has to be more by this, from the bar's axis: a fist is broader across the bar [m].
        step_m: Distance from a height beyond the bar's end to the next one, which is safer still [m].
        height_cost: Added cost of each next height.
        off_middle: Heights to push at where no bar is known, off the middle, where bars are [ratio of half the height].
        aside: Where to push a drawer, sideways from its middle, to keep clear of its bar [ratio of half its width],
        below: and up from its middle [ratio of half its height].
        turns: How far the hand turns along with the door [ratio of its angle]: at half, base and arm share the turning.
        turn_cost: Cost of each unit off the first of these.
        leans_rad: Leans along the hinge of a hand that pushes a lid down [rad].
        lean_cost: Cost of each radian of it.
        courses: Courses that are looked at, the cheapest first.
    """

    inset_m: tuple[float, ...] = (0.07, 0.12, 0.2)
    unseen_m: tuple[float, ...] = (0.18, 0.24)
    lid_m: tuple[float, ...] = (0.03, 0.045)
    widest: float = 1.5
    inset_cost: float = 3.0
    edge_m: float = 0.04
    beside_m: float = 0.09
    spare_m: float = 0.03
    across_m: float = 0.06
    step_m: float = 0.1
    height_cost: float = 0.1
    off_middle: tuple[float, ...] = (0.6, -0.6)
    aside: tuple[float, ...] = (0.4, -0.4, 0.6, -0.6, 0.0)
    below: tuple[float, ...] = (0.0, -0.3)
    turns: tuple[float, ...] = (0.5, 0.75, 0.3, 0.9)
    turn_cost: float = 1.5
    leans_rad: tuple[float, ...] = (0.0, 0.5, -0.5, 1.0, -1.0)
    lean_cost: float = 0.3
    courses: int = 48


_PUSH = PushPoints()


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
        felt = yield from _shut(work, thing, ajar[0], tried, words.get("hand"))
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
    if not work.scene.exact or upright(door) or lid(door):
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
    if work.scene.exact:
        return _SHUT.beyond
    return _SHUT.unsure_m if door.kind == "slide" else _SHUT.unsure_rad


def _push_home(
    work: Work, door: Door, course: Course, start: Start, side: Side, idle: Side | None
) -> Generator[Array, None, bool]:
    motion, way = work.motion, door.position + _beyond(work, door)
    held_up, left = 0, door.position

    def shut(x: float) -> bool:  # a shut door resists; to go on pushing would only shove the robot back
        nonlocal held_up, left
        if work.scene.exact:
            return x > _SHUT.nearly and resistance(motion, side) > _SHUT.exact_m
        held_up = held_up + 1 if resistance(motion, side) > _SHUT.stopped_m and x > _SHUT.moving else 0
        left = door.position - way * x
        return held_up >= _SHUT.stopped_steps

    def push() -> Actions:
        yield from touch(work, course, side, until_contact=not work.scene.exact)
        yield from go_along(motion, course, side, start.torso_after, shut, 1.0 if work.scene.exact else FOLLOW.pushing)

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


def pushes(hand: Hand, door: Door, beyond: float = _SHUT.beyond) -> list[Course]:
    """Ways to push a door, a flap or a drawer shut with the fist, on its outer face, clear of its bar.

    What turns is pushed near its free edge, what slides anywhere.

    Args:
        hand: What pushes.
        door: As it stands.
        beyond: How far beyond the closed door the fist goes [rad or m] if nothing stops it: arms give way.
    """
    face, shut, out_of = panel(door), moved(door, -door.position), outward(door)
    axes, half = face.T[:3, :3], face.half_m
    through = int(np.abs(matmul(out_of, axes)).argmax())
    rising = -np.abs(axes[2]) if door.kind == "slide" else -np.abs(matmul(door.axis, axes))
    up = int(np.where(np.arange(3) == through, 1.0, rising).argmin())
    wide = 3 - up - through
    center = face.T[:3, 3]
    away = axes[:, wide]
    if door.kind == "hinge":
        away = away * np.sign(float(matmul(center - door.origin, away)))  # from the hinge to the free edge
    rise = axes[:, up] * (1.0 if axes[2, up] >= 0 else -1.0)
    out = []
    for point, bias in _points(door, center, away, rise, float(half[wide]), float(half[up])):
        point = point + out_of * half[through]
        if door.bar is not None and _near_bar(door, point):
            continue
        if lid(door):
            out += [_push(hand, door, point, R, 0.0, beyond, more + bias) for R, more in _from_above(door)]
            continue
        for turn in _PUSH.turns if door.kind == "hinge" else (0.0,):
            for flip in (1.0, -1.0):
                straight = kin.hand_rotation(-matmul(shut[:3, :3], out_of), flip * np.cross(rise, out_of))
                cost = _PUSH.turn_cost * abs(turn - _PUSH.turns[0]) + bias
                out.append(_push(hand, door, point, straight, turn, beyond, cost))
    return sorted(out, key=lambda course: course.cost)[: _PUSH.courses]


def _from_above(door: Door) -> Iterator[tuple[Array, float]]:
    """Rotations (3, 3) of a fist that goes down with a lid as it is, the fingertips side by side, with their costs."""
    up = matmul(moved(door, -door.position)[:3, :3], outward(door))
    for lean in _PUSH.leans_rad:
        approach, along = np.sin(lean) * door.axis - np.cos(lean) * up, np.cos(lean) * door.axis + np.sin(lean) * up
        for flip in (1.0, -1.0):
            yield kin.hand_rotation(approach, flip * along), _PUSH.lean_cost * abs(lean)


def _points(door: Door, center: Array, away: Array, rise: Array, wide: float, high: float) -> list[tuple[Array, float]]:
    """Points [m] in the middle plane of a panel to push it at, with their costs."""
    if door.kind == "slide":
        places = product(_PUSH.aside, _PUSH.below)
        return [(center + away * u * wide + rise * v * high, abs(u) / 10 + abs(v)) for u, v in places]
    out = [
        (center + away * (wide - inset) + rise * height, _PUSH.inset_cost * (inset - _insets(door)[0]) + bias)
        for inset in _insets(door) if inset < wide * _PUSH.widest
        for height, bias in _heights(door, center, rise, high)
    ]  # fmt: skip
    if door.bar is None and upright(door):  # bars are about the middle of an edge
        out += [
            (center + away * (wide - inset) + rise * v * high, _PUSH.inset_cost * (inset - _PUSH.inset_m[0]))
            for inset in _PUSH.inset_m[:2] for v in _PUSH.off_middle if inset < wide * _PUSH.widest
        ]  # fmt: skip
    return out


def _insets(door: Door) -> tuple[float, ...]:
    if lid(door):
        return _PUSH.lid_m
    return _PUSH.inset_m if door.bar is not None else _PUSH.unseen_m


def _heights(door: Door, center: Array, rise: Array, half: float) -> list[tuple[float, float]]:
    """Heights [m] on the panel, from its middle, with their costs: beyond the bar's ends first."""
    at, reach = 0.0, 0.0
    if door.bar is not None:
        at, reach = float(matmul(door.bar.center - center, rise)), door.bar.length_m / 2 + _PUSH.beside_m
    wanted = [at + reach, at - reach, at + reach + _PUSH.step_m, at - reach - _PUSH.step_m, at, 0.0]
    return [(h, _PUSH.height_cost * k) for k, h in enumerate(dict.fromkeys(wanted)) if abs(h) < half - _PUSH.edge_m]


def _near_bar(door: Door, point: Array) -> bool:
    bar = door.bar
    assert bar is not None
    off = point - bar.center
    beyond = max(0.0, abs(float(matmul(off, bar.axis))) - bar.length_m / 2)
    flat = off - bar.axis * float(matmul(off, bar.axis)) - bar.outward * float(matmul(off, bar.outward))
    return bool(np.hypot(beyond, max(0.0, float(norm(flat)) - _PUSH.across_m)) < _PUSH.beside_m - _PUSH.spare_m)


def _push(shape: Hand, door: Door, point: Array, straight: Array, turn: float, beyond: float, cost: float) -> Course:
    start, face = door.position, outward(door)

    def hand(x: float) -> Array:
        at = start - (start + beyond) * x
        R = straight
        if door.kind == "hinge":
            R = matmul(turned(door.axis, turn * at), straight)
        T = moved(door, at - start)
        out = matmul(T[:3, :3], face)
        aside = shape.finger_half_m * float(norm(np.cross(out, R[:, 2])))  # a finger that lies along the face
        return kin.transform(R, matmul(T[:3, :3], point) + T[:3, 3] - shape.tip_m * R[:, 2] + aside * out)

    before = hand(0.0)
    touched = before[:3, 3].copy()

    def carry(x: float) -> Array:
        yaw = -float(np.sign(door.axis[2])) * turn * (start + beyond) * x if upright(door) else 0.0
        R = kin.rot_z(yaw)
        return kin.transform(R, (hand(x)[:3, 3] - matmul(R, touched)) * [1.0, 1.0, 0.0])

    def moving(x: float) -> Sequence[Solid]:
        T = moved(door, -start * x)
        return [s.moved(T) for s in door.solids]

    before[:3, 3] -= SHORT_M * before[:3, 2]
    return Course(before, hand, carry, moving, float(np.arctan2(before[1, 2], before[0, 2])), cost)
