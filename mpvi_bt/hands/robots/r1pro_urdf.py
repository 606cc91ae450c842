"""Writes the r1pro as a URDF: the frames, masses and torques of BEHAVIOR's, of primitives as large as its meshes."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import NamedTuple

from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.robots import r1pro
from mpvi_bt.hands.robots.r1pro import R1PRO
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

_TORSO_TORQUE, _FINGER_FORCE = 100.0, 100.0  # [Nm, N]
_WHEELS = ((0.16897, 0.28), (0.16897, -0.28), (-0.32703, 0.0))  # x, y [m]
_FROM_OPTICAL = (math.pi / 2, -math.pi / 2, 0.0)  # rpy of a camera's link, which looks along x, in its picture's frame


class _Row(NamedTuple):
    """A link of an arm: place of its joint, its axis, and the box that it fills, of the left arm."""

    place: Vector
    axis: Vector
    mass: float
    low: Vector
    high: Vector
    touches: bool
    color: Vector


_ARM = (
    _Row((0, 0.0735, 0), (0, 1, 0), 1.135, (-0.024, 0, -0.05), (0.025, 0.132, 0.05), False, DARK),
    _Row((0.025012, 0.081265, 0), (1, 0, 0), 0.92, (-0.079, -0.057, -0.093), (0.029, 0.058, 0.055), False, WHITE),
    _Row((-0.025012, 0, -0.1155), (0, 0, 1), 1.245, (-0.047, -0.046, -0.232), (0.048, 0.046, 0.022), True, WHITE),
    _Row((0, 0.035065, -0.1945), (0, 1, 0), 0.827, (-0.042, -0.08, -0.114), (0.043, 0.01, 0.036), False, DARK),
    _Row((0, -0.035065, -0.095), (0, 0, 1), 0.939, (-0.041, -0.042, -0.187), (0.041, 0.042, 0.03), True, WHITE),
    _Row((0, -0.028, -0.16305), (0, 1, 0), 0.527, (-0.029, -0.007, -0.03), (0.03, 0.056, 0.03), False, DARK),
    _Row((0.0295, 0.028, 0), (1, 0, 0), 0.185, (-0.059, -0.03, -0.092), (0.011, 0.03, 0.023), True, DARK),
)
# Where the right arm is not the left one's mirror image: x of joints 2 and 3.
_RIGHT_X_M = 0.023988


def r1pro_urdf() -> str:
    """The robot's description as URDF text."""
    robot = ET.Element("robot", name="r1pro")
    _base(robot)
    _trunk(robot)
    for side in SIDES:
        _arm(robot, side)
        _hand(robot, side)
    return ET.tostring(robot, encoding="unicode")


def _base(robot: ET.Element) -> None:
    add_base_joints(robot, R1PRO.base_joints)
    base = add_link(robot, "base_link", 47.63, (1.58, 1.46, 2.84), com=(-0.08, 0, 0.12))
    (back, front), (right, left) = r1pro.BASE_M
    length, width, middle, high = float(front - back), float(left - right), float(front + back) / 2, r1pro.DECK_M
    hip = vector(r1pro.HIP_M)
    add_visual(base, "box", (length, width, high - 0.10), (middle, 0, high / 2 + 0.04), DARK)
    add_visual(base, "box", (length - 0.06, width - 0.06, 0.01), (middle, 0, high - 0.005), WHITE)
    add_visual(base, "box", (0.02, 0.30, 0.03), (front, 0, 0.13), ORANGE)
    for y in (-0.11, 0.11):  # the hip is between two cheeks
        add_visual(base, "box", (0.16, 0.03, hip[2] - high + 0.08), (hip[0], y, (hip[2] + high) / 2 + 0.04), WHITE)
    for x, y in _WHEELS:
        add_visual(base, "cylinder", (0.07, 0.055), (x, y, 0.07), BLACK, (math.pi / 2, 0, 0))
        add_visual(base, "cylinder", (0.05, 0.06), (x, y, 0.14), DARK)
    add_collision(base, "box", (length, width, high - 0.03), (middle, 0, high / 2 + 0.015))
    add_collision(base, "box", (0.18, 0.24, 0.22), (hip[0] - 0.02, 0, 0.31))


