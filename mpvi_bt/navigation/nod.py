"""Tilting the head toward a place, or raising it above one, the rest of the robot holding still."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.protocol import CONTROL_HZ, ActionLayout, Robot
from mpvi_bt.robot.robots import robot_named
from mpvi_bt.robot.solids import Array

_LIFT, _TILT = ActionLayout.TORSO.start, ActionLayout.TORSO.start + 3
_TILT_RAD_S, _NEAR_RAD, _TILT_S = 1.5, 0.03, 1.5
_LIFT_M_S, _NEAR_M, _LIFT_S = 0.2, 0.01, 4.0
_OVER_M = 0.25  # above what is looked at


def tilt_toward(robot: Robot, p_world: Array) -> float:
    """The head tilt [rad] that brings a place (3,) to the middle of the head's picture, as far as the neck goes."""
    body = robot.proprioception()
    eye = matmul(kin.base(body.base_pose), robot_named(body.robot).head_camera(body.torso))
    away = float(norm(p_world[:2] - eye[:2, 3]))
    down = math.atan2(eye[2, 3] - p_world[2], max(away, 1e-3))
    low, high = robot_named(body.robot).torso_limits[3]
    return float(np.clip(down - body.torso[2], low, high))


def lift_over(robot: Robot, height_m: float) -> float:
    """The lift [m] of the torso from which the head looks down on what is so high, as far as it goes; never lower."""
    body = robot.proprioception()
    model = robot_named(body.robot)
    eye_m = float(model.head_camera(body.torso)[2, 3])
    lift = float(body.torso[0])
    return float(np.clip(lift + height_m + _OVER_M - eye_m, lift, model.torso_limits[0, 1]))


def nod(robot: Robot, tilt_rad: float) -> Iterator[None]:
    """One command a step until the head is tilted so; it gives up after a moment if it does not get there."""
    yield from _move(robot, _TILT, tilt_rad, _TILT_RAD_S, _NEAR_RAD, _TILT_S)


def crane(robot: Robot, lift_m: float) -> Iterator[None]:
    """One command a step until the torso is lifted so; it gives up after a moment if it does not get there."""
    yield from _move(robot, _LIFT, lift_m, _LIFT_M_S, _NEAR_M, _LIFT_S)


def _move(robot: Robot, joint: int, to: float, rate: float, near: float, most_s: float) -> Iterator[None]:
    """Move one joint of the torso, an index of the action, at a rate a second."""
    for _ in range(round(most_s * CONTROL_HZ)):
        felt = float(robot.proprioception().torso[joint - ActionLayout.TORSO.start])
        if abs(felt - to) < near:
            return
        robot.hold()
        action = robot.action.copy()
        step = rate / CONTROL_HZ
        action[joint] += float(np.clip(to - action[joint], -step, step))
        robot.act(action)
        yield
