"""A robot over ROS 2 that misbehaves, or whose bridge is stopped: commands end soon, with a reason."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock

from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.ground.errors import RobotError, UserError
from mpvi_bt.runs.ros2.bridge_file import load_bridge
from mpvi_bt.runs.ros2.heard_states import HeardStates
from mpvi_bt.runs.ros2.robot_session import RobotSession, robot_session
from tests.loopback import alone
from tests.ros_robot import FETCH, SIDE, TestRobot, write_bridge

pytestmark = pytest.mark.slow

SOON_S = 1.5  # tests run on busy machines
STRICT = {
    "watchdog_s": "watchdog_s: 0.5"
}  # of bridges that are to find states too old; others find none on any machine


@pytest.fixture(autouse=True)
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is heard of others on this machine or on the net."""
    alone(monkeypatch)


@pytest.fixture
def robot() -> Iterator[TestRobot]:
    """One that does as it is told."""
    with TestRobot() as robot:
        yield robot


@contextmanager
def session(
    folder: Path, motion: bool = True, clock: str = "system", lines: Mapping[str, str] | None = None
) -> Iterator[RobotSession]:
    """A bridge to it."""
    bridge = load_bridge(write_bridge(folder, clock, **(lines or {})), FETCH)
    with robot_session(bridge, FETCH, motion, Stop(), lambda line: None) as made:
        yield made


def drive(made: RobotSession, seconds: float, forward: float = 0.4) -> None:
    """Tick with a constant speed."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        action = made.world.robot.action
        FETCH.layout.set_velocity(action, np.array([forward, 0.0, 0.0]))
        made.world.robot.act(action)
        made.world.step()


def set_off(made: RobotSession, robot: TestRobot) -> None:
    """Drive until the robot does."""
    until = time.monotonic() + 20.0
    while not robot.drives or robot.drives[-1][1][0] <= 0.2:
        assert time.monotonic() < until
        drive(made, 0.1)


def ending(made: RobotSession, robot: TestRobot, fault: Callable[[], object]) -> RobotError:
    """Drive, let a fault happen, and drive on. Asserts that commands end in time; returns the reason."""
    set_off(made, robot)
    at = time.monotonic()
    fault()
    with pytest.raises(RobotError) as raised:
        drive(made, 5.0)
    assert time.monotonic() - at < 4.0
    assert robot.comes_to_stand()
    assert robot.last_motion() - at < SOON_S
    assert made.gate.halted == (raised.value.reason, str(raised.value))
    return raised.value


def test_a_robot_is_driven(robot: TestRobot, tmp_path: Path) -> None:
    """Odometry comes in, commands go out, and the arm keeps its targets."""
    with session(tmp_path) as made:
        before = made.world.robot.proprioception()
        drive(made, 1.0)
        after = made.world.robot.proprioception()
        assert 0.15 < after.base_pose[0] - before.base_pose[0] < 0.5
        assert made.world.steps == pytest.approx(30, abs=12)
        names = FETCH.arm_joints[SIDE]
        assert [robot.moves[-1][1].get(name) for name in names] in (
            pytest.approx(list(FETCH.travel_arm[SIDE])),
            [None] * len(names),
        )
        image = made.world.robot.look("head")
        assert image.rgb.shape == (48, 64, 3)
        assert image.depth[0, 0] == pytest.approx(3.0)
        assert image.K[0, 2] == 32.0
    assert robot.comes_to_stand()


def test_speed_and_acceleration_are_limited(robot: TestRobot, tmp_path: Path) -> None:
    """However much is asked for, the speed rises by the robot's acceleration up to its top speed."""
    with session(tmp_path) as made:
        drive(made, 3.0, forward=99.0)
    speeds = [velocity[0] for _, velocity in robot.drives]
    moving = speeds[: speeds.index(max(speeds)) + 1]
    assert max(speeds) == pytest.approx(FETCH.base_speed[0])
    assert max(b - a for a, b in pairwise(moving)) <= FETCH.drive_acceleration[0] / 30 + 1e-9


