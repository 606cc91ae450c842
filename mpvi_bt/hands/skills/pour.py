"""Pouring: a held vessel is tipped over its lip above something, and shaken until it is empty."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.motion.approach import close_in, going_around
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.stance.stance import Option, Stance
from mpvi_bt.hands.stance.stance_search import Search

TURNS_RAD = tuple(np.arange(12) * np.pi / 6)  # our choice: of a held tool or vessel about the vertical


@dataclass(frozen=True)
class Tipping:
    """How a vessel is tipped over its lip, and shaken.

    Our choice, by trial in episodes.
    """

    over_m: float = 0.04  # clearance of the vessel's lip over the container below [m]
    within_m: float = 0.01  # distance of the lip from the middle of the place, toward the vessel [m]
    above_m: float = 0.06  # height from which the vessel comes down [m]
    steps: int = 6  # straight lines from upright to tipped
    # tip angle [rad] and added height [m], as the arms allow, the surest to empty it first
    ways: tuple[tuple[float, float], ...] = ((2.75, 0.05), (2.45, 0.0), (2.45, 0.1), (2.0, 0.0), (2.0, 0.1))
    tip_rad_s: float = 0.8  # speed of the fastest joint while the vessel is tipped [rad/s]
    right_rad_s: float = 1.5  # speed while it is righted again [rad/s]
    shakes: int = 3  # shakes at the end
    shaken: int = 10  # postures of a shake, a tenth of a radian apart; what slid down to the palm slides out past it
    lips: int = 8  # places around the rim that it may be poured over
    palm_m: float = 0.05  # distance of the palm behind the tcp [m]; the palm covers the rim there
    deep_m: float = 0.02  # least depth assumed for a vessel [m]
    off_m: float = 0.02  # least distance of the palm from its middle [m]
    bars_m: float = 0.005  # a part that stands higher above the rim, such as a handle, is in the way of pouring [m]


_TIP = Tipping()


@dataclass(frozen=True)
class LevelWays:
    """Ways to bring a vessel over a place without spilling."""

    tries: int = 4  # stances from which a level way is searched, each with another turn of the vessel; our choice
    effort: float = 1.0  # effort of each of them [base poses]; our choice
    alike: float = 0.8  # cosine between two turns of the vessel that are as good as one; our choice
    level: float = 0.75  # least cosine between the vessel's axis on the way and as it is now; our choice
    turn_cost: float = 0.05  # cost of each radian of the vessel's turn; our choice
    palm_cost: float = 0.5  # cost of pouring over the lip where the palm is; our choice
    # offsets of the middle of the way, y toward the hand's own side [m]; our choice
    detours_m: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.15),
        (0.0, 0.15, 0.0),
        (0.0, 0.1, 0.25),
        (0.15, 0.0, 0.1),
        (0.0, 0.25, 0.0),
    )


_LEVEL = LevelWays()


def pour(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Tip what a held vessel, `words["source"]` if that is said, holds out into or onto `words["container"]`.

    Raises:
        MotionFailure: "not_held", "not_a_container" (what is held holds nothing), "unknown_object", "no_stance",
            "dropped", "missed" (something went elsewhere), or a motion's own reason.
    """
    scene = work.scene
    side = _pouring_hand(work, words)
    target = work.nearest(words.get("container", ""))
    contents = list(scene.within(str(scene.holding(side))))

    def find(search: Search, here_first: bool) -> Stance | None:
        held = work.load(side)
        place, height = _opening(work, target)
        last: Stance | None = None
        for tipped, higher in _TIP.ways:
            options = list(_options(work, held, place, height + higher, tipped, len(tried)))
            for _ in range(_LEVEL.tries):
                if (stance := search.find(place, options, here_first)) is None:
                    break
                search.effort.left -= _LEVEL.effort
                around = search.around(stance.route[-1], touched=True)
                if _course(work, replace(work.body(), around=around), side, stance, stance.waypoints) is not None:
                    return stance
                last, turned = last or stance, options[stance.option].waypoints[0][:3, 0]
                options = [o for o in options if matmul(o.waypoints[0][:3, 0], turned) < _LEVEL.alike]
        return last

    stance, search = yield from going_around(work, target, lambda: close_in(work, side, {target}, target, find, tried))
    for base in stance.route:
        yield from work.motion.drive(base)
    if search.other is not None and len(stance.aside) > 1:
        yield from work.motion.follow(search.other, stance.aside, speed=0.8)
    waypoints = matmul(kin.inverse(work.base), kin.base(stance.base), stance.waypoints)
    course = _course(work, work.body(), side, stance, waypoints)
    if course is None:
        raise MotionFailure("no_path")
    yield from work.motion.stand(stance.torso, course.arms)
    yield from work.motion.follow(side, course.path)
    yield from _tip(work, side, course.tipping)
    if not work.gripped(side):
        raise MotionFailure("dropped")
    yield from settle(work, without={target})
    yield from look_at(work, target)
    if scene.volumes(target) and any(name not in scene.within(target) for name in contents):
        raise MotionFailure("missed")


