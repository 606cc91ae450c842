"""What a robot may be commanded: speeds of the base, joint limits, and how far a target may go in one step."""

from __future__ import annotations

from functools import cache

import numpy as np

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robot_description import RobotDescription

# Our choice: targets may run ahead of the joints, as those of learned policies do, so that a step may be three times
# what a joint does at its top speed; the base ramps its speed up by itself, and a gripper may be told to shut at once.
_AHEAD = 3.0
BASE_ACCELERATION = np.array([1.5, 1.5, 3.0])  # [m/s^2, m/s^2, rad/s^2]: a jerk flings what is held


@cache
def largest_step(robot: RobotDescription) -> Array:
    """(A,) how far targets of two steps in a row may be apart; infinite for base and grippers."""
    layout = robot.layout
    step = np.full(layout.size, np.inf)
    step[layout.torso] = _AHEAD / CONTROL_HZ * robot.torso_top_speed
    for side, arm in layout.arm.items():
        step[arm] = _AHEAD / CONTROL_HZ * robot.arm_top_speed[side]
    return step


@cache
def extremes(robot: RobotDescription) -> tuple[Array, Array]:
    """(A,) the lowest and (A,) the highest of each number of a robot's action: 0 of what it does not have."""
    layout = robot.layout
    lowest, highest = np.zeros(layout.size), np.zeros(layout.size)
    layout.set_velocity(lowest, -robot.base_speed)
    layout.set_velocity(highest, robot.base_speed)
    lowest[layout.torso], highest[layout.torso] = robot.torso_limits.T
    for side, arm in layout.arm.items():
        lowest[arm], highest[arm] = robot.arm_limits[side].T
    for gripper in layout.gripper.values():
        lowest[gripper], highest[gripper] = -1.0, 1.0
    return lowest, highest


def within_limits(robot: RobotDescription, action: Array) -> Array:
    """(A,) the nearest action within speeds, joint limits and -1 .. 1 of the grippers."""
    return np.clip(action, *extremes(robot))


def within_reach_of(robot: RobotDescription, last: Array, action: Array) -> Array:
    """(A,) the nearest action within all limits whose targets are no farther from those of `last` than a step goes.

    Args:
        robot: Whose limits.
        last: (A,) the command before.
        action: (A,) finite; what is asked for. One within the limits comes back bit by bit.
    """
    return np.clip(within_limits(robot, action), last - largest_step(robot), last + largest_step(robot))


def commanded(robot: RobotDescription, action: Array) -> Array:
    """(A,) the action, clipped to the robot's limits.

    Raises:
        BackendError: The action is not as many finite numbers as its layout has.
    """
    action = np.asarray(action, float)
    if action.shape != (size := robot.layout.size,):
        raise BackendError(f"an action of shape {action.shape} was given; it has to be ({size},)")
    if not np.isfinite(action).all():
        raise BackendError(f"an action that is not finite was given: {action.tolist()}")
    return within_limits(robot, action)


def travel_action(robot: RobotDescription) -> Array:
    """(A,) the command for standing in the travel posture, hands open."""
    layout = robot.layout
    action = np.zeros(layout.size)
    action[layout.torso] = robot.travel_torso
    for side, arm in layout.arm.items():
        action[arm] = robot.travel_arm[side]
    action[list(layout.gripper.values())] = 1.0
    return action
