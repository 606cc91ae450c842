"""Which physics a robot has: by its model, or by the URDF of its file."""

from __future__ import annotations

from functools import cache

from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.house.sim.described_physics import described_physics
from mpvi_bt.house.sim.robot_physics import Finger, RobotPhysics


@cache
def physics_of(robot: RobotDescription) -> RobotPhysics:
    """What physics needs to know of a robot: by its model, or by the URDF of its file."""
    if isinstance(robot, DescribedRobot):
        return described_physics(robot)
    assert isinstance(robot, RobotModel)
    return RobotPhysics(
        urdf=robot.urdf(),
        base_joints=robot.base_joints,
        drives=robot.drives,
        mode="force",
        fingers={side: tuple(map(Finger, names)) for side, names in robot.finger_joints.items()},
        finger_links=robot.finger_links,
        hand_links=robot.hand_links,
        tip_m=robot.hand.tip_m,
        finger_half_m=robot.hand.finger_half_m,
        neighbors=robot.neighbors,
        still=robot.still,
    )
