"""Bridge files: what they say of a robot's topics, and what is said of those that are wrong."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from mpvi_bt.ground.errors import FileProblems, UnknownName
from mpvi_bt.ground.marked_yaml import load_marked
from mpvi_bt.ground.robot.robot_reading import read_robot
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named
from mpvi_bt.runs.ros2.bridge_file import check_bridge, joint_names, load_bridge

GOOD = """\
clock: system
joint_states: [/joint_states, /gripper/joint_states]
odometry: { topic: /odom }
cameras:
  head: { color: /head/color, depth: /head/depth, info: /head/info }
base: { topic: /cmd_vel }
joints:
  - { topic: /torso_controller, joints: [torso_lift_joint] }
  - { topic: /other_controller }
grippers:
  right: { topic: /gripper_controller, open: 0.05 }
"""


@pytest.fixture
def written(tmp_path: Path):
    """Writes a bridge file; answers its path."""

    def write(text: str) -> str:
        path = tmp_path / "mine.yaml"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


@pytest.mark.parametrize("name", list(ROBOTS))
def test_the_bridge_of_the_house_fits_every_robot(name: str) -> None:
    """Every camera, joint and gripper of the robot has its topic."""
    robot = robot_named(name)
    bridge = load_bridge("house", robot)
    assert set(bridge.cameras) == set(robot.cameras)
    assert set(bridge.grippers) == set(robot.sides)
    assert [name for entry in bridge.joints for name in entry.joints or ()] == list(joint_names(robot))
    assert bridge.cameras["head"].color == "/head/color/image_raw"


def test_a_controller_without_names_has_the_other_joints(written) -> None:
    """A file names the joints of one controller, and leaves the rest to the other."""
    robot = robot_named("fetch")
    bridge = load_bridge(written(GOOD), robot)
    first, second = (entry.joints or () for entry in bridge.joints)
    assert first == ("torso_lift_joint",)
    assert {*first, *second} == set(joint_names(robot))
    assert bridge.grippers["right"].joints == robot.finger_joints["right"]


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("joint_states: [", "joint_state: [", 2, "unknown key 'joint_state'. Did you mean 'joint_states'"),
        ("{ topic: /odom }", "{ topic: /odom, tf: { fixed: map, base: base_link } }", 3, "either 'topic' or 'tf'"),
        ("  head:", "  haed:", 5, "unknown camera 'haed' of the robot fetch. Did you mean 'head'"),
        ("/head/depth", "head depth", 5, "should match the pattern"),
        ("depth: /head/depth, ", "", 5, "missing key 'depth'"),
        ("info: /head/info", "info: /head/info, labels: /l", 5, "'labels' and 'names' come together"),
        ("/cmd_vel }", "/cmd_vel, type: twist }", 6, "'twist' is not valid. Did you mean 'Twist'"),
        ("[torso_lift_joint]", "[torso_lift]", 8, "unknown joint 'torso_lift' of the robot fetch"),
        ("/torso_controller", "/torso_controller, action: /a", 8, "either 'topic' or 'action'"),
        ("- { topic: /other_controller }", "- { topic: /x, joints: [torso_lift_joint] }", 9, "commanded by entry 0"),
        ("open: 0.05", "open: 0", 11, "open and closed are the same"),
        ("  right:", "  left:", 11, "unknown gripper 'left' of the robot fetch"),
        ("clock: system", "clock: sim\nwatchdog_s: 0", 2, "greater than 0"),
        ("clock: system", "lockstep: true", 1, "'lockstep' is for a simulator"),
    ],
)
def test_a_mistake_is_told_with_its_place(written, old: str, new: str, line: int, message: str) -> None:
    """One problem of a file that is wrong in one place: its line, and what would be right."""
    assert old in GOOD
    with pytest.raises(FileProblems) as raised:
        load_bridge(written(GOOD.replace(old, new)), robot_named("fetch"))
    assert any(problem.line == line and message in problem.message for problem in raised.value.problems), raised.value


def test_joints_without_a_controller_are_named(written) -> None:
    """A joint that nobody would command is a mistake of the file."""
    with pytest.raises(FileProblems, match=r"no controller has .*shoulder_pan_joint"):
        load_bridge(written(GOOD.replace("  - { topic: /other_controller }\n", "")), robot_named("fetch"))


def test_an_unknown_bridge_is_told_with_the_nearest() -> None:
    """A name that is in no `bridges/`."""
    with pytest.raises(UnknownName, match=r"unknown bridge 'huose'\. Did you mean 'house'"):
        load_bridge("huose", robot_named("r1"))


@pytest.mark.parametrize("file", sorted(Path("examples").glob("*_bridge.yaml")), ids=lambda path: path.stem)
def test_the_bridges_of_the_examples_can_be_read(file: Path) -> None:
    """Their robots are the reader's own; what can be said without them is right."""
    assert check_bridge(*load_marked(file)).state_topics


def test_a_gripper_has_joints_by_its_robot_or_by_its_bridge(written, tmp_path: Path) -> None:
    """Of a robot whose URDF has no fingers the bridge file has to name what its driver calls them."""
    home = Path("examples/six_joints")
    shutil.copy(home / "robot.urdf", tmp_path)
    text = (home / "robot.yaml").read_text().replace("joints: [left_finger]", "joints: []\n    opening_m: 0.08")
    (tmp_path / "robot.yaml").write_text(text)
    robot = read_robot(tmp_path / "robot.yaml")
    bridge = re.sub("  - .*torso.*\n", "", GOOD).replace(", open: 0.05", "")
    bridge = bridge.replace("cameras:\n", "cameras:\n  right: { color: /c, depth: /d, info: /i }\n")
    with pytest.raises(FileProblems, match="names no joints of its right gripper: give 'joints'"):
        load_bridge(written(bridge), robot)
    bridge = bridge.replace("/gripper_controller", "/gripper_controller, joints: [driven_finger]")
    assert load_bridge(written(bridge), robot).fingers["right"].ends.tolist() == [[0.0, 0.08]]