def test_nothing_moves_before_it_is_allowed(robot: TestRobot, tmp_path: Path) -> None:
    """Without --allow-motion all runs, and nothing is sent."""
    with session(tmp_path, motion=False) as made:
        drive(made, 0.3)
    time.sleep(0.1)
    assert (robot.drives, robot.moves) == ([], [])


@pytest.mark.parametrize("topic", ["/joint_states", "/odom"])
def test_a_silent_topic_stops_the_robot(robot: TestRobot, tmp_path: Path, topic: str) -> None:
    """States that end."""
    with session(tmp_path, lines=STRICT) as made:
        error = ending(made, robot, lambda: robot.silent.add(topic))
    assert error.reason == "silent"
    assert topic in str(error)


def test_a_robot_that_is_gone_is_told(robot: TestRobot, tmp_path: Path) -> None:
    """Its node is killed."""
    with session(tmp_path, lines=STRICT) as made:
        error = ending(made, robot, lambda: robot.silent.update(("/joint_states", "/odom", "/head/color")))
    assert error.reason == "silent"


@pytest.mark.parametrize("jump_s", [-3.0, 3.0])
def test_a_clock_that_jumps_stops_the_robot(tmp_path: Path, jump_s: float) -> None:
    """Simulated time that goes back, or on by seconds at once."""
    with TestRobot("sim") as robot, session(tmp_path, clock="sim") as made:
        error = ending(made, robot, lambda: setattr(robot, "shift_s", jump_s))
    assert error.reason == "time_jump"


def test_a_clock_that_comes_late_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Until its first message a clock does not stand still: on a busy machine nodes find each other late."""
    heard = HeardStates(load_bridge(write_bridge(tmp_path, "sim"), FETCH), FETCH, {})
    later = time.monotonic() + 5.0
    monkeypatch.setattr(time, "monotonic", lambda: later)
    assert heard.wrong() is None
    heard.hear_clock(Clock(clock=Time(sec=7)))
    later += 5.0
    assert heard.wrong() == ("silent", "/clock: nothing came for 2 s")


def test_stamps_of_another_time_stop_the_robot(robot: TestRobot, tmp_path: Path) -> None:
    """The robot's own clock is set back: its states are old."""
    with session(tmp_path, lines=STRICT) as made:
        error = ending(made, robot, lambda: setattr(robot, "shift_s", -3.0))
    assert error.reason == "silent"


def no_number(message: Any) -> None:
    message.position[0] = math.nan


def too_few(message: Any) -> None:
    message.position = message.position[:-1]


def other_names(message: Any) -> None:
    message.name = [f"x_{name}" for name in message.name]


@pytest.mark.parametrize("spoil", [no_number, too_few])
def test_states_that_cannot_be_stop_the_robot(robot: TestRobot, tmp_path: Path, spoil: Callable[[Any], None]) -> None:
    """NaN, lists of different lengths."""
    with session(tmp_path) as made:
        error = ending(made, robot, lambda: setattr(robot, "spoil", spoil))
    assert error.reason == "bad_state"
    assert "/joint_states" in str(error)


def test_names_of_no_joint_are_no_states(robot: TestRobot, tmp_path: Path) -> None:
    """What was last heard of the robot's own joints gets old."""
    with session(tmp_path, lines=STRICT) as made:
        error = ending(made, robot, lambda: setattr(robot, "spoil", other_names))
    assert error.reason == "silent"
    assert "/joint_states" in str(error)


def test_a_place_that_jumps_stops_the_robot(robot: TestRobot, tmp_path: Path) -> None:
    """A localization that finds the base elsewhere all at once."""
    with session(tmp_path) as made:
        error = ending(made, robot, lambda: setattr(robot, "pose", robot.pose + [50.0, 0.0, 0.0]))
    assert error.reason == "bad_state"
    assert "does not follow" in str(error)


def test_an_old_picture_is_refused(robot: TestRobot, tmp_path: Path) -> None:
    """A camera that lags by seconds: whoever looks is told so, and the robot stops."""
    with session(tmp_path) as made:
        robot.old_s = 4.0
        drive(made, 1.2)
        made.world.step()
        with pytest.raises(RobotError, match="/head/color: the newest picture is") as raised:
            made.world.robot.look("head")
        assert raised.value.reason == "late_picture"
    assert robot.comes_to_stand()


