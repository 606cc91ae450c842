"""BEHAVIOR's 256 and 61 numbers: what stands where, both ways."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mpvi_bt.executive.remote.joint_dialects import DIALECTS
from mpvi_bt.ground.errors import BadMessage
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.behavior_robot.behavior_layout import (
    BASE_UNITS,
    FIELDS,
    SIZE,
    action_for,
    action_from,
    camera_poses,
    cameras_in_base,
    decoded,
    encoded,
    fields_of,
    pose_in_world,
    velocity_of_base,
)
from tests.layouts import ACTION_SIZE
from tests.numbered_body import numbered_body

# First index of each entry, as the table of BEHAVIOR's evaluator has them: left and right arm where there are two.
STARTS_2025: dict[str, int] = {
    "joint_qpos": 0, "joint_qpos_sin": 28, "joint_qpos_cos": 56, "joint_qvel": 84, "joint_qeffort": 112,
    "robot_pos": 140, "robot_ori_cos": 143, "robot_ori_sin": 146,
    "robot_2d_ori": 149, "robot_2d_ori_cos": 150, "robot_2d_ori_sin": 151,
    "robot_lin_vel": 152, "robot_ang_vel": 155,
    "arm_left_qpos": 158, "arm_left_qpos_sin": 165, "arm_left_qpos_cos": 172, "arm_left_qvel": 179,
    "eef_left_pos": 186, "eef_left_quat": 189, "gripper_left_qpos": 193, "gripper_left_qvel": 195,
    "arm_right_qpos": 197, "arm_right_qpos_sin": 204, "arm_right_qpos_cos": 211, "arm_right_qvel": 218,
    "eef_right_pos": 225, "eef_right_quat": 228, "gripper_right_qpos": 232, "gripper_right_qvel": 234,
    "trunk_qpos": 236, "trunk_qvel": 240,
    "base_qpos": 244, "base_qpos_sin": 247, "base_qpos_cos": 250, "base_qvel": 253,
}  # fmt: skip
STARTS_2026: dict[str, int] = {
    "base_qvel": 0,
    "arm_left_qpos": 3, "arm_left_qvel": 10, "eef_left_pos": 17, "eef_left_quat": 20,
    "gripper_left_qpos": 24, "gripper_left_qvel": 26,
    "arm_right_qpos": 28, "arm_right_qvel": 35, "eef_right_pos": 42, "eef_right_quat": 45,
    "gripper_right_qpos": 49, "gripper_right_qvel": 51,
    "trunk_qpos": 53, "trunk_qvel": 57,
}  # fmt: skip
ROBOT = "r1pro"


@pytest.mark.parametrize(
    ("dialect", "size", "starts"), [("behavior-2025", 256, STARTS_2025), ("behavior-2026", 61, STARTS_2026)]
)
def test_entries_stand_where_the_evaluator_has_them(dialect: Any, size: int, starts: dict[str, int]) -> None:
    """Every entry of the evaluator's table begins at its index, and together they are all numbers, without a gap."""
    assert {name: where.start for name, where in FIELDS[dialect].items()} == starts
    assert SIZE[dialect] == size
    taken = [i for where in FIELDS[dialect].values() for i in range(where.start, where.stop)]
    assert taken == list(range(size))


@pytest.mark.parametrize("dialect", DIALECTS)
def test_entries_are_what_the_robot_feels(dialect: Any) -> None:
    """Arms, hands, fingers and trunk are the robot's; hands are in the base frame, quaternions xyzw."""
    felt = numbered_body(yaw=0.7)
    fields = fields_of(encoded(felt, dialect), dialect)
    for side in SIDES:
        hand = robot_named(ROBOT).tcp(felt.torso, felt.arm[side], side)
        np.testing.assert_array_equal(fields[f"arm_{side}_qpos"], felt.arm[side])
        np.testing.assert_array_equal(fields[f"arm_{side}_qvel"], felt.arm_velocity[side])
        np.testing.assert_allclose(fields[f"eef_{side}_pos"], hand[:3, 3])
        np.testing.assert_allclose(Rotation.from_quat(fields[f"eef_{side}_quat"]).as_matrix(), hand[:3, :3], atol=1e-9)
        np.testing.assert_allclose(fields[f"gripper_{side}_qpos"], felt.gripper_width[side] / 2)
        np.testing.assert_allclose(fields[f"gripper_{side}_qvel"], felt.gripper_velocity[side] / 2)
    np.testing.assert_array_equal(fields["trunk_qpos"], felt.torso)
    np.testing.assert_array_equal(fields["trunk_qvel"], felt.torso_velocity)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_what_is_decoded_is_what_was_encoded(dialect: Any) -> None:
    """Numbers that are read back give what the robot feels, whichever frame the base's velocity is sent in."""
    felt = numbered_body(yaw=0.7)
    fields = fields_of(encoded(felt, dialect, loaded_at=(4.0, 1.0, 0.9)), dialect)
    read = decoded(fields, felt.base_pose, felt.gripper_command)
    np.testing.assert_allclose(read.base_velocity, felt.base_velocity)
    np.testing.assert_array_equal(read.torso, felt.torso)
    np.testing.assert_array_equal(read.torso_velocity, felt.torso_velocity)
    assert read.gripper_velocity == pytest.approx(felt.gripper_velocity)
    for side in SIDES:
        np.testing.assert_array_equal(read.arm[side], felt.arm[side])
        np.testing.assert_allclose(read.arm_velocity[side], felt.arm_velocity[side])
        assert read.gripper_width[side] == pytest.approx(felt.gripper_width[side])
    in_world = pose_in_world(fields)
    assert (in_world is None) == (dialect == "behavior-2026")
    if in_world is not None:
        np.testing.assert_allclose(in_world, felt.base_pose)


