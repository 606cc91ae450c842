"""Set a held thing down in one of some poses: upright, or leaning where there is no room to stay upright."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import tee

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rotations import rotation
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.approach import close_in, going_around, leave, lines, take_up, withdraw
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.stance.stance import Option, Stance
from mpvi_bt.hands.stance.stance_search import SPACINGS, Search

# Our choice: how a payload leans when it is let go of, about the closing axis, about which it turns in the hand [rad].
UPRIGHT = (0.0,)
SLANTED = (0.25, -0.25, 0.5, -0.5, 0.8, -0.8)
LYING = (0.25, -0.25, 0.55, -0.55, 0.9, -0.9, 1.5, -1.5, 1.2, -1.2)
LIES_RAD = 1.1  # our choice: what leans farther is to come to lie [rad]
TURNS = tuple(np.arange(12) * np.pi / 6 - np.pi)  # our choice: of a payload about the vertical [rad]


@dataclass(frozen=True)
class Leaning:
    """Which payloads may lean when they are released, and how far."""

    stands: float = 0.8  # largest lean of a payload that comes to stand [ratio of the lean at its tipping]; our choice
    hardly_rad: float = 0.1  # lean added to that in the hand for a payload with contents [rad]; our choice
    level: float = 0.5  # least sine from the vertical of the axis that a payload leans about; our choice
    lean_cost: float = 1.0  # cost of each radian of lean; our choice
    turn_cost: float = 0.05  # cost of each radian of turn about the vertical; our choice


_LEAN = Leaning()


@dataclass(frozen=True)
class SettingDown:
    """How a payload is lowered and released.

    Our choice, by how far arms give way and things slip.
    """

    down_m: float = 0.004  # clearance of the payload from the surface when the hand opens [m]
    leaning_down_m: float = 0.008  # clearance of a leaning payload [m]
    lower_m_s: float = 0.10  # lowering speed [m/s]
    mended_m: float = 0.04  # largest correction for a payload that slipped in the hand, or an arm that gave way [m]
    spare_m: float = 0.03  # opening of the hand beyond the width of the payload [m]
    released_m: float = 0.01  # a hand has let go if it has opened by this [m]
    wide: float = 0.8  # or to this [ratio of its full opening]
    freed_m: float = 0.015  # rise of a hand whose fingers do not open [m]; fingertips on the floor do not slide apart
    lost_m: float = 0.04  # a payload this much higher or lower than planned has fallen over or off [m]
    groups: int = 14  # groups of poses that are tried


SETTING = SettingDown()


@dataclass(frozen=True)
class HandBack:
    """How a hand comes in over the pose of a payload, and how it retreats after the release.

    Our choice: a hand well above what stands around folds without sweeping that away.
    """

    # height to come in from, retreat along the fingers, run-up of the base [m] and cost of each way
    ways: tuple[tuple[float, float, float, float], ...] = (
        (0.12, 0.20, 0.0, 0.0),
        (0.05, 0.09, 0.0, 0.1),
        (0.06, 0.09, 0.4, 0.1),
        (0.06, 0.09, 0.25, 0.15),
    )
    low_m: float = 0.1  # a hand that comes in from a lower height may retreat sideways instead [m]
    aside_m: float = 0.15  # distance of that sideways retreat [m]
    aside_cost: float = 0.05  # cost of that retreat
    closes_level: float = 0.95  # least cosine of its closing axis with level
    straight: float = 0.95  # largest cosine of that direction with straight back
    forward: float = 0.2  # largest cosine of that direction with the fingers' direction
    step_m: float = 0.015  # distance between two checks of that way [m]
    grazed_m: float = 0.002  # largest loss of the fingers' clearance from the payload on it [m]


_BACK = HandBack()


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose to leave a thing in.

    Attributes:
        T_world_thing: (4, 4).
        cost: Preference.
    """

    T_world_thing: Array
    cost: float


def leaning(work: Work, held: Held, lean: float) -> Array | None:
    """The rotation (3, 3) of a payload with a lean [rad]; None if it would not come to rest from there.

    A payload that leans a little comes to stand, one that is nearly flat comes to lie; in between it falls anywhere,
    unless it is a ball. So does a flat one that would have to stand on end, such as a pen. A container with things in
    it leans hardly more than it does in the hand.
    """
    now = work.scene.pose(held.name)[:3, :3]
    upright = _upright(_as_taken(work, held))
    if not lean:
        return upright
    frame = kin.inverse(held.T_tcp_thing)
    size = np.ptp(bounds(s.moved(matmul(kin.transform(upright, (0.0, 0.0, 0.0)), frame)) for s in held.solids), axis=0)
    stands = abs(lean) < _LEAN.stands * float(np.arctan2(size[:2].min(), size[2]))
    hangs = float(rotation(matmul(upright.T, now)).magnitude())
    if held.laden and not (stands and abs(lean) < hangs + _LEAN.hardly_rad):
        return None
    closing = matmul(upright, frame[:3, 1]) * [1, 1, 0]
    if (length := float(norm(closing))) < _LEAN.level:
        return None
    turn = matmul(kin.rot_z(-np.arctan2(closing[1], closing[0])), upright)
    square = matmul(kin.transform(turn, (0.0, 0.0, 0.0)), frame)
    _, deep, high = np.ptp(bounds(s.moved(square) for s in held.solids), axis=0)
    lies = abs(lean) > LIES_RAD and 2 * high > deep
    if not (stands or lies or all(s.kind == "sphere" for s in held.solids)):
        return None
    return np.asarray(matmul(Rotation.from_rotvec(closing / length * lean).as_matrix(), upright))


