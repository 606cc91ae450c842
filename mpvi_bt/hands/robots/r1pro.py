"""The r1pro: BEHAVIOR's robot, Galaxea's R1 Pro, made of primitives. Two arms on a trunk that folds, any way it drives.

Joints, their names, places and limits are those of the URDF that BEHAVIOR uses; sizes of primitives are the bounds of
its meshes. What is felt and commanded are BEHAVIOR's numbers. Angles of zero stand the trunk up and hang the arms down.

What differs, by our choice: pictures are smaller than BEHAVIOR's 720 and 480 pixels, as each pixel is drawn on a
processor; motors of the trunk are stronger, and no gravity is on it, as if it were compensated.
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
from mpvi_bt.ground.robot.model import SIGN, Drive, Hull, RobotModel
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.trunk import FoldingTrunk
from mpvi_bt.hands.robots.action_numbers import action_layout

HIP_M = np.array([-0.079032, 0.0, 0.34265])  # in the base frame
THIGH_M, SHIN_M, NECK_M = 0.4, 0.3, 0.09962  # hip, knee, waist, chest
ARM_BASE_M: Mapping[Side, Array] = {  # in the chest frame
    "left": np.array([-0.00048618, 0.097234, 0.30302]),
    "right": np.array([-0.00048706, -0.097236, 0.30302]),
}
SHOULDER_OUT_M = 0.0735 + 0.081265  # from there to where the axes of the shoulder meet, away from the other arm
UPPER_ARM_M = 0.1155 + 0.1945
FOREARM_M = 0.095 + 0.16305
GRIPPER_M = 0.16065  # wrist to the gripper's frame
TCP_M = GRIPPER_M + 0.06  # wrist to BEHAVIOR's eef frame, 18 mm before the tips of the pads
FINGER_TRAVEL_M = 0.05
ZED_M, ZED_RPY = np.array([0.065511, 0.060003, 0.47598]), (-1.9199, 0.0, -1.5708)  # in the chest frame
HEAD_CAMERA_M = np.array([0.06, 0.0, 0.01])  # in that of zed_link, whose axes are those of the picture
REALSENSE_M, REALSENSE_RPY = np.array([0.05051, 0.0028934, 0.0051317]), (-3.1376, -0.43631, 3.1399)  # of the gripper
BASE_M = np.array([[-0.40, 0.24], [-0.34, 0.34]])  # the base's bounds along x and y
DECK_M = 0.20  # height of the base, but for what the hip is on

_BASE_JOINTS = ("base_footprint_x_joint", "base_footprint_y_joint", "base_footprint_rz_joint")
_TORSO_JOINTS = tuple(f"torso_joint{i}" for i in range(1, 5))
_ARM_JOINTS: Mapping[Side, tuple[str, ...]] = {s: tuple(f"{s}_arm_joint{i}" for i in range(1, 8)) for s in SIGN}
_FINGER_JOINTS: Mapping[Side, tuple[str, str]] = {
    s: (f"{s}_gripper_finger_joint1", f"{s}_gripper_finger_joint2") for s in SIGN
}
_FINGER_LINKS: Mapping[Side, tuple[str, str]] = {
    s: (f"{s}_gripper_finger_link1", f"{s}_gripper_finger_link2") for s in SIGN
}

TORSO_LIMITS = np.array([[-1.1345, 1.8326], [-2.7925, 2.5307], [-1.8326, 1.5708], [-3.0543, 3.0543]])
_LEFT_LIMITS = np.array(
    [[-4.4506, 1.3090], [-0.1745, 3.1416], [-2.3562, 2.3562], [-2.0944, 0.3491], [-2.3562, 2.3562], [-1.0472, 1.0472],
     [-1.5708, 1.5708]]
)  # fmt: skip
_MIRROR = np.array([1, -1, -1, 1, -1, 1, -1])
ARM_LIMITS: Mapping[Side, Array] = {"left": _LEFT_LIMITS, "right": np.sort(_LEFT_LIMITS * _MIRROR[:, None], axis=1)}
TORSO_TOP_SPEED = np.array([2.5, 2.5, 2.5, 2.5])  # [rad/s]
ARM_TOP_SPEED = np.array([7.12, 7.12, 8.38, 8.38, 10.47, 10.47, 10.47])  # [rad/s]
ARM_TORQUE = np.array([55.0, 55.0, 25.0, 25.0, 18.0, 18.0, 18.0])  # [Nm]

# An episode of BEHAVIOR begins so, and so the robot drives: the hanging arms are over the base, whichever way it turns.
TRAVEL_TORSO = np.array([1.025, -1.45, -0.47, 0.0])
TRAVEL_ARM: Mapping[Side, Array] = {s: np.zeros(7) for s in SIGN}

_CHEST_X_M = float(HIP_M[0] + THIGH_M * np.sin(1.025) + SHIN_M * np.sin(1.025 - 1.45) + NECK_M * np.sin(0.045))
TRUNK = FoldingTrunk(
    hip=HIP_M[[0, 2]],
    thigh_m=THIGH_M,
    shin_m=SHIN_M,
    neck_m=NECK_M,
    forward_m=_CHEST_X_M,  # of the posture to begin with
    ground_m=0.47,  # as of the r1: so its shoulders, 0.30 m above the chest, too, are 0.77 m high at a lift of 0
    joint_limits=TORSO_LIMITS,
    # The widest range of lifts from the lowest on that goes with pitches down to the floor, found by sampling.
    limits=np.array([[0.05, 0.58], [-3.0543, 3.0543], [-0.3, 1.2], [0.0, 0.0]]),
)


def turned(roll: float, pitch: float, yaw: float) -> Array:
    """(3, 3) rotation of a URDF's rpy [rad]."""
    return _product(kin.rot_z(yaw), kin.rot_y(pitch), kin.rot_x(roll))