def test_base_velocity_of_2025_is_in_the_frame_of_loading() -> None:
    """At a yaw of a right angle from how it was loaded, a robot that drives ahead moves along that frame's y."""
    felt = replace(numbered_body(yaw=0.4 + np.pi / 2), base_velocity=np.array([0.3, 0.0, 0.1]))
    fields = fields_of(encoded(felt, "behavior-2025", loaded_at=(0.0, 0.0, 0.4)), "behavior-2025")
    np.testing.assert_allclose(fields["base_qvel"], [0.0, 0.3, 0.1], atol=1e-12)
    np.testing.assert_allclose(fields["joint_qvel"][:6], [0.0, 0.3, 0.0, 0.0, 0.0, 0.1], atol=1e-12)
    assert fields["base_qpos"][2] == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(velocity_of_base(fields), felt.base_velocity, atol=1e-12)


def test_base_velocity_of_2026_is_in_the_robots_frame() -> None:
    """It is what the robot feels, whichever way it is turned."""
    felt = numbered_body(yaw=2.1)
    fields = fields_of(encoded(felt, "behavior-2026"), "behavior-2026")
    np.testing.assert_allclose(fields["base_qvel"], felt.base_velocity)


def test_base_velocity_may_be_as_in_the_demonstrations() -> None:
    """In those of 2025 it is about 0; where that is asked for, so are the joints of the base."""
    fields = fields_of(encoded(numbered_body(yaw=0.7), "behavior-2025", "zero"), "behavior-2025")
    assert not fields["base_qvel"].any()
    assert not fields["joint_qvel"][:6].any()


def test_sines_and_cosines_are_on_the_unit_circle() -> None:
    """They are of one angle each, also of joints that are not felt: never 0 and 0."""
    fields = fields_of(encoded(numbered_body(yaw=0.7), "behavior-2025"), "behavior-2025")
    for angles in ("joint_qpos", "arm_left_qpos", "arm_right_qpos", "base_qpos"):
        np.testing.assert_allclose(fields[f"{angles}_sin"], np.sin(fields[angles]), atol=1e-12)
        np.testing.assert_allclose(fields[f"{angles}_cos"], np.cos(fields[angles]), atol=1e-12)
    for angles in ("robot_ori", "robot_2d_ori"):
        np.testing.assert_allclose(fields[f"{angles}_sin"] ** 2 + fields[f"{angles}_cos"] ** 2, 1.0)
    assert fields["robot_ori_sin"][2] == pytest.approx(np.sin(0.7))


def test_all_joints_are_in_behaviors_order() -> None:
    """Of the 28, six are the base's, four the trunk's, then the arms' in turn and two fingers of each hand."""
    felt = numbered_body(yaw=0.7)
    fields = fields_of(encoded(felt, "behavior-2025"), "behavior-2025")
    joints, velocities = fields["joint_qpos"], fields["joint_qvel"]
    np.testing.assert_allclose(joints[:6], [1.5, -2.0, 0, 0, 0, 0.7])
    np.testing.assert_allclose(joints[6:10], fields["trunk_qpos"])
    np.testing.assert_allclose(joints[24:], [0.03, 0.03, 0.04, 0.04])
    np.testing.assert_array_equal(velocities[6:10], felt.torso_velocity)
    np.testing.assert_allclose(velocities[24:], [0.01, 0.01, -0.02, -0.02])
    for i, side in enumerate(SIDES):
        np.testing.assert_allclose(joints[10 + i : 24 : 2], fields[f"arm_{side}_qpos"])
        np.testing.assert_allclose(velocities[10 + i : 24 : 2], felt.arm_velocity[side])


