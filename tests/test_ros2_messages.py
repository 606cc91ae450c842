"""What messages of ROS 2 say of a robot's state and its pictures, and what commands become."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpvi_bt.apps.cli import main
from mpvi_bt.ground.errors import BadMessage, UserError
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.robot_reading import read_robot
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named
from mpvi_bt.runs.recording.ros_values import joint_commands, joint_states
from mpvi_bt.runs.ros2.bridge_file import load_bridge
from mpvi_bt.runs.ros2.command_messages import targets_of
from mpvi_bt.runs.ros2.heard_states import HeardStates
from mpvi_bt.runs.ros2.house_commands import HouseCommands
from mpvi_bt.runs.ros2.picture_messages import color_of, depth_of, intrinsics_of, labels_of, names_of
from mpvi_bt.runs.ros2.ros_packages import part
from mpvi_bt.runs.ros2.state_messages import FeltBase, FeltJoint, body_of, next_place, read_joints, yaw_of
from mpvi_bt.runs.ros2.transform_tree import TransformTree

Bag = SimpleNamespace


def header(seconds: float = 1.0, frame: str = "") -> Any:
    return Bag(stamp=Bag(sec=int(seconds), nanosec=round(seconds % 1 * 1e9)), frame_id=frame)


def image(encoding: str, data: np.ndarray, pad: int = 0, big: bool = False) -> Any:
    """An Image, with rows padded by some bytes."""
    rows = data.reshape(data.shape[0], -1).view(np.uint8)
    padded = np.pad(rows, ((0, 0), (0, pad)))
    return Bag(
        encoding=encoding, height=data.shape[0], width=data.shape[1], step=padded.shape[1], is_bigendian=big,
        data=padded.tobytes(),
    )  # fmt: skip


@pytest.mark.parametrize("name", list(ROBOTS))
def test_commands_come_back_as_states(name: str) -> None:
    """A robot whose joints are where an action tells them feels that action, and its grippers as wide as told."""
    robot = robot_named(name)
    bridge = load_bridge("house", robot)
    rng = np.random.default_rng(0)
    action = rng.uniform(-0.5, 0.5, robot.layout.size)
    targets = targets_of(robot, bridge, action)
    joints = {joint: FeltJoint(position, 0.5, 1) for joint, position in targets.items()}
    body = body_of(robot, bridge, joints, FeltBase(np.zeros(3), np.zeros(3), 1))
    told = [q if joint else 0.0 for joint, q in zip(robot.torso_joints, action[robot.layout.torso], strict=True)]
    assert list(body.torso) == told
    for side in robot.sides:
        assert list(body.arm[side]) == list(action[robot.layout.arm[side]])
        assert list(body.arm_velocity[side]) == [0.5] * len(robot.arm_joints[side])
        wide = (action[robot.layout.gripper[side]] + 1) / 2 * robot.opening_m
        assert body.gripper_width[side] == pytest.approx(wide, abs=1e-12)


def test_a_gripper_that_turns_is_read_by_its_ends(tmp_path: Path) -> None:
    """Its joint closes at 0.8 rad and is open at 0."""
    robot = robot_named("fetch")
    text = Path("bridges/house.yaml").read_text(encoding="utf-8")
    text = text.replace(
        '"*": { topic: "/{name}_gripper/joint_trajectory" }',
        "right: { topic: /g, joints: [knuckle], open: 0.0, closed: 0.8 }",
    )
    (tmp_path / "b.yaml").write_text(text)
    bridge = load_bridge(str(tmp_path / "b.yaml"), robot)
    action = np.zeros(robot.layout.size)
    action[robot.layout.gripper["right"]] = 0.5
    targets = targets_of(robot, bridge, action)
    assert targets["knuckle"] == pytest.approx(0.2)
    joints = {joint: FeltJoint(position, 0.0, 1) for joint, position in targets.items()}
    width = body_of(robot, bridge, joints, FeltBase(np.zeros(3), np.zeros(3), 1)).gripper_width["right"]
    assert width == pytest.approx(0.75 * robot.opening_m)


def turning(folder: Path) -> DescribedRobot:
    """A robot of a file: its fingers turn, one up to open, the other one down."""
    text = Path("examples/six_joints/robot.urdf").read_text(encoding="utf-8")
    for name, limits in (("left_finger", (0.0, 0.8)), ("right_finger", (-0.7, 0.1))):
        joint = f'<joint name="{name}" type="prismatic">'
        assert joint in text
        head, tail = text.split(joint)
        low, high = limits
        tail = tail.replace('lower="0" upper="0.05"', f'lower="{low}" upper="{high}"', 1)
        text = head + joint.replace("prismatic", "revolute") + tail
    (folder / "robot.urdf").write_text(text.replace('<mimic joint="left_finger"/>', ""))
    text = Path("examples/six_joints/robot.yaml").read_text(encoding="utf-8")
    ends = "joints: [left_finger, right_finger]\n    closed: [0.0, 0.1]\n    open: [0.8, -0.7]\n    opening_m: 0.085"
    (folder / "robot.yaml").write_text(text.replace("joints: [left_finger]", ends))
    return read_robot(folder / "robot.yaml")


@pytest.mark.parametrize(("told", "at"), [(-1.0, (0.0, 0.1)), (1.0, (0.8, -0.7)), (0.5, (0.6, -0.5))])
def test_fingers_of_a_robots_file_that_turn_go_between_its_ends(
    tmp_path: Path, told: float, at: tuple[float, float]
) -> None:
    """Commands, the house that takes them, recordings, and what is felt say the same of them."""
    robot = turning(tmp_path)
    bridge = load_bridge("house", robot)
    action = np.zeros(robot.layout.size)
    action[robot.layout.gripper["right"]] = told
    fingers = {"left_finger": pytest.approx(at[0]), "right_finger": pytest.approx(at[1])}
    targets = targets_of(robot, bridge, action)
    assert {name: targets[name] for name in fingers} == fingers

    house = HouseCommands(robot, np.zeros(robot.layout.size), bridge)
    house.follow(
        "/right_gripper/joint_trajectory", 0, list(fingers), [1 / 30], [np.array([targets[n] for n in fingers])]
    )
    assert house.next_action()[robot.layout.gripper["right"]] == pytest.approx(told)

    joints = {joint: FeltJoint(position, 0.0, 1) for joint, position in targets.items()}
    joints |= {"left_finger": FeltJoint(at[0], 0.8, 1), "right_finger": FeltJoint(at[1], -0.8, 1)}
    body = body_of(robot, bridge, joints, FeltBase(np.zeros(3), np.zeros(3), 1))
    assert body.gripper_width["right"] == pytest.approx((told + 1) / 2 * 0.085, abs=1e-12)
    assert body.gripper_velocity["right"] == pytest.approx(0.085)
    recorded = joint_states(0.0, robot, body)
    felt = dict(zip(recorded["name"], zip(recorded["position"], recorded["velocity"], strict=True), strict=True))
    assert {name: felt[name][0] for name in fingers} == fingers
    assert [felt[name][1] for name in fingers] == pytest.approx([0.8, -0.8])
    commanded = joint_commands(0.0, robot, body, action)
    assert fingers.items() <= dict(zip(commanded["name"], commanded["position"], strict=True)).items()


def test_a_joint_state_is_read() -> None:
    """Without velocities they are 0; without a stamp it is of now."""
    message = Bag(header=header(0.0), name=["a", "b"], position=[1.0, 2.0], velocity=[])
    assert read_joints(message, "/j", 7) == {"a": FeltJoint(1.0, 0.0, 7), "b": FeltJoint(2.0, 0.0, 7)}


@pytest.mark.parametrize(
    ("position", "velocity", "why"),
    [([1.0], [], "2 names, 1 positions"), ([1.0, 2.0], [1.0], "1 velocities"), ([1.0, float("inf")], [], "joint b")],
)
def test_a_joint_state_that_is_none_is_refused(position: list[float], velocity: list[float], why: str) -> None:
    """Its topic and what is wrong are named."""
    message = Bag(header=header(), name=["a", "b"], position=position, velocity=velocity)
    with pytest.raises(BadMessage, match=f"/j: .*{why}"):
        read_joints(message, "/j", 7)


def test_a_rotation_that_is_none_is_refused() -> None:
    """A message whose quaternion nobody set."""
    assert yaw_of(0.0, 0.0, np.sin(0.4), np.cos(0.4), "/odom") == pytest.approx(0.8)
    with pytest.raises(BadMessage, match="/odom: the quaternion"):
        yaw_of(0.0, 0.0, 0.0, 0.0, "/odom")


def test_pictures_are_read_in_every_encoding() -> None:
    """Channels in their order, rows without their padding, millimeters as meters, nothing seen as 0."""
    rgb = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    assert np.array_equal(color_of(image("rgb8", rgb, pad=5), "/c"), rgb)
    assert np.array_equal(color_of(image("bgr8", rgb[:, :, ::-1].copy()), "/c"), rgb)
    near = np.array([[1500, 0], [250, 65535]], np.uint16)
    assert np.allclose(depth_of(image("16UC1", near), "/d"), [[1.5, 0], [0.25, 65.535]])
    swapped = near.astype(">u2").view(np.uint16)
    assert np.allclose(depth_of(image("16UC1", swapped, big=True), "/d"), [[1.5, 0], [0.25, 65.535]])
    far = np.array([[1.5, np.nan], [np.inf, -1.0]], np.float32)
    assert np.array_equal(depth_of(image("32FC1", far), "/d"), np.array([[1.5, 0], [0, 0]], np.float32))
    labels = np.array([[3, -1]], np.int32)
    assert np.array_equal(labels_of(image("32SC1", labels), "/l"), labels)


def test_pictures_that_are_none_are_refused() -> None:
    """By topic: an unknown encoding, or fewer bytes than pixels."""
    broken = image("rgb8", np.zeros((2, 4, 3), np.uint8))
    broken.data = broken.data[:-1]
    with pytest.raises(BadMessage, match="/c: 23 bytes do not make 2 rows"):
        color_of(broken, "/c")
    with pytest.raises(BadMessage, match="/c: the encoding 'yuv422' is not known"):
        color_of(image("yuv422", np.zeros((2, 4, 2), np.uint8)), "/c")
    with pytest.raises(BadMessage, match="/i: the camera is not calibrated"):
        intrinsics_of(Bag(k=[0.0] * 9, height=2, width=4), "/i")


def test_names_of_labels_are_read() -> None:
    """Ids to names, and what those are called."""
    text = json.dumps({"names": {"7": "ashcan.n.01_1"}, "vocabulary": {"ashcan.n.01_1": ["trash can"]}})
    names, vocabulary = names_of(text, "/n")
    assert names == {7: "ashcan.n.01_1"}
    assert list(vocabulary["ashcan.n.01_1"]) == ["trash can"]
    with pytest.raises(BadMessage, match="/n: "):
        names_of("[1, 2]", "/n")


def moved(parent: str, child: str, x: float, yaw: float, seconds: float = 1.0) -> Any:
    """A transform along x and about z."""
    rotation = Bag(x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))
    transform = Bag(translation=Bag(x=x, y=0.0, z=0.0), rotation=rotation)
    return Bag(header=header(seconds, parent), child_frame_id=child, transform=transform)


def test_frames_are_placed_in_one_another() -> None:
    """Up to a common parent and down again."""
    tree = TransformTree("b.yaml")
    tree.hear(Bag(transforms=[moved("map", "odom", 1.0, np.pi / 2), moved("odom", "base_link", 2.0, 0.0)]), "/tf")
    tree.hear(Bag(transforms=[moved("base_link", "camera", 0.5, 0.0)]), "/tf_static")
    assert tree.place("map", "camera")[:2, 3] == pytest.approx([1.0, 2.5])
    assert tree.place("camera", "odom")[:2, 3] == pytest.approx([-2.5, 0.0])
    with pytest.raises(BadMessage, match=r"b.yaml: the frame 'base_lnk' is not in tf. Did you mean 'base_link'"):
        tree.place("map", "base_lnk")


def test_a_base_that_tf_places_has_a_speed() -> None:
    """In its own frame: it stands at a right angle to the fixed one."""
    tree = TransformTree("b.yaml")
    base = None
    for seconds, x in ((1.0, 0.0), (1.5, 0.0)):
        tree.hear(
            Bag(transforms=[moved("map", "odom", 0.0, np.pi / 2), moved("odom", "b", x + seconds, 0.0, seconds)]), "/tf"
        )
        base = next_place(base, tree.place("map", "b"), tree.stamp_ns("b"))
    assert base is not None
    assert base.pose == pytest.approx([0.0, 1.5, np.pi / 2])
    assert base.velocity == pytest.approx([1.0, 0.0, 0.0])


def test_a_package_that_is_missing_is_named() -> None:
    """With what it was for."""
    with pytest.raises(
        UserError, match="--navigator nav2 needs the package no_such_msgs of ROS 2, which is not installed"
    ):
        part("no_such_msgs.action:Goal", "--navigator nav2")


def test_goals_are_sent_when_targets_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not thirty a second; a stop is always sent."""
    pytest.importorskip("rclpy")
    sent: list[list[float]] = []
    client = Bag(send_goal_async=lambda goal: sent.append(goal.trajectory.points[-1].positions))
    kind = Bag(Goal=lambda trajectory: Bag(trajectory=trajectory))
    module = ModuleType("control_msgs.action")
    vars(module).update(FollowJointTrajectory=kind)
    monkeypatch.setitem(sys.modules, "control_msgs.action", module)
    monkeypatch.setattr("rclpy.action.client.ActionClient", lambda *given: client)
    from mpvi_bt.runs.ros2.goal_sender import GoalSender

    sender = GoalSender(None, "/arm/follow_joint_trajectory", "b.yaml")
    for position in (0.0, 0.1, 0.2, 0.3, 0.3, 0.3):
        point = Bag(positions=[position], time_from_start=Bag(nanosec=33_000_000))
        sender.publish(Bag(points=[point]))
    assert sent == [[0.0], [0.3]]


