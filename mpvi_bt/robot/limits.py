"""What a robot may be commanded: speeds of the base, joint limits, and how far a target may go in one step."""

from __future__ import annotations

import numpy as np

from mpvi_bt.robot import r1
from mpvi_bt.robot.protocol import CONTROL_HZ
from mpvi_bt.robot.solids import Array

LOWEST = np.concatenate(
    [-r1.BASE_SPEED, r1.TORSO_LIMITS[:, 0], r1.ARM_LIMITS["left"][:, 0], [-1], r1.ARM_LIMITS["right"][:, 0], [-1]]
)
HIGHEST = np.concatenate(
    [r1.BASE_SPEED, r1.TORSO_LIMITS[:, 1], r1.ARM_LIMITS["left"][:, 1], [1], r1.ARM_LIMITS["right"][:, 1], [1]]
)

# Our choice: targets may run ahead of the joints, as those of learned policies do, so that a step may be three times
# what a joint does at its top speed; the base ramps its speed up by itself, and a gripper may be told to shut at once.
_AHEAD = 3.0
_ARM_RAD_S = 5.0
_TORSO_PER_S = np.array([0.5, 2.0, 2.0, 5.0])  # [m/s, rad/s, rad/s, rad/s]
_FREE = [np.inf]
LARGEST_STEP = _AHEAD / CONTROL_HZ * np.concatenate(
    [3 * _FREE, _TORSO_PER_S, 7 * [_ARM_RAD_S], _FREE, 7 * [_ARM_RAD_S], _FREE]
)  # fmt: skip


def within_limits(action: Array) -> Array:
    """(23,) the nearest action within speeds, joint limits and -1 .. 1 of the grippers."""
    return np.clip(action, LOWEST, HIGHEST)


def within_reach_of(last: Array, action: Array) -> Array:
    """(23,) the nearest action within all limits whose targets are no farther from those of `last` than a step goes.

    Args:
        last: (23,) the command before.
        action: (23,) finite; what is asked for. One within the limits comes back bit by bit.
    """
    return np.clip(within_limits(action), last - LARGEST_STEP, last + LARGEST_STEP)
