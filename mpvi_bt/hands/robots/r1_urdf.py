"""Writes the r1 as a URDF of boxes, cylinders and spheres, so that no mesh is needed and pictures stay cheap."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.robots import r1
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

_Look = tuple[str, Sequence[float], Vector, Vector]  # kind, size, place, color
_Hull = tuple[Vector, Vector]  # size and place of a box


def r1_urdf() -> str:
    """The robot's description as URDF text."""
    robot = ET.Element("robot", name="r1")
    _base(robot)
    _trunk(robot)
    for side in SIDES:
        _arm(robot, side)
    return ET.tostring(robot, encoding="unicode")


def _base(robot: ET.Element) -> None:
    add_base_joints(robot, r1.BASE_JOINTS)
    r = r1.BASE_RADIUS_M
    base = add_link(robot, "base_link", 40.0, (1.2, 1.2, 1.6), com=(0, 0, 0.12))
    add_visual(base, "cylinder", (r, 0.20), (0, 0, 0.13), DARK)
    add_visual(base, "cylinder", (0.8 * r, 0.03), (0, 0, 0.245), WHITE)
    add_visual(base, "box", (0.10, 0.14, 0.30), (-0.10, 0, 0.38), DARK)
    add_visual(base, "box", (0.03, 0.06, 0.03), (r - 0.01, 0, 0.16), ORANGE)
    add_collision(base, "cylinder", (r, 0.22), (0, 0, 0.14))
    add_collision(base, "box", (0.10, 0.14, 0.28), (-0.10, 0, 0.39))


def _trunk(robot: ET.Element) -> None:
    lift, yaw, pitch, tilt = r1.TORSO_JOINTS
    limits = [tuple(map(float, row)) for row in r1.TORSO_LIMITS]
    carriage = add_link(robot, "torso_lift_link", 6.0, (0.08, 0.08, 0.05))
    add_visual(carriage, "box", (0.12, 0.16, 0.14), (-0.10, 0, 0), WHITE)
    add_collision(carriage, "box", (0.12, 0.16, 0.10), (-0.10, 0, -0.03))
    add_joint(robot, lift, "prismatic", "base_link", "torso_lift_link", (0, 0, r1.WAIST_M), axis=(0, 0, 1),
              limits=limits[0], effort=600, speed=0.4)  # fmt: skip
    waist = add_link(robot, "waist_link", 2.0, (0.02, 0.02, 0.02))
    add_visual(waist, "cylinder", (0.075, 0.08), (-0.06, 0, 0.06), DARK)
    add_joint(robot, yaw, "revolute", "torso_lift_link", "waist_link", axis=(0, 0, 1), limits=limits[1], effort=200)
    chest = add_link(robot, "chest_link", 10.0, box_inertia(10.0, 0.16, 0.24, 0.30), com=(-0.03, 0, 0.18))
    add_visual(chest, "box", (0.14, 0.22, 0.30), (-0.04, 0, 0.19), WHITE)
    add_visual(chest, "box", (0.02, 0.12, 0.08), (0.035, 0, 0.20), BLUE)
    add_visual(chest, "cylinder", (0.035, 0.14), (-0.03, 0, 0.40), DARK)
    add_collision(chest, "box", (0.14, 0.22, 0.28), (-0.04, 0, 0.21))
    add_joint(robot, pitch, "revolute", "waist_link", "chest_link", (0, 0, r1.CHEST_M), axis=(0, 1, 0),
              limits=limits[2], effort=300)  # fmt: skip
    head = add_link(robot, "head_link", 1.5, (6e-3, 6e-3, 6e-3))
    add_visual(head, "box", (0.12, 0.18, 0.11), (0.01, 0, 0.05), WHITE)
    add_visual(head, "box", (0.012, 0.15, 0.06), (0.072, 0, 0.05), BLACK)
    add_collision(head, "box", (0.12, 0.18, 0.11), (0.01, 0, 0.05))
    add_joint(robot, tilt, "revolute", "chest_link", "head_link", vector(r1.HEAD_M), axis=(0, 1, 0), limits=limits[3],
              effort=20)  # fmt: skip
    add_link(robot, "head_camera_link", 0.05, (1e-4, 1e-4, 1e-4))
    add_joint(robot, "head_camera_joint", "fixed", "head_link", "head_camera_link", vector(r1.HEAD_CAMERA_M))


