"""Brings the robot into its travel posture (Paper, Navigation appendix: fixed arms while driving)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import product

import numpy as np

from mpvi_bt.ground.geometry.kinematics import rot_z
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import Robot, Side
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.ground.robot.straight_fold import StraightFold

# All our choice.
_CLOSE_RAD = 0.05  # an arm so near to its posture is in it
_BACK_M = 0.25  # that the base draws back, at the least
_BACK_RAD = (0.0, 0.6, -0.6, 1.1, -1.1)  # from straight back, where an arm or the base is against a wall
_OFF_M = 0.15  # off what fingers stand around
_RAISED_M = 0.15  # that hands are raised, off what they worked on
_DRAWN_M = 0.12  # of a hand along its fingers, off what it may have let go of a moment ago
_DOWN = 0.9  # of the length of a hand's approach, downward: what it took from above may be in a basin or a box still
_LEVEL = 0.3  # of the length of a hand's approach, seen from above: one that points down more steeply is not drawn back
_CARRIED_M = 0.58  # from the base's axis, and between these heights, a hand carries what it holds;
_CARRIED_AT_M = (0.5, 1.15)  # farther out, lower or higher it may still be in a shelf, a basket or under a table,
_OUT_M = 0.30  # and is drawn back to where it was so far ahead,
_BEFORE_M = ((0.42, 0.25), (0.46, 0.30), (0.50, 0.30), (0.55, 0.28))  # then brought in: x, y toward its own side,
_LEVELS_M = (1.00, 0.80, 0.70)  # at about the height that it has, or at one of these
_CLOSING_S = 0.4  # for a hand that is told to be half open to close


class ArmStow:
    """Folds empty hands and straightens the torso; a hand that holds something keeps its pose in front of the body.

    It knows nothing of the surroundings: from an unknown posture, and with a hand that holds something far out, it
    first draws back from where the hands worked; an empty hand that still points there is drawn off along its fingers
    before that, and one that took something from above is raised. What is held far out is brought in, level, before
    the base turns, and so is what the torso cannot straighten up around. Where there is no room to go back, arms and
    torso are brought home as far as they get.
    """

    def __init__(self, robot: Robot, seed: int = 0, carries: Callable[[Side], bool] | None = None) -> None:
        """Command `robot`.

        Args:
            robot: The robot.
            seed: The same folds in the same way.
            carries: Whether what a hand feels between its fingers comes along; None: it always does. Where it does not,
                such as a door's bar, the hand lets go and is drawn back along its fingers.
        """
        self._robot, self._seed, self._carries = robot, seed, carries
        self._motion = Motion(robot.proprioception())
        self._actions: Iterator[Array] = iter(())

    def start(self) -> None:
        """Begin from the present posture."""
        self._motion = Motion(self._robot.proprioception())
        self._actions = self._fold(self._motion)

    def step(self) -> bool:
        """Write one step's command; True once the posture is reached, or cannot be."""
        self._motion.felt = self._robot.proprioception()
        try:
            action = next(self._actions, None)
        except MotionFailure:
            action = None  # drive as it stands rather than not at all
        if action is None:
            return True
        self._robot.act(action)
        return False

    def _fold(self, motion: Motion) -> Actions:
        felt, robot = motion.felt, motion.robot
        if squeezes(felt):
            return  # the arms hold a box between them
        if self._carries is not None:
            for side in robot.sides:
                if felt.holds(side) and not self._carries(side):
                    yield from _let_go(motion, side)
        felt = motion.felt
        held: list[Side] = [s for s in robot.sides if felt.holds(s)]
        empty: list[Side] = [s for s in robot.sides if s not in held]
        away = [s for s in empty if np.abs(motion.arm(s) - robot.travel_arm[s]).max() > _CLOSE_RAD]
        for side in held:  # one that was cut short while it closed would lose what it holds
            yield from motion.grip(side, -1.0, _CLOSING_S * (felt.gripper_command[side] + 1.0))
        out = [s for s in held if _far_out(motion.hand(s))]
        for side in away:
            yield from _draw_off(motion, side, _DRAWN_M)
        for side in out:
            T = motion.hand(side)
            if T[2, 2] < -_DOWN and (room_m := _CARRIED_AT_M[1] - T[2, 3]) > 0.0:  # it is carried no higher
                yield from _draw_off(motion, side, min(_RAISED_M, room_m))
        if away or out:
            back = max(_BACK_M, *(float(motion.hand(s)[0, 3]) - _OUT_M for s in out), 0.0)
            try:
                yield from _draw_back(motion, back)
            except MotionFailure:  # an empty hand may be caught behind a rim, such as that of a box in a trunk
                if not away:
                    raise
                for side in away:
                    yield from _raise(motion, side)
                with suppress(MotionFailure):  # between furniture the arms fold where it stands, or not at all
                    yield from _draw_back(motion, back, _BACK_RAD if robot.sideways else (0.0,))
        rng = np.random.default_rng(self._seed)
        for side in away:
            try:
                yield from _home(motion, side, rng)
            except MotionFailure:  # it may be in a trunk still, whose walls are in its way
                with suppress(MotionFailure):  # a torso that stays bent would meet what the base does not
                    yield from _draw_back(motion, _BACK_M)
                    yield from _home(motion, side, rng)
        for side in out:
            yield from _bring_in(motion, side)
        yield from motion.stand(robot.travel_torso, _level(motion, held))


