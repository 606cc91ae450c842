"""The r1: a bimanual robot on a holonomic base, made of primitives, close to BEHAVIOR's R1Pro.

Frames are those of `model`; the chest's is on the waist's pitch axis, turning with yaw and pitch. Angles of zero hang
the arms straight down.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.arms import SphericalArm
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.model import SIGN, Drive, Hull, RobotModel, wrist_mount
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.trunk import LiftTrunk
from mpvi_bt.hands.robots.action_numbers import action_layout

# Our choice: a robot of about the size of BEHAVIOR's R1Pro.
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
FINGER_LINKS: Mapping[Side, tuple[str, str]] = {s: (f"{s}_leftfinger", f"{s}_rightfinger") for s in SIGN}

TORSO_LIMITS = np.array([[0.0, 0.55], [-1.57, 1.57], [-0.3, 1.4], [-0.6, 1.3]])
# The elbow could bend to -2.55, but forearm and upper arm touch from -2.2.
_LEFT_LIMITS = np.array([[-3.05, 1.6], [-0.25, 2.6], [-2.9, 2.9], [-2.1, 0.0], [-2.9, 2.9], [-2.0, 2.0], [-2.9, 2.9]])
_MIRROR = np.array([1, -1, -1, 1, -1, 1, -1])
ARM_LIMITS: Mapping[Side, Array] = {
    "left": _LEFT_LIMITS,
    "right": np.sort(_LEFT_LIMITS * _MIRROR[:, None], axis=1),
}
# What motions are planned with; nothing on the robot enforces the arms' and the torso's. Our choice.
ARM_SPEED = np.array([2.0, 2.0, 2.0, 2.0, 2.5, 2.5, 2.5])  # [rad/s]
ARM_ACCELERATION = np.array([6.0, 6.0, 6.0, 6.0, 8.0, 8.0, 8.0])  # [rad/s^2]
TORSO_SPEED = np.array([0.25, 0.8, 0.7, 2.0])  # [m/s, rad/s, rad/s, rad/s]
TORSO_ACCELERATION = np.array([0.8, 2.5, 2.0, 8.0])  # [m/s^2, rad/s^2, rad/s^2, rad/s^2]
TORSO_GIVE = np.array([0.015, 0.04, 0.04, 0.2])  # [m, rad, rad, rad]
TOP_SPEED = np.array([0.5, 2.0, 2.0, 5.0, *7 * [5.0]])  # of torso and arm [m/s, rad/s]
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


CAMERAS: Mapping[str, Camera] = {
    "head": Camera(320, 240, 1.2, 0.02, 20.0, "head_camera_link"),
    "left": Camera(224, 224, 1.4, 0.01, 10.0, "left_wrist_camera_link"),
    "right": Camera(224, 224, 1.4, 0.01, 10.0, "right_wrist_camera_link"),
}


def _drives() -> dict[str, Drive]:
    """Gains by joint, measured to settle without overshoot (arms: 0.002 rad half a second after 0.3 rad)."""
    torso = [Drive(5e4, 5e3, 2e3), Drive(1e4, 1e3, 500.0), Drive(1e4, 1e3, 800.0), Drive(1e3, 1e2, 50.0)]
    out = dict.fromkeys(BASE_JOINTS, Drive(0.0, 1e3, 1e3)) | dict(zip(TORSO_JOINTS, torso, strict=True))
    for side in SIGN:
        out |= dict.fromkeys(ARM_JOINTS[side], Drive(1e3, 1e2, 100.0))
        out |= dict.fromkeys(FINGER_JOINTS[side], Drive(3e3, 1e2, 250.0))
    return out


# Spheres: centers and radii in the frames of upper arm, forearm, tcp.
_UPPER = [(0, 0, -z, 0.05) for z in (0.10, 0.18, 0.26, 0.32)]
_FORE = [(0, 0, -z, 0.045) for z in (0.08, 0.16, 0.24, 0.30)]
_HAND = [
    *((0, y, 0.085 - TCP_M, 0.033) for y in (-0.06, -0.02, 0.02, 0.06)),
    (-0.055, 0, 0.085 - TCP_M, 0.02),
    *((0, y, z - TCP_M, 0.012) for y in (-0.055, 0.055) for z in (0.135, 0.155)),
]
_SPHERES = np.array([*_UPPER, *_FORE, *_HAND], float)
_HULL = Hull(
    centers=_SPHERES[:, :3].copy(),
    radii=_SPHERES[:, 3].copy(),
    frame=np.repeat([0, 1, 2], [len(_UPPER), len(_FORE), len(_HAND)]),
    fingers=4,
    boxes=np.array([(-0.04, 0, 0.21, 0.07, 0.11, 0.14), (-0.01, 0, 0.51, 0.06, 0.09, 0.06)]),
    boxes_from=np.array([1, 2]),
    columns=np.array([(-0.10, 0, 0.40, 0.06, 0.08, 0.20)]),
    link_boxes=np.array([(-0.10, 0, -0.03, 0.06, 0.08, 0.05)]),  # the carriage of the lift, as of the URDF
    base=np.array([BASE_RADIUS_M, 0.26]),
    fold_m=0.09,
    trunk=np.array([(0.03, 0, 0.52, 0.12), (-0.04, 0, 0.40, 0.09), (-0.04, 0.06, 0.25, 0.10),
                    (-0.04, -0.06, 0.25, 0.10), (-0.04, 0, 0.10, 0.11)]),
    standing=np.array([(0.0, 0.0, z, 0.30) for z in (0.04, 0.11, 0.18, 0.25)]
                      + [(-0.1, 0.0, z, 0.14) for z in (0.35, 0.5, 0.65, 0.8)]),
)  # fmt: skip

HAND = Hand(
    travel_m=FINGER_TRAVEL_M,
    tip_m=0.012,
    finger_half_m=0.0065,
    tip_half_m=0.011,
    finger_z_m=np.array([0.125, 0.143, 0.161]) - TCP_M,
    finger_m=0.009,
    palm=(np.array([(0.0, y, 0.085 - TCP_M) for y in (-0.06, -0.02, 0.02, 0.06)]), np.full(4, 0.030)),
    wrist=(-TCP_M, 0.045),
    room_m=0.038,
    widest_m=0.086,
    pad_m=0.006,
    palm_reach_m=0.07,
)

# Our choice, by trial in episodes.
ASIDE_M = np.array([(0.50, 0.30, 0.76), (0.52, 0.16, 0.76), (0.42, 0.36, 0.78), (0.50, 0.30, 0.90)])


R1 = RobotModel(
    name="r1",
    layout=action_layout(TORSO_JOINTS, ARM_JOINTS),
    urdf_writer="mpvi_bt.hands.robots.r1_urdf:r1_urdf",
    arms={s: SphericalArm(SHOULDER_M * [1, SIGN[s], 1], UPPER_ARM_M, FOREARM_M, TCP_M, ARM_LIMITS[s]) for s in SIGN},
    trunk=LiftTrunk(np.array([0.0, 0.0, WAIST_M]), CHEST_M, TORSO_LIMITS),
    base_joints=BASE_JOINTS,
    torso_joints=TORSO_JOINTS,
    arm_joints=ARM_JOINTS,
    finger_joints=FINGER_JOINTS,
    hand_links={s: f"{s}_hand" for s in SIGN},
    finger_links=FINGER_LINKS,
    arm_speed=ARM_SPEED,
    arm_acceleration=ARM_ACCELERATION,
    torso_speed=TORSO_SPEED,
    torso_acceleration=TORSO_ACCELERATION,
    base_speed=BASE_SPEED,
    torso_give=TORSO_GIVE,
    top_speed=TOP_SPEED,
    drive_acceleration=DRIVE_ACCELERATION,
    head_m=HEAD_M,
    head_to_camera=kin.transform(kin.LINK_TO_OPTICAL, HEAD_CAMERA_M),
    tcp_m=TCP_M,
    hand_to_camera=wrist_mount(WRIST_CAMERA_M, WRIST_CAMERA_TILT_RAD),
    hand=HAND,
    base=MobileBase(radius_m=BASE_RADIUS_M, folded_m=0.33, turn_m=BASE_RADIUS_M, own_m=0.50),
    arm_m=0.05,
    travel_arm=TRAVEL_ARM,
    travel_torso=TRAVEL_TORSO,
    lifts=(0.0, 0.1, 0.2, 0.3, 0.42, 0.55),
    aside=ASIDE_M,
    drives=_drives(),
    cameras=CAMERAS,
    hull=_HULL,
    neighbors=(
        ("base_link", "torso_lift_link", "waist_link", "chest_link", "head_link"),
        *(
            group
            for s in SIGN
            for group in (
                (f"{s}_arm_link3", f"{s}_arm_link5"),
                (f"{s}_arm_link5", f"{s}_hand"),
                FINGER_LINKS[s],
            )
        ),
    ),
)
