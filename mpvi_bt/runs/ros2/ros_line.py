"""The connection of a remote world to a robot over ROS 2: a command goes out, and the next tick's state comes back."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from mpvi_bt.executive.remote.reading import Reading
from mpvi_bt.ground.errors import BadMessage, RobotError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge
from mpvi_bt.runs.ros2.camera_buffer import RawPicture
from mpvi_bt.runs.ros2.command_messages import PERIOD_NS
from mpvi_bt.runs.ros2.motion_gate import MotionGate
from mpvi_bt.runs.ros2.ros_node import RobotNode
from mpvi_bt.runs.ros2.state_messages import NS, body_of
from mpvi_bt.runs.ros2.watchdog import STOPPED

_POLL_S = 0.02
_ANSWER_S = 60.0  # Our choice: a simulator that waits for us takes no longer for a step or a picture [wall clock]
_ASK_AGAIN_S = 1.0
_GONE_S = 1.0  # Our choice: a simulator whose states nobody publishes for so long has ended [wall clock]
_PAST = 60  # states that are kept, two seconds: pictures are older than states


@dataclass
class LineTimes:
    """How the line went.

    Attributes:
        late: Ticks that could not be made in time.
        resent: Commands that were sent again.
        picture_to_command_s: From a picture's arrival at the tree to the command that followed, in wall time.
        state_to_command_s: Likewise of states.
    """

    late: int = 0
    resent: int = 0
    picture_to_command_s: list[float] = field(default_factory=list)
    state_to_command_s: list[float] = field(default_factory=list)


class RosLine:
    """A `RobotConnection` over ROS 2. The loop ticks at its rate in the robot's time.

    Attributes:
        node, gate: What it speaks through.
        times: How it went.
    """

    def __init__(
        self, bridge: Bridge, robot: RobotDescription, node: RobotNode, gate: MotionGate, say: Callable[[str], None]
    ) -> None:
        """Nothing was exchanged yet."""
        self._bridge, self._robot, self.node, self.gate, self._say = bridge, robot, node, gate, say
        self._heard = node.heard
        self._past: deque[tuple[int, Proprioception]] = deque(maxlen=_PAST)
        self._due_ns = 0
        self._stamp_ns = 0
        self._read_at = 0.0
        self._looked_at: list[float] = []
        self._published_at = time.monotonic()
        self.times = LineTimes()

    def begin(self) -> Reading:
        """Wait for the first state and pictures. Raises RobotError: a topic is silent."""
        wait_s = self._bridge.settings.wait_s
        in_step = self._heard.in_step if self._bridge.settings.lockstep else lambda: not self._heard.missing()
        if not self._wait(in_step, wait_s):
            silent = self._heard.missing() or ["the joint states, the odometry and /clock are not of one moment"]
            self._lose("no_topic", f"nothing to begin with after {wait_s:g} s: {self.node.told_of(silent)}")
        reading = self._state(0)
        cameras = {"head"} & set(self._bridge.cameras)
        images = {camera: self.look(camera).images[camera] for camera in cameras}
        known = [self._heard.cameras[camera].vocabulary for camera in cameras]
        self._due_ns = self._heard.now_ns()
        return Reading(body=reading.body, images=images, vocabulary=next(filter(None, known), None))

    def exchange(self, actions: Array) -> Reading:
        """Send the last of actions (K, A), and wait for the next tick's state. Raises RobotError."""
        self._check()
        self.gate.send(actions[-1], self._stamp_ns if self._bridge.settings.lockstep else self._heard.now_ns())
        now = time.monotonic()
        self.times.state_to_command_s.append(now - self._read_at)
        self.times.picture_to_command_s += [now - at for at in self._looked_at]
        self._looked_at = []
        return self._state(self._answered() if self._bridge.settings.lockstep else self._next_tick())

    def look(self, camera: str) -> Reading:
        """A camera's newest picture. Raises RobotError: there is none, or it is too old."""
        if camera not in self._bridge.cameras:
            self._lose("no_topic", f"{self._bridge.file} has no topics for the camera {camera!r}")
        raw = self._requested(camera) if self._bridge.cameras[camera].request else self._streamed(camera)
        stamp = raw.stamp_ns
        try:
            pose = matmul(kin.base(self._place_at(stamp)), self._on_base(camera, stamp))
            image = self._heard.cameras[camera].picture(raw, pose)
        except BadMessage as error:
            self._lose("bad_picture", str(error))
        self._looked_at.append(time.monotonic())
        return Reading(body=self._past[-1][1], images={camera: image})

    def go_on(self) -> None:
        """Count ticks from now on: those while the run was paused were not missed."""
        self._due_ns = self._heard.now_ns()

    # --- ticks

    def _answered(self) -> int:
        """Wait for the state that answers the last command; 0: no tick was missed."""
        before = self._stamp_ns
        topic = self._bridge.settings.state_topics[0]
        heard = self._heard.count.get(topic, 0)

        def next_one() -> bool:
            nonlocal heard
            if self._heard.in_step() and self._heard.now_ns() > before:
                return True
            if (count := self._heard.count.get(topic, 0)) > heard and self._heard.now_ns() == before:
                self.gate.resend()  # it asks again: what we sent was lost
                self.times.resent += 1
            heard = count
            return False

        if not self._wait(next_one, _ANSWER_S):
            topics = [*self._bridge.settings.state_topics, "/clock"]
            self._lose("silent", f"no state came for {_ANSWER_S:g} s: {self.node.told_of(topics)}")
        return 0

    def _next_tick(self) -> int:
        """Wait for the next tick in the robot's time; how many were missed."""
        self._due_ns += PERIOD_NS
        late = max(0, self._heard.now_ns() - self._due_ns) // PERIOD_NS
        if late:
            if not self.times.late:
                self._say(f"late by {late} ticks: this computer does not keep up with the robot (said once)")
            self.times.late += late
            self._due_ns += late * PERIOD_NS
        self._wait(lambda: self._heard.now_ns() >= self._due_ns, _ANSWER_S)
        return int(late)

    def _state(self, skipped: int) -> Reading:
        with self._heard.changed:
            base = self._heard.base
            assert base is not None
            body = body_of(self._robot, self._bridge, self._heard.joints, base)
            self._stamp_ns = self._heard.stamp_ns()
        self._past.append((base.stamp_ns, body))
        self._read_at = time.monotonic()
        return Reading(body=body, images={}, skipped=skipped)

    def _wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        """Wait until it is so; False: it was not. Raises RobotError, KeyboardInterrupt: the robot was halted."""
        until = time.monotonic() + seconds
        with self._heard.changed:
            while not ready():
                self._check()
                self._check_there()
                left = until - time.monotonic()
                if left <= 0:
                    return False
                ahead_s = (self._due_ns - self._heard.now_ns()) / NS
                self._heard.changed.wait(min(left, _POLL_S, ahead_s if ahead_s > 0 else _POLL_S))
        self._check()
        return True

    def _check(self) -> None:
        if self.gate.halted is not None:
            reason, why = self.gate.halted
            if reason == STOPPED:
                raise KeyboardInterrupt(why)
            raise RobotError(reason, why)

    def _check_there(self) -> None:
        """Lose a simulator in lockstep that has ended: it answers nothing more."""
        topic, now = self._bridge.settings.state_topics[0], time.monotonic()
        if not self._bridge.settings.lockstep or not self._past or self.node.is_published(topic):
            self._published_at = now
        elif now - self._published_at > _GONE_S:
            self._lose("silent", f"{topic}: nobody publishes it any more: the simulator has ended")

    def _lose(self, reason: str, why: str) -> NoReturn:
        self.gate.halt(reason, why)
        raise RobotError(reason, why)

    # --- pictures

    def _on_base(self, camera: str, stamp: int) -> Array:
        """T_base_camera (4, 4) at a moment: by tf if the bridge names a frame. Raises BadMessage: tf has it not."""
        if frame := self._bridge.cameras[camera].frame:
            with self._heard.changed:
                return self._heard.transforms.place(self._heard.base_frame, frame)
        body = min(self._past, key=lambda one: abs(one[0] - stamp))[1]
        return self._robot.camera_poses(body.torso, body.arm)[camera]

    def _requested(self, camera: str) -> RawPicture:
        """Ask for the picture of the present state."""
        buffer, stamp = self._heard.cameras[camera], self._stamp_ns
        until = time.monotonic() + _ANSWER_S
        while time.monotonic() < until:
            self.node.ask_picture(camera, stamp)
            self._wait(lambda: buffer.newest(stamp) is not None, _ASK_AGAIN_S)
            if (picture := buffer.newest(stamp)) is not None:
                return picture
        return self._lose("no_topic", f"no picture of {camera!r} was sent: {self.node.told_of(buffer.missing())}")

    def _streamed(self, camera: str) -> RawPicture:
        """The newest picture that is whole and not too old."""
        buffer, oldest_s = self._heard.cameras[camera], self._bridge.settings.picture_s
        wait_s = oldest_s if self._looked(camera) else self._bridge.settings.wait_s

        def fresh() -> bool:
            picture = buffer.newest()
            return picture is not None and self._heard.now_ns() - picture.stamp_ns <= oldest_s * NS

        self._wait(fresh, wait_s)
        if (picture := buffer.newest()) is not None:
            age_s = (self._heard.now_ns() - picture.stamp_ns) / NS
            if age_s <= oldest_s:
                return picture
            self._lose(
                "late_picture",
                f"{buffer.topics.color}: the newest picture is {age_s:.2f} s old, {oldest_s:g} s is the limit",
            )
        silent = buffer.missing() or [f"{buffer.topics.color} and {buffer.topics.depth} have no pictures of one moment"]
        return self._lose("no_topic", f"no picture of {camera!r} for {wait_s:g} s: {self.node.told_of(silent)}")

    def _looked(self, camera: str) -> bool:
        return self._heard.cameras[camera].newest() is not None

    def _place_at(self, stamp: int) -> Array:
        """(3,) where the base was at a moment: between the states before and after it."""
        after = next((i for i, (at, _) in enumerate(self._past) if at >= stamp), None)
        if after is None or after == 0:
            return self._past[-1 if after is None else 0][1].base_pose
        (t0, before), (t1, then) = self._past[after - 1], self._past[after]
        share = (stamp - t0) / max(1, t1 - t0)
        step = then.base_pose - before.base_pose
        step[2] = kin.wrap(step[2])
        place = before.base_pose + share * step if share < 1 else then.base_pose
        return np.array([place[0], place[1], kin.wrap(place[2]) if share < 1 else place[2]])
