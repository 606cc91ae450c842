"""Pauses a run, lets it go on, or stops it, on request over ROS 2."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.runs.ros2.robot_session import RobotSession
from mpvi_bt.runs.ros2.ros_packages import is_there
from mpvi_bt.runs.ros2.watchdog import STOPPED

ORDERS = ("pause", "resume", "stop")
_POLL_S = 0.02


class RunControl(Watcher):
    """Subscriber that waits while the run is paused. The base stands meanwhile, and joints keep their targets.

    Orders come by the services PREFIX/pause, /resume and /stop (std_srvs/Trigger), and as words on PREFIX/control.

    Args:
        session: The robot's.
        prefix: Of the names.
        stop: Asked to end the run.
    """

    def __init__(self, session: RobotSession, prefix: str, stop: Stop) -> None:
        from std_msgs.msg import String

        self._gate, self._line, self._stop, self._prefix = session.gate, session.line, stop, prefix
        self._paused = False
        node = session.node.node
        node.create_subscription(String, f"{prefix}/control", self._hear, 10)
        if is_there("std_srvs.srv"):
            from std_srvs.srv import Trigger

            for order in ORDERS:
                node.create_service(Trigger, f"{prefix}/{order}", partial(self._serve, order))

    def step(self, tree: Tree, world: World) -> None:
        """Wait until the run may go on."""
        if not self._paused:
            return
        with tree.context.stopwatch("paused"):
            self._gate.stand(0.0)
            while self._paused and self._gate.halted is None:
                time.sleep(_POLL_S)
            self._line.go_on()

    def _hear(self, message: Any) -> None:
        self._obey(message.data.strip())

    def _serve(self, order: str, request: Any, response: Any) -> Any:
        response.success, response.message = self._obey(order), order
        return response

    def _obey(self, order: str) -> bool:
        """Carry out an order; whether it is one."""
        if order == "pause":
            self._paused = True
        elif order == "resume":
            self._paused = False
        elif order == "stop":
            self._gate.halt(STOPPED, f"it was stopped by {self._prefix}/stop")
            self._stop.request()
        return order in ORDERS
