"""Motions of both hands with a box pressed between them: raised, looked over, and let go of."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.squeeze import pressing, squeezes
from mpvi_bt.hands.motion.work import Work


@dataclass(frozen=True)
class InStep:
    """How both hands move at once, with a box between them or as they release it.

    Our choice, by boxes, baskets and trays of the tasks.
    """

    closing_m_s: float = 0.12  # speed of each hand that closes in or draws off [m/s]; slow, so the box hardly shifts
    raise_s_m: float = 5.0  # time for the arms to raise the box by a meter [s/m]
    short_m: float = 0.004  # the arms finish a lift that the trunk leaves short by more [m]
    outward_m: float = 0.07  # sideways retreat of each hand to release the box [m]
    loose_m: float = 0.05  # hands that have moved apart by less still hold the box [m]
    # parts of a motion of both hands that are tried, if the arms cannot go all of it [ratio]
    shares: tuple[float, ...] = (1.0, 0.75, 0.5, 0.25)


IN_STEP = InStep()


@dataclass(frozen=True)
class Bending:
    """How the body bends and straightens up with a box before it.

    Our choice: a grid over the trunk's range; the arms keep the hands level and have to reach them from there.
    """

    pitches_rad: tuple[float, ...] = (0.0, 0.25, 0.5, 0.8, 1.1, 1.35)  # pitches of the trunk, most upright first [rad]
    upright_rad: tuple[float, ...] = (0.0, 0.25, 0.5, 0.8)  # pitches of a trunk behind a box [rad]
    lifts_m: tuple[float, ...] = (0.3, 0.42, 0.2, 0.55, 0.1)  # lifts of the trunk, the most comfortable first [m]
    folded_m: float = 0.06  # least lift with hands folded before a bent trunk [m]; lower, they would meet the base
    carry_m: float = 0.62  # height of the hands above the floor while carrying [m]
    shares: tuple[float, ...] = (1.0, 0.6, 0.3)  # parts of the way to that height, if the arms cannot go on [ratio]
    steeper_rad: float = 0.1  # least gain in the head's downward view over a box for which the trunk bends [rad]


BENDING = Bending()


def together(*motions: Actions, motion_of: Work) -> Actions:
    """Motions of different parts of the body at the same time, until the last has ended."""
    going = list(motions)
    while going:
        going = [motion for motion in going if next(motion, None) is not None]
        if going:
            yield motion_of.motion.action.copy()


def raise_both(work: Work, by_m: float, seconds_per_m: float = IN_STEP.raise_s_m) -> Actions:
    """Raise what is held, negative lowers, so that the squeeze stays: by the lift with the arms frozen, then by both
    arms or, where these cannot go so far, by bending or straightening up with the hands kept level.
    """
    motion = work.motion
    lift = motion.posture[0]
    target = float(np.clip(lift + by_m, *motion.robot.trunk.limits[0]))
    rest = by_m - (target - lift)
    if abs(target - lift) > 1e-3:
        yield from motion.stand(motion.bent(lift=target))
    if abs(rest) > IN_STEP.short_m:
        by = {side: np.array([0.0, 0.0, rest]) for side in SIDES}
        whole = yield from _shift(work, by, 1 / seconds_per_m, (1.0,))
        if not whole and not (yield from _bent(work, by, product(BENDING.pitches_rad, BENDING.lifts_m))):
            yield from _shift(work, by, 1 / seconds_per_m)


def straighten_up(work: Work) -> Actions:
    """Straighten up with the hands, and a box between them, kept level before the body, as far as the arms allow."""
    motion = work.motion
    height = float(motion.robot.tcp(motion.torso, motion.felt.arm["left"], "left")[2, 3])
    for share in BENDING.shares:
        rise = max(0.0, BENDING.carry_m - height) * share
        upright = [pitch for pitch in BENDING.upright_rad if pitch <= motion.posture[2]]
        by = {side: np.array([0.0, 0.0, rise]) for side in SIDES}
        if (yield from _bent(work, by, product(upright, BENDING.lifts_m))):
            return
    room = motion.robot.trunk.limits[0, 1] - motion.posture[0]
    yield from raise_both(work, max(0.0, min(room, BENDING.carry_m - height)))


def look_over(work: Work) -> Actions:
    """Bring the head to where it sees over what both hands hold, that kept where it is, as near behind it as it can."""
    motion, name = work.motion, work.scene.between()
    if name is None:
        return
    box = bounds(s.moved(kin.inverse(work.base)) for s in work.scene.solids(name))
    far, top = box[1, 0], box[1, 2]

    def steepness(way: tuple[float, float]) -> float:
        torso = motion.robot.trunk.joints(np.array([way[1], 0.0, way[0], 0.0]))
        eye = motion.robot.head_camera(torso)[:3, 3]
        return float(np.arctan2(eye[2] - top, far - eye[0]))

    least = steepness((float(motion.posture[2]), float(motion.posture[0]))) + BENDING.steeper_rad
    ways = [way for way in product(BENDING.upright_rad, BENDING.lifts_m) if steepness(way) > least]
    yield from _bent(work, dict.fromkeys(SIDES, np.zeros(3)), sorted(ways, key=steepness, reverse=True))


def _bent(work: Work, by: Mapping[Side, Array], ways: Iterable[tuple[float, float]]) -> Generator[Array, None, bool]:
    """Move both hands by (3,) in the base frame, turned as they are, while the body comes to the first pitch [rad] and
    lift [m] for which that can be done. Returns whether there was one.
    """
    motion = work.motion
    robot, felt = motion.robot, motion.felt
    body = replace(motion.body(), arms=dict(felt.arm))  # where the hands are, not where they press to
    now = {side: robot.tcp(motion.torso, felt.arm[side], side) for side in SIDES}
    paths = {s: arm_motion.glide(T, kin.transform(T[:3, :3], T[:3, 3] + by[s])) for s, T in now.items()}
    for pitch, lift in ways:
        torso = robot.trunk.joints(np.array([lift, 0.0, pitch, motion.posture[3]]))
        if (arms := arm_motion.sweep(body, torso, paths)) is not None:
            told = _pressed(robot, motion.torso, torso, arms) if squeezes(felt) else arms
            yield from motion.stand(torso, told, give_rad=np.inf)
            return True
    return False


def _pressed(robot: RobotModel, start: Array, end: Array, arms: Mapping[Side, list[Array]]) -> dict[Side, list[Array]]:
    """What arms are told that go on pressing along paths of postures (7,), while the torso moves from start to end."""
    n = len(arms["left"])
    torsos = start + (end - start) * np.linspace(0, 1, n)[:, None]
    told = [pressing(robot, torso, {s: arms[s][k] for s in SIDES}) for k, torso in enumerate(torsos)]
    return {side: [t[side] for t in told] for side in SIDES}


def open_wide(work: Work) -> Actions:
    """Take both hands off what they press, outward; where the arms cannot go there, with the body bent otherwise."""
    motion, outward = work.motion, {side: np.array([0.0, SIGN[side] * IN_STEP.outward_m, 0.0]) for side in SIDES}
    for side in SIDES:  # from where the hands are, not from where they press to
        motion.action[motion.layout.arm[side]] = motion.felt.arm[side]
    yield motion.still()
    start = _apart(work)
    with suppress(MotionFailure):  # hands that have let go, if not by the whole way, are good enough
        yield from _shift(work, outward, IN_STEP.closing_m_s)
    if _apart(work) - start < IN_STEP.loose_m:
        with suppress(MotionFailure):
            yield from _bent(work, outward, product(BENDING.pitches_rad, BENDING.lifts_m))


def _apart(work: Work) -> float:
    """Between the hands, as felt [m]."""
    felt = work.motion.felt
    left, right = (work.motion.robot.tcp(felt.torso, felt.arm[side], side)[:3, 3] for side in SIDES)
    return float(norm(left - right))


def _shift(
    work: Work, by: Mapping[Side, Array], speed: float, shares: Sequence[float] = IN_STEP.shares
) -> Generator[Array, None, bool]:
    """Move both hands along straight lines (3,) in the base frame, by the first of `shares` that both arms can go.

    Returns whether there was one.
    """
    motion = work.motion
    for share in shares:
        goals = {side: motion.hand(side) for side in SIDES}
        for side in SIDES:
            goals[side][:3, 3] += share * by[side]
        robot, torso = motion.robot, motion.torso
        if all(arm_motion.trace(robot, torso, side, motion.arm(side), goals[side]) is not None for side in SIDES):
            lines = [motion.line(side, goals[side], speed, give_rad=np.inf) for side in SIDES]
            yield from together(*lines, motion_of=work)
            return True
    return False