def _product(first: Array, *more: Array) -> Array:
    """Of matrices (3, 3), or at last a vector (3,): `matmul` would load numba with the list of robots."""
    out = first
    for factor in more:
        out = np.stack([(row[:, None] * factor.reshape(3, -1)).sum(0) for row in out]).reshape(factor.shape)
    return out


def _arm(side: Side) -> SphericalArm:
    shoulder = ARM_BASE_M[side] + [0.0, SIGN[side] * SHOULDER_OUT_M, 0.0]
    return SphericalArm(shoulder, UPPER_ARM_M, FOREARM_M, TCP_M, ARM_LIMITS[side], last="x")


def _head_camera() -> Array:
    R = turned(*ZED_RPY)
    return kin.transform(R, _product(R, HEAD_CAMERA_M))


def _wrist_camera() -> Array:
    """In the hand frame, which is the gripper's turned by half a turn about y, at the wrist."""
    half = np.diag([-1.0, 1.0, -1.0])
    R = _product(half, turned(*REALSENSE_RPY), kin.rot_z(-np.pi / 2))
    return kin.transform(R, _product(half, REALSENSE_M) + [0.0, 0.0, GRIPPER_M])


def _drives() -> dict[str, Drive]:
    """Gains by joint, of the r1's kind. Our choice for the trunk: 5 times its motors' torque, as it bears no load."""
    out = dict.fromkeys(_BASE_JOINTS, Drive(0.0, 1e3, 1e3)) | dict.fromkeys(_TORSO_JOINTS, Drive(2e4, 2e3, 500.0))
    for side in SIGN:
        out |= {n: Drive(1e3, 1e2, float(most)) for n, most in zip(_ARM_JOINTS[side], ARM_TORQUE, strict=True)}
        out |= dict.fromkeys(_FINGER_JOINTS[side], Drive(3e3, 1e2, 250.0))
    return out


# Spheres: centers and radii in the frames of upper arm, forearm, tcp.
_UPPER = [(0, 0, -0.03, 0.07), *((0, 0, -z, 0.056) for z in (0.12, 0.19, 0.26, 0.32))]
_FORE = [(0, 0, -z, 0.048) for z in (0.07, 0.13, 0.19, 0.25)]
_HAND = [
    *((0, 0, z, 0.042) for z in (-0.20, -0.15)),
    *((0, y, z, 0.036) for y in (-0.025, 0.025) for z in (-0.11, -0.085)),
    *((-0.048, y, -0.08, 0.022) for y in (-0.055, -0.01)),
    *((0, y, -0.052, 0.02) for y in (-0.085, 0.085)),
    *((0, y, z, 0.013) for y in (-0.056, 0.056) for z in (-0.02, 0.005)),
]
_SPHERES = np.array([*_UPPER, *_FORE, *_HAND], float)
_LINKS = np.array([*((0, 0, z, 0.09) for z in (0.0, 0.1, 0.2, 0.3, 0.4)), *((0, 0, z, 0.09) for z in (0.1, 0.2, 0.3))])
# So many that they reach no more than 3 cm beyond the base, as those of the r1.
_DECK = [(x, y) for x in np.linspace(-0.33, 0.17, 5) for y in np.linspace(-0.27, 0.27, 5)]
_HULL = Hull(
    centers=_SPHERES[:, :3].copy(),
    radii=_SPHERES[:, 3].copy(),
    frame=np.repeat([0, 1, 2], [len(_UPPER), len(_FORE), len(_HAND)]),
    fingers=4,
    boxes=np.array([(0.0115, 0, 0.192, 0.1075, 0.174, 0.223), (-0.01, 0, 0.49, 0.09, 0.10, 0.085)]),
    boxes_from=np.array([2, 2]),
    columns=np.array([(-0.08, 0, DECK_M / 2, 0.32, 0.34, DECK_M / 2), (-0.10, 0, 0.31, 0.10, 0.12, 0.11)]),
    base=np.array([0.24, DECK_M]),
    fold_m=0.11,
    trunk=np.array([(0.0, 0, 0.49, 0.13)] + [(0.01, y, z, 0.12) for y in (-0.07, 0.07) for z in (0.06, 0.19, 0.32)]),
    standing=np.array([(x, y, 0.10, 0.099) for x, y in _DECK] + [(-0.1, 0, 0.31, 0.15)]),
    links=_LINKS,
    link=np.repeat([0, 1], [5, 3]),
    link_boxes=np.array([(0, 0, 0.1995, 0.063, 0.089, 0.2625), (0, 0, 0.15, 0.063, 0.092, 0.213)]),  # as of the URDF
)  # fmt: skip

