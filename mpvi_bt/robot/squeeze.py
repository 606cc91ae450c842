"""What two hands hold between them: a box pressed from both sides, the fingers open."""

from __future__ import annotations

import numpy as np

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot import r1
from mpvi_bt.robot.protocol import SIDES, Proprioception

_PRESSED_M = 0.02  # the hands are kept apart by at least that much more than they were told to be
_FACING = 0.4  # cosine between where a hand points and where the other one is: they have to face each other
_ARM_M = r1.UPPER_ARM_M + r1.FOREARM_M + r1.TCP_M  # a joint that turns by 1 rad moves the tcp by no more


def squeezes(felt: Proprioception) -> bool:
    """Whether something between the hands keeps them from closing in on each other (Our choice: by 2 cm or more)."""
    if not felt.arm_command:
        return False
    turned = sum(float(np.abs(felt.arm[s] - felt.arm_command[s]).sum()) for s in SIDES)
    if turned * _ARM_M <= _PRESSED_M:  # no hand can be as far as that from where it was told to be
        return False
    left, right = (kin.tcp(felt.torso, felt.arm[s], s) for s in SIDES)
    across = right[:3, 3] - left[:3, 3]
    across /= max(float(np.linalg.norm(across)), 1e-9)
    if left[:3, 2] @ across < _FACING or right[:3, 2] @ -across < _FACING:
        return False
    told_left, told_right = (kin.tcp(felt.torso, felt.arm_command[s], s) for s in SIDES)
    apart = np.linalg.norm(left[:3, 3] - right[:3, 3]) - np.linalg.norm(told_left[:3, 3] - told_right[:3, 3])
    return bool(apart > _PRESSED_M)
