"""Robots are files: those that ship say what their models say, and what is wrong with a file is told in a line."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import load_marked
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.robot_reading import lint_robot_file, read_robot
from tests.robot_urdfs import FOLDER, MODELS, indented

EXAMPLE = Path(__file__).parent.parent / "examples" / "four_joints"
FOLDS = "r1pro"  # three joints fold its trunk in one plane; a file has one joint for each part of a posture

by_robot = pytest.mark.parametrize("name", MODELS)


def by_file(name: str) -> DescribedRobot:
    return read_robot(FOLDER / f"{name}.yaml")


def drawn(rng: np.random.Generator, limits: Array) -> Array:
    """(n,) joints anywhere within limits (n, 2)."""
    return rng.uniform(limits[:, 0], limits[:, 1])


@by_robot
def test_a_shipped_file_has_the_joints_limits_and_speeds_of_its_model(name: str) -> None:
    """To the bit; a number that no joint follows has no speed to compare."""
    robot, model = by_file(name), MODELS[name]
    assert robot.layout.names == model.layout.names
    assert robot.sides == model.sides
    assert robot.torso_joints == model.torso_joints
    for what in ("torso_limits", "travel_torso", "base_speed", "drive_acceleration"):
        assert np.array_equal(getattr(robot, what), getattr(model, what)), what
    real = [joint is not None for joint in model.torso_joints]
    assert np.array_equal(robot.torso_top_speed[real], model.torso_top_speed[real])
    for side in model.sides:
        assert robot.arm_joints[side] == model.arm_joints[side]
        assert robot.finger_joints[side] == model.finger_joints[side]
        for what in ("arm_limits", "arm_top_speed", "travel_arm"):
            assert np.array_equal(getattr(robot, what)[side], getattr(model, what)[side]), (what, side)
    assert robot.linear_joints == model.linear_joints
    assert (robot.opening_m, robot.grasp_m, robot.nods) == (model.opening_m, model.grasp_m, model.nods)


@by_robot
def test_a_shipped_file_has_the_base_and_cameras_of_its_model(name: str) -> None:
    """To the bit."""
    robot, model = by_file(name), MODELS[name]
    for what in ("radius_m", "folded_m", "turn_m", "own_m"):
        assert getattr(robot.base, what) == getattr(model.base, what), what
    assert np.array_equal(robot.base.corners, model.base.corners)
    assert list(robot.cameras) == list(model.cameras)
    for camera in model.cameras:
        ours, theirs = robot.cameras[camera], model.cameras[camera]
        assert (ours.width, ours.height, ours.fov_rad) == (theirs.width, theirs.height, theirs.fov_rad)
        assert (ours.near_m, ours.far_m) == (theirs.near_m, theirs.far_m)


@by_robot
def test_hands_and_cameras_of_a_shipped_file_are_where_its_model_has_them(name: str) -> None:
    """At 20 random postures: the URDF and the closed form are one robot."""
    robot, model = by_file(name), MODELS[name]
    rng = np.random.default_rng(0)
    for _ in range(20):
        torso = drawn(rng, model.torso_limits)
        arm = {side: drawn(rng, model.arm_limits[side]) for side in model.sides}
        for side in model.sides:
            assert np.allclose(robot.tcp(torso, arm[side], side), model.tcp(torso, arm[side], side), rtol=0, atol=1e-6)
        ours, theirs = robot.camera_poses(torso, arm), model.camera_poses(torso, arm)
        assert ours.keys() == theirs.keys()
        for camera in theirs:
            assert np.allclose(ours[camera], theirs[camera], rtol=0, atol=1e-6), camera


@pytest.mark.parametrize("name", [name for name in MODELS if name != FOLDS])
def test_a_trunk_of_a_shipped_file_has_the_postures_of_its_model(name: str) -> None:
    robot, model = by_file(name), MODELS[name]
    rng = np.random.default_rng(1)
    for _ in range(20):
        torso = drawn(rng, model.torso_limits)
        assert np.allclose(robot.trunk.posture(torso), model.trunk.posture(torso), rtol=0, atol=1e-9)


@by_robot
def test_a_shipped_urdf_is_what_its_model_writes(name: str) -> None:
    """`python -m tests.robot_urdfs` writes them."""
    assert (FOLDER / f"{name}.urdf").read_text() == indented(MODELS[name])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The robot of the example, to be spoiled."""
    for name in ("robot.yaml", "robot.urdf"):
        shutil.copy(EXAMPLE / name, tmp_path)
    return tmp_path


def spoil(folder: Path, name: str, old: str, new: str) -> int:
    """Write one thing otherwise. Returns its line."""
    text = (folder / name).read_text()
    assert text.count(old) == 1, old
    (folder / name).write_text(text.replace(old, new))
    return text[: text.index(old)].count("\n") + 1


FINGER = '<limit lower="0.0" upper="0.12" effort="20" velocity="0.2"/>'
PAN = '<limit lower="-2.5" upper="2.5" effort="20" velocity="1.0"/>'