BASE = MobileBase(
    radius_m=float(np.abs(BASE_M).min()),
    folded_m=float(np.abs(BASE_M).min()),
    turn_m=0.327,  # from the middle to each of the steered wheels
    own_m=0.55,
    corners=np.array([(BASE_M[0, i], BASE_M[1, j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]),
)
HAND = Hand(
    travel_m=FINGER_TRAVEL_M,
    tip_m=0.018,
    finger_half_m=0.0055,
    tip_half_m=0.007,
    finger_z_m=np.array([-0.021, -0.006, 0.009]),
    finger_m=0.009,
    palm=(np.array([(0.0, y, -0.088) for y in (-0.04, 0.0, 0.04)]), np.full(3, 0.030)),
    wrist=(-TCP_M, 0.048),
    room_m=0.055,
    widest_m=0.086,
    pad_m=0.006,
    palm_reach_m=0.07,
)


R1PRO = RobotModel(
    name="r1pro",
    layout=action_layout(_TORSO_JOINTS, _ARM_JOINTS),
    urdf_writer="mpvi_bt.hands.robots.r1pro_urdf:r1pro_urdf",
    arms={s: _arm(s) for s in SIGN},
    trunk=TRUNK,
    base_joints=_BASE_JOINTS,
    torso_joints=_TORSO_JOINTS,
    arm_joints=_ARM_JOINTS,
    finger_joints=_FINGER_JOINTS,
    hand_links={s: f"{s}_gripper_link" for s in SIGN},
    finger_links=_FINGER_LINKS,
    arm_speed=np.array([2.0, 2.0, 2.0, 2.0, 2.5, 2.5, 2.5]),
    arm_acceleration=np.array([6.0, 6.0, 6.0, 6.0, 8.0, 8.0, 8.0]),
    torso_speed=np.array([0.7, 1.0, 0.8, 0.8]),
    torso_acceleration=np.array([1.5, 2.0, 2.0, 2.5]),
    base_speed=np.array([0.75, 0.75, 1.0]),  # BEHAVIOR's
    torso_give=np.array([0.03, 0.03, 0.03, 0.04]),
    top_speed=np.concatenate([TORSO_TOP_SPEED, ARM_TOP_SPEED]),
    drive_acceleration=np.array([1.0, 2.0]),
    head_m=ZED_M,
    head_to_camera=_head_camera(),
    tcp_m=TCP_M,
    hand_to_camera=_wrist_camera(),
    hand=HAND,
    base=BASE,
    arm_m=0.05,
    travel_arm=TRAVEL_ARM,
    travel_torso=TRAVEL_TORSO,
    lifts=(0.05, 0.15, 0.25, 0.35, 0.453, 0.58),
    # Our choice: of places 0.1 m apart those in reach from most of the torsos that searches try, hand down or ahead.
    # The first shows its head most of a vessel's rim.
    aside=np.array([(0.60, 0.40, 0.85), (0.55, 0.50, 0.75), (0.50, 0.50, 0.85), (0.60, 0.50, 0.90)]),
    # Our choice: of places 0.1 m apart those from where the other hand reaches over most of a bin's opening.
    meets=np.array([(0.55, 0.0, 0.80), (0.55, 0.0, 0.70), (0.55, 0.1, 0.80), (0.55, 0.0, 0.90)]),
    drives=_drives(),
    cameras={
        "head": Camera(320, 320, float(np.deg2rad(99.3)), 0.02, 20.0, "head_camera_link"),
        "left": Camera(224, 224, float(np.deg2rad(63.4)), 0.01, 10.0, "left_wrist_camera_link"),
        "right": Camera(224, 224, float(np.deg2rad(63.4)), 0.01, 10.0, "right_wrist_camera_link"),
    },
    hull=_HULL,
    neighbors=(
        ("base_link", *(f"torso_link{i}" for i in range(1, 5)), "zed_link"),
        *(
            group
            for s in SIGN
            for group in (
                ("torso_link4", f"{s}_arm_base_link", f"{s}_arm_link1", f"{s}_arm_link2", f"{s}_arm_link3"),
                tuple(f"{s}_arm_link{i}" for i in range(2, 6)),
                (*(f"{s}_arm_link{i}" for i in range(5, 8)), f"{s}_gripper_link"),
                (f"{s}_gripper_link", f"{s}_realsense_link", *_FINGER_LINKS[s]),
            )
        ),
    ),
)
