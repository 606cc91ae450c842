"""The Fetch: a mobile manipulator with one arm, on two wheels, made of primitives.

Joints, their places, limits and speeds are those that Fetch Robotics publishes (fetch_description, fetch.urdf), and so
are the links' names; sizes of primitives are those of its collision meshes. Angles of zero stretch the arm ahead.

What differs, by our choice: joints that turn on without end stop before half a turn, so that paths never wind up; the
head does not pan, as the robots' common layout has no such joint; and it has a camera at the wrist, as ManiSkill's has.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.robot.arms import PannedArm
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.model import Drive, Hull, RobotModel, wrist_mount
from mpvi_bt.ground.robot.trunk import LiftTrunk
from mpvi_bt.hands.robots.action_numbers import action_layout
from mpvi_bt.hands.robots.r1 import HAND

HAND_M = 0.1385  # wrist to flange, at the roll joint
GRIPPER_M = 0.16645  # flange to gripper_link, between the fingers
TCP_M = GRIPPER_M + 0.019  # flange to tcp: 12 mm before the fingertips, as the r1's
FINGER_TRAVEL_M = 0.05
FINGER_GAP_M = 0.015425  # of a finger's origin from the middle, closed
BASE_RADIUS_M = 0.288
BASE_HEIGHT_M = 0.36
LIFT_M = np.array([-0.086875, 0.0, 0.37743])  # of torso_lift_link, everything down, in the base frame
PAN_M = np.array([0.119525, 0.0, 0.34858])  # of the shoulder in torso_lift_link
HEAD_PAN_M = np.array([0.053125, 0.0, 0.603001])
HEAD_TILT_M = np.array([0.14253, 0.0, 0.057999])  # in head_pan_link
HEAD_CAMERA_M = np.array([0.055, 0.0, 0.0225])  # in head_tilt_link
WRIST_CAMERA_M = np.array([-0.10, 0.0, 0.08])  # in the hand frame
WRIST_CAMERA_TILT_RAD = 0.5
HEAD_PAN_JOINT = "head_pan_joint"  # stays where it is

_FREE = 3.1  # [rad] of a joint that turns on without end
_LIMITS = np.array(
    [[-1.6056, 1.6056], [-1.221, 1.518], [-_FREE, _FREE], [-2.251, 2.251], [-_FREE, _FREE], [-2.16, 2.16],
     [-_FREE, _FREE]]
)  # fmt: skip
_ARM = PannedArm(
    shoulder=PAN_M,
    offset=np.array([0.117, 0.0, 0.06]),
    upper_m=0.219 + 0.133,
    forearm_m=0.197 + 0.1245,
    tcp_m=HAND_M + TCP_M,
    limits=_LIMITS,
)
_TORSO_JOINTS = ("torso_lift_joint", None, None, "head_tilt_joint")
_ARM_JOINTS = (
    "shoulder_pan_joint", "shoulder_lift_joint", "upperarm_roll_joint", "elbow_flex_joint", "forearm_roll_joint",
    "wrist_flex_joint", "wrist_roll_joint",
)  # fmt: skip
_FINGERS = ("l_gripper_finger_joint", "r_gripper_finger_joint")
_FINGER_LINKS = ("l_gripper_finger", "r_gripper_finger")
_BASE_JOINTS = ("root_x_axis_joint", "root_y_axis_joint", "root_z_rotation_joint")

_SPHERES = np.array(
    [(x, 0, 0, 0.065) for x in (0.06, 0.14, 0.22, 0.30)]  # upper arm; what is before it is over the base
    + [(x, 0, 0, 0.065) for x in (0.0, 0.08, 0.16, 0.24, 0.31)]  # forearm
    + [(0, 0, z, 0.06) for z in (-0.26, -0.20)]
    + [(0, y, z, 0.047) for y in (-0.025, 0.025) for z in (-0.135, -0.09)]  # gripper
    + [(0, y, z, 0.013) for y in (-0.057, 0.057) for z in (-0.025, -0.002)],  # fingers, open
    float,
)
_HULL = Hull(
    centers=_SPHERES[:, :3].copy(),
    radii=_SPHERES[:, 3].copy(),
    frame=np.repeat([1, 2, 3], [4, 5, 10]),
    fingers=4,
    boxes=np.array([(-0.07, 0, 0.32, 0.115, 0.17, 0.285), (0.10, 0, 0.23, 0.06, 0.10, 0.09),
                    (0.09, 0, 0.66, 0.16, 0.145, 0.06)]),
    boxes_from=np.array([1, 2, 1]),
    columns=np.array([(-0.187, 0, 0.59, 0.068, 0.155, 0.23)]),
    base=np.array([BASE_RADIUS_M, BASE_HEIGHT_M]),
    fold_m=0.13,
    trunk=np.array([(-0.07, y, z, 0.13) for y in (-0.08, 0.08) for z in (0.12, 0.32, 0.5)] + [(0.09, 0, 0.66, 0.16)]),
    standing=np.array([(0.0, 0.0, z, 0.31) for z in (0.04, 0.11, 0.18, 0.25, 0.32)]
                      + [(-0.15, 0.0, z, 0.22) for z in (0.45, 0.6, 0.75, 0.9, 1.05)]),
)  # fmt: skip


FETCH = RobotModel(
    name="fetch",
    layout=action_layout(_TORSO_JOINTS, {"right": _ARM_JOINTS}),
    urdf_writer="mpvi_bt.hands.robots.fetch_urdf:fetch_urdf",
    arms={"right": _ARM},
    trunk=LiftTrunk(LIFT_M, 0.0, np.array([[0.0, 0.38615], [0.0, 0.0], [0.0, 0.0], [-0.76, 1.45]])),
    base_joints=_BASE_JOINTS,
    torso_joints=_TORSO_JOINTS,
    arm_joints={"right": _ARM_JOINTS},
    finger_joints={"right": _FINGERS},
    hand_links={"right": "gripper_link"},
    finger_links={"right": _FINGER_LINKS},
    arm_speed=np.array([1.256, 1.454, 1.571, 1.521, 1.571, 2.268, 2.268]),
    arm_acceleration=np.array([4.0, 4.0, 5.0, 5.0, 5.0, 7.0, 7.0]),
    torso_speed=np.array([0.1, 1.0, 1.0, 1.57]),
    torso_acceleration=np.array([0.5, 1.0, 1.0, 6.0]),
    base_speed=np.array([1.0, 0.0, 1.5]),
    drive_acceleration=np.array([1.0, 2.0]),
    torso_give=np.array([0.015, 0.04, 0.04, 0.2]),
    top_speed=np.array([0.5, 2.0, 2.0, 5.0, *7 * [5.0]]),  # as of the r1
    head_m=HEAD_PAN_M + HEAD_TILT_M,
    head_to_camera=kin.transform(kin.LINK_TO_OPTICAL, HEAD_CAMERA_M),
    tcp_m=TCP_M,
    hand_to_camera=wrist_mount(WRIST_CAMERA_M, WRIST_CAMERA_TILT_RAD),
    hand=replace(HAND, travel_m=FINGER_TRAVEL_M),  # Our choice: planned with as if it were the r1's
    base=MobileBase(radius_m=BASE_RADIUS_M, folded_m=0.33, turn_m=BASE_RADIUS_M, own_m=0.50),
    arm_m=0.05,
    travel_arm={"right": np.array([0.65, 1.22, -0.84, 2.15, -0.38, 1.44, 0.0])},  # within 0.33 m, 3 cm clear of itself
    travel_torso=np.array([0.20, 0.0, 0.0, 0.5]),
    lifts=(0.0, 0.1, 0.2, 0.3, 0.386),
    aside=np.zeros((0, 3)),  # with one arm there is no other hand
    drives={
        **dict.fromkeys(_BASE_JOINTS, Drive(0.0, 1e3, 1e3)),
        "torso_lift_joint": Drive(5e4, 5e3, 2e3),
        HEAD_PAN_JOINT: Drive(1e3, 1e2, 50.0),
        "head_tilt_joint": Drive(1e3, 1e2, 50.0),
        **dict.fromkeys(_ARM_JOINTS, Drive(1e3, 1e2, 100.0)),
        **dict.fromkeys(_FINGERS, Drive(3e3, 1e2, 250.0)),
    },
    cameras={
        "head": Camera(320, 240, 1.2, 0.02, 20.0, "head_camera_link"),
        "right": Camera(224, 224, 1.4, 0.01, 10.0, "wrist_camera_link"),
    },
    hull=_HULL,
    neighbors=(
        ("base_link", "torso_lift_link", "head_pan_link", "head_tilt_link"),
        ("torso_lift_link", "shoulder_pan_link", "shoulder_lift_link"),
        ("forearm_roll_link", "wrist_flex_link", "wrist_roll_link", "gripper_link"),
        _FINGER_LINKS,
    ),
    still=(HEAD_PAN_JOINT,),
)