def stow_of(robot: Robot, seed: int = 0, carries: Callable[[Side], bool] | None = None) -> ArmStow | StraightFold:
    """What folds a robot's arms: around itself where its model tells how, straight where only a file describes it.

    Args:
        robot: What to fold.
        seed, carries: As of `ArmStow`.
    """
    planned = isinstance(robot_named(robot.proprioception().robot), RobotModel)
    return ArmStow(robot, seed, carries) if planned else StraightFold(robot)


def _draw_back(motion: Motion, by_m: float, turns: Sequence[float] = (0.0,)) -> Actions:
    """Have the base go back, in the first of the directions `turns` [rad] from straight back in which it can."""
    for turn in turns:
        x, y, yaw = motion.felt.base_pose
        goal = np.array([x - by_m * np.cos(yaw + turn), y - by_m * np.sin(yaw + turn), yaw])
        try:
            yield from motion.drive(goal, speed=0.2)
            return
        except MotionFailure:
            if turn == turns[-1]:
                raise


def _let_go(motion: Motion, side: Side) -> Actions:
    """Open a hand and have the base draw it straight back, as far as it can, off what its fingers stood around."""
    motion.action[motion.layout.arm[side]] = motion.felt.arm[side]  # it pulls no more
    yield from motion.grip(side, 1.0, _CLOSING_S)
    x, y, yaw = motion.felt.base_pose
    away = -matmul(rot_z(yaw), motion.hand(side)[:3, 2])[:2]
    if norm(away) > _LEVEL:
        with suppress(MotionFailure):
            back = away / norm(away) * _OFF_M
            yield from motion.drive(np.array([x + back[0], y + back[1], yaw]), speed=0.2)


def _home(motion: Motion, side: Side, rng: np.random.Generator) -> Actions:
    """Fold an arm, if a way is found that keeps it clear of the robot itself."""
    body = motion.body()
    path = arm_motion.plan(body, side, motion.robot.travel_arm[side], rng)
    if path is not None:
        yield from motion.follow(side, path)


def _draw_off(motion: Motion, side: Side, by_m: float) -> Actions:
    """Draw a hand straight back along its fingers, if its arm can: the base would drag along what is between."""
    T = motion.hand(side)
    T[:3, 3] -= by_m * T[:3, 2]
    body = motion.body()
    line = arm_motion.trace(motion.robot, motion.torso, side, motion.arm(side), T)
    if line is not None and all(body.free(side, q)[0] for q in line):
        with suppress(MotionFailure):
            yield from motion.line(side, T)


def _raise(motion: Motion, side: Side) -> Actions:
    """Raise a hand straight up, if its arm can."""
    T = motion.hand(side)
    T[2, 3] += _RAISED_M
    with suppress(MotionFailure):
        yield from motion.line(side, T)


def _bring_in(motion: Motion, side: Side) -> Actions:
    """Bring a hand, with its payload level, in front of the body; without a free path it stays."""
    body = motion.body()
    T = motion.hand(side)
    here = float(np.clip(T[2, 3], min(_LEVELS_M), max(_LEVELS_M)))
    for goal in _before(T, side, (here, *_LEVELS_M)):
        if (path := arm_motion.plan_level(body, side, goal)) is not None:
            yield from motion.follow(side, path)
            return


def _before(T_base_tcp: Array, side: Side, levels: Sequence[float]) -> Iterator[Array]:
    """Poses of a hand before the body at these heights [m], turned as it is."""
    for (x, y), z in product(_BEFORE_M, levels):
        goal = T_base_tcp.copy()
        goal[:3, 3] = x, y * SIGN[side], z
        yield goal


def _level(motion: Motion, held: Sequence[Side]) -> dict[Side, list[Array]]:
    """Arm postures that keep payloads level while the torso straightens up, at the same place or closer.

    Raises:
        MotionFailure: "no_reach" if there are none.
    """
    body, torso = motion.body(), motion.robot.travel_torso
    stays = {s: arm_motion.stay(motion.hand(s)) for s in held}
    if (arms := arm_motion.sweep(body, torso, stays)) is not None:
        return arms
    for side in held:  # a torso that stays bent drives on blindly
        T = motion.hand(side)
        for goal in _before(T, side, _LEVELS_M):
            if (arms := arm_motion.sweep(body, torso, {**stays, side: arm_motion.glide(T, goal)})) is not None:
                return arms
    raise MotionFailure("no_reach")


def _far_out(T_base_tcp: Array) -> bool:
    """Whether a hand is beyond where things are carried."""
    x, y, z = T_base_tcp[:3, 3]
    return bool(np.hypot(x, y) > _CARRIED_M or not _CARRIED_AT_M[0] < z < _CARRIED_AT_M[1])
