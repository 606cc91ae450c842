"""The one way out for commands: nothing passes before motion is allowed, or after a halt."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge, joint_names
from mpvi_bt.runs.ros2.command_messages import targets_of

_STOPS = 3  # Our choice: a stop is said so often, as a message can be lost


class CommandWriter(Protocol):
    """Publishes commands."""

    def drive(self, velocity: Array, stamp_ns: int) -> None:
        """Publish the base's velocity (3,)."""
        ...

    def move(self, targets: Mapping[str, float], stamp_ns: int) -> None:
        """Publish positions of all joints, by name."""
        ...


class MotionGate:
    """Lets commands out, within the limits of the base's speed and acceleration.

    Attributes:
        halted: Reason and sentence of the halt; None: there was none.
        sent: Commands that went out.
        base_elsewhere: Whether another node drives the base for us: no velocity goes out.
    """

    def __init__(
        self,
        bridge: Bridge,
        robot: RobotDescription,
        writer: CommandWriter | None,
        felt: Callable[[], Mapping[str, float]],
    ) -> None:
        """Nothing was sent yet.

        Args:
            bridge, robot: Whose.
            writer: Publishes; None: motion is not allowed.
            felt: Positions of the joints that were felt last.
        """
        self._bridge, self._robot, self._writer, self._felt = bridge, robot, writer, felt
        self._lock = threading.Lock()
        self._velocity = np.zeros(3)
        self._targets: dict[str, float] = {}
        self._stamp_ns = 0
        self._at = time.monotonic()
        self._stops: list[Callable[[], None]] = []
        self.halted: tuple[str, str] | None = None
        self.sent = 0
        self.base_elsewhere = False

    def on_halt(self, stop: Callable[[], None]) -> None:
        """Have something else stopped with the robot."""
        self._stops.append(stop)

    @property
    def watched(self) -> bool:
        """Whether it commands a robot that is not halted."""
        return self.halted is None and self._writer is not None

    def send(self, action: Array, stamp_ns: int) -> None:
        """Send an action (A,) out.

        Args:
            action: Within the robot's limits.
            stamp_ns: The moment that it answers.
        """
        with self._lock:
            if self.halted or self._writer is None:
                return
            asked = np.zeros(3) if self.base_elsewhere else self._robot.layout.velocity(action)
            self._velocity = self._ramped(asked)
            self._targets = targets_of(self._robot, self._bridge, action)
            self._stamp_ns = stamp_ns
            self._write(self._writer)
            self.sent += 1

    def resend(self) -> None:
        """Send the last command again."""
        with self._lock:
            if self.halted is None and self._writer is not None and self.sent:
                self._write(self._writer)

    def stand(self, after_s: float) -> bool:
        """Stop the base if nothing was sent for so long while it drives; whether that was so."""
        with self._lock:
            if self.halted or self._writer is None or not self._velocity.any():
                return False
            if time.monotonic() - self._at < after_s:
                return False
            self._velocity = np.zeros(3)
            self._writer.drive(self._velocity, self._stamp_ns)
            return True

    def halt(self, reason: str, why: str) -> None:
        """Stop base and arms for good: zero velocity, and joints hold where they are. Grippers keep their targets."""
        with self._lock:
            if self.halted:
                return
            self.halted = (reason, why)
            if self._writer is None:
                return
            for stop in self._stops:
                stop()
            felt = self._felt()
            arms = {name: felt[name] for name in joint_names(self._robot) if name in felt}
            for _ in range(_STOPS):
                self._writer.drive(np.zeros(3), self._stamp_ns)
                if self.sent:
                    self._writer.move({**self._targets, **arms}, self._stamp_ns)

    def _write(self, writer: CommandWriter) -> None:
        if not self.base_elsewhere:
            writer.drive(self._velocity, self._stamp_ns)
        writer.move(self._targets, self._stamp_ns)
        self._at = time.monotonic()

    def _ramped(self, velocity: Array) -> Array:
        """(3,) the nearest velocity that is within the base's limits after the last one."""
        velocity = np.clip(velocity, -self._robot.base_speed, self._robot.base_speed)
        if self._bridge.settings.lockstep:  # the house has a base with ramps of its own
            return velocity
        straight, turn = self._robot.drive_acceleration
        step = np.array([straight, straight, turn]) / CONTROL_HZ
        return np.clip(velocity, self._velocity - step, self._velocity + step)
