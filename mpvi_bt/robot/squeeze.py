"""What two hands hold between them: a box pressed from both sides, the fingers open."""

from __future__ import annotations

import numpy as np

from mpvi_bt.robot.protocol import SIDES, Proprioception
from mpvi_bt.robot.robots import robot_named

_PRESSED_M = 0.02  # the hands are kept apart by at least that much more than they were told to be
_FACING = 0.4  # cosine between where a hand points and where the other one is: they have to face each other


def squeezes(felt: Proprioception) -> bool:
    """Whether something between the hands keeps them from closing in on each other (Our choice: by 2 cm or more)."""
    if not felt.arm_command or len(felt.sides) < 2:
        return False
    robot = robot_named(felt.robot)
    turned = sum(float(np.abs(felt.arm[s] - felt.arm_command[s]).sum()) for s in SIDES)
    if turned * robot.arms["left"].reach_m <= _PRESSED_M:  # no hand can be as far as that from where it was told to be
        return False
    left, right = (robot.tcp(felt.torso, felt.arm[s], s) for s in SIDES)
    across = right[:3, 3] - left[:3, 3]
    across /= max(float(np.linalg.norm(across)), 1e-9)
    if left[:3, 2] @ across < _FACING or right[:3, 2] @ -across < _FACING:
        return False
    told_left, told_right = (robot.tcp(felt.torso, felt.arm_command[s], s) for s in SIDES)
    apart = np.linalg.norm(left[:3, 3] - right[:3, 3]) - np.linalg.norm(told_left[:3, 3] - told_right[:3, 3])
    return bool(apart > _PRESSED_M)
