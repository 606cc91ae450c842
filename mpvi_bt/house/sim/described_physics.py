"""A robot of a file as the simulator builds it: by its URDF alone.

Our choice, for what a URDF does not say: links do not collide with their own robot, and gravity does not act on it.
A mesh that is not there is left out.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.kinematic_chain import KinematicChain
from mpvi_bt.ground.robot.model import Drive
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.urdf_tree import UrdfJoint, mesh_file
from mpvi_bt.hands.robots.urdf_writing import Vector, add_joint, add_link, vector
from mpvi_bt.house.sim.robot_physics import Finger, MimicJoint, RobotPhysics

_BASE_JOINTS = ("mpvi_base_x", "mpvi_base_y", "mpvi_base_yaw")
_BASE_LINKS = ("mpvi_floor", "mpvi_base_x_link", "mpvi_base_y_link", "mpvi_base_link")
_LEAST_INERTIA = 1e-6  # [kg m^2] our choice: of a part of a few grams
_FAR = 1e3  # [m] that the base may go
# Our choice. Those of joints are in 1/s^2 and 1/s: a twentieth of a second to follow, without swinging.
_BASE = Drive(0.0, 20.0, 2e3)
_TURNS = Drive(400.0, 40.0, 100.0)
_SLIDES = Drive(400.0, 40.0, 2e3)
_GRIP_N_PER_M, _GRIP_DAMPING, _GRIP_N = 3e3, 1e2, 250.0  # as of the robots that ship


def described_physics(robot: DescribedRobot) -> RobotPhysics:
    """What physics needs to know of a robot of a file.

    Raises:
        UserError: A gripper has no fingers.
    """
    tree = robot.tree
    for side, names in robot.finger_joints.items():
        if not names:
            raise UserError(f"the {side} gripper of {robot.name} has no joints: our house cannot build it.")
    fingers = {side: tuple(_fingers(robot, side)) for side in robot.sides}
    drives = dict.fromkeys(_BASE_JOINTS, _BASE)
    moving = [joint for joint in tree.joints.values() if joint.kind in ("revolute", "continuous", "prismatic")]
    drives |= {joint.name: _SLIDES if joint.kind == "prismatic" else _TURNS for joint in moving}
    for side, group in fingers.items():
        drives |= {finger.joint: _grip(robot, tree.joints[finger.joint], side) for finger in group}
    gripping = {finger.joint for group in fingers.values() for finger in group}
    led = {*filter(None, robot.torso_joints), *(name for names in robot.arm_joints.values() for name in names)}
    followers = tuple(
        MimicJoint(joint.name, *joint.mimic)
        for joint in moving if joint.mimic is not None and joint.name not in gripping and joint.mimic[0] in led
    )  # fmt: skip
    following = {follower.joint for follower in followers}
    hands = {side: tree.joints[names[0]].parent for side, names in robot.finger_joints.items()}
    return RobotPhysics(
        urdf=_text(robot),
        base_joints=_BASE_JOINTS,
        drives=drives,
        mode="acceleration",
        fingers=fingers,
        finger_links={side: _held_between(robot, group, hands[side]) for side, group in fingers.items()},
        hand_links=hands,
        tip_m=0.0,
        finger_half_m=0.0,
        neighbors=(tuple(tree.links),),
        still=tuple(joint.name for joint in moving if joint.name not in led | gripping | following),
        followers=followers,
        mounts={name: _mount(robot, name) for name in robot.cameras},
    )


def _fingers(robot: DescribedRobot, side: Side) -> Iterator[Finger]:
    """The joints of a gripper, and those that follow them."""
    for name, (closed, opened) in zip(robot.finger_joints[side], robot.finger_range[side], strict=True):
        rate = float(opened - closed) / (robot.opening_m / 2)
        yield Finger(name, float(closed), rate)
        for joint in robot.tree.joints.values():
            if joint.mimic is not None and joint.mimic[0] == name:
                _, factor, offset = joint.mimic
                yield Finger(joint.name, factor * float(closed) + offset, factor * rate)


def _held_between(robot: DescribedRobot, fingers: tuple[Finger, ...], hand: str) -> tuple[str, ...]:
    """The links of the fingers; of a single finger the hand, too, against which it closes."""
    links = [robot.tree.joints[finger.joint].child for finger in fingers]
    return (*links, *([hand] if len(links) == 1 else ()))


def _grip(robot: DescribedRobot, joint: UrdfJoint, side: Side) -> Drive:
    """Gains that press as much on the tcp, whether a finger slides or turns."""
    arm_m = 1.0
    if joint.kind != "prismatic":
        joints = robot.travel_torso, robot.travel_arm[side]
        arm_m = max(0.02, float(norm(robot.tcp(*joints, side)[:3, 3] - _link_pose(robot, joint.child, side)[:3, 3])))
    return Drive(_GRIP_N_PER_M * arm_m**2, _GRIP_DAMPING * arm_m**2, _GRIP_N * arm_m)


def _link_pose(robot: DescribedRobot, link: str, side: Side | None) -> Array:
    """T_base_link (4, 4) in the travel posture."""
    path = robot.tree.path(link, robot.link)
    assert path is not None
    order, joints = robot.torso_joints, robot.travel_torso
    if side is not None:
        order, joints = (*order, *robot.arm_joints[side]), np.concatenate([joints, robot.travel_arm[side]])
    start = kin.transform(np.eye(3), (0.0, 0.0, robot.above_floor_m))
    return KinematicChain(path, order, start, np.eye(4)).pose(joints)


def _mount(robot: DescribedRobot, camera: str) -> Array:
    """T_link_camera (4, 4), optical frame."""
    T_base_link = _link_pose(robot, robot.cameras[camera].link, robot.carried[camera])
    T_base_camera = robot.camera_poses(robot.travel_torso, robot.travel_arm)[camera]
    return matmul(kin.inverse(T_base_link), T_base_camera)


def _text(robot: DescribedRobot) -> str:
    """The URDF with joints under the base, limits at all joints, and meshes where they are."""
    root = ET.fromstring(robot.tree.text)
    for element in list(root):
        if element.tag not in ("link", "joint", "material"):
            root.remove(element)
    for link in root.iter("link"):
        _keep_what_is_there(link, Path(robot.tree.file).resolve().parent)
        _make_inertia_possible(link)
    for joint in root.findall("joint"):
        _bound(joint, robot)
    _add_base(root, robot)
    return ET.tostring(root, encoding="unicode")


def _keep_what_is_there(link: ET.Element, folder: Path) -> None:
    """Leave out shapes whose mesh is not there; name the files of the others from anywhere."""
    for shape in [*link.findall("visual"), *link.findall("collision")]:
        for mesh in shape.iter("mesh"):
            file = mesh_file(mesh.get("filename", ""), folder)
            if file is None:
                link.remove(shape)
            else:
                mesh.set("filename", str(file))


def _make_inertia_possible(link: ET.Element) -> None:
    """Raise moments of inertia that no body has, such as negative ones of light parts that a tool has rounded."""
    inertia = link.find("inertial/inertia")
    if inertia is None:
        return
    xx, xy, xz, yy, yz, zz = (float(inertia.get(f"i{key}", "0")) for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
    third = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    if (xx > 0 and xx * yy > xy * xy and third > 0) or not any((xx, xy, xz, yy, yz, zz)):
        return
    low = min(xx - abs(xy) - abs(xz), yy - abs(xy) - abs(yz), zz - abs(xz) - abs(yz))  # no moment is lower: Gershgorin
    for key, value in (("ixx", xx), ("iyy", yy), ("izz", zz)):
        inertia.set(key, repr(value - low + _LEAST_INERTIA))


def _bound(joint: ET.Element, robot: DescribedRobot) -> None:
    """Give a joint the limits that it is commanded within; what follows another one is driven like any other."""
    if (mimic := joint.find("mimic")) is not None:
        joint.remove(mimic)
    kind, name = joint.get("type"), joint.get("name", "")
    if kind in ("floating", "planar"):
        joint.set("type", "fixed")
        return
    if kind == "fixed":
        return
    names = [*robot.torso_joints, *(n for side in robot.sides for n in robot.arm_joints[side])]
    limits = [*robot.torso_limits, *(row for side in robot.sides for row in robot.arm_limits[side])]
    names += [n for side in robot.sides for n in robot.finger_joints[side]]
    limits += [np.sort(row) for side in robot.sides for row in robot.finger_range[side]]
    own = robot.tree.joints[name].limits
    low, high = next((row for n, row in zip(names, limits, strict=True) if n == name), own or (-np.pi, np.pi))
    if kind == "continuous":
        joint.set("type", "revolute")
    if (limit := joint.find("limit")) is None:
        limit = ET.SubElement(joint, "limit", effort="100", velocity="1")
    limit.set("lower", str(float(low)))
    limit.set("upper", str(float(high)))


def _add_base(root: ET.Element, robot: DescribedRobot) -> None:
    """Add what moves the URDF's root over the floor, so that its base frame is where the base is."""
    for name in _BASE_LINKS[:-1]:
        add_link(root, name, 1.0, (1e-2, 1e-2, 1e-2))
    add_link(root, _BASE_LINKS[-1], 20.0, (1.0, 1.0, 1.0))
    x, y, yaw = _BASE_JOINTS
    for name, axis, parent, child in zip((x, y), ((1, 0, 0), (0, 1, 0)), _BASE_LINKS, _BASE_LINKS[1:], strict=False):
        add_joint(root, name, "prismatic", parent, child, axis=axis, limits=(-_FAR, _FAR), effort=1000, speed=10)
    add_joint(root, yaw, "continuous", _BASE_LINKS[2], _BASE_LINKS[3], axis=(0, 0, 1))
    path = robot.tree.path(robot.link)
    assert path is not None
    down = KinematicChain(path, (), np.eye(4), np.eye(4)).pose(np.zeros(0))
    T = matmul(kin.transform(np.eye(3), (0.0, 0.0, robot.above_floor_m)), kin.inverse(down))
    add_joint(root, "mpvi_base_fixed", "fixed", _BASE_LINKS[-1], robot.tree.root, vector(T[:3, 3]), _rpy(T[:3, :3]))


def _rpy(R: Array) -> Vector:
    """Roll, pitch and yaw of a rotation (3, 3), as a URDF has them."""
    pitch = float(np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])))
    return float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))
