"""Straight drives, of bases that go any way and of those on two wheels."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.robot_description import RobotDescription

_NEAR_M = 0.02  # Our choice: what is left aside is not worth two turns
_STEER = 5.0  # [1/m] a base on two wheels turns by so much more as it would have to go sideways,
_CREEP_M_S = 0.1  # and by less when it goes slower than this: standing, it has no way to steer


def legs(robot: RobotDescription, start: Array, goal: Array) -> list[Array]:
    """Poses (3,) to go to `goal` by, one straight leg each.

    A base that cannot go sideways turns to face its way, or to have it behind, whichever is less turning in all.
    """
    way = goal[:2] - start[:2]
    if robot.sideways:
        return [goal]
    if norm(way) < _NEAR_M:
        return [np.array([*start[:2], goal[2]])]
    ahead = float(np.arctan2(way[1], way[0]))
    heading = min((ahead, ahead + np.pi), key=lambda a: abs(wrap(a - start[2])) + abs(wrap(goal[2] - a)))
    yaw = float(wrap(heading))
    return [np.array([*start[:2], yaw]), np.array([*goal[:2], yaw]), goal]


def in_base_frame(robot: RobotDescription, velocity_world: Array, yaw: float) -> Array:
    """(3,) vx, vy [m/s] and yaw rate [rad/s] in the base frame of a velocity in the world, within the robot's speeds.

    A base that cannot go sideways steers toward where it should.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    if robot.sideways:
        vx, vy, w = np.clip(velocity_world, -robot.base_speed, robot.base_speed)
        return np.array([c * vx + s * vy, -s * vx + c * vy, w])
    vx, vy, w = velocity_world
    ahead, aside = c * vx + s * vy, -s * vx + c * vy
    return np.clip([ahead, 0.0, w + steering(ahead, aside)], -robot.base_speed, robot.base_speed)


def steering(ahead: float, aside: float) -> float:
    """The yaw rate [rad/s] that moves a base going `ahead` [m/s] sideways at `aside` [m/s]."""
    return _STEER * aside * float(np.clip(ahead / _CREEP_M_S, -1.0, 1.0))
