"""What a robot feels, for tests of where numbers go: each is different from every other."""

from __future__ import annotations

from typing import Any

import numpy as np

from mpvi_bt.ground.robot.protocol import SIDES, Proprioception


def numbered_body(robot: str = "r1pro", yaw: float = 0.0) -> Proprioception:
    """A robot of two arms that is somewhere, turned by `yaw` [rad], and moves."""
    numbers = iter(np.arange(1, 100) / 100)

    def take(n: int) -> Any:
        return np.array([next(numbers) for _ in range(n)])

    return Proprioception(
        base_pose=np.array([1.5, -2.0, yaw]),
        base_velocity=take(3),
        torso=take(4),
        arm={side: take(7) for side in SIDES},
        arm_velocity={side: take(7) for side in SIDES},
        gripper_width={"left": 0.06, "right": 0.08},
        gripper_command={"left": -1.0, "right": 0.5},
        torso_velocity=take(4),
        gripper_velocity={"left": 0.02, "right": -0.04},
        robot=robot,
    )