def test_hands_at_the_start_of_an_episode_are_where_behavior_has_them() -> None:
    """Trunk at the start and arms hanging: 0.1213, +-0.2520, 0.4380 in base_link, about half a turn about y."""
    start = replace(
        numbered_body(yaw=0.7), torso=np.array([1.025, -1.45, -0.47, 0.0]), arm=dict.fromkeys(SIDES, np.zeros(7))
    )
    fields = fields_of(encoded(start, "behavior-2026"), "behavior-2026")
    for side, sign in (("left", 1), ("right", -1)):
        np.testing.assert_allclose(fields[f"eef_{side}_pos"], [0.1213, sign * 0.2520, 0.4380], atol=1e-4)
        quaternion = fields[f"eef_{side}_quat"] * np.sign(fields[f"eef_{side}_quat"][1])
        np.testing.assert_allclose(quaternion, [0, 0.9997, 0, -0.0225], atol=1e-4)


def test_a_batch_of_one_is_read() -> None:
    """The evaluator from 3.9.3 on puts a leading dimension of 1 before every array."""
    numbers = encoded(numbered_body(yaw=0.7), "behavior-2026")
    np.testing.assert_array_equal(
        fields_of(numbers[None], "behavior-2026")["trunk_qpos"], fields_of(numbers, "behavior-2026")["trunk_qpos"]
    )


@pytest.mark.parametrize(
    ("numbers", "dialect", "words"),
    [
        (np.zeros(61), "behavior-2025", ["(61,)", "behavior-2026", "256"]),
        (np.zeros((1, 256)), "behavior-2026", ["(1, 256)", "behavior-2025", "61"]),
        (np.zeros((2, 61)), "behavior-2026", ["(2, 61)"]),
        (np.zeros(60), "behavior-2026", ["(60,)", "61"]),
        (np.float32(1), "behavior-2026", ["()", "61"]),
        (np.where(np.arange(256) == 238, np.nan, 0.0), "behavior-2025", ["nan at 238", "trunk_qpos[2]"]),
        (np.where(np.arange(61) == 24, -np.inf, 0.0), "behavior-2026", ["-inf at 24", "gripper_left_qpos[0]"]),
    ],
    ids=lambda given: str(given.shape) if isinstance(given, np.ndarray) else None,
)
def test_numbers_that_are_no_proprioception_are_refused(numbers: Any, dialect: Any, words: list[str]) -> None:
    """It is told how many came and which dialect has so many, or which entry is not finite."""
    with pytest.raises(BadMessage) as caught:
        fields_of(numbers, dialect)
    assert all(word in str(caught.value) for word in words), caught.value


def test_the_base_of_an_action_is_clipped_and_scaled() -> None:
    """1 is 0.75 m/s or 1 rad/s, more is no faster; what is ours becomes theirs again."""
    theirs = np.zeros((2, ACTION_SIZE))
    theirs[0, :3], theirs[1, :3] = [0.5, -1.0, 0.2], [7.0, -3.0, 1.5]
    ours = action_from(theirs)
    np.testing.assert_allclose(ours[:, :3], [[0.375, -0.75, 0.2], [0.75, -0.75, 1.0]])
    np.testing.assert_allclose(action_for(ours), np.clip(theirs, -1, 1))
    assert list(BASE_UNITS) == [0.75, 0.75, 1.0]


def test_camera_poses_are_left_right_head_in_usd_axes() -> None:
    """A camera at the head that looks along the base's x has USD's -z along it, and its y up."""
    ahead = kin.transform(kin.LINK_TO_OPTICAL, (0.1, 0.2, 1.4))
    poses = {"head": ahead, "left": np.eye(4), "right": kin.transform(kin.rot_x(0.3), (1.0, 2.0, 3.0))}
    numbers = camera_poses(poses)
    np.testing.assert_allclose(numbers[14:17], [0.1, 0.2, 1.4])
    axes = Rotation.from_quat(numbers[17:]).as_matrix()
    np.testing.assert_allclose(-axes[:, 2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(axes[:, 1], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(numbers[7:10], [1, 2, 3])
    for camera, T in cameras_in_base(numbers[None].astype(np.float32)).items():
        np.testing.assert_allclose(T, poses[camera], atol=1e-6)


@pytest.mark.parametrize("numbers", [np.zeros(20), np.zeros(21), np.full(21, np.nan)], ids=["20", "zeros", "nan"])
def test_numbers_that_are_no_camera_poses_are_refused(numbers: Any) -> None:
    """There are 21, finite, and no quaternion is 0."""
    with pytest.raises(BadMessage, match="cam_rel_poses"):
        cameras_in_base(numbers)
