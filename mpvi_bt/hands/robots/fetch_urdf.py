"""Writes the Fetch as a URDF of boxes and cylinders, with the joints and links of the one that its maker publishes."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from mpvi_bt.hands.robots import fetch
from mpvi_bt.hands.robots.fetch import FETCH
from mpvi_bt.hands.robots.urdf_writing import (
    BLACK,
    BLUE,
    DARK,
    ORANGE,
    WHITE,
    ZERO,
    Vector,
    add_base_joints,
    add_collision,
    add_joint,
    add_link,
    add_visual,
    box_inertia,
    vector,
)

_Box = tuple[Vector, Vector]  # sizes and middle
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
# Of each link of the arm: name, mass [kg], box in its frame, its joint's place in the parent's, axis, effort, color.
# Boxes end short of each other: physics exempts only parent and child.
_LINKS: list[tuple[str, float, _Box, Vector, Vector, float, Vector]] = [
    ("shoulder_pan_link", 2.56, ((0.16, 0.11, 0.12), (0.04, 0, 0.04)), vector(fetch.PAN_M), _Z, 34, WHITE),
    ("shoulder_lift_link", 2.66, ((0.15, 0.09, 0.09), (0.085, 0, 0)), (0.117, 0, 0.06), _Y, 132, BLUE),
    ("upperarm_roll_link", 2.33, ((0.09, 0.09, 0.09), (0.05, 0, 0)), (0.219, 0, 0), _X, 77, WHITE),
    ("elbow_flex_link", 2.13, ((0.13, 0.09, 0.09), (0.08, 0, 0)), (0.133, 0, 0), _Y, 66, BLUE),
    ("forearm_roll_link", 1.66, ((0.09, 0.09, 0.09), (0.045, 0, 0)), (0.197, 0, 0), _X, 29, WHITE),
    ("wrist_flex_link", 1.73, ((0.10, 0.09, 0.09), (0.055, 0, 0)), (0.1245, 0, 0), _Y, 26, BLUE),
    ("wrist_roll_link", 0.5, ((0.03, 0.09, 0.09), (0.0, 0, 0)), (fetch.HAND_M, 0, 0), _X, 7, WHITE),
]


def fetch_urdf() -> str:
    """The robot's description as URDF text."""
    robot = ET.Element("robot", name="fetch")
    _base(robot)
    _trunk(robot)
    _arm(robot)
    return ET.tostring(robot, encoding="unicode")


def _base(robot: ET.Element) -> None:
    add_base_joints(robot, FETCH.base_joints)
    r, high = fetch.BASE_RADIUS_M, fetch.BASE_HEIGHT_M
    base = add_link(robot, "base_link", 70.1, (1.2, 1.3, 1.6), com=(0, 0, 0.12))
    add_visual(base, "cylinder", (r, high - 0.05), (0, 0, (high + 0.05) / 2), DARK)
    add_visual(base, "cylinder", (0.9 * r, 0.02), (0, 0, high), WHITE)
    add_visual(base, "box", (0.03, 0.12, 0.03), (r - 0.01, 0, 0.28), ORANGE)
    add_visual(base, "box", (0.13, 0.31, 0.44), (-0.187, 0, 0.59), WHITE)
    add_collision(base, "cylinder", (r, high - 0.03), (0, 0, (high + 0.03) / 2))
    add_collision(base, "box", (0.13, 0.31, 0.44), (-0.187, 0, 0.59))