def test_intrinsics_that_do_not_fit_are_told(robot: TestRobot, tmp_path: Path) -> None:
    """A picture of another size than CameraInfo is for: topics and file."""
    robot.size = (24, 32)
    with pytest.raises(RobotError, match="32 x 24 pixels, but /head/info is for 64 x 48") as raised, session(tmp_path):
        pass
    assert "bridge.yaml" in str(raised.value)


def test_a_second_bridge_is_refused(robot: TestRobot, tmp_path: Path) -> None:
    """Who commands the robot already is named."""
    with session(tmp_path) as made:
        drive(made, 0.2)
        with pytest.raises((UserError, RobotError), match="another node commands the robot: /mpvi_bridge_"):  # noqa: SIM117
            with session(tmp_path) as second:
                drive(second, 5.0)  # where nodes find each other late


def test_another_commander_stops_the_robot(robot: TestRobot, tmp_path: Path) -> None:
    """One that comes later."""
    from geometry_msgs.msg import TwistStamped

    with session(tmp_path) as made:
        error = ending(made, robot, lambda: robot.node.create_publisher(TwistStamped, "/cmd_vel", 1))
    assert error.reason == "second_bridge"
    assert "/test_robot on /cmd_vel" in str(error)


def test_a_topic_that_nobody_has_is_told_at_the_start(robot: TestRobot, tmp_path: Path) -> None:
    """It is named, with the nearest that there is."""
    with (
        pytest.raises(RobotError, match="/joint_state: nobody publishes it; there is /joint_states") as raised,
        session(tmp_path, lines={"joint_states": "joint_states: /joint_state"}),
    ):
        pass
    assert raised.value.reason == "no_topic"


def test_a_loop_that_hangs_stops_the_base(robot: TestRobot, tmp_path: Path) -> None:
    """Whoever thinks for a second does not drive on meanwhile; then the run goes on."""
    with session(tmp_path, lines=STRICT) as made:
        set_off(made, robot)
        at = time.monotonic()
        time.sleep(2.5)
        assert robot.comes_to_stand()
        assert robot.last_motion() - at < SOON_S
        set_off(made, robot)
        assert made.watchdog.stalls >= 1


def test_a_signal_stops_the_robot(robot: TestRobot, tmp_path: Path) -> None:
    """SIGTERM, while the main thread is at something else."""
    with session(tmp_path) as made:
        set_off(made, robot)
        at = time.monotonic()
        threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGTERM)).start()
        time.sleep(0.6)
        with pytest.raises(KeyboardInterrupt, match="SIGTERM"):
            drive(made, 5.0)
    assert robot.comes_to_stand()
    assert robot.last_motion() - at < SOON_S


def test_an_error_stops_the_robot(robot: TestRobot, tmp_path: Path) -> None:
    """Whatever is raised while it drives."""

    def broken() -> None:
        with session(tmp_path) as made:
            set_off(made, robot)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        broken()
    at = time.monotonic()
    assert robot.comes_to_stand()
    assert robot.last_motion() - at < SOON_S


def test_a_fault_of_ours_in_what_hears_halts_the_robot(tmp_path: Path) -> None:
    """A message that nothing here is ready for does not end the listening unheard."""
    heard = HeardStates(load_bridge(write_bridge(tmp_path, "sim"), FETCH), FETCH, {})
    heard.hear_clock(object())
    assert heard.wrong() == ("broken", "/clock: AttributeError: 'object' object has no attribute 'clock'")


def test_a_watchdog_that_breaks_halts_the_robot(robot: TestRobot, tmp_path: Path, monkeypatch) -> None:
    """What it watches by may fail in a way that nobody thought of."""

    def fails() -> list[str]:
        raise RuntimeError("the graph is gone")

    with session(tmp_path) as made:
        error = ending(made, robot, lambda: monkeypatch.setattr(made.node, "commanders", fails))
    assert str(error) == "the watchdog broke: RuntimeError: the graph is gone"
