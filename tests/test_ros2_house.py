"""The house as a robot of ROS 2: a bridge that answers its states steps it, and it scores what comes of that."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.ground.errors import RobotError
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.ros2.bridge_file import load_bridge
from mpvi_bt.runs.ros2.robot_session import RobotSession, robot_session
from mpvi_bt.runs.ros2.ros_episode import play_on_robot
from mpvi_bt.runs.serving.served import ServedWork
from tests.loopback import alone

pytestmark = [pytest.mark.slow, pytest.mark.render]

SIX_JOINTS = Path(__file__).parent.parent / "examples" / "six_joints" / "robot.yaml"
_BEGIN_S, _END_S = 180.0, 120.0  # of a busy machine


@pytest.fixture(autouse=True)
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is heard of others on this machine or on the net."""
    alone(monkeypatch)


@contextmanager
def house(folder: Path, task: str, *options: str) -> Iterator[subprocess.Popen[str]]:
    """The house in a process of its own, ready for a bridge."""
    words = [sys.executable, "-m", "mpvi_bt.apps.cli", "ros2", "house", task, "--out", str(folder)]
    with subprocess.Popen([*words, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        until = time.monotonic() + _BEGIN_S
        while "ready" not in process.stderr.readline():
            assert process.poll() is None
            assert time.monotonic() < until
        yield process
        process.terminate()


def result_of(folder: Path, task: str, process: subprocess.Popen[str]) -> dict[str, Any]:
    """What the house has written, once it has ended."""
    process.wait(_END_S)
    return dict(json.loads((folder / f"{task}_0_house.json").read_text()))


def step_on(made: RobotSession) -> None:
    """Step until something is raised."""
    while True:
        made.world.step()


def test_the_house_steps_once_for_each_answer(tmp_path: Path) -> None:
    """Every command is taken, nothing is lost, the picture is of the present step, and the end is scored."""
    bridge = load_bridge("house", R1)
    with house(tmp_path, "picking_up_trash") as process:
        with robot_session(bridge, R1, True, Stop(), lambda line: None) as made:
            robot = made.world.robot
            before = robot.proprioception()
            for _ in range(30):
                action = robot.action
                R1.layout.set_velocity(action, np.array([0.0, 0.0, 0.5]))
                robot.act(action)
                made.world.step()
            after, image = robot.proprioception(), robot.look("head")
        told = result_of(tmp_path, "picking_up_trash", process)
    assert after.base_pose[2] - before.base_pose[2] == pytest.approx(0.45, abs=0.1)
    assert image.rgb.shape[:2] == (R1.cameras["head"].height, R1.cameras["head"].width)
    assert image.labels is not None
    assert {int(label) for label in set(image.labels.flat)} - {0} <= {*image.names}
    assert 30 <= told["time"]["simulator_steps"] <= 31
    assert {topic["lost"] for topic in told["messages"]["commands"].values()} <= {0, 1}
    assert (told["ended"], told["q_score"]["final"], len(told["conditions"])) == ("bridge_gone", 0.0, 3)


def test_a_bridge_ends_soon_after_the_house(tmp_path: Path) -> None:
    """It does not wait for answers that nobody will send, for which it has 60 s."""
    with house(tmp_path, "picking_up_trash") as process:
        with robot_session(load_bridge("house", R1), R1, True, Stop(), lambda line: None) as made:
            made.world.step()
            process.terminate()
            at = time.monotonic()
            with pytest.raises(RobotError, match="/joint_states: nobody publishes it any more") as raised:
                step_on(made)
        assert raised.value.reason == "silent"
        assert time.monotonic() - at < 30.0
        assert result_of(tmp_path, "picking_up_trash", process)["ended"] == "stopped"


def test_a_house_that_nobody_drives_ends(tmp_path: Path) -> None:
    """It waits as long as it was told to, scores, and says why."""
    with house(tmp_path, "picking_up_trash", "--wait", "0.5") as process:
        assert result_of(tmp_path, "picking_up_trash", process)["ended"] == "no_bridge"


@pytest.mark.rare
def test_a_robot_of_a_file_drives_over_ros(tmp_path: Path) -> None:
    """Two wheels, by the robot's file, its URDF and a bridge alone: it finds the sofa and drives there."""
    robot = robot_named(str(SIX_JOINTS))
    (tmp_path / "there.yaml").write_text("{tree: there, root: {navigate: sofa}}")
    config = EpisodeConfig(
        "", tree=str(tmp_path / "there.yaml"), robot=str(SIX_JOINTS), policy="reactive", map="online",
        detector="segmentation",
    )  # fmt: skip
    with house(tmp_path, "picking_up_trash", "--robot", str(SIX_JOINTS)) as process:
        bridge = load_bridge("house", robot)
        played = play_on_robot(ServedWork(config, "", tmp_path), bridge, robot, True, lambda line: None)
        told = result_of(tmp_path, "picking_up_trash", process)
    assert played["success"], played
    assert told["agent_distance"]["base"] > 0.5
    assert told["q_score"]["final"] == 0.0
    assert {topic["lost"] for topic in told["messages"]["commands"].values()} == {0}


@pytest.mark.rare
def test_an_episode_over_ros_is_the_one_without_it(tmp_path: Path) -> None:
    """The whole executive drives the house over ROS 2, and needs as many steps as in its own process."""
    config = EpisodeConfig("turning_on_radio", robot="r1", policy="reactive", map="online")
    with house(tmp_path, config.task) as process:
        work = ServedWork(config, "", tmp_path)
        played = play_on_robot(work, load_bridge("house", R1), R1, True, lambda line: None)
        told = result_of(tmp_path, config.task, process)
    assert played["success"]
    assert told["q_score"]["final"] == 1.0
    assert {topic["lost"] for topic in told["messages"]["commands"].values()} == {0}
    assert told["time"]["simulator_steps"] == run(config)["time"]["simulator_steps"]
