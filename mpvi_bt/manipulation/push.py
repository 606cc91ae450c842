"""Push a thing along what it stands on, with the open hand behind it: two fingertips keep it from turning away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mpvi_bt.manipulation.course import Course, CourseSearch, Start
from mpvi_bt.manipulation.follow import go_along, resistance, take_up, touch
from mpvi_bt.manipulation.open import then_leave
from mpvi_bt.manipulation.work import Words, Work
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.collision import Surroundings
from mpvi_bt.robot.motion import Actions, MotionFailure
from mpvi_bt.robot.protocol import Side
from mpvi_bt.robot.solids import Array, Solid

_FAR_M = 0.30  # how far to push if nothing is said of it
_LEAST = 0.5  # of that way counts as pushed
_GAP_M = 0.02  # what is pushed up to something stops so far before it
_TIP_M = 0.012  # the fingertips are that far before the tcp
_SHORT_M = 0.10
_BETWEEN_M = 0.085  # what is narrower goes between the fingers, up to the palm
_INTO_M = 0.03
_DROOPS = (0.0, 0.4, 0.8, 1.1)  # how far the hand points down [rad]
_HEIGHTS = (0.35, 0.5, 0.65, 0.2, 0.8, 0.95)  # of the thing, where to push it: low, so that it does not tip over
_LOWEST_M = 0.03  # above what it stands on
_STUCK_M = 0.04  # a hand held off so far pushes against something that does not give way
_TURNS = {"away": 0.0, "forward": 0.0, "left": np.pi / 2, "right": -np.pi / 2, "aside": np.pi / 2, "backward": np.pi}


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
    yield from work.study(name)
    before = _middle(work, name)
    way = _way(work, name, words)
    length = float(np.linalg.norm(way))
    if length < _GAP_M:
        return
    side, start, course, search = _beginning(work, name, way, tried, words.get("hand"))
    motion = work.motion

    def stuck(x: float) -> bool:
        return resistance(motion, side) > _STUCK_M

    def going() -> Actions:
        yield from touch(work, course, side)
        yield from go_along(motion, course, side, start.torso_after, stuck)

    tried.append(start.base)
    yield from motion.grip(side, 1.0, 0.2)
    yield from take_up(work, start, side, search.other)
    yield from then_leave(work, side, going())
    yield from work.study(name)
    if float((_middle(work, name) - before) @ way) / length < _LEAST * length:
        raise MotionFailure("not_moved")


def _middle(work: Work, name: str) -> Array:
    return np.asarray(_box(work.scene.solids(name)).mean(0)[:2])


def _box(solids: Sequence[Solid]) -> Array:
    boxes = np.stack([s.aabb() for s in solids])
    return np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)])


def _way(work: Work, name: str, words: Words) -> Array:
    """(2,) where to, from where the thing is [m]."""
    at, here = _middle(work, name), work.motion.felt.base_pose
    if "target" in words:
        target = _box(work.scene.solids(work.nearest(words["target"])))[:, :2]
        toward = np.clip(at, target[0], target[1]) - at
        far = float(np.linalg.norm(toward))
        toward /= max(far, 1e-9)
        length = max(0.0, far - _reach(work.scene.solids(name), toward, at) - _GAP_M)
        return np.asarray(toward * length)
    bearing = float(np.arctan2(at[1] - here[1], at[0] - here[0])) + _TURNS[words.get("direction", "away")]
    return _FAR_M * np.array([np.cos(bearing), np.sin(bearing)])


def _reach(solids: Sequence[Solid], toward: Array, at: Array) -> float:
    """How far solids reach from a place (2,) along a direction (2,)."""
    d = np.append(toward, 0.0)
    return max(float(d @ (s.T[:3, 3] - [*at, 0.0]) + np.abs(d @ s.T[:3, :3]) @ s.half_m) for s in solids)


def _beginning(
    work: Work, name: str, way: Array, tried: list[Array], hand: str | None
) -> tuple[Side, Start, Course, CourseSearch]:
    courses = pushes(work.scene.solids(name), way)
    at, here = _middle(work, name), work.motion.felt.base_pose
    bearing = float(np.arctan2(at[1] - here[1], at[0] - here[0]))
    ahead = float(np.arctan2(way[1], way[0]))
    for heading in (ahead, bearing):
        for side in work.free_hands(name, hand):
            search = _search(work, name, side, tried)
            facing = [replace(c, heading=heading) for c in courses]
            start = search.start(facing)
            if start is not None:
                return side, start, facing[start.course], search
    raise MotionFailure("no_stance")


def _search(work: Work, name: str, side: Side, tried: list[Array]) -> CourseSearch:
    held = work.held()
    carried = {n for h in held.values() for n in (h.name, *work.scene.within(h.name))}
    moved = {name, *work.scene.within(name)}
    near = work.scene.obstacles(work.motion.felt.base_pose[:2], 2.5, without={*carried, *moved})
    touched = [s for n in moved for s in work.scene.solids(n)]
    return CourseSearch(work.motion, side, held, near, touched, work.rng, list(tried))


def pushes(solids: Sequence[Solid], way: Array) -> list[Course]:
    """Ways to push solids by `way` (2,) [m], the base going along or, where it cannot, standing."""
    length = float(np.linalg.norm(way))
    d = np.append(way / length, 0.0)
    across = np.array([-d[1], d[0], 0.0])
    low, high = _box(solids)

    def shifted(x: float) -> Array:
        return kin.transform(np.eye(3), np.append(way * x, 0.0))

    def moving(x: float) -> list[Solid]:
        return [s.moved(shifted(x)) for s in solids]

    def standing(x: float) -> Array:
        return np.eye(4)

    out = []
    for rank, share in enumerate(_HEIGHTS):
        z = max(low[2] + share * (high[2] - low[2]), low[2] + _LOWEST_M)
        rear = _rear(solids, d, z)
        if rear is None:
            continue
        into = min(_INTO_M, _width(solids, across, z) / 2) if _width(solids, across, z) < _BETWEEN_M else -_TIP_M
        for droop in _DROOPS:
            approach = d * np.cos(droop) - np.array([0.0, 0.0, np.sin(droop)])
            for flip in (1.0, -1.0):
                T = kin.transform(kin.hand_rotation(approach, flip * across), rear + into * approach)
                before = T.copy()
                before[:3, 3] -= _SHORT_M * T[:3, 2]
                for carry, more in ((shifted, 0.0), (standing, 0.6)):
                    cost = 0.15 * rank + 0.3 * droop + more
                    out.append(Course(before, _led(shifted, T), carry, moving, float(np.arctan2(d[1], d[0])), cost))
    return out


def _led(shifted: Callable[[float], Array], T: Array) -> Callable[[float], Array]:
    return lambda x: shifted(x) @ T


def _rear(solids: Sequence[Solid], d: Array, z: float) -> Array | None:
    """(3,) where a line along `d` through the middle, at a height, first meets the solids."""
    box = _box(solids)
    middle = np.append(box.mean(0)[:2], z)
    reach = float(np.linalg.norm(box[1] - box[0]))
    points = middle + d * np.linspace(-reach, reach, round(reach / 0.0025))[:, None]
    inside = Surroundings(solids).distance(points) <= 0
    return points[int(inside.argmax())] if inside.any() else None


def _width(solids: Sequence[Solid], across: Array, z: float) -> float:
    """How wide the solids are at a height."""
    box = _box(solids)
    middle = np.append(box.mean(0)[:2], z)
    reach = float(np.linalg.norm(box[1] - box[0]))
    steps = np.linspace(-reach, reach, round(reach / 0.0025))
    inside = Surroundings(solids).distance(middle + across * steps[:, None]) <= 0
    return float(np.ptp(steps[inside])) if inside.any() else 0.0
