"""Push a thing along what it stands on, with the open hand behind it: two fingertips keep it from turning away."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.collision import Surroundings, covering_spheres
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.follow import FOLLOW, go_along, resistance, take_up, touch
from mpvi_bt.hands.motion.gaze import study
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.skills.open import then_leave
from mpvi_bt.hands.stance.course import AROUND_M, SHORT_M, Course, CourseSearch, CourseStart


@dataclass(frozen=True)
class Pushing:
    """How far a thing is pushed, and when the push is over.

    Our choice, by errors of sight and by how far arms give way.
    """

    far_m: float = 0.30  # length of a push without a given one [m]
    least: float = 0.5  # part of it that counts as pushed [ratio]
    gap_m: float = 0.02  # a thing this close to its goal need not be pushed [m]
    unsure_m: float = 0.05  # possible error in the place of the thing that it is pushed up to [m]
    step_m: float = 0.01  # distance between two checks of where the two meet [m]
    stuck_m: float = 0.04  # distance that a stuck thing holds the hand off its target [m]
    met_m: float = 0.02  # the same for a thing that has met its goal [m]


_PUSHING = Pushing()


@dataclass(frozen=True)
class Fingertips:
    """Where and how fingertips push a thing.

    Our choice: level and low, so that it does not tip over and is not in the hand's way.
    """

    # heights to push at, in this order [ratio of the thing's height]
    heights: tuple[float, ...] = (0.35, 0.5, 0.65, 0.2, 0.1, 0.8, 0.95)
    height_cost: float = 0.15  # added cost of each next height
    lowest_m: float = 0.03  # least height above the support of the thing [m]
    toppling: float = 1.5  # cost of pushing twice as high as the thing is deep, none up to once; it may tip over
    most_toppling: float = 2.0  # that cost is counted up to this many times
    apart: float = 0.6  # distance between two fingertips, so that the thing does not turn or slip [ratio of its width]
    droops_rad: tuple[float, ...] = (0.0, 0.4, 0.8, 1.1, 1.4)  # downward tilts of the hand [rad]
    # downward tilts behind a thin thing, where a level hand has no room above the support [rad]
    steep_rad: tuple[float, ...] = (1.1, 1.4)
    droop_cost: float = 0.3  # cost of each radian of tilt
    standing_cost: float = 0.6  # cost of pushing with the arm alone, the base standing
    sample_m: float = 0.0025  # distance between the points that find where the solids begin and end [m]


_TIPS = Fingertips()
# Of the direction that a prompt says, from the one away from the robot [rad].
_TURNS = {"away": 0.0, "forward": 0.0, "left": np.pi / 2, "right": -np.pi / 2, "aside": np.pi / 2, "backward": np.pi}


@dataclass(frozen=True, eq=False)
class Push(Course):
    """A course of fingertips behind a thing.

    Attributes:
        opening_m: Between the fingers.
    """

    opening_m: float = math.inf


def push(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Push what `words["object"]` names up to `words["target"]`, or toward `words["direction"]` as the robot sees it.

    Without either it is pushed away.

    Args:
        work: Robot and world.
        words: Of the skill call.
        tried: Base poses that did not do; those taken are added.

    Raises:
        MotionFailure: "unknown_object", "hands_full", "no_stance", "not_moved", or a motion's own reason.
    """
    name = work.nearest(words["object"])
    yield from study(work, name)
    before = work.middle(name)[:2]
    way, near = _way(work, name, words)
    length = float(norm(way))
    if length < _PUSHING.gap_m:
        return
    side, start, course, search = _beginning(work, name, way, tried, words.get("hand"))
    motion = work.motion

    def stuck(x: float) -> bool:
        met = x * length >= near - _PUSHING.unsure_m
        return resistance(motion, side) > (_PUSHING.met_m if met else _PUSHING.stuck_m)

    def going() -> Actions:
        yield from touch(work, course, side, until_contact=True)
        yield from go_along(motion, course, side, start.torso_after, stuck, FOLLOW.pushing)

    tried.append(start.base)
    yield from motion.grip(side, motion.robot.hand.command(course.opening_m), GRIP.preset_s)
    yield from take_up(work, start, side, search.other)
    yield from then_leave(work, side, going())
    yield from study(work, name)
    least = near - _PUSHING.unsure_m if "target" in words else _PUSHING.least * length
    if float(matmul(work.middle(name)[:2] - before, way)) / length < least:
        raise MotionFailure("not_moved")


