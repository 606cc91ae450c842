"""What two hands hold between them: a box pressed from both sides, the fingers open."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.ground.robot.robots import robot_named

# All our choice.
_PRESSED_M = 0.02  # the hands are kept apart by at least that much more than they were told to be
_FACING = 0.4  # cosine between where a hand points and where the other one is: they have to face each other,
_FLAT, _DOWN, _AWAY = 0.9, 0.7, 0.1  # or the fingers' flat sides do, of hands that point down and hardly away
_FORCE_N = 250.0  # that hands press with,
_STRAIN = 0.9  # or less, so that no joint needs more than that share of what its drive can do
_STEP_RAD = 1e-4  # for slopes


@lru_cache(maxsize=2)  # policy, navigator and triggers ask of the same step
def squeezes(felt: Proprioception) -> bool:
    """Whether something between the hands keeps them from closing in on each other (Our choice: by 2 cm or more)."""
    if not felt.arm_command or len(felt.sides) < 2:
        return False
    robot = robot_named(felt.robot)
    turned = sum(float(np.abs(felt.arm[s] - felt.arm_command[s]).sum()) for s in SIDES)
    if isinstance(robot, RobotModel) and turned * robot.arms["left"].reach_m <= _PRESSED_M:
        return False  # no hand can be as far as that from where it was told to be
    left, right = (robot.tcp(felt.torso, felt.arm[s], s) for s in SIDES)
    across = right[:3, 3] - left[:3, 3]
    across /= max(float(norm(across)), 1e-9)
    if not (_faces(left, across) and _faces(right, -across)):
        return False
    told_left, told_right = (robot.tcp(felt.torso, felt.arm_command[s], s) for s in SIDES)
    apart = norm(left[:3, 3] - right[:3, 3]) - norm(told_left[:3, 3] - told_right[:3, 3])
    return bool(apart > _PRESSED_M)


def _faces(T_base_tcp: Array, toward: Array) -> bool:
    """Whether a hand points toward the other one or, its fingers pointing down, turns their flat sides to it."""
    ahead, flat = float(matmul(T_base_tcp[:3, 2], toward)), abs(float(matmul(T_base_tcp[:3, 0], toward)))
    return ahead > _FACING or (ahead > -_AWAY and flat > _FLAT and T_base_tcp[2, 2] < -_DOWN)


def pressing(robot: RobotModel, torso: Array, arms: Mapping[Side, Array]) -> dict[Side, Array]:
    """Arm commands, from postures (7,), that press the fingertips straight toward each other.

    Hands that are told to be further in would give way aside, turn, and slip: an arm gives more in some directions than
    in others. So each joint is told to be as far on as its spring takes to bear its share of a force that acts midway
    between the fingertips.
    """

    def tip(side: Side, q: Array) -> Array:
        return np.asarray(matmul(robot.tcp(torso, q, side), [0.0, 0.0, robot.hand.tip_m, 1.0])[:3])

    tips = {side: tip(side, arms[side]) for side in SIDES}
    rightward = (tips["right"] - tips["left"]) / max(float(norm(tips["right"] - tips["left"])), 1e-9)
    levers, forces = {}, [_FORCE_N]
    drives = {side: [robot.drives[joint] for joint in robot.arm_joints[side]] for side in SIDES}
    for side in SIDES:
        moved = np.stack([tip(side, arms[side] + step) for step in _STEP_RAD * np.eye(7)]) - tips[side]
        levers[side] = matmul(moved / _STEP_RAD, rightward) * SIGN[side]
        forces += [_STRAIN * d.force / max(abs(x), 1e-6) for d, x in zip(drives[side], levers[side], strict=True)]
    return {s: arms[s] + min(forces) * levers[s] / [d.stiffness for d in drives[s]] for s in SIDES}
