"""The robot that is learned for, and the hand: the right one.

The left hand's world is seen as the right hand's, mirrored in the plane y = 0. Each function is its own inverse.
"""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.robots.r1 import R1, mirrored

BODY = R1
LAYOUT = R1.layout
SIDE: Side = "right"
_BASE = np.array([1.0, -1.0, -1.0])  # x, y, yaw, or their rates
_POINT = np.array([1.0, -1.0, 1.0])
_TORSO = np.array([1.0, -1.0, 1.0, 1.0])  # the waist's yaw


def base(base: Array) -> Array:
    """(..., 3) poses or velocities of the base."""
    return base * _BASE


def torso(joints: Array) -> Array:
    """(..., 4) joints of the torso."""
    return joints * _TORSO


def arm(joints: Array) -> Array:
    """(..., 7) joints of one arm that bring it to the mirrored posture of the other one."""
    return mirrored(joints, "right")


def points(points: Array) -> Array:
    """(..., 3) points."""
    return points * _POINT


def action(action: Array) -> Array:
    """(..., A) actions: what is told to one arm and hand is told to the other."""
    out = np.array(action, float)
    LAYOUT.set_velocity(out, base(LAYOUT.velocity(action)))
    out[..., LAYOUT.torso] = torso(action[..., LAYOUT.torso])
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        out[..., LAYOUT.arm[side]] = arm(action[..., LAYOUT.arm[other]])
        out[..., LAYOUT.gripper[side]] = action[..., LAYOUT.gripper[other]]
    return out