def poses(
    work: Work, held: Held, spot: Array, leans: Sequence[float] = UPRIGHT, turns: Sequence[float] = TURNS
) -> Iterator[Pose]:
    """Poses with the middle of the thing's underside on a spot (3,), at several turns [rad], upright first."""
    frame = kin.inverse(held.T_tcp_thing)
    solids = [s.moved(frame) for s in held.solids]  # in the thing's frame
    for lean in leans:
        standing = leaning(work, held, lean)
        if standing is None:
            continue
        for turn in turns:
            R = matmul(kin.rot_z(turn), standing)
            low, high = bounds(s.moved(kin.transform(R, (0.0, 0.0, 0.0))) for s in solids)
            down = SETTING.leaning_down_m if lean else SETTING.down_m
            p = spot - np.append((low + high)[:2] / 2, low[2] - down)
            yield Pose(kin.transform(R, p), _LEAN.turn_cost * abs(float(turn)) + _LEAN.lean_cost * abs(lean))


def place_at(
    work: Work, side: Side, about: str | None, groups: Callable[[Held], Iterable[Sequence[Pose]]], tried: list[Array]
) -> Generator[Array, None, Array]:
    """Set what a hand holds down in the first of some poses that can be reached, open the hand and come away.

    Args:
        work: Robot and world.
        side: The hand.
        about: What it is to be set down on, in or beside, to look at, and to go around if need be; None for the floor.
        groups: Says what poses there are for what the hand holds, as things are known at that time: those about one
            place together, better places first.
        tried: Base poses that did not do; the one taken is added.

    Returns:
        Heights (2,) of the thing's underside and of its top in that pose [m]. The arm is not folded: what came of it
        can be looked at first.

    Raises:
        MotionFailure: "no_free_spot" if there are no poses, "no_stance", "not_released", or a motion's own reason.
    """
    goal, seen, held = np.eye(4), 0, work.load(side)

    def find(search: Search, here_first: bool) -> Stance | None:
        nonlocal goal, seen, held
        held = work.load(side)  # each look may show it better, and in another frame
        # A coarse look at every place before a closer one at any.
        for spacing, found in enumerate(tee(groups(held), len(SPACINGS))):
            seen = 0
            for group in found:
                width_m, hand = work.motion.felt.gripper_width[side], work.motion.robot.hand
                options = [option for pose in group for option in _options(hand, held, pose, width_m)]
                if not options:
                    continue
                seen += 1
                focus = np.mean([pose.T_world_thing[:2, 3] for pose in group], axis=0)
                stance = search.find(focus, options, here_first and not spacing, (spacing,))
                if stance is not None:
                    goal = matmul(options[stance.option].waypoints[1], held.T_tcp_thing)
                    return stance
                if seen >= SETTING.groups or search.effort.left <= 0:
                    break
        return None

    def attempt() -> Generator[Array, None, tuple[Stance, Search]]:
        try:
            return (yield from close_in(work, side, (), about, find, tried))
        except MotionFailure as failure:
            if failure.reason != "no_stance" or seen:
                raise
            raise work.no_free_spot(held.name, about) from None

    stance, search = yield from attempt() if about is None else going_around(work, about, attempt)
    try:
        yield from take_up(work, stance, search)
        yield from _lower(work, side, stance, goal)
        yield from look_at(work, held.name)
        yield from release(work, side, stance.opening_m, falls_s=0.1)
        yield from lines(work, side, stance, [2])
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from leave(work, stance)
    return bounds(s.moved(matmul(goal, kin.inverse(held.T_tcp_thing))) for s in held.solids)[:, 2]


