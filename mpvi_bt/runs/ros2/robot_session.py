"""A robot over ROS 2, from its first state to the halt at the end: node, gate, watchdog and world put together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import quantiles
from typing import Any

from mpvi_bt.executive.remote.reading import Reading
from mpvi_bt.executive.remote.remote_world import RemoteWorld
from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.ground.errors import BadMessage, RobotError, UserError
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge
from mpvi_bt.runs.ros2.motion_gate import MotionGate
from mpvi_bt.runs.ros2.ros_line import RosLine
from mpvi_bt.runs.ros2.ros_node import RobotNode
from mpvi_bt.runs.ros2.watchdog import Watchdog

_DISCOVERY_S = 2.0  # Our choice: on one busy machine some nodes know each other only after more than 1 s


class RosWorld(RemoteWorld):
    """The world of a robot over ROS 2: a state that does not follow the one before halts it."""

    def __init__(self, robot: RobotDescription, first: Reading, line: RosLine) -> None:
        """Begin with a state."""
        super().__init__(robot, first, line)
        self._gate = line.gate

    def step(self) -> None:
        """As of `RemoteWorld`. Raises RobotError: the robot was halted."""
        try:
            super().step()
        except BadMessage as error:
            self._gate.halt("bad_state", str(error))
            raise RobotError("bad_state", str(error)) from None


@dataclass(frozen=True, eq=False)
class RobotSession:
    """A robot that stands at its first state.

    Attributes:
        first: That state, with a picture of the head.
        world: Steps it.
        node, gate, line, watchdog: The parts of the bridge.
    """

    first: Reading
    world: RosWorld
    node: RobotNode
    gate: MotionGate
    line: RosLine
    watchdog: Watchdog

    def told(self) -> dict[str, Any]:
        """How the bridge went, for a result."""
        self.watchdog.heed()
        times = self.line.times
        halted = self.gate.halted
        return {
            "commands": self.gate.sent,
            "late_ticks": times.late,
            "stalls": self.watchdog.stalls,
            "resent": times.resent,
            "lost": self.node.lost,
            "picture_to_command_ms": _spread(times.picture_to_command_s),
            "state_to_command_ms": _spread(times.state_to_command_s),
            "halted": {"reason": halted[0], "why": halted[1]} if halted else None,
        }


@contextmanager
def robot_session(
    bridge: Bridge,
    robot: RobotDescription,
    allow_motion: bool,
    stop: Stop,
    say: Callable[[str], None],
    base_is_shared: bool = False,
) -> Iterator[RobotSession]:
    """A robot over ROS 2. However the block is left, the robot is told to stop.

    Args:
        bridge: Its topics.
        robot: What robot it is.
        allow_motion: Whether commands go out.
        stop: Asked to end the run by Ctrl-C or SIGTERM.
        say: Told what a person should know.
        base_is_shared: Whether other nodes may drive the base too, for us.

    Raises:
        UserError: A package of ROS 2 is missing, another node commands the robot, or it waits for commands that may
            not go out.
        RobotError: A topic is silent, or says what cannot be.
        KeyboardInterrupt: The process was stopped.
    """
    settings = bridge.settings
    if settings.lockstep and not allow_motion:
        raise UserError(f"{bridge.file}: with 'lockstep' the simulator waits for each command: give --allow-motion.")
    node = RobotNode(bridge, robot, base_is_shared)
    try:
        node.wait_discovered(_DISCOVERY_S)
        if allow_motion and (others := node.commanders()):
            raise UserError(f"another node commands the robot: {', '.join(others)}. Stop it first.")
        if not allow_motion:
            say("nothing moves: commands go out only with --allow-motion")
        writer = node.commander() if allow_motion else None
        gate = MotionGate(
            bridge, robot, writer, lambda: {name: joint.position for name, joint in dict(node.heard.joints).items()}
        )
        line = RosLine(bridge, robot, node, gate, say)
        with Watchdog(node, gate, settings.watchdog_s, settings.lockstep, stop) as watchdog:
            first = line.begin()
            world = RosWorld(robot, first, line)
            yield RobotSession(first, world, node, gate, line, watchdog)
    finally:
        node.close()


def _spread(seconds: list[float]) -> dict[str, float] | None:
    """Median and 95th percentile [ms]; None of fewer than two."""
    if len(seconds) < 2:
        return None
    twentieths = quantiles(seconds, n=20)
    return {"median": round(1000 * twentieths[9], 3), "p95": round(1000 * twentieths[18], 3)}
