"""A robot of a file in the house's physics: it drives, moves its arm and holds things by what its URDF tells."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robot_reading import read_robot
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.house.sim.described_physics import described_physics
from mpvi_bt.house.sim.world import SimWorld
from tests.small_house import placed, small_house

FILE = Path(__file__).parent.parent / "examples" / "six_joints" / "robot.yaml"


def robot() -> DescribedRobot:
    found = robot_named(str(FILE))
    assert isinstance(found, DescribedRobot)
    return found


def world(**things: str) -> SimWorld:
    at = {name: placed(entry, 1.5, 0.0) for name, entry in things.items()}
    made = SimWorld(small_house(), at, np.zeros(3), render=False, robot=robot())
    made.settle()
    return made


def act(made: SimWorld, action: Array, seconds: float) -> None:
    for _ in range(round(seconds * CONTROL_HZ)):
        made.robot.act(action)
        made.step()


def test_the_base_drives_along_its_heading_only() -> None:
    """Two wheels: two seconds ahead at 0.3 m/s are 0.6 m along x, and nothing across."""
    made = world()
    action = made.robot.action.copy()
    robot().layout.set_velocity(action, np.array([0.3, 0.0, 0.0]))
    act(made, action, 2.0)
    x, y, yaw = made.robot.proprioception().base_pose
    assert x == pytest.approx(0.6, abs=0.1)
    assert (y, yaw) == pytest.approx((0.0, 0.0), abs=0.01)


def test_the_arm_follows_its_numbers() -> None:
    """Every joint of the arm comes to where the action has it."""
    made = world()
    action = made.robot.action.copy()
    goal = np.array([0.3, -1.2, 2.4, 0.2, 0.5, -0.3])
    action[robot().layout.arm["right"]] = goal
    act(made, action, 3.0)
    assert made.robot.proprioception().arm["right"] == pytest.approx(goal, abs=0.02)


def test_the_gripper_holds_a_thing_while_the_base_drives() -> None:
    """Fingers press on what is between them; it comes along, and the width tells that something is there."""
    made = world(can="can_of_soda")
    felt = made.robot.proprioception()
    hand = robot().tcp(felt.torso, felt.arm["right"], "right")
    middle = np.eye(4)
    middle[:3, 3] = hand[:3, 3] - [0.0, 0.0, 0.06]  # half a can below
    made.place("can", middle, fixed=True)
    action = made.robot.action.copy()
    action[robot().layout.gripper["right"]] = -1.0
    act(made, action, 1.0)
    made.place("can", middle, fixed=False)
    robot().layout.set_velocity(action, np.array([0.3, 0.0, 0.0]))
    act(made, action, 2.0)
    felt = made.robot.proprioception()
    assert felt.base_pose[0] > 0.4
    assert made.holding("right") == "can"
    assert felt.gripper_width["right"] > robot().grasp_m
    assert made.pose("can")[0, 3] - middle[0, 3] == pytest.approx(felt.base_pose[0], abs=0.03)


def test_a_gripper_without_fingers_is_refused(tmp_path: Path) -> None:
    """In a line; there is nothing that could hold a thing."""
    shutil.copy(FILE.with_suffix(".urdf"), tmp_path)
    text = FILE.read_text().replace("joints: [left_finger]", "joints: []\n    opening_m: 0.08")
    (tmp_path / "robot.yaml").write_text(text)
    with pytest.raises(UserError, match="the right gripper of robot has no joints"):
        described_physics(read_robot(tmp_path / "robot.yaml"))


def test_moments_of_inertia_that_cannot_be_are_raised(tmp_path: Path) -> None:
    """Some tools write slightly negative ones for light parts; the robot drives all the same."""
    urdf = FILE.with_suffix(".urdf").read_text()
    assert 'ixx="0.001" iyy="0.001" izz="0.001"' in urdf
    (tmp_path / "robot.urdf").write_text(
        urdf.replace('ixx="0.001" iyy="0.001" izz="0.001"', 'ixx="3e-8" iyy="9e-8" izz="-3e-8"')
    )
    shutil.copy(FILE, tmp_path)
    light = read_robot(tmp_path / "robot.yaml")
    made = SimWorld(small_house(), {}, np.zeros(3), render=False, robot=light)
    action = made.robot.action.copy()
    light.layout.set_velocity(action, np.array([0.3, 0.0, 0.0]))
    act(made, action, 1.0)
    assert made.robot.proprioception().base_pose[0] > 0.2


def test_a_base_alone_drives(tmp_path: Path) -> None:
    """Of a robot without arm, torso or head joint, such as one that only looks around."""
    shutil.copy(FILE.with_suffix(".urdf"), tmp_path)
    told = yaml.safe_load(FILE.read_text())
    for key in ("arms", "grippers", "torso"):
        del told[key]
    del told["cameras"]["right"]
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(told))
    alone = read_robot(tmp_path / "robot.yaml")
    radio = {"radio": placed("radio_receiver", 1.5, 0.0)}  # it has a switch, which no hand is near
    made = SimWorld(small_house(), radio, np.zeros(3), render=False, robot=alone)
    act(made, np.array([0.3, 0.0]), 1.0)
    assert made.robot.proprioception().base_pose[0] > 0.2


def test_a_urdf_that_the_simulator_cannot_read_is_told(tmp_path: Path) -> None:
    """In a line with what its loader says, not with a traceback."""
    urdf = FILE.with_suffix(".urdf").read_text()
    (tmp_path / "robot.urdf").write_text(urdf.replace('<material name="dark">', '<material name="dark"><texture/>', 1))
    shutil.copy(FILE, tmp_path)
    with pytest.raises(UserError, match="robot: the simulator cannot build its URDF"):
        SimWorld(small_house(), {}, np.zeros(3), render=False, robot=read_robot(tmp_path / "robot.yaml"))
