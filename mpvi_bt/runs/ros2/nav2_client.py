"""Goals for Nav2's NavigateToPose, and what its error codes mean here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.ros2.command_messages import time_message
from mpvi_bt.runs.ros2.ros_node import RobotNode
from mpvi_bt.runs.ros2.ros_packages import part

_SUCCEEDED = 4  # action_msgs/GoalStatus
FAILED = "nav2_failed"

# Error codes of nav2_msgs (Jazzy and Kilted): of FollowPath, ComputePathToPose and NavigateToPose itself, which hands
# on those of the other two.
REASONS: Mapping[int, tuple[str, str]] = {
    100: (FAILED, "the controller failed"),
    101: (FAILED, "there is no such controller"),
    102: ("no_pose", "the controller does not know where the base is"),
    103: ("no_path", "the path is none"),
    104: ("blocked", "the controller lost its patience"),
    105: ("blocked", "the base makes no progress"),
    106: ("blocked", "no command leads on"),
    107: ("blocked", "the controller took too long"),
    200: (FAILED, "the planner failed"),
    201: (FAILED, "there is no such planner"),
    202: ("no_pose", "the planner does not know where the base is"),
    203: ("no_pose", "the base is outside the map"),
    204: ("no_path", "the goal is outside the map"),
    205: ("start_in_collision", "the base stands in obstacles"),
    206: ("goal_in_obstacle", "the goal is in obstacles"),
    207: ("no_path", "planning took too long"),
    208: ("no_path", "no free way"),
    9000: (FAILED, "the navigator failed"),
    9001: (FAILED, "its behavior tree cannot be loaded"),
    9002: ("no_pose", "the navigator does not know where the base is"),
    9003: (FAILED, "a server of Nav2 does not answer"),
}


def reason_of(code: int, message: str = "") -> tuple[str, str]:
    """Our reason for an error code of Nav2, and a line for a person."""
    reason, meaning = REASONS.get(code, (FAILED, "an unknown error"))
    return reason, f"Nav2: {message or meaning} (error code {code})"


class Nav2Client:
    """One goal at a time.

    Attributes:
        failure: Reason and line of the goal that failed; None: it did not.
        arrived: Whether the last goal was reached.
    """

    def __init__(self, node: RobotNode) -> None:
        """Connect. Raises UserError: nav2_msgs is not installed."""
        self._kind = part("nav2_msgs.action:NavigateToPose", "--navigator nav2")
        from rclpy.action.client import ActionClient

        self._heard = node.heard
        self._client: Any = ActionClient(node.node, self._kind, "navigate_to_pose")
        self._handle: Any = None
        self._number = 0
        self.failure: tuple[str, str] | None = None
        self.arrived = False

    def send(self, goal: Array) -> None:
        """Have the base driven to x, y [m], yaw [rad] (3,) in the fixed frame, in place of the goal before."""
        self._number += 1
        self.failure, self.arrived, self._handle = None, False, None
        if not self._client.server_is_ready():
            self.failure = (FAILED, "Nav2: nobody offers the action navigate_to_pose")
            return
        message = self._kind.Goal()
        pose = message.pose
        pose.header.stamp, pose.header.frame_id = time_message(self._heard.now_ns()), self._heard.frame
        pose.pose.position.x, pose.pose.position.y = float(goal[0]), float(goal[1])
        pose.pose.orientation.z, pose.pose.orientation.w = float(np.sin(goal[2] / 2)), float(np.cos(goal[2] / 2))
        number = self._number
        self._client.send_goal_async(message).add_done_callback(lambda future: self._taken(number, future.result()))

    def cancel(self) -> None:
        """Have the base stop."""
        self._number += 1
        if self._handle is not None and not self.arrived and self.failure is None:
            self._handle.cancel_goal_async()
        self._handle = None

    def _taken(self, number: int, handle: Any) -> None:
        if not handle.accepted:
            if number == self._number:
                self.failure = (FAILED, "Nav2: the goal was refused")
            return
        if number != self._number:  # it was canceled before it was taken
            handle.cancel_goal_async()
            return
        self._handle = handle
        handle.get_result_async().add_done_callback(lambda future: self._ended(number, future.result()))

    def _ended(self, number: int, answer: Any) -> None:
        if number != self._number:
            return
        code = int(getattr(answer.result, "error_code", 0))
        if answer.status == _SUCCEEDED and not code:
            self.arrived = True
        else:
            self.failure = reason_of(code, str(getattr(answer.result, "error_msg", "")))
