"""What was last heard of a robot: its clock, joints, base and cameras, and whether that can be."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from mpvi_bt.ground.errors import BadMessage
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge
from mpvi_bt.runs.ros2.camera_buffer import CameraBuffer
from mpvi_bt.runs.ros2.state_messages import (
    NS,
    FeltBase,
    FeltJoint,
    needed_joints,
    next_place,
    read_joints,
    read_odometry,
)
from mpvi_bt.runs.ros2.transform_tree import TransformTree

FORWARD_S = 1.0  # Our choice: a clock that goes on by more at once has jumped
_CLOCK_S = 2.0  # Our choice: a simulator whose clock stands still for longer [wall clock] is gone


class HeardStates:
    """The last of everything that a robot says. Callbacks write it, all else reads it, under `changed`.

    Attributes:
        changed: Notified after each message.
        joints, base: What was felt last; base: None before the first.
        frame, base_frame: The fixed frame that the base's place is in, and the base's.
        transforms: What tf told.
        cameras: By name.
        fault: Reason and sentence of the first thing that cannot be; None: all is well.
        count: Messages by topic.
    """

    def __init__(self, bridge: Bridge, robot: RobotDescription, cameras: Mapping[str, CameraBuffer]) -> None:
        """Nothing was heard yet."""
        self.changed = threading.Condition()
        self.joints: dict[str, FeltJoint] = {}
        self.base: FeltBase | None = None
        self.frame = "odom"
        self.cameras = cameras
        self.fault: tuple[str, str] | None = None
        self.count: dict[str, int] = {}
        self._bridge, self._simulated = bridge, bridge.settings.clock == "sim"
        self._needed = needed_joints(robot, bridge)
        self.transforms = TransformTree(bridge.file)
        self.base_frame = "base_link"
        if tf := bridge.settings.odometry.tf:
            self.frame, self.base_frame = tf.fixed, tf.base
        self._clock_ns = 0
        self._ticked = time.monotonic()  # when the clock last came
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    # --- written by callbacks

    def hear_joints(self, topic: str, message: Any) -> None:
        """A sensor_msgs/JointState."""
        self._take(topic, lambda: self.joints.update(read_joints(message, topic, self.now_ns())))

    def hear_odometry(self, topic: str, message: Any) -> None:
        """A nav_msgs/Odometry."""

        def take() -> None:
            self.base = read_odometry(message, topic, self.now_ns())
            self.frame = message.header.frame_id or self.frame
            self.base_frame = message.child_frame_id or self.base_frame

        self._take(topic, take)

    def hear_transforms(self, topic: str, message: Any) -> None:
        """A tf2_msgs/TFMessage, which tells the base's place too if the bridge says so."""

        def take() -> None:
            self.transforms.hear(message, topic)
            if self._bridge.settings.odometry.tf and self.transforms.has(self.frame, self.base_frame):
                T, stamp = self.transforms.place(self.frame, self.base_frame), self.transforms.stamp_ns(self.base_frame)
                self.base = next_place(self.base, T, stamp or self.now_ns())

        self._take(topic, take)

    def hear_clock(self, message: Any) -> None:
        """A rosgraph_msgs/Clock."""

        def take() -> None:
            now = int(message.clock.sec) * NS + int(message.clock.nanosec)
            if self._clock_ns and now < self._clock_ns:
                self.blame("time_jump", f"/clock went back by {(self._clock_ns - now) / NS:.2f} s")
            elif self._clock_ns and now > self._clock_ns + FORWARD_S * NS:
                self.blame("time_jump", f"/clock went on by {(now - self._clock_ns) / NS:.2f} s at once")
            self._clock_ns, self._ticked = now, time.monotonic()

        self._take("/clock", take)

    def hear_camera(self, camera: str, part: str, raw: Any) -> None:
        """A serialized message of color, depth, labels or info; of names the text."""
        buffer = self.cameras[camera]
        put = buffer.put_names if part == "names" else lambda given: buffer.put(part, given)
        self._take(str(getattr(buffer.topics, part)), lambda: put(raw))

    def _take(self, topic: str, take: Callable[[], None]) -> None:
        with self.changed:
            try:
                take()
            except BadMessage as error:
                self.blame("bad_state", str(error))
            except Exception as error:  # a fault of ours must not end the listening unheard
                self.blame("broken", f"{topic}: {type(error).__name__}: {error}")
            self.count[topic] = self.count.get(topic, 0) + 1
            self.changed.notify_all()

    def blame(self, reason: str, why: str) -> None:
        """Have the robot halted: the first reason counts."""
        self.fault = self.fault or (reason, why)

    # --- read

    def now_ns(self) -> int:
        """The robot's time."""
        return self._clock_ns if self._simulated else time.time_ns()

    def missing(self) -> list[str]:
        """What has not come yet, in words; empty: there is a whole state."""
        topics = self._bridge.settings.state_topics
        absent = [name for name in self._needed if name not in self.joints]
        told = []
        if self._simulated and not self._clock_ns:
            told.append("/clock")
        if absent and not any(self.count.get(topic) for topic in topics):
            told += topics
        elif absent:
            told.append(f"{' and '.join(topics)} without the joint {', '.join(absent)}")
        if self.base is None:
            source = self._bridge.settings.odometry
            told.append(source.topic or self.transforms.why(self.frame, self.base_frame))
        return told

    def stamp_ns(self) -> int:
        """When the oldest part of the state was measured. Only of a whole state."""
        assert self.base is not None
        return min([self.base.stamp_ns, *(self.joints[name].stamp_ns for name in self._needed)])

    def in_step(self) -> bool:
        """Whether every part of the state, and the clock, is of one moment."""
        if self.missing() or self.base is None:
            return False
        stamps = {self.joints[name].stamp_ns for name in self._needed}
        return stamps | {self.base.stamp_ns} == {self._clock_ns}

    def wrong(self) -> tuple[str, str] | None:
        """Reason and sentence if the state cannot be driven by: it is old, ahead, or no state."""
        if self.fault is not None:
            return self.fault
        settings = self._bridge.settings
        if self._clock_ns and not settings.lockstep and time.monotonic() - self._ticked > _CLOCK_S:
            return "silent", f"/clock: nothing came for {_CLOCK_S:g} s"
        if not self._simulated and (jump := self._own_jump()):
            return "time_jump", jump
        if settings.lockstep or self.missing():
            return None
        assert self.base is not None
        topic, stamp = settings.odometry.topic or "/tf", self.base.stamp_ns
        for name in self._needed:
            if self.joints[name].stamp_ns < stamp:
                topic, stamp = f"{' and '.join(settings.state_topics)} (joint {name})", self.joints[name].stamp_ns
        age_s = (self.now_ns() - stamp) / NS
        if age_s > settings.watchdog_s:
            return "silent", f"{topic}: the last state is {age_s:.2f} s old, {settings.watchdog_s:g} s is the limit"
        if age_s < -FORWARD_S:
            return "time_jump", f"{topic}: the state is stamped {-age_s:.2f} s ahead: the clocks differ"
        return None

    def _own_jump(self) -> str:
        """How far this computer's clock has jumped, in words; "": it has not."""
        offset = time.time_ns() - time.monotonic_ns()
        by_s, self._offset_ns = (offset - self._offset_ns) / NS, offset
        if by_s < -0.05 or by_s > FORWARD_S:
            return f"this computer's clock jumped by {by_s:+.2f} s"
        return ""