def _trunk(robot: ET.Element) -> None:
    """Each link's box is half its length up."""
    parts: tuple[tuple[Vector, Vector, float, Vector, Vector], ...] = (
        (vector(r1pro.HIP_M), (0, 1, 0), 5.72, (-0.063, -0.089, -0.063), (0.063, 0.089, 0.462)),
        ((0, 0, r1pro.THIGH_M), (0, 1, 0), 3.5, (-0.063, -0.092, -0.063), (0.063, 0.092, 0.363)),
        ((0, 0.0001005, r1pro.SHIN_M), (0, -1, 0), 3.4, (-0.063, -0.071, -0.063), (0.063, 0.063, 0.125)),
        ((0, -0.00010015, r1pro.NECK_M), (0, 0, 1), 5.0, (-0.096, -0.174, -0.031), (0.119, 0.174, 0.415)),
    )
    links = []
    parent = "base_link"
    for i, (place, axis, mass, low, high) in enumerate(parts, start=1):
        size, middle = _filled(low, high)
        name = f"torso_link{i}"
        links.append(add_link(robot, name, mass, box_inertia(mass, *size), middle))
        add_collision(links[-1], "box", size, middle)
        bounds = tuple(map(float, r1pro.TORSO_LIMITS[i - 1]))
        add_joint(robot, f"torso_joint{i}", "revolute", parent, name, place, axis=axis, limits=bounds,
                  effort=_TORSO_TORQUE, speed=float(r1pro.TORSO_TOP_SPEED[i - 1]))  # fmt: skip
        parent = name
    thigh, shin, waist, chest = links
    across: Vector = (math.pi / 2, 0, 0)  # of a cylinder
    for link, length, width in ((thigh, r1pro.THIGH_M, 0.10), (shin, r1pro.SHIN_M, 0.08)):
        add_visual(link, "cylinder", (0.063, 0.17), ZERO, DARK, across)
        add_visual(link, "box", (0.10, width, length - 0.06), (0, 0, length / 2), WHITE)
    add_visual(thigh, "cylinder", (0.04, 0.18), (0, 0, r1pro.THIGH_M), BLUE, across)
    add_visual(waist, "cylinder", (0.063, 0.13), ZERO, DARK, across)
    add_visual(waist, "cylinder", (0.055, 0.10), (0, 0, 0.06), DARK)
    add_visual(chest, "box", (0.20, 0.22, 0.20), (0.01, 0, 0.09), WHITE)
    add_visual(chest, "box", (0.18, 0.32, 0.20), (0.01, 0, 0.30), WHITE)
    add_visual(chest, "box", (0.01, 0.14, 0.05), (0.106, 0, 0.30), BLUE)
    add_visual(chest, "cylinder", (0.04, 0.08), (-0.01, 0, 0.42), DARK)
    head = add_link(robot, "zed_link", 2.05, box_inertia(2.05, 0.20, 0.17, 0.17), (0.06, 0.03, -0.07))
    add_visual(head, "box", (0.20, 0.12, 0.13), (0.06, 0.0, -0.075), WHITE)
    add_visual(head, "box", (0.18, 0.07, 0.012), (0.06, 0.0, -0.006), BLACK)
    add_collision(head, "box", (0.20, 0.15, 0.15), (0.06, 0.02, -0.07))
    add_joint(robot, "zed_joint", "fixed", "torso_link4", "zed_link", vector(r1pro.ZED_M), r1pro.ZED_RPY)
    _camera(robot, "zed_link", "head_camera_link", vector(r1pro.HEAD_CAMERA_M), _FROM_OPTICAL)


def _arm(robot: ET.Element, side: Side) -> None:
    base = add_link(robot, f"{side}_arm_base_link", 1.48, (2e-3, 2e-3, 2e-3), (0, SIGN[side] * 0.037, 0))
    add_visual(base, "box", (0.12, 0.074, 0.128), (0, SIGN[side] * 0.037, 0), DARK)
    add_joint(robot, f"{side}_arm_base_joint", "fixed", "torso_link4", f"{side}_arm_base_link",
              vector(r1pro.ARM_BASE_M[side]))  # fmt: skip
    parent = f"{side}_arm_base_link"
    for i, row in enumerate(_ARM, start=1):
        name, mass = f"{side}_arm_link{i}", 0.63 if (side, i) == ("right", 5) else row.mass
        size, (x, y, z) = _filled(row.low, row.high)
        middle = (x, SIGN[side] * y, z)
        link = add_link(robot, name, mass, [max(3e-4, inertia) for inertia in box_inertia(mass, *size)], middle)
        if i in (3, 5):
            add_visual(link, "cylinder", (size[0] / 2, size[2]), middle, row.color)
        else:
            add_visual(link, "box", size, middle, row.color)
        if row.touches:
            add_collision(link, "box", size, middle)
        low, high = map(float, r1pro.ARM_LIMITS[side][i - 1])
        add_joint(robot, f"{side}_arm_joint{i}", "revolute", parent, name, _place(row.place, i, side), axis=row.axis,
                  limits=(low, high), effort=float(r1pro.ARM_TORQUE[i - 1]),
                  speed=float(r1pro.ARM_TOP_SPEED[i - 1]))  # fmt: skip
        parent = name


