"""A run on a robot over ROS 2: what it publishes, and how it is paused and stopped from outside."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.ros2.bridge_file import load_bridge
from mpvi_bt.runs.ros2.ros_episode import play_on_robot
from mpvi_bt.runs.serving.served import ServedWork
from tests.loopback import alone
from tests.mcap_reading import mcap_rows
from tests.ros_robot import FETCH, TestRobot, write_bridge

pytestmark = pytest.mark.slow

TREE = """\
tree: waiting
root:
  sequence: all
  memory: true
  children:
    - wait: 1.5
    - wait: 1.0
"""


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[TestRobot]:
    """One that nobody else hears."""
    alone(monkeypatch)
    with TestRobot() as robot:
        yield robot


def played(folder: Path, out: dict[str, Any], tree: str = TREE, mcap: Path | None = None) -> threading.Thread:
    """Plays a tree in a thread of its own; `out` gets the result."""
    (folder / "tree.yaml").write_text(tree)
    config = EpisodeConfig(
        "", tree=str(folder / "tree.yaml"), robot="fetch", map="online", policy="reactive", mcap=mcap
    )
    bridge = load_bridge(write_bridge(folder), FETCH)

    def work() -> None:
        try:
            out.update(play_on_robot(ServedWork(config, "", folder), bridge, FETCH, True, lambda line: None))
        except (KeyboardInterrupt, Exception) as error:
            out["error"] = str(error)

    thread = threading.Thread(target=work)
    thread.start()
    return thread


def until(ready: Callable[[], object], out: dict[str, Any]) -> None:
    """Wait until it is so. Asserts that it becomes so before the run ends by an error."""
    end = time.monotonic() + 120.0  # a process may take long to begin
    while not ready():
        assert "error" not in out, out
        assert time.monotonic() < end
        time.sleep(0.02)


def test_the_run_is_published(robot: TestRobot, tmp_path: Path) -> None:
    """The tree as text and as JSON, diagnostics, and the map in the frame of the odometry."""
    from diagnostic_msgs.msg import DiagnosticArray
    from nav_msgs.msg import OccupancyGrid
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import String

    heard: dict[str, list[Any]] = {name: [] for name in ("tree", "tree_json", "map", "diagnostics")}
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for name, kind in (("tree", String), ("tree_json", String), ("map", OccupancyGrid)):
        robot.node.create_subscription(kind, f"/mpvi/{name}", heard[name].append, latched)
    robot.node.create_subscription(DiagnosticArray, "/diagnostics", heard["diagnostics"].append, 10)
    out: dict[str, Any] = {}
    played(tmp_path, out).join(timeout=60)
    assert out.get("success") is True, out
    until(lambda: heard["diagnostics"] and "succeeded" in heard["diagnostics"][-1].status[0].message, out)
    assert "wait" in heard["tree"][0].data
    assert {json.loads(message.data)["tree"] for message in heard["tree_json"]} == {"waiting"}
    grid = heard["map"][-1]
    assert grid.header.frame_id == "odom"
    assert len(grid.data) == grid.info.width * grid.info.height
    told = json.loads((tmp_path / "waiting_ros2.json").read_text())
    assert told["ros2"]["commands"] > 30
    assert told["ros2"]["state_to_command_ms"]["median"] > 0


def test_a_run_on_a_robot_is_recorded(robot: TestRobot, tmp_path: Path) -> None:
    """Its joints by name and its base at each step; the recorder asks for no picture, which could stop the robot."""
    pytest.importorskip("mcap_ros2", reason="needs the extra 'mcap'")
    file = tmp_path / "run.mcap"
    out: dict[str, Any] = {}
    played(tmp_path, out, mcap=file).join(timeout=60)
    assert out.get("success") is True, out
    logged = mcap_rows(file)
    assert len(logged["/joint_states"]) == len(logged["/odom"]) > 30
    assert {*FETCH.arm_joints["right"]} < {*logged["/joint_states"][0][2].name}
    assert not [topic for topic in logged if "color" in topic]
    assert "succeeded" in logged["/rosout"][-1][2].msg


def test_a_run_is_paused_and_goes_on(robot: TestRobot, tmp_path: Path) -> None:
    """By a word on the topic; the time of the pause does not count."""
    from std_msgs.msg import String

    orders = robot.node.create_publisher(String, "/mpvi/control", 10)
    out: dict[str, Any] = {}
    thread = played(tmp_path, out)
    until(lambda: len(robot.drives) > 5, out)
    orders.publish(String(data="pause"))
    time.sleep(0.5)
    count = len(robot.drives)
    time.sleep(2.0)
    assert len(robot.drives) <= count + 1
    orders.publish(String(data="resume"))
    thread.join(timeout=60)
    assert out.get("success") is True, out
    assert out["time"]["simulator_time"] < 4.0


def test_a_run_is_stopped_by_a_service(robot: TestRobot, tmp_path: Path) -> None:
    """The robot is halted, and the run ends as interrupted."""
    from std_srvs.srv import Trigger

    out: dict[str, Any] = {}
    thread = played(tmp_path, out, TREE.replace("1.5", "60"))
    until(lambda: len(robot.drives) > 5, out)
    client: Any = robot.node.create_client(Trigger, "/mpvi/stop")
    until(client.service_is_ready, out)
    future = client.call_async(Trigger.Request())
    until(future.done, out)
    assert future.result().success
    thread.join(timeout=20)
    assert not thread.is_alive()
    told = json.loads((tmp_path / "waiting_ros2.json").read_text())
    assert told["ended"] == "interrupted"
    assert told["ros2"]["halted"] == {"reason": "stopped", "why": "it was stopped by /mpvi/stop"}
    assert robot.comes_to_stand()


def test_a_robot_that_falls_silent_ends_the_run(robot: TestRobot, tmp_path: Path) -> None:
    """The result says which topic."""
    out: dict[str, Any] = {}
    thread = played(tmp_path, out, TREE.replace("1.5", "60"))
    until(lambda: len(robot.drives) > 5, out)
    robot.silent.add("/odom")
    thread.join(timeout=20)
    assert out["ended"] == "backend_error"
    assert out["failures"][-1]["reason"] == "silent"
    assert "/odom" in out["failures"][-1]["feedback"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_process_that_is_stopped_stops_the_robot(robot: TestRobot, tmp_path: Path, number: signal.Signals) -> None:
    """It ends by itself, with a stop as its last command and the signal in its result."""
    (tmp_path / "tree.yaml").write_text(TREE.replace("1.5", "60"))
    words = ["ros2", "--robot", "fetch", "--bridge", write_bridge(tmp_path), "--tree", str(tmp_path / "tree.yaml")]
    command = [sys.executable, "-m", "mpvi_bt.apps.cli", *words, "--allow-motion", "--out", str(tmp_path), "--no-watch"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        until(lambda: len(robot.drives) > 5, {})
        process.send_signal(number)
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130, said
    assert "Traceback" not in said
    told = json.loads((tmp_path / "waiting_ros2.json").read_text())
    assert told["ended"] == "interrupted"
    assert told["ros2"]["halted"] == {"reason": "stopped", "why": f"the process was stopped by {number.name}"}
    assert robot.comes_to_stand()
    count = len(robot.drives)
    time.sleep(0.5)
    assert len(robot.drives) == count
