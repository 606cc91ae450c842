"""Sends trajectories as goals of a controller's action. A new goal takes the place of the one before."""

from __future__ import annotations

import time
from typing import Any

from mpvi_bt.runs.ros2.ros_packages import part

_EVERY_S = 0.1  # Our choice: controllers take topics at any rate, but goals have an answer each
_SAME = 1e-4  # [m or rad]


class GoalSender:
    """Publishes trajectories of one point to an action of control_msgs/FollowJointTrajectory.

    A goal is sent when targets have changed, and no more often than ten times a second; a trajectory that comes between
    is sent with a later one. The first that stands still is always sent, so that a stop is one.

    Args:
        node: The rclpy node.
        action: Its name.
        file: The bridge file, for messages.
    """

    def __init__(self, node: Any, action: str, file: str) -> None:
        self._kind = part("control_msgs.action:FollowJointTrajectory", f"the action {action} in {file}")
        from rclpy.action.client import ActionClient

        self._client: Any = ActionClient(node, self._kind, action)
        self._sent: list[float] = []
        self._told: list[float] = []
        self._at = float("-inf")

    def publish(self, trajectory: Any) -> None:
        """Send a trajectory_msgs/JointTrajectory, or leave it for later."""
        point = trajectory.points[-1]
        targets = list(point.positions)
        stands, self._told = _same(targets, self._told), targets
        if _same(targets, self._sent):
            return
        if not stands and time.monotonic() - self._at < _EVERY_S:
            return
        point.time_from_start.nanosec = max(point.time_from_start.nanosec, int(_EVERY_S * 1e9))
        self._client.send_goal_async(self._kind.Goal(trajectory=trajectory))
        self._sent, self._at = targets, time.monotonic()


def _same(first: list[float], second: list[float]) -> bool:
    return len(first) == len(second) and all(abs(a - b) < _SAME for a, b in zip(first, second, strict=True))