def _way(work: Work, name: str, words: Words) -> tuple[Array, float]:
    """(2,) where to, from where the thing is, and after how much of it it may meet something [m].

    What is pushed up to a target may reach under it, as a chair's seat under a table: how far is felt. But what is
    light, such as a mouse beside a keyboard, is not felt: it would be pushed along.
    """
    at, here = work.middle(name)[:2], work.motion.felt.base_pose
    if "target" in words:
        goal = list(work.scene.solids(work.nearest(words["target"])))
        target = bounds(goal)[:, :2]
        toward = np.clip(at, target[0], target[1]) - at
        far = float(norm(toward))
        if far < 1e-6:
            return np.zeros(2), 0.0  # it is there already
        toward /= far
        solids = work.scene.solids(name)
        whole, near = far + _reach(solids, -toward, at), far - _reach(solids, toward, at)
        return toward * min(whole, _meets(solids, goal, toward, whole) + _PUSHING.unsure_m), near
    bearing = float(np.arctan2(at[1] - here[1], at[0] - here[0])) + _TURNS[words.get("direction", "away")]
    # Left stays left, from wherever it is tried again.
    bearing = work.bearings.setdefault(f"{name}: {words.get('direction')}", bearing)
    return _PUSHING.far_m * np.array([np.cos(bearing), np.sin(bearing)]), np.inf


def _meets(solids: Sequence[Solid], others: Sequence[Solid], toward: Array, length: float) -> float:
    """How far solids go along a direction (2,), `length` [m] at the most, until they meet others."""
    centers, radii = covering_spheres(solids)
    steps = np.arange(0.0, length, _PUSHING.step_m)
    away = Surroundings(others).distance(centers + steps[:, None, None] * np.append(toward, 0.0))
    met = (away < radii).any(1)
    return float(steps[met.argmax()]) if met.any() else length


def _reach(solids: Sequence[Solid], toward: Array, at: Array) -> float:
    """How far solids reach from a place (2,) along a direction (2,)."""
    d = np.append(toward, 0.0)
    return max(
        float(matmul(d, s.T[:3, 3] - [*at, 0.0]) + matmul(np.abs(matmul(d, s.T[:3, :3])), s.half_m)) for s in solids
    )


def _beginning(
    work: Work, name: str, way: Array, tried: list[Array], hand: str | None
) -> tuple[Side, CourseStart, Push, CourseSearch]:
    courses = pushes(work.motion.robot.hand, work.scene.solids(name), way)
    at, here = work.middle(name)[:2], work.motion.felt.base_pose
    bearing = float(np.arctan2(at[1] - here[1], at[0] - here[0]))
    ahead = float(np.arctan2(way[1], way[0]))
    for heading in (ahead, bearing, ahead + np.pi / 2, ahead - np.pi / 2, ahead + np.pi):
        for side in work.free_hands(name, hand):
            search = _search(work, name, side, tried)
            facing = [replace(c, heading=heading) for c in courses]
            start = search.start(facing)
            if start is not None:
                return side, start, facing[start.course], search
    raise work.no_stance()


def _search(work: Work, name: str, side: Side, tried: list[Array]) -> CourseSearch:
    moved = work.along(name)
    near = work.scene.obstacles(work.motion.felt.base_pose[:2], AROUND_M, without=work.carried().union(moved))
    touched = [s for n in moved for s in work.scene.solids(n)]
    return CourseSearch(
        work.motion, side, work.held(), near, touched, work.rng, list(tried), work.effort, refusals=work.refusals
    )