@dataclass(frozen=True, eq=False)
class _Course:
    """How to bring a vessel over a place and to tip it there.

    Attributes:
        arms: Postures (7,) of the arms while the torso moves.
        path: Postures of the pouring arm after that.
        tipping: Those from upright to tipped.
    """

    arms: Mapping[Side, Sequence[Array]]
    path: list[Array]
    tipping: list[Array]


def _course(work: Work, body: Body, side: Side, stance: Stance, waypoints: Array) -> _Course | None:
    """A free course on which the vessel stays level until it is tipped: else it is emptied on the way.

    Args:
        work: The robot as it stands.
        body: The same, among what is around the base where it will pour.
        side: The pouring hand.
        stance: Where it will stand.
        waypoints: (K, 4, 4) T_base_tcp: the first over the place, then tipping.
    """
    now = work.motion.hand(side)
    ways: list[tuple[Mapping[Side, Sequence[Array]], list[Array]]] = []
    others = {s: arm_motion.stay(work.motion.hand(s)) for s in body.held if s != side}
    for detour in np.array(_LEVEL.detours_m):
        glide = arm_motion.glide(now, waypoints[0], detour * [1, SIGN[side], 1])
        if (swept := arm_motion.sweep(body, stance.torso, {**others, side: glide})) is not None:
            ways.append((swept, [swept[side][-1]]))
    if _level(body.robot, stance.torso, side, now, stance.path):
        ways.append((stance.level, stance.path))
    for arms, path in ways:
        ends = {**body.arms, **{s: q[-1] for s, q in arms.items()}, side: path[-1]}
        there, tipping = replace(body, torso=stance.torso, arms=ends), [path[-1]]
        for T in waypoints[1:]:
            line = arm_motion.trace(body.robot, stance.torso, side, tipping[-1], T)
            if line is None:
                break
            tipping += line[1:]
        else:
            if there.free(side, np.stack(tipping)).all():
                return _Course(arms, path, tipping)
    return None


def _level(robot: RobotModel, torso: Array, side: Side, now: Array, path: Sequence[Array]) -> bool:
    """Whether a hand keeps about as level as T_base_tcp `now` (4, 4) along a path, so that contents stay inside."""
    between = [a + (b - a) * u for a, b in pairwise(path) for u in (0.25, 0.5, 0.75, 1.0)]
    return all(float(matmul(robot.tcp(torso, q, side)[2, :3], now[2, :3])) > _LEVEL.level for q in (path[0], *between))


def _tip(work: Work, side: Side, path: list[Array]) -> Actions:
    """Down, over the lip, shaken, and upright again, whatever happens."""
    motion, shake = work.motion, path[-_TIP.shaken :]
    blocked: MotionFailure | None = None
    try:
        yield from motion.follow(side, path, _TIP.tip_rad_s)
        for _ in range(_TIP.shakes):
            yield from motion.follow(side, shake[::-1])
            yield from motion.follow(side, shake)
        yield from motion.wait(0.3)
    except MotionFailure as failure:
        blocked = failure
    now = motion.arm(side)
    nearest = int(np.argmin([np.abs(q - now).max() for q in path]))
    yield from motion.follow(side, [now, *path[nearest::-1]], _TIP.right_rad_s)
    if blocked is not None:
        raise blocked


def _pouring_hand(work: Work, words: Words) -> Side:
    """The hand that holds the vessel: what is said to, else the only one."""
    for slot in ("source", "object"):
        named = {e.name for e in work.scene.knowledge().find(words[slot])} if slot in words else set()
        for side in SIDES:
            name = work.scene.holding(side)
            if name in named and words.get("hand") in (None, side) and work.scene.volumes(str(name)):
                return side
    for side in SIDES:
        name = work.scene.holding(side)
        if name is not None and words.get("hand") in (None, side) and work.scene.volumes(name):
            return side
    raise MotionFailure("not_held" if not work.held() else "not_a_container")