def release(work: Work, side: Side, opening_m: float = math.inf, falls_s: float = 0.5) -> Actions:
    """Open a hand as far as there is room for, and wait while what it held falls, by default into a deep container.

    A longer pause looks like the end of the motion: who is asked then may say yes before the hand is out of the way.

    Raises:
        MotionFailure: "not_released" if the fingers do not open.
    """
    hand = work.motion.robot.hand
    enough = min(work.motion.felt.gripper_width[side] + SETTING.released_m, SETTING.wide * hand.opening_m)
    yield from work.motion.grip(side, hand.command(opening_m), GRIP.firm_s)
    yield from work.motion.wait(falls_s)
    if work.motion.felt.gripper_width[side] < enough:
        with suppress(MotionFailure):  # fingertips that stand on the floor do not slide apart
            yield from work.rise(side, SETTING.freed_m)
            yield from work.motion.wait(falls_s)
    if work.motion.felt.gripper_width[side] < enough:
        raise MotionFailure("not_released")


def _lower(work: Work, side: Side, stance: Stance, goal: Array) -> Actions:
    """Bring the thing to its pose `goal` (4, 4) in the world, from where it really hangs by now."""
    motion = work.motion
    planned = matmul(kin.inverse(work.base), kin.base(stance.base), stance.waypoints[1])
    now = work.held().get(side)
    if now is not None:
        felt = motion.robot.tcp(motion.felt.torso, motion.felt.arm[side], side)
        mended = matmul(kin.inverse(work.base), goal, kin.inverse(now.T_tcp_thing))
        mended[:3, 3] += motion.hand(side)[:3, 3] - felt[:3, 3]  # arms give way under a load
        if norm(mended[:3, 3] - planned[:3, 3]) < SETTING.mended_m:
            planned = mended
    yield from motion.line(side, planned, speed=SETTING.lower_m_s)


def _options(hand: Hand, held: Held, pose: Pose, width_m: float) -> Iterator[Option]:
    """Ways to bring a thing into a pose from above, and the hand back along its fingers, or level past the thing."""
    T = matmul(pose.T_world_thing, kin.inverse(held.T_tcp_thing))
    opening = min(hand.opening_m, width_m + SETTING.spare_m)
    asides = [aside for aside in _asides(T) if _slides_past(hand, held, matmul(T[:3, :3].T, aside), opening)]
    for over_m, back_m, run_up, cost in _BACK.ways:
        over = T.copy()
        over[2, 3] += over_m
        level = asides if over_m < _BACK.low_m else []
        for off, more in [(-back_m * T[:3, 2], 0.0), *((_BACK.aside_m * aside, _BACK.aside_cost) for aside in level)]:
            back = T.copy()
            back[:3, 3] += off
            yield Option(np.stack([over, T, back]), 1, pose.cost + cost + more, run_up, None, opening)


def _asides(T: Array) -> Iterator[Array]:
    """Level unit vectors (3,) along which the open fingers of a hand at `T` (4, 4) slide past what they let go of.

    Our choice: below a board a hand that points down has no room to draw back along its fingers.
    """
    level = np.cross(T[:3, 1], [0.0, 0.0, 1.0])
    length = float(norm(level))
    for away in (level / length, -level / length) if length > _BACK.closes_level else ():
        if -_BACK.straight < float(matmul(away, T[:3, 2])) < _BACK.forward:
            yield away


def _slides_past(hand: Hand, held: Held, way: Array, opening_m: float) -> bool:
    """Whether fingers that are open so far slide along a unit vector (3,) in the tcp frame, past what they let go of.

    The finger within a vessel meets the wall around the corner, and that within a plate its lip farther along.
    """
    thing = Surroundings(held.solids)
    centers, radii = hand.fingers(opening_m)
    gaps = thing.distance(centers + np.arange(0.0, _BACK.aside_m, _BACK.step_m)[:, None, None] * way) - radii
    return bool((gaps > np.minimum(gaps[0], 0.0) - _BACK.grazed_m).all())


def _as_taken(work: Work, held: Held) -> Array:
    """The rotation (3, 3) that a payload had when it was grasped, with the yaw that it has now.

    A bottle that could not be laid down is carried on its side; it is still known that it stood upright.
    """
    now = work.scene.pose(held.name)[:3, :3]
    if held.side not in work.grasped:
        return now
    taken = matmul(work.grasped[held.side], held.T_tcp_thing[:3, :3])
    M = matmul(taken, now.T)
    return np.asarray(matmul(kin.rot_z(np.arctan2(M[0, 1] - M[1, 0], M[0, 0] + M[1, 1])), taken))


def _upright(R: Array) -> Array:
    """The rotation (3, 3) next to `R` in which the axis that is nearest to the vertical is vertical."""
    up = int(np.abs(R[2]).argmax())
    lean = np.cross(R[:, up] * np.sign(R[2, up]), [0, 0, 1.0])
    size = float(norm(lean))
    if size < 1e-6:
        return R
    return np.asarray(matmul(Rotation.from_rotvec(lean / size * np.arcsin(min(1.0, size))).as_matrix(), R))
