"""What a robot may be commanded: speeds of the base, joint limits, and how far a target may go in one step."""

from __future__ import annotations

from functools import cache

import numpy as np

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import ACTION_SIZE, CONTROL_HZ, StaticLayout

# Our choice: targets may run ahead of the joints, as those of learned policies do, so that a step may be three times
# what a joint does at its top speed; the base ramps its speed up by itself, and a gripper may be told to shut at once.
_AHEAD = 3.0
BASE_ACCELERATION = np.array([1.5, 1.5, 3.0])  # [m/s^2, m/s^2, rad/s^2]: a jerk flings what is held


@cache
def largest_step(robot: RobotModel) -> Array:
    """(23,) how far targets of two steps in a row may be apart; infinite for base and grippers."""
    step = np.full(ACTION_SIZE, np.inf)
    step[StaticLayout.TORSO] = _AHEAD / CONTROL_HZ * robot.top_speed[:4]
    for arm in StaticLayout.ARM.values():
        step[arm] = _AHEAD / CONTROL_HZ * robot.top_speed[4:]
    return step


@cache
def extremes(robot: RobotModel) -> tuple[Array, Array]:
    """(23,) the lowest and (23,) the highest of each number of a robot's action: 0 of what it does not have."""
    lowest, highest = np.zeros(ACTION_SIZE), np.zeros(ACTION_SIZE)
    lowest[StaticLayout.BASE], highest[StaticLayout.BASE] = -robot.base_speed, robot.base_speed
    lowest[StaticLayout.TORSO], highest[StaticLayout.TORSO] = robot.torso_limits.T
    for side, arm in robot.arms.items():
        lowest[StaticLayout.ARM[side]], highest[StaticLayout.ARM[side]] = arm.limits.T
        lowest[StaticLayout.GRIPPER[side]], highest[StaticLayout.GRIPPER[side]] = -1.0, 1.0
    return lowest, highest


def within_limits(robot: RobotModel, action: Array) -> Array:
    """(23,) the nearest action within speeds, joint limits and -1 .. 1 of the grippers."""
    return np.clip(action, *extremes(robot))


def within_reach_of(robot: RobotModel, last: Array, action: Array) -> Array:
    """(23,) the nearest action within all limits whose targets are no farther from those of `last` than a step goes.

    Args:
        robot: Whose limits.
        last: (23,) the command before.
        action: (23,) finite; what is asked for. One within the limits comes back bit by bit.
    """
    return np.clip(within_limits(robot, action), last - largest_step(robot), last + largest_step(robot))


def commanded(robot: RobotModel, action: Array) -> Array:
    """(23,) the action, clipped to the robot's limits.

    Raises:
        BackendError: The action is not 23 finite numbers.
    """
    action = np.asarray(action, float)
    if action.shape != (ACTION_SIZE,):
        raise BackendError(f"an action of shape {action.shape} was given; it has to be ({ACTION_SIZE},)")
    if not np.isfinite(action).all():
        raise BackendError(f"an action that is not finite was given: {action.tolist()}")
    return within_limits(robot, action)


def travel_action(robot: RobotModel) -> Array:
    """(23,) the command for standing in the travel posture, hands open."""
    action = np.zeros(ACTION_SIZE)
    action[StaticLayout.TORSO] = robot.travel_torso
    for s in robot.sides:
        action[StaticLayout.ARM[s]] = robot.travel_arm[s]
        action[StaticLayout.GRIPPER[s]] = 1.0
    return action
