"""Brings the robot into its travel posture (Paper, Navigation appendix: fixed arms while driving)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mpvi_bt.robot import arm_motion, r1
from mpvi_bt.robot.collision import Body
from mpvi_bt.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.robot.protocol import SIDES, Robot, Side
from mpvi_bt.robot.solids import Array
from mpvi_bt.robot.squeeze import squeezes

_CLOSE_RAD = 0.05
_BACK_M = 0.25
_CARRIED_M = 0.65  # from the base's axis, and between these heights, a hand carries what it holds;
_CARRIED_AT_M = (0.5, 1.15)  # farther out, lower or higher it may still be in a shelf, a basket or under a table


class ArmStow:
    """Folds empty hands and straightens the torso; a hand that holds something keeps its pose in front of the body.

    It knows nothing of the surroundings: from an unknown posture, and with a hand that holds something far out, it
    first draws back from where the hands worked.
    """

    def __init__(self, robot: Robot, seed: int = 0) -> None:
        """Command `robot`; the same seed folds in the same way."""
        self._robot, self._seed = robot, seed
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
        felt = motion.felt
        if squeezes(felt):
            return  # the arms hold a box between them
        held: list[Side] = [s for s in SIDES if felt.holds(s)]
        empty: list[Side] = [s for s in SIDES if s not in held]
        away = [s for s in empty if np.abs(motion.arm(s) - r1.TRAVEL_ARM[s]).max() > _CLOSE_RAD]
        if away or any(_far_out(motion.hand(s)) for s in held):
            x, y, yaw = felt.base_pose
            yield from motion.drive(np.array([x - _BACK_M * np.cos(yaw), y - _BACK_M * np.sin(yaw), yaw]), speed=0.2)
        rng = np.random.default_rng(self._seed)
        for side in away:
            body = Body(motion.torso, {s: motion.arm(s) for s in SIDES})
            path = arm_motion.plan(body, side, r1.TRAVEL_ARM[side], rng)
            if path is not None:
                yield from motion.follow(side, path)
        body = Body(motion.torso, {s: motion.arm(s) for s in SIDES})
        arms = arm_motion.sweep(body, r1.TRAVEL_TORSO, {s: arm_motion.stay(motion.hand(s)) for s in held})
        if arms is None:
            raise MotionFailure("no_reach")
        yield from motion.stand(r1.TRAVEL_TORSO, arms)


def _far_out(T_base_tcp: Array) -> bool:
    """Whether a hand is beyond where things are carried."""
    x, y, z = T_base_tcp[:3, 3]
    return bool(np.hypot(x, y) > _CARRIED_M or not _CARRIED_AT_M[0] < z < _CARRIED_AT_M[1])