WRONG = {
    "no limits": ("robot.urdf", PAN, '<limit effort="20" velocity="1.0"/>', "robot.yaml", "no limits of joint 'pan'"),
    "no speed": ("robot.urdf", PAN, '<limit lower="-2.5" upper="2.5"/>', "robot.yaml", "no speed of joint 'pan'"),
    "xacro": ("robot.urdf", 'size="0.06 0.06 1.0"', 'size="${w} 0.06 1.0"', "robot.urdf", "expand it: `xacro"),
    "two roots": ("robot.urdf", '<link name="carriage"/>', '<link name="carriage"/><link name="lost"/>', "robot.urdf",
                  "a robot has one root"),
    "no such parent": ("robot.urdf", '<parent link="hand"/>', '<parent link="hant"/>', "robot.urdf", "'hand'"),
    "a joint that follows": ("robot.urdf", FINGER, f'{FINGER}<mimic joint="lift"/>', "robot.yaml", "follows 'lift'"),
    "follows nothing": ("robot.urdf", FINGER, f'{FINGER}<mimic joint="lifd"/>', "robot.urdf", "'lift'"),
    "no such joint": ("robot.yaml", "[pan, lift, reach]", "[pan, lift, reech]", "robot.yaml", "'reach'"),
    "no such link": ("robot.yaml", "link: hand", "link: hant", "robot.yaml", "'hand'"),
    "no such camera link": ("robot.yaml", "camera_optical_frame", "camera_optical_fram", "robot.yaml",
                            "'camera_optical_frame'"),
    "intrinsics of another size": ("robot.yaml", "cx: 80, cy: 60", "cx: 320, cy: 240", "robot.yaml",
                                   "of a picture of about 640 x 480, not of 160 x 120"),
    "a car": ("robot.yaml", "kind: differential", "kind: ackermann", "robot.yaml", "steers like a car is not driven"),
    "no URDF": ("robot.yaml", "urdf: robot.urdf", "urdf: robots.urdf", "robot.yaml", "there is no file"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_in_a_line_with_its_place(folder: Path, case: str) -> None:
    name, old, new, where, told = WRONG[case]
    line = spoil(folder, name, old, new)
    with pytest.raises(FileProblems) as caught:
        read_robot(folder / "robot.yaml")
    (message,) = str(caught.value).splitlines()
    assert told in message
    assert message.startswith(f"{folder / where}:")
    if name == where:
        near = int(message.removeprefix(f"{folder / where}:").split(":")[0])
        assert line - 3 <= near <= line  # a joint is told by where it begins


def test_a_mesh_that_is_not_there_is_a_note(folder: Path) -> None:
    """A robot drives without it."""
    line = spoil(folder, "robot.urdf", '<box size="0.4 0.04 0.04"/>', '<mesh filename="package://arm/hand.stl"/>')
    (note,) = lint_robot_file(*load_marked(folder / "robot.yaml"))
    assert note.severity == "note"
    assert "hand.stl" in note.message
    assert (note.file, note.line) == (str(folder / "robot.urdf"), line)


def test_a_joint_that_mimics_another_follows_it(folder: Path) -> None:
    """With its factor and offset; and a second finger that follows opens the gripper by as much again."""
    width = read_robot(folder / "robot.yaml").opening_m
    joint = '<joint name="{}" type="prismatic"><parent link="{}"/><child link="{}"/><axis xyz="{}"/>{}</joint>\n'
    other = joint.format("other", "hand", "other", "0 -1 0", FINGER + '<mimic joint="finger"/>')
    nod = joint.format("nod", "mast", "eye", "0 0 1", PAN + '<mimic joint="lift" multiplier="2" offset="0.1"/>')
    spoil(folder, "robot.urdf", "</robot>", f'<link name="other"/><link name="eye"/>{other}{nod}</robot>')
    spoil(folder, "robot.yaml", "arms:", "  right: { link: eye, size: [16, 12], fov_rad: 1.0 }\narms:")
    robot = read_robot(folder / "robot.yaml")
    assert robot.opening_m == pytest.approx(2 * width)
    low, high = (
        robot.camera_poses(np.zeros(0), {"right": np.array([0.0, lift, 0.0])})["right"][2, 3] for lift in (0.0, 0.25)
    )
    assert low == pytest.approx(0.2 + 0.1)
    assert high == pytest.approx(0.2 + 0.1 + 2 * 0.25)


def test_a_fixed_joint_follows_none(folder: Path) -> None:
    """Though its URDF says so, as some do of what they have fixed."""
    still = '<joint name="still" type="fixed"><parent link="hand"/><child link="pad"/><mimic joint="lift"/></joint>'
    text = (folder / "robot.urdf").read_text()
    (folder / "robot.urdf").write_text(text.replace("</robot>", f'<link name="pad"/>{still}</robot>'))
    assert read_robot(folder / "robot.yaml").tree.joints["still"].mimic is None


def test_a_link_below_the_floor_is_a_warning(folder: Path) -> None:
    """With how high the base frame would have to be; robots that ship have none."""
    text = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(text.replace("kind: differential", "kind: differential\n  above_floor_m: -0.1"))
    (found,) = lint_robot_file(*load_marked(folder / "robot.yaml"))
    assert (found.code, found.severity) == ("below-floor", "warning")
    assert "0.10 m below the floor" in found.message
    assert "`above_floor_m: 0.00`" in found.message
    for file in (*FOLDER.glob("*.yaml"), *EXAMPLE.parent.glob("*_joints/robot.yaml")):
        assert lint_robot_file(*load_marked(file)) == []
