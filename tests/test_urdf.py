"""The generated URDF is sound, and is the robot that the kinematics are about."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
import pytest

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.ground.robot.robots import ROBOTS, model_named, sides_of
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1_urdf import r1_urdf

TEXT = r1_urdf()
ROBOT = ElementTree.fromstring(TEXT)
LINKS = {link.attrib["name"]: link for link in ROBOT.iter("link")}
JOINTS = {joint.attrib["name"]: joint for joint in ROBOT.iter("joint")}
INTO = {joint.find("child").attrib["link"]: joint for joint in JOINTS.values()}  # type: ignore[union-attr]


def numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def about(axis: Array, angle: float) -> Array:
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def pose_of(link: str, positions: dict[str, float]) -> Array:
    """(4, 4) of a link in the root's frame, as any reader of URDF would compose it."""
    T = np.eye(4)
    while link in INTO:
        joint = INTO[link]
        origin = joint.find("origin")
        assert origin is not None
        roll, pitch, yaw = numbers(origin.attrib["rpy"])
        R = kin.rot_z(yaw) @ kin.rot_y(pitch) @ kin.rot_x(roll)
        own = kin.transform(R, numbers(origin.attrib["xyz"]))
        q = positions.get(joint.attrib["name"], 0.0)
        axis = joint.find("axis")
        if axis is not None:
            along = numbers(axis.attrib["xyz"])
            if joint.attrib["type"] == "prismatic":
                own = own @ kin.transform(np.eye(3), along * q)
            else:
                own = own @ kin.transform(about(along, q), (0.0, 0.0, 0.0))
        T = own @ T
        link = joint.find("parent").attrib["link"]  # type: ignore[union-attr]
    return T


@pytest.fixture(params=range(5))
def drawn(request):
    """Random positions of all joints, and the same as base, torso and arms."""
    rng = np.random.default_rng(request.param)
    base, torso = rng.uniform(-3, 3, 3), rng.uniform(r1.TORSO_LIMITS[:, 0], r1.TORSO_LIMITS[:, 1])
    arms = {s: rng.uniform(r1.ARM_LIMITS[s][:, 0], r1.ARM_LIMITS[s][:, 1]) for s in SIDES}
    positions = dict(zip(r1.BASE_JOINTS, base, strict=True)) | dict(zip(r1.TORSO_JOINTS, torso, strict=True))
    for s in SIDES:
        positions |= dict(zip(r1.ARM_JOINTS[s], arms[s], strict=True))
    return positions, base, torso, arms


def test_kinematics_compose_what_the_urdf_says(drawn) -> None:
    """Chest, tcps and cameras are where a plain reading of the URDF puts them."""
    positions, base, torso, arms = drawn
    T = kin.base(base)
    to_link = kin.transform(kin.LINK_TO_OPTICAL.T, (0.0, 0.0, 0.0))
    expected = {"chest_link": R1.chest(torso), "head_camera_link": R1.head_camera(torso) @ to_link}
    for s in SIDES:
        expected[f"{s}_tcp"] = R1.tcp(torso, arms[s], s)
        expected[f"{s}_wrist_camera_link"] = R1.wrist_camera(torso, arms[s], s) @ to_link
        upper, fore, _ = R1.arm_frames(arms[s], s)
        expected[f"{s}_arm_link3"] = R1.chest(torso) @ upper
        expected[f"{s}_arm_link5"] = R1.chest(torso) @ fore
    for link, pose in expected.items():
        np.testing.assert_allclose(pose_of(link, positions), T @ pose, atol=1e-6, err_msg=link)


def test_it_is_one_tree() -> None:
    """Every link but the root is the child of one joint, and comes from the root."""
    children = [joint.find("child").attrib["link"] for joint in JOINTS.values()]  # type: ignore[union-attr]
    assert len(children) == len(set(children)) == len(LINKS) - 1
    assert set(LINKS) - set(children) == {"root"}
    for link in LINKS:
        for _ in LINKS:
            if link == "root":
                break
            link = INTO[link].find("parent").attrib["link"]  # type: ignore[union-attr]
        assert link == "root"


def test_its_joints_are_the_models() -> None:
    """What moves is base, torso, arms and fingers, in the limits of the model."""
    moving = {name for name, joint in JOINTS.items() if joint.attrib["type"] != "fixed"}
    fingers = {name for s in SIDES for name in r1.FINGER_JOINTS[s]}
    arms = {name for s in SIDES for name in r1.ARM_JOINTS[s]}
    assert moving == {*r1.BASE_JOINTS, *r1.TORSO_JOINTS} | arms | fingers
    wanted: dict[str, Array] = {}
    wanted.update(zip(r1.TORSO_JOINTS, list(r1.TORSO_LIMITS), strict=True))
    for s in SIDES:
        wanted.update(zip(r1.ARM_JOINTS[s], list(r1.ARM_LIMITS[s]), strict=True))
        wanted |= dict.fromkeys(r1.FINGER_JOINTS[s], np.array([0.0, r1.FINGER_TRAVEL_M]))
    for name, limits in wanted.items():
        limit = JOINTS[name].find("limit")
        assert limit is not None
        assert [float(limit.attrib[k]) for k in ("lower", "upper")] == pytest.approx(limits.tolist())


@pytest.mark.parametrize("name", sorted(LINKS))
def test_every_link_has_a_possible_mass(name: str) -> None:
    """Mass and principal inertias are positive, and no inertia exceeds the sum of the others."""
    inertial = LINKS[name].find("inertial")
    assert inertial is not None
    assert float(inertial.find("mass").attrib["value"]) > 0  # type: ignore[union-attr]
    inertia = inertial.find("inertia")
    assert inertia is not None
    a, b, c = sorted(float(inertia.attrib[k]) for k in ("ixx", "iyy", "izz"))
    assert a > 0
    assert c <= a + b + 1e-12


def test_cameras_are_on_links_that_exist() -> None:
    """Every camera of the model names a link of the URDF."""
    assert {camera.link for camera in r1.CAMERAS.values()} <= set(LINKS)


def test_it_is_small_and_needs_no_meshes() -> None:
    """Primitives only, and the same text each time."""
    assert not list(ROBOT.iter("mesh"))
    assert len(TEXT) < 30_000
    assert r1_urdf() == TEXT


def test_every_joint_has_its_drive() -> None:
    """Each joint is damped and limited in force; all but the base's hold a position."""
    for name, joint in JOINTS.items():
        if joint.attrib["type"] != "fixed":
            gains = r1.R1.drives[name]
            assert gains.damping > 0
            assert gains.force > 0
            assert (gains.stiffness > 0) is (name not in r1.BASE_JOINTS)


@pytest.mark.parametrize("robot", list(ROBOTS))
def test_a_model_writes_the_robot_that_it_is_of(robot: str) -> None:
    """Every joint, link and camera of the model is in the URDF that it writes."""
    model = model_named(robot)
    assert sides_of(robot) == model.sides  # known before a model loads
    written = ElementTree.fromstring(model.urdf())
    joints, links = ({element.attrib["name"] for element in written.iter(kind)} for kind in ("joint", "link"))
    arms = [name for side in model.sides for name in (*model.arm_joints[side], *model.finger_joints[side])]
    assert {*model.base_joints, *filter(None, model.torso_joints), *arms, *model.still} <= joints
    hands = [name for side in model.sides for name in (model.hand_links[side], *model.finger_links[side])]
    assert {*hands, *(camera.link for camera in model.cameras.values())} <= links