def _hand(robot: ET.Element, side: Side) -> None:
    gripper_name, realsense_name = f"{side}_gripper_link", f"{side}_realsense_link"
    gripper = add_link(robot, gripper_name, 0.246, (5e-4, 5e-4, 5e-4), (0, 0, 0.035))
    add_visual(gripper, "box", (0.06, 0.108, 0.077), (0, 0, 0.0385), WHITE)
    add_collision(gripper, "box", (0.06, 0.108, 0.077), (0, 0, 0.0385))
    add_joint(robot, f"{side}_gripper_joint", "fixed", f"{side}_arm_link7", gripper_name,
              (-0.0295, 0, -r1pro.GRIPPER_M))  # fmt: skip
    realsense = add_link(robot, realsense_name, 0.175, (2e-4, 2e-4, 2e-4), (0.01, -0.03, -0.012))
    add_visual(realsense, "box", (0.03, 0.089, 0.03), (0.0, -0.0325, -0.015), BLACK)
    add_collision(realsense, "box", (0.046, 0.089, 0.037), (0.01, -0.0325, -0.0115))
    add_joint(robot, f"{side}_realsense_joint", "fixed", gripper_name, realsense_name, vector(r1pro.REALSENSE_M),
              r1pro.REALSENSE_RPY)  # fmt: skip
    roll, pitch, _ = _FROM_OPTICAL
    _camera(robot, realsense_name, f"{side}_wrist_camera_link", ZERO, (roll, pitch, -math.pi / 2))
    joints = zip(R1PRO.finger_joints[side], R1PRO.finger_links[side], (1, -1), strict=True)
    for joint, name, sign in joints:  # a pad along z, and a carriage that goes aside, seen from where the finger slides
        finger = add_link(robot, name, 0.025, (1e-4, 1e-4, 1e-4), (0, 0, 0.01))
        place = (-8.9e-5, sign * 0.013453, -0.03689)
        pad, carriage = (
            (at[0], at[1] - place[1], at[2] - place[2]) for at in ((0, sign * 0.0055, -0.032), (0, sign * 0.03, -0.008))
        )
        add_visual(finger, "box", (0.014, 0.011, 0.092), pad, DARK)
        add_visual(finger, "box", (0.012, 0.002, 0.03), (0, pad[1] - sign * 0.005, pad[2] - 0.03), ORANGE)
        add_visual(finger, "box", (0.014, 0.043, 0.044), carriage, DARK)
        add_collision(finger, "box", (0.014, 0.011, 0.092), pad)
        add_collision(finger, "box", (0.014, 0.043, 0.044), carriage)
        add_joint(robot, joint, "prismatic", gripper_name, name, place, axis=(0, sign, 0),
                  limits=(0, r1pro.FINGER_TRAVEL_M), effort=_FINGER_FORCE, speed=0.25)  # fmt: skip
    add_link(robot, f"{side}_eef_link", 0.01, (1e-5, 1e-5, 1e-5))
    add_joint(robot, f"{side}_eef_joint", "fixed", gripper_name, f"{side}_eef_link", (0, 0, -0.06), (0, math.pi, 0))


def _camera(robot: ET.Element, parent: str, name: str, place: Vector, rpy: Vector) -> None:
    add_link(robot, name, 0.01, (1e-5, 1e-5, 1e-5))
    add_joint(robot, name.replace("_link", "_joint"), "fixed", parent, name, place, rpy)


def _place(left: Vector, joint: int, side: Side) -> Vector:
    """Where a joint of an arm is; those of the right arm are the left one's mirrored but for small parts of 1 mm."""
    if side == "left":
        return left
    x, y, z = left
    x = math.copysign(_RIGHT_X_M, x) if joint in (2, 3) else x
    y = {4: -0.035058, 5: 0.035058, 6: 0.028001, 7: -0.028001}.get(joint, -y)
    return (x, y, z)


def _filled(low: Vector, high: Vector) -> tuple[Vector, Vector]:
    """Size and middle of a box between two corners."""
    size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
    return size, ((high[0] + low[0]) / 2, (high[1] + low[1]) / 2, (high[2] + low[2]) / 2)