def _opening(work: Work, target: str) -> tuple[Array, float]:
    """Where (2,) and from what height [m] to pour into a thing or, if it holds nothing, onto it.

    What spans an opening, such as a handle, is poured past, over its height.
    """
    solids = work.scene.solids(target)
    low, high = bounds(solids)
    volumes = work.scene.volumes(target)
    if not volumes:
        return (low + high)[:2] / 2, float(high[2])
    volume = max(volumes, key=lambda v: float(np.prod(v.half_m)))
    rim, half = float(volume.aabb()[1, 2]), float(volume.half_m[:2].min())
    above = [b for b in map(Solid.aabb, solids) if b[1, 2] > rim + _TIP.bars_m]

    def room(at: Array) -> float:
        gaps = [norm(np.maximum(np.maximum(b[0, :2] - at, at - b[1, :2]), 0)) for b in above]
        return float(min([*gaps, half - np.abs(at - volume.T[:2, 3]).max() / 2]))

    places = [volume.T[:2, 3] + half * np.array([x, y]) for x in (0.0, 0.5, -0.5) for y in (0.0, 0.5, -0.5)]
    return max(places, key=room), float(high[2])


def _options(
    work: Work, held: Held, place: Array, height: float, tipped: float, tries: int
) -> Iterator[Option]:  # fmt: skip
    """Ways of the hand: over the place, then tilting about the vessel's lip, which comes down as the vessel tips."""
    volumes = work.scene.volumes(held.name)
    if not volumes:
        raise MotionFailure("not_a_container")  # it looks otherwise now
    inside = max(volumes, key=lambda v: float(np.prod(v.half_m)))
    T_thing = righted(work.scene.pose(held.name), inside.T[:3, 2])
    solid = inside.moved(kin.inverse(work.scene.pose(held.name)))
    bodies = [s.moved(kin.inverse(held.T_tcp_thing)).aabb() for s in held.solids]
    deep = max(float(solid.aabb()[1, 2]) - min(float(b[0, 2]) for b in bodies), _TIP.deep_m)
    to_tcp = kin.inverse(held.T_tcp_thing)
    for turn in TURNS_RAD:
        R = matmul(kin.rot_z(turn), T_thing[:3, :3])
        palm = to_tcp[:3, 3] - _TIP.palm_m * to_tcp[:3, 2]
        hand = matmul(R, palm - solid.T[:3, 3])[:2]  # of where the palm is, off the vessel's middle
        from_above = max(0.0, -float(matmul(R, to_tcp[:3, 2])[2]))  # 0 for a hand that has it from outside
        for at in 2 * np.pi * np.arange(_TIP.lips) / _TIP.lips:
            out = np.array([np.cos(at), np.sin(at), 0.0])
            edge = lip(solid, R, out)
            axis = np.cross([0.0, 0.0, 1.0], out)
            poses: list[Array] = []
            for tilt in (0.0, *np.linspace(0.0, tipped, _TIP.steps)):
                Q = matmul(np.asarray(Rotation.from_rotvec(axis * tilt).as_matrix()), R)
                z = height + _TIP.over_m + deep * max(float(np.cos(tilt)), 0.0)
                if not poses:
                    z += _TIP.above_m
                goal = np.array([*(place - _TIP.within_m * out[:2]), z])
                poses.append(matmul(kin.transform(Q, goal - matmul(Q, edge)), to_tcp))
            # The palm covers the rim along the way that the hand closes, and fingers dam what flows to their side.
            aside = float(matmul(hand, out[:2])) / max(float(norm(hand)), _TIP.off_m)
            dammed = from_above * abs(float(matmul(R, to_tcp[:3, 1], out)))
            again = float(work.rng.random()) if tries else 0.0  # what stuck one way may come out another
            cost = _LEVEL.turn_cost * abs(float(kin.wrap(turn))) + _LEVEL.palm_cost * aside + dammed + again
            yield Option(np.stack(poses), len(poses), cost)


def righted(T: Array, axis: Array) -> Array:
    """The same pose (4, 4), turned by as little as it takes for `axis` (3,) in the world to point up."""
    lean = np.cross(axis, [0.0, 0.0, 1.0])
    angle = float(np.arctan2(norm(lean), axis[2]))
    if angle < 1e-6:
        return T
    R = np.asarray(Rotation.from_rotvec(lean / norm(lean) * angle).as_matrix())
    return kin.transform(matmul(R, T[:3, :3]), T[:3, 3])


def lip(volume: Solid, R: Array, out: Array) -> Array:
    """(3,) the point of the rim, in the vessel's frame, that lies farthest toward `out` (3,) in the world."""
    toward = matmul(volume.T[:3, :3].T, matmul(R.T, out))
    if volume.kind == "box":
        reach = min(float(h) / max(abs(float(t)), 1e-9) for h, t in zip(volume.half_m[:2], toward[:2], strict=True))
    else:
        reach = float(volume.half_m[0])
    p = np.array([*(toward[:2] * reach), volume.half_m[2]])
    return matmul(volume.T[:3, :3], p) + volume.T[:3, 3]
