"""The r1: a bimanual robot on a holonomic base, made of primitives, close to BEHAVIOR's R1Pro.

Frames: base x forward, y left, z up, on the floor. Chest: on the waist's pitch axis, turning with yaw and pitch.
Hand: z along the fingers (approach), y across them (closing), origin at the flange; the tcp lies between the pads.
Angles of zero hang the arm straight down.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mpvi_bt.robot.protocol import Side
from mpvi_bt.robot.solids import Array

SIGN: Mapping[Side, int] = {"left": 1, "right": -1}

UPPER_ARM_M = 0.32
FOREARM_M = 0.30
TCP_M = 0.158  # flange to tcp
WAIST_M = 0.45  # height of the lift's zero above the floor
CHEST_M = 0.02  # waist to chest origin
SHOULDER_M = np.array([0.0, 0.175, 0.30])  # left shoulder in the chest frame; the right one is mirrored
HEAD_M = np.array([-0.02, 0.0, 0.46])  # tilt axis in the chest frame
HEAD_CAMERA_M = np.array([0.085, 0.0, 0.055])  # in the head frame
WRIST_CAMERA_M = np.array([-0.085, 0.0, 0.10])  # in the hand frame
WRIST_CAMERA_TILT_RAD = 0.55  # toward the tcp
BASE_RADIUS_M = 0.27
FINGER_TRAVEL_M = 0.05  # of each finger; the hand opens 0.10 m

BASE_JOINTS = ("root_x_axis_joint", "root_y_axis_joint", "root_z_rotation_joint")
TORSO_JOINTS = ("torso_lift_joint", "waist_yaw_joint", "waist_pitch_joint", "head_tilt_joint")
ARM_JOINTS: Mapping[Side, tuple[str, ...]] = {s: tuple(f"{s}_arm_joint{i}" for i in range(1, 8)) for s in SIGN}
FINGER_JOINTS: Mapping[Side, tuple[str, str]] = {s: (f"{s}_leftfinger_joint", f"{s}_rightfinger_joint") for s in SIGN}

TORSO_LIMITS = np.array([[0.0, 0.55], [-1.57, 1.57], [-0.3, 1.4], [-0.6, 1.3]])
# The elbow could bend to -2.55, but forearm and upper arm touch from -2.2.
_LEFT_LIMITS = np.array([[-3.05, 1.6], [-0.25, 2.6], [-2.9, 2.9], [-2.1, 0.0], [-2.9, 2.9], [-2.0, 2.0], [-2.9, 2.9]])
_MIRROR = np.array([1, -1, -1, 1, -1, 1, -1])
ARM_LIMITS: Mapping[Side, Array] = {
    "left": _LEFT_LIMITS,
    "right": np.sort(_LEFT_LIMITS * _MIRROR[:, None], axis=1),
}
# What motions are planned with; nothing on the robot enforces the arms' and the torso's.
ARM_SPEED = np.array([2.0, 2.0, 2.0, 2.0, 2.5, 2.5, 2.5])  # [rad/s]
ARM_ACCELERATION = np.array([6.0, 6.0, 6.0, 6.0, 8.0, 8.0, 8.0])  # [rad/s^2]
TORSO_SPEED = np.array([0.25, 0.8, 0.7, 2.0])  # [m/s, rad/s, rad/s, rad/s]
TORSO_ACCELERATION = np.array([0.8, 2.5, 2.0, 8.0])  # [m/s^2, rad/s^2, rad/s^2, rad/s^2]
BASE_SPEED = np.array([0.8, 0.8, 1.5])  # [m/s, m/s, rad/s]
DRIVE_ACCELERATION = np.array([1.0, 2.0])  # of straight drives [m/s^2, rad/s^2]


def mirrored(q_left: Array, side: Side) -> Array:
    """The posture `q_left` (7,) of the left arm, mirrored if `side` is the right one."""
    return np.asarray(q_left, float) * (_MIRROR if side == "right" else 1)


# Hands folded before the chest: the whole robot within a radius of 0.31 m and a half width of 0.26 m, and 2.7 cm clear
# of itself at every pitch from a lift of 5 cm on, below that up to a pitch of 1 rad (found by sampling postures).
TRAVEL_ARM: Mapping[Side, Array] = {
    s: mirrored(np.array([0.51, 0.10, -0.28, -2.03, 0.05, -0.96, 0.0]), s) for s in SIGN
}
TRAVEL_TORSO = np.array([0.30, 0.0, 0.0, 0.5])


@dataclass(frozen=True)
class Camera:
    """A camera of the robot: picture size [px], vertical field of view [rad], nearest and farthest depth [m]."""

    width: int
    height: int
    fov_rad: float
    near_m: float
    far_m: float
    link: str


CAMERAS: Mapping[str, Camera] = {
    "head": Camera(320, 240, 1.2, 0.02, 20.0, "head_camera_link"),
    "left": Camera(224, 224, 1.4, 0.01, 10.0, "left_wrist_camera_link"),
    "right": Camera(224, 224, 1.4, 0.01, 10.0, "right_wrist_camera_link"),
}


@dataclass(frozen=True)
class Drive:
    """Gains of one kind of joint: force = stiffness * error - damping * velocity error, at most `force` [N, Nm]."""

    stiffness: float
    damping: float
    force: float


def drive(joint: str) -> Drive:
    """Gains of a joint, by name; measured to settle without overshoot (arms: 0.002 rad half a second after 0.3 rad)."""
    if joint in BASE_JOINTS:
        return Drive(0.0, 1e3, 1e3)
    if joint in TORSO_JOINTS:
        stiffness, force = dict(zip(TORSO_JOINTS, [(5e4, 2e3), (1e4, 500.0), (1e4, 800.0), (1e3, 50.0)], strict=True))[
            joint
        ]
        return Drive(stiffness, stiffness / 10, force)
    if "finger" in joint:
        return Drive(3e3, 1e2, 250.0)
    return Drive(1e3, 1e2, 100.0)
