"""Tilting the head toward a place, or raising it above one, the rest of the robot holding still."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Robot
from mpvi_bt.ground.robot.robots import robot_named


@dataclass(frozen=True)
class Nod:
    """How a part of the trunk moves for a look.

    Our choice: a little slower than our robots' trunks can.

    Attributes:
        part: Index of the joint in the trunk's posture.
        rate: Speed [m/s or rad/s].
        near: Tolerance [m or rad].
        most_s: Time after which it gives up [s].
    """

    part: int
    rate: float
    near: float
    most_s: float


_LIFT, _TILT = Nod(0, 0.2, 0.01, 4.0), Nod(3, 1.5, 0.03, 1.5)
_OVER_M = 0.25  # our choice: of the eye above what it looks down on


def tilt_toward(robot: Robot, p_world: Array) -> float:
    """The head tilt [rad] that brings a place (3,) to the middle of the head's picture, as far as the neck goes."""
    body = robot.proprioception()
    model = robot_named(body.robot)
    eye = matmul(kin.base(body.base_pose), model.head_camera(body.torso))
    away = float(norm(p_world[:2] - eye[:2, 3]))
    down = math.atan2(eye[2, 3] - p_world[2], max(away, 1e-3))
    low, high = model.trunk.limits[3]
    return float(np.clip(down - model.trunk.posture(body.torso)[2], low, high))


def lift_over(robot: Robot, height_m: float) -> float:
    """Trunk lift [m] for the head to look down on something this high: within the limits, and never lower than now."""
    body = robot.proprioception()
    model = robot_named(body.robot)
    eye_m = float(model.head_camera(body.torso)[2, 3])
    lift = float(model.trunk.posture(body.torso)[0])
    return float(np.clip(lift + height_m + _OVER_M - eye_m, lift, model.trunk.limits[0, 1]))


def nod(robot: Robot, tilt_rad: float) -> Iterator[None]:
    """One command a step until the head is tilted so; it gives up after a moment if it does not get there."""
    yield from _move(robot, _TILT, tilt_rad)


def crane(robot: Robot, lift_m: float) -> Iterator[None]:
    """One command a step until the trunk is lifted so; it gives up after a moment if it does not get there."""
    yield from _move(robot, _LIFT, lift_m)


def _move(robot: Robot, how: Nod, to: float) -> Iterator[None]:
    """Change one part of the trunk's posture."""
    model = robot_named(robot.proprioception().robot)
    trunk, torso = model.trunk, model.layout.torso
    for _ in range(round(how.most_s * CONTROL_HZ)):
        if abs(float(trunk.posture(robot.proprioception().torso)[how.part]) - to) < how.near:
            return
        robot.hold()
        action = robot.action.copy()
        told = action[torso]
        posture = trunk.posture(told)
        step = how.rate / CONTROL_HZ
        posture[how.part] += float(np.clip(to - posture[how.part], -step, step))
        action[torso] = trunk.joints(posture, near=told)
        robot.act(action)
        yield
