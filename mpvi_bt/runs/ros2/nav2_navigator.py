"""Drives the base by Nav2: our navigator says where to, finds things and drives the last piece."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from mpvi_bt.executive.remote.remote_world import RemoteRobot
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Navigator, Progress, Report
from mpvi_bt.ground.robot.protocol import Robot
from mpvi_bt.runs.ros2.motion_gate import MotionGate


class GoalClient(Protocol):
    """As `nav2_client.Nav2Client`."""

    failure: tuple[str, str] | None
    arrived: bool

    def send(self, goal: Array) -> None: ...  # noqa: D102

    def cancel(self) -> None: ...  # noqa: D102


class KnowsGoal(Navigator, Protocol):
    """A navigator that says what it drives to."""

    @property
    def goal(self) -> Array | None: ...  # noqa: D102

    @property
    def path(self) -> Array | None: ...  # noqa: D102

    def leave(self) -> None: ...  # noqa: D102


class Nav2Navigator:
    """Implements `Navigator`. While Nav2 drives to our navigator's goal, ours sends no velocity.

    Nav2 stops a quarter of a meter from a goal, hands reach less far: once it has arrived ours drives the rest. Turns
    for looking around are ours too.

    Args:
        robot: The robot.
        ours: Our navigator.
        client: Sends goals.
        gate: The way out for commands.
    """

    def __init__(self, robot: Robot, ours: KnowsGoal, client: GoalClient, gate: MotionGate) -> None:
        self._robot, self._ours, self._client, self._gate = robot, ours, client, gate
        self._sent: Array | None = None
        gate.on_halt(client.cancel)

    def __getattr__(self, name: str) -> Any:
        """What a search shows of itself: that of our navigator."""
        return getattr(self._ours, name)

    def start(self, target: str, room: str | None) -> None:
        """As of `Navigator`."""
        self._give_back()
        self._ours.start(target, room)

    def leave(self) -> None:
        """As of `Navigator`."""
        self._ours.leave()

    def step(self) -> Report:
        """As of `Navigator`."""
        report = self._ours.step()
        goal, path = self._ours.goal, self._ours.path
        if report.progress is not Progress.RUNNING or goal is None or path is None:
            self._give_back()
            return report
        if not self._gate.watched:
            return report
        if self._sent is None or not np.allclose(self._sent, goal):
            self._sent = goal.copy()
            self._client.send(goal)
        if self._client.failure is not None:
            reason, why = self._client.failure
            self.stop()
            return Report(Progress.FAILED, reason, why)
        self._gate.base_elsewhere = not self._client.arrived
        return report

    def stop(self) -> None:
        """As of `Navigator`."""
        self._give_back()
        self._ours.stop()

    def _give_back(self) -> None:
        """Let ours drive the base."""
        if self._sent is not None and not self._client.arrived:
            self._client.cancel()
        self._sent, self._gate.base_elsewhere = None, False


def nav2(robot: Robot, ours: KnowsGoal) -> Nav2Navigator:
    """The navigator of a run on a robot over ROS 2.

    Raises:
        UserError: The robot is none, or nav2_msgs is not installed.
    """
    from mpvi_bt.runs.ros2.nav2_client import Nav2Client
    from mpvi_bt.runs.ros2.ros_line import RosLine

    line = robot.line if isinstance(robot, RemoteRobot) else None
    if not isinstance(line, RosLine):
        raise UserError("--navigator nav2 drives robots over ROS 2 only: mpvi ros2.")
    return Nav2Navigator(robot, ours, Nav2Client(line.node), line.gate)
