"""The robot's own parts in a picture, by its joints: for detectors that do not know them for certain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robots import robot_named

_OUT_M = 0.015  # our choice: the spheres stand for links with rounded corners, and joints and depth are off a little


def own_body(points: Array, felt: Proprioception) -> NDArray[np.bool_]:
    """(H, W) bool: pixels within the spheres that stand for the robot's arms and trunk, but for its fingers.

    Fingers are left out as what they hold is between them. Robots that are no `RobotModel` have no such spheres.

    Args:
        points: (H, W, 3) world position of every pixel [m]; nan where nothing was measured.
        felt: Of the moment of the picture.
    """
    own = np.zeros(points.shape[:2], bool)
    robot = robot_named(felt.robot)
    if not isinstance(robot, RobotModel):
        return own
    body = Body(robot, felt.torso, felt.arm)
    parts = [robot.links(felt.torso)]
    for side, joints in felt.arm.items():
        centers, radii = body.spheres(side, joints)
        arm = len(radii) - robot.hull.fingers
        parts.append((centers[0, :arm], radii[:arm]))
    T = kin.base(felt.base_pose)
    for centers, radii in parts:
        for p, radius in zip(matmul(centers, T[:3, :3].T) + T[:3, 3], radii, strict=True):
            own |= ((points - p) ** 2).sum(-1) < (radius + _OUT_M) ** 2
    return own