def _trunk(robot: ET.Element) -> None:
    low, high = map(float, FETCH.torso_limits[0])
    torso = add_link(robot, "torso_lift_link", 10.8, (0.34, 0.34, 0.10), com=(0, 0, 0.29))
    for size, at in (((0.23, 0.34, 0.57), (-0.07, 0, 0.32)), ((0.12, 0.20, 0.17), (0.10, 0, 0.23))):
        add_visual(torso, "box", size, at, WHITE)
        add_collision(torso, "box", size, at)
    add_joint(robot, "torso_lift_joint", "prismatic", "base_link", "torso_lift_link", vector(fetch.LIFT_M), axis=_Z,
              limits=(low, high), effort=450, speed=0.1)  # fmt: skip
    pan = add_link(robot, "head_pan_link", 2.26, (0.013, 0.010, 0.018))
    add_visual(pan, "box", (0.25, 0.28, 0.09), (0.05, 0, 0.055), WHITE)
    add_collision(pan, "box", (0.25, 0.28, 0.09), (0.05, 0, 0.055))
    add_joint(robot, fetch.HEAD_PAN_JOINT, "revolute", "torso_lift_link", "head_pan_link", vector(fetch.HEAD_PAN_M),
              axis=_Z, limits=(-1.57, 1.57), effort=10)  # fmt: skip
    tilt = add_link(robot, "head_tilt_link", 0.91, (0.006, 0.003, 0.006))
    add_visual(tilt, "box", (0.09, 0.20, 0.09), ZERO, DARK)
    add_visual(tilt, "box", (0.01, 0.14, 0.05), (0.048, 0, 0.01), BLACK)
    add_collision(tilt, "box", (0.09, 0.20, 0.09), ZERO)
    low, high = map(float, FETCH.torso_limits[3])
    add_joint(robot, "head_tilt_joint", "revolute", "head_pan_link", "head_tilt_link", vector(fetch.HEAD_TILT_M),
              axis=_Y, limits=(low, high), effort=10)  # fmt: skip
    add_link(robot, "head_camera_link", 0.05, (1e-4, 1e-4, 1e-4))
    add_joint(robot, "head_camera_joint", "fixed", "head_tilt_link", "head_camera_link", vector(fetch.HEAD_CAMERA_M))


def _arm(robot: ET.Element) -> None:
    parent = "torso_lift_link"
    for row, name, bounds in zip(_LINKS, FETCH.arm_joints["right"], FETCH.arms["right"].limits, strict=True):
        link_name, mass, (size, at), place, axis, effort, color = row
        inertia = box_inertia(mass, *size)
        part = add_link(robot, link_name, mass, [max(2e-3, i) for i in inertia], at)
        add_visual(part, "box", size, at, color)
        if link_name != "wrist_roll_link":
            add_collision(part, "box", size, at)
        low, high = map(float, bounds)
        add_joint(robot, name, "revolute", parent, link_name, place, axis=axis, limits=(low, high), effort=effort)
        parent = link_name
    gripper = add_link(robot, "gripper_link", 1.52, (2e-3, 2e-3, 2.4e-3), (-0.09, 0, 0))
    add_visual(gripper, "box", (0.12, 0.125, 0.075), (-0.093, 0, 0), DARK)
    add_collision(gripper, "box", (0.12, 0.125, 0.075), (-0.093, 0, 0))
    add_joint(robot, "gripper_axis", "fixed", "wrist_roll_link", "gripper_link", (fetch.GRIPPER_M, 0, 0))
    middle = 0.0068 - fetch.FINGER_GAP_M
    for name, finger_name, sign in zip(FETCH.finger_joints["right"], FETCH.finger_links["right"], (-1, 1), strict=True):
        finger = add_link(robot, finger_name, 0.08, (2e-4, 2e-4, 2e-4))
        add_visual(finger, "box", (0.060, 0.0135, 0.026), (0.001, sign * middle, 0), DARK)
        add_visual(finger, "box", (0.022, 0.002, 0.022), (0.018, sign * (0.0005 - fetch.FINGER_GAP_M), 0), ORANGE)
        add_collision(finger, "box", (0.060, 0.0135, 0.026), (0.001, sign * middle, 0))
        add_joint(robot, name, "prismatic", "gripper_link", finger_name, (0, sign * fetch.FINGER_GAP_M, 0),
                  axis=(0, sign, 0), limits=(0, fetch.FINGER_TRAVEL_M), effort=60, speed=0.2)  # fmt: skip
    ahead, aside, up = fetch.WRIST_CAMERA_M[2], fetch.WRIST_CAMERA_M[1], -fetch.WRIST_CAMERA_M[0]
    add_link(robot, "wrist_camera_link", 0.01, (1e-5, 1e-5, 1e-5))
    add_joint(robot, "wrist_camera_joint", "fixed", "wrist_roll_link", "wrist_camera_link",
              (float(ahead), float(aside), float(up)), (0, fetch.WRIST_CAMERA_TILT_RAD, 0))  # fmt: skip