def _arm(robot: ET.Element, side: Side) -> None:
    a, b = r1.UPPER_ARM_M, r1.FOREARM_M
    # Gaps at elbow and wrist keep neighbors that physics does not exempt from touching.
    shoulder = vector(r1.SHOULDER_M * [1, SIGN[side], 1])
    links: list[tuple[float, Sequence[float], Vector, Vector, Vector, Vector, float, list[_Look], list[_Hull]]] = [
        (1.2, (4e-3,) * 3, ZERO, shoulder, ZERO, (0, 1, 0), 90, [("sphere", (0.06,), ZERO, DARK)], []),
        (1.0, (4e-3,) * 3, ZERO, ZERO, ZERO, (1, 0, 0), 90, [], []),
        (1.8, box_inertia(1.8, 0.09, 0.09, a), (0, 0, -a / 2), ZERO, ZERO, (0, 0, 1), 60,
         [("cylinder", (0.045, a - 0.05), (0, 0, -a / 2), WHITE)], [((0.08, 0.08, a - 0.13), (0, 0, -a / 2 + 0.015))]),
        (0.6, (3e-3,) * 3, ZERO, (0, 0, -a), ZERO, (0, 1, 0), 60, [("sphere", (0.05,), ZERO, BLUE)], []),
        (1.2, box_inertia(1.2, 0.07, 0.07, b), (0, 0, -b / 2), ZERO, ZERO, (0, 0, 1), 25,
         [("cylinder", (0.038, b - 0.06), (0, 0, -b / 2), WHITE)], [((0.07, 0.07, b - 0.12), (0, 0, -b / 2 - 0.01))]),
        (0.5, (2e-3,) * 3, ZERO, (0, 0, -b), ZERO, (0, 1, 0), 25, [("sphere", (0.042,), ZERO, DARK)], []),
        (0.5, (1.5e-3,) * 3, (0, 0, 0.05), ZERO, (0, math.pi, 0), (0, 0, 1), 15,
         [("cylinder", (0.035, 0.05), (0, 0, 0.045), DARK), ("box", (0.05, 0.15, 0.05), (0, 0, 0.09), WHITE),
          ("box", (0.03, 0.05, 0.02), (-0.055, 0, 0.085), BLACK)], [((0.05, 0.15, 0.06), (0, 0, 0.085))]),
    ]  # fmt: skip
    parent = "chest_link"
    for i, (mass, inertia, com, xyz, rpy, axis, effort, visuals, collisions) in enumerate(links, start=1):
        name = f"{side}_hand" if i == 7 else f"{side}_arm_link{i}"
        link = add_link(robot, name, mass, inertia, com)
        for kind, size, at, color in visuals:
            add_visual(link, kind, size, at, color)
        for size, at in collisions:
            add_collision(link, "box", size, at)
        low, high = map(float, r1.ARM_LIMITS[side][i - 1])
        add_joint(robot, r1.ARM_JOINTS[side][i - 1], "revolute", parent, name, xyz, rpy, axis, (low, high), effort)
        parent = name
    for joint, name, sign in zip(r1.FINGER_JOINTS[side], r1.FINGER_LINKS[side], (1, -1), strict=True):
        finger = add_link(robot, name, 0.08, (2e-4, 2e-4, 2e-4), (0, sign * 0.006, 0.025))
        add_visual(finger, "box", (0.022, 0.012, 0.055), (0, sign * 0.007, 0.0275), DARK)
        add_visual(finger, "box", (0.020, 0.002, 0.022), (0, sign * 0.0005, 0.044), ORANGE)
        add_collision(finger, "box", (0.022, 0.012, 0.055), (0, sign * 0.0065, 0.0275))
        add_joint(robot, joint, "prismatic", f"{side}_hand", name, (0, 0, 0.115), axis=(0, sign, 0),
                  limits=(0, r1.FINGER_TRAVEL_M), effort=60, speed=0.2)  # fmt: skip
    add_link(robot, f"{side}_tcp", 0.01, (1e-5, 1e-5, 1e-5))
    add_joint(robot, f"{side}_tcp_joint", "fixed", f"{side}_hand", f"{side}_tcp", (0, 0, r1.TCP_M))
    camera = f"{side}_wrist_camera_link"
    add_link(robot, camera, 0.01, (1e-5, 1e-5, 1e-5))
    add_joint(robot, f"{side}_wrist_camera_joint", "fixed", f"{side}_hand", camera, vector(r1.WRIST_CAMERA_M),
              (0, -math.pi / 2 + r1.WRIST_CAMERA_TILT_RAD, 0))  # fmt: skip
