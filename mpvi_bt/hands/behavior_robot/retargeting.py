"""A two-armed robot's joints as an R1Pro's, and back: settings for R1Pro can be tried on another robot.

The trunk goes by its posture, which means the same for every robot: the nearest one that the other trunk can take. Arms
keep their first four joints, which turn about the same axes; the last three turn the hand as it was in the frame of the
upper arm. Links differ in length, so that hands come out some centimeters off. An R1Pro's own numbers are not touched.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.arms import SphericalArm
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception
from mpvi_bt.ground.robot.robots import model_named

_R1PRO = "r1pro"
_STEP_S = 1e-4  # of differences that stand for a velocity
_SINGULAR = 1e-6  # sine of a bend at which the turns before and after it are one


def check_like_r1pro(robot: RobotModel) -> None:
    """Raise UserError unless an R1Pro's numbers can stand for the robot's."""
    if robot.sides != SIDES or not all(isinstance(arm, SphericalArm) for arm in robot.arms.values()):
        raise UserError(
            f"the {robot.name} is too unlike BEHAVIOR's R1Pro, which has two arms with shoulder, elbow and wrist: "
            "choose --robot r1pro, whose numbers these are."
        )


def as_r1pro(body: Proprioception) -> Proprioception:
    """The nearest that an R1Pro can feel. Raises as `check_like_r1pro`."""
    if body.robot == _R1PRO:
        return body
    robot, r1pro = model_named(body.robot), model_named(_R1PRO)
    check_like_r1pro(robot)
    arm = {side: _wrist_of_r1pro(robot, body.arm[side]) for side in SIDES}
    after = {side: _wrist_of_r1pro(robot, body.arm[side] + _STEP_S * body.arm_velocity[side]) for side in SIDES}
    trunk, trunk_after = (
        r1pro.trunk.joints(robot.trunk.posture(torso))
        for torso in (body.torso, body.torso + _STEP_S * body.torso_velocity)
    )
    return replace(
        body,
        torso=trunk,
        torso_velocity=(trunk_after - trunk) / _STEP_S,
        arm=arm,
        arm_velocity={side: kin.wrap(after[side] - arm[side]) / _STEP_S for side in SIDES},
        arm_command={side: _wrist_of_r1pro(robot, q) for side, q in body.arm_command.items()},
        robot=_R1PRO,
    )


def from_r1pro(actions: Array, body: Proprioception) -> Array:
    """(H, 23) an R1Pro's actions as the robot's own. Raises as `check_like_r1pro`.

    Args:
        actions: (H, 23) in our units, joints of an R1Pro.
        body: What the robot feels: of two ways to turn a hand the one that is nearer to the step before is taken.
    """
    if body.robot == _R1PRO:
        return actions
    robot, r1pro = model_named(body.robot), model_named(_R1PRO)
    check_like_r1pro(robot)
    out, layout = actions.copy(), r1pro.layout
    posture = r1pro.trunk.posture(actions[:, layout.torso])
    posture[:, 3] = math.asin(-float(r1pro.head_to_camera[2, 2]))  # an R1Pro cannot tilt its head
    out[:, layout.torso] = robot.trunk.joints(posture)
    for side in SIDES:
        near = np.array(body.arm[side], float)
        for row in out[:, layout.arm[side]]:
            row[4:] = near[4:] = _wrist(_turn(r1pro, row), robot, near)
    return out


def _wrist_of_r1pro(robot: RobotModel, q: Array) -> Array:
    """(7,) the arm's posture with R1Pro's last three joints."""
    q = np.asarray(q, float)
    return np.concatenate([q[:4], _wrist(_turn(robot, q), model_named(_R1PRO), q)])


def _last(robot: RobotModel) -> str:
    arm = robot.arms["left"]
    assert isinstance(arm, SphericalArm)
    return arm.last


def _turn(robot: RobotModel, q: Array) -> Array:
    """(3, 3) how the hand is turned in the frame of the forearm, before it turns about itself."""
    last = kin.rot_x(q[6]) if _last(robot) == "x" else kin.rot_z(-q[6])
    return matmul(matmul(kin.rot_z(q[4]), kin.rot_y(q[5])), last)


def _wrist(M: Array, robot: RobotModel, near: Array) -> Array:
    """(3,) the last three joints for this turn of the hand, nearest to a posture (7,)."""
    if _last(robot) == "x":  # its second joint turns by less than a right angle, so that there is one way only
        bend = math.asin(min(1.0, max(-1.0, -M[2, 0])))
        return np.array([math.atan2(M[1, 0], M[0, 0]), bend, math.atan2(M[2, 1], M[2, 2])])
    bend = math.acos(min(1.0, max(-1.0, M[2, 2])))
    if math.sin(bend) < _SINGULAR:
        turn = math.atan2(M[1, 0], M[1, 1])
        return np.array([near[4], 0.0, kin.wrap(near[4] - turn)])
    one = np.array([math.atan2(M[1, 2], M[0, 2]), bend, -math.atan2(M[2, 1], -M[2, 0])])
    other = np.array([one[0] + math.pi, -bend, one[2] + math.pi])
    other[[0, 2]] = kin.wrap(other[[0, 2]])
    return min(one, other, key=lambda q: float(np.abs(q - near[4:]).sum()))