def pushes(hand: Hand, solids: Sequence[Solid], way: Array) -> list[Push]:
    """Ways to push solids by `way` (2,) [m], the base going along or, where it cannot, standing."""
    length = float(norm(way))
    d = np.append(way / length, 0.0)
    across = np.array([-d[1], d[0], 0.0])
    low, high = bounds(solids)

    def shifted(x: float) -> Array:
        return kin.transform(np.eye(3), np.append(way * x, 0.0))

    def moving(x: float) -> list[Solid]:
        return [s.moved(shifted(x)) for s in solids]

    def standing(x: float) -> Array:
        return np.eye(4)

    out = []
    rearmost = max(
        solids,
        key=lambda solid: float(matmul(np.abs(matmul(d, solid.T[:3, :3])), solid.half_m) - matmul(d, solid.T[:3, 3])),
    )
    shares = [float(low[2] + share * (high[2] - low[2])) for share in _TIPS.heights]
    flat = float(high[2] - low[2]) < 2 * _TIPS.lowest_m
    least = float(high[2] - low[2]) / 2 if flat else _TIPS.lowest_m
    for rank, height in enumerate((float(rearmost.T[2, 3]), *shares)):  # the edge of a seat, before what is below it
        z = max(height, low[2] + least)
        rear = _rear(solids, d, z)
        if rear is None:
            continue
        wide, deep = _width(solids, across, z), max(_width(solids, d, z), 1e-3)
        opening = float(np.clip(_TIPS.apart * wide - 2 * hand.finger_half_m, 0.0, hand.opening_m))
        toppling = _TIPS.toppling * min(max(0.0, (z - low[2]) / deep - 1), _TIPS.most_toppling)
        for droop in _TIPS.steep_rad if flat else _TIPS.droops_rad:
            approach = d * np.cos(droop) - np.array([0.0, 0.0, np.sin(droop)])
            at = rear - hand.tip_m * approach - hand.finger_half_m * np.sin(droop) * d
            for flip in (1.0, -1.0):
                T = kin.transform(kin.hand_rotation(approach, flip * across), at)
                before = T.copy()
                before[:3, 3] -= SHORT_M * T[:3, 2]
                for carry, more in ((shifted, 0.0), (standing, _TIPS.standing_cost)):
                    cost = _TIPS.height_cost * rank + _TIPS.droop_cost * droop + more + toppling
                    heading = float(np.arctan2(d[1], d[0]))
                    out.append(Push(before, _led(shifted, T), carry, moving, heading, cost, opening))
    return out


def _led(shifted: Callable[[float], Array], T: Array) -> Callable[[float], Array]:
    return lambda x: matmul(shifted(x), T)


def _rear(solids: Sequence[Solid], d: Array, z: float) -> Array | None:
    """(3,) where a line along `d` through the middle, at a height, first meets the solids."""
    box = bounds(solids)
    middle = np.append(box.mean(0)[:2], z)
    reach = float(norm(box[1] - box[0]))
    points = middle + d * np.linspace(-reach, reach, round(reach / _TIPS.sample_m))[:, None]
    inside = Surroundings(solids).distance(points) <= 0
    return points[int(inside.argmax())] if inside.any() else None


def _width(solids: Sequence[Solid], across: Array, z: float) -> float:
    """How wide the solids are at a height."""
    box = bounds(solids)
    middle = np.append(box.mean(0)[:2], z)
    reach = float(norm(box[1] - box[0]))
    steps = np.linspace(-reach, reach, round(reach / _TIPS.sample_m))
    inside = Surroundings(solids).distance(middle + across * steps[:, None]) <= 0
    return float(np.ptp(steps[inside])) if inside.any() else 0.0