def test_without_rclpy_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """The extra, or the installation to source."""
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(SystemExit) as ended:
        main(["ros2", "--robot", "r1", "--bridge", "house", "--tree", "hello"])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("mpvi: mpvi ros2 needs rclpy, which is not installed: ")
    assert "source /opt/ros/" in line


def test_a_base_without_joints_is_heard(tmp_path: Path) -> None:
    """Its odometry alone is its state; when that is old it is told so."""
    path = tmp_path / "b.yaml"
    path.write_text("joint_states: /j\nodometry: { topic: /odom }\nbase: { topic: /cmd_vel }\n")
    layout = ActionLayout(("vx", "turn"), (0, None, 1), slice(2, 2), {}, {})
    robot: Any = Bag(
        name="turtle", sides=(), torso_joints=(), arm_joints={}, finger_joints={}, cameras={}, layout=layout,
        opening_m=0.0,
    )  # fmt: skip
    bridge = load_bridge(str(path), robot)
    heard = HeardStates(bridge, robot, {})
    assert heard.missing() == ["/odom"]
    place = Bag(position=Bag(x=1.0, y=2.0), orientation=Bag(x=0.0, y=0.0, z=0.0, w=1.0))
    still = Bag(linear=Bag(x=0.0, y=0.0), angular=Bag(z=0.0))
    now = header(heard.now_ns() / 1e9, "odom")
    told = Bag(header=now, child_frame_id="base", pose=Bag(pose=place), twist=Bag(twist=still))
    heard.hear_odometry("/odom", told)
    assert heard.missing() == []
    assert heard.wrong() is None
    body = body_of(robot, bridge, heard.joints, heard.base or FeltBase(np.zeros(3), np.zeros(3), 0))
    assert (list(body.base_pose), body.sides, body.torso.size) == ([1.0, 2.0, 0.0], (), 0)
    assert targets_of(robot, bridge, np.array([0.1, 0.2])) == {}
    told.header = header(heard.now_ns() / 1e9 - 2.0)
    heard.hear_odometry("/odom", told)
    wrong = heard.wrong()
    assert wrong is not None
    assert wrong[0] == "silent"
    assert wrong[1].startswith("/odom: the last state is 2.")
