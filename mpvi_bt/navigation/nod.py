"""Tilting the head toward a place, the rest of the robot holding still."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.protocol import CONTROL_HZ, ActionLayout, Robot
from mpvi_bt.robot.robots import robot_named
from mpvi_bt.robot.solids import Array

_TILT = ActionLayout.TORSO.start + 3
_RATE_RAD_S = 1.5
_NEAR_RAD = 0.03
_MOST_S = 1.5


def tilt_toward(robot: Robot, p_world: Array) -> float:
    """The head tilt [rad] that brings a place (3,) to the middle of the head's picture, as far as the neck goes."""
    body = robot.proprioception()
    eye = kin.base(body.base_pose) @ robot_named(body.robot).head_camera(body.torso)
    away = float(np.linalg.norm(p_world[:2] - eye[:2, 3]))
    down = math.atan2(eye[2, 3] - p_world[2], max(away, 1e-3))
    low, high = robot_named(body.robot).torso_limits[3]
    return float(np.clip(down - body.torso[2], low, high))


def nod(robot: Robot, tilt_rad: float) -> Iterator[None]:
    """One command a step until the head is tilted so; it gives up after a moment if it does not get there."""
    for _ in range(round(_MOST_S * CONTROL_HZ)):
        felt = float(robot.proprioception().torso[3])
        if abs(felt - tilt_rad) < _NEAR_RAD:
            return
        robot.hold()
        action = robot.action.copy()
        step = _RATE_RAD_S / CONTROL_HZ
        action[_TILT] += float(np.clip(tilt_rad - action[_TILT], -step, step))
        robot.act(action)
        yield
