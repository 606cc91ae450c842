"""Our house as a robot of ROS 2: a peer to test a bridge against.

It has the topics of a bridge file, the other way round, and simulated time. Its base stops by itself when commands stay
away, as a real one does. At the end it scores the episode by where things truly are.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header, String
from trajectory_msgs.msg import JointTrajectory

from mpvi_bt.executive.ticking.goal_report import GoalReport
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.house.goals.evaluate import judge, snapshot
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.instances.instances import begin, expanded_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.runs.episode.assembly import floors
from mpvi_bt.runs.episode.metrics import Meter
from mpvi_bt.runs.ros2 import house_messages as messages
from mpvi_bt.runs.ros2.bridge_file import Bridge, CameraTopics, load_bridge
from mpvi_bt.runs.ros2.command_messages import time_message
from mpvi_bt.runs.ros2.house_commands import HouseCommands, stamp_ns, trajectory_topics

Ended = Literal["bridge_gone", "no_bridge", "silent", "stopped", "time_limit"]
AGAIN_S = 0.1  # of wall time: the state is sent anew while its answer is waited for; a sign of life, too
REST_S = 0.5  # of wall time, from the first command that answers a state: those that come later are lost
GONE_S = 1.0  # of wall time without anybody who could send commands
_LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)  # fmt: skip


@dataclass(frozen=True)
class HouseSession:
    """What the house plays.

    Attributes:
        task: Name or file of a task.
        instance: Which of its starts.
        robot: That is in the house.
        bridge: Name or file of the bridge that is answered to.
        assisted: Whether grasps are assisted.
        wait_s: How long a bridge is waited for at the start.
        patience_s: How long the answer to a state is waited for, in lockstep: plans and searches take their time.
        stream_hz: How often pictures are sent without being asked for, in simulated time; 0: never.
    """

    task: str
    instance: int = 0
    robot: str = DEFAULT_ROBOT
    bridge: str = "house"
    assisted: bool = False
    wait_s: float = 60.0
    patience_s: float = 120.0
    stream_hz: float = 0.0


@dataclass(frozen=True)
class HouseEpisode:
    """What became of an episode.

    Attributes:
        goal: At its end.
        ended: Why it ended.
        result: Everything, ready for JSON.
    """

    goal: GoalReport
    ended: Ended
    result: Mapping[str, Any]


def play(session: HouseSession, say: Callable[[str], None], stop: Callable[[], bool] = lambda: False) -> HouseEpisode:
    """Play an episode; rclpy has been set up.

    Args:
        session: What is played.
        say: Told what a person should know, in a line.
        stop: Ends the episode.

    Raises:
        UserError: There is no such task, instance, robot or bridge, or the bridge is none for a house.
        NoRenderingDevice: Nothing can be drawn here.
    """
    task = load_task(session.task)
    task.check_instance(session.instance)
    robot = robot_named(session.robot)
    bridge = load_bridge(session.bridge, robot)
    check_mirrored(bridge)
    house, catalogue = load_house(task.house), load_catalogue()
    problem = expanded_problem(task, house)
    say(f"{session.task}, instance {session.instance}: setting up")
    world, start = begin(
        task, house, catalogue, problem, session.instance, assisted=session.assisted, robot=robot
    )  # fmt: skip
    truth = truth_in(world, start.scene_names)
    before = snapshot(problem, truth)
    vocabulary: dict[str, Iterable[str]] = {e.name: e.phrases for e in world.knowledge() if e.kind != "room"}
    node = RosHouse(session, world, bridge, {**vocabulary, **world.phrases, **floors(house)})
    try:
        say(f"ready: {session.task}, instance {session.instance}, for bridge {session.bridge}")
        began = time.monotonic()
        ended = node.drive(task.budget_s, stop)
        wall_s = time.monotonic() - began
    finally:
        node.close()
    world.robot.hold()
    world.settle()  # what was let go of in the last step is still falling
    goal = judge(problem, before, snapshot(problem, truth))
    measured = node.meter.measurement
    result = {
        "task": session.task,
        "instance": session.instance,
        "robot": session.robot,
        "bridge": session.bridge,
        "lockstep": bridge.settings.lockstep,
        "ended": ended,
        "q_score": {"final": goal.q},
        "success": goal.satisfied,
        "conditions": [{"condition": c.text, "satisfied": c.satisfied} for c in goal.conditions],
        "time": {"simulator_steps": measured.steps, "simulator_time": measured.time_s},
        "agent_distance": {"base": measured.base_m, **{str(s): m for s, m in measured.hand_world_m.items()}},
        "messages": node.counts(),
        "wall": {
            "total_s": wall_s,
            "physics_s": world.physics_s,
            "drawing_s": world.cameras.seconds if world.cameras else 0.0,
            **node.latency(),
        },
    }
    say(f"{session.task}, instance {session.instance}: q {goal.q:.3f} after {world.steps} steps, {ended}")
    return HouseEpisode(goal, ended, result)


def check_mirrored(bridge: Bridge) -> None:
    """Raise UserError for a bridge that our house cannot answer to."""
    trajectory_topics(bridge)
    settings = bridge.settings
    for wrong, what in (
        (settings.clock != "sim", "clock: our house has simulated time: say 'sim'"),
        (settings.odometry.topic is None, "odometry: our house has no transforms: give a 'topic'"),
        (len(settings.state_topics) > 1, "joint_states: our house has one topic for all joints"),
        (any(camera.compressed for camera in bridge.cameras.values()), "cameras: our house compresses no pictures"),
    ):
        if wrong:
            raise UserError(f"{bridge.file}: {what}.")


@dataclass
class _Waits:
    """Wall times [s] from a state, and from a picture, to the whole command that answers it."""

    state: list[float] = field(default_factory=list)
    picture: list[float] = field(default_factory=list)


class RosHouse:
    """The node.

    Attributes:
        meter: What was measured.
    """

    def __init__(
        self, session: HouseSession, world: SimWorld, bridge: Bridge, vocabulary: Mapping[str, Iterable[str]]
    ) -> None:
        self._node = rclpy.create_node("mpvi_house")
        self._session, self._world, self._bridge = session, world, bridge
        self._vocabulary = {name: list(words) for name, words in vocabulary.items()}
        self._hears = SingleThreadedExecutor()
        self._hears.add_node(self._node)
        self.meter = Meter()
        self._commands = HouseCommands(world.robot.model, world.robot.action, bridge)
        self._waits, self._drawn, self._sent = _Waits(), Counter[str](), 0
        self._shown_at, self._unanswered, self._alone = 0.0, 0, 0
        settings = bridge.settings
        assert settings.odometry.topic is not None
        self._clock_out = self._node.create_publisher(Clock, "/clock", 10)
        self._joints_out = self._node.create_publisher(JointState, settings.state_topics[0], 10)
        self._odometry_out = self._node.create_publisher(Odometry, settings.odometry.topic, 10)
        self._pictures = {name: self._camera(name, topics) for name, topics in bridge.cameras.items()}
        base = settings.base
        stamped = base.type == "TwistStamped"
        hear = partial(self._hear_stamped if stamped else self._hear_twist, base.topic)
        self._node.create_subscription(TwistStamped if stamped else Twist, base.topic, hear, 10)
        for topic in trajectory_topics(bridge):
            self._node.create_subscription(JointTrajectory, topic, partial(self._hear_trajectory, topic), 10)

    def drive(self, budget_s: float, stop: Callable[[], bool]) -> Ended:
        """Step the world by what it is told, until the end."""
        world, lockstep = self._world, self._bridge.settings.lockstep
        self.meter.note(world)
        if (ended := self._await_bridge(stop)) is not None:
            return ended
        due = time.monotonic()
        while True:
            self._send_state()
            if lockstep:
                ended = self._await_answer(stop)
            else:
                due = max(due + 1 / CONTROL_HZ, time.monotonic() - 1.0)
                ended = self._spin_until(due, stop)
            if ended is not None:
                return ended
            if world.time_s >= budget_s:
                return "time_limit"
            world.robot.act(self._commands.next_action())
            world.step()
            self.meter.note(world)
            self._stream()

    def close(self) -> None:
        """Leave the graph."""
        self._hears.shutdown()
        self._node.destroy_node()

    def counts(self) -> dict[str, Any]:
        """Messages by kind: sent, taken, lost."""
        heard = self._commands.heard.items()
        return {
            "states": self._sent,
            "states_unanswered": self._unanswered,
            "pictures": dict(self._drawn),
            "commands": {topic: {**vars(h), "refused": dict(h.refused)} for topic, h in heard},
        }

    def latency(self) -> dict[str, Any]:
        """Wall times until commands are there, in lockstep [s]."""
        return {
            f"{kind}_to_command_s": {
                "count": len(waits),
                "median": float(np.median(waits)) if waits else None,
                "p95": float(np.percentile(waits, 95)) if waits else None,
            }
            for kind, waits in vars(self._waits).items()
        }

    # --- waiting

    def _await_bridge(self, stop: Callable[[], bool]) -> Ended | None:
        """Wait until somebody could send commands."""
        deadline = time.monotonic() + self._session.wait_s
        while not self._is_driven():
            if stop():
                return "stopped"
            if time.monotonic() > deadline:
                return "no_bridge"
            self._send_state()
            self._hears.spin_once(AGAIN_S)
        return None

    def _await_answer(self, stop: Callable[[], bool]) -> Ended | None:
        """Wait for the commands that answer the present state."""
        commands, began = self._commands, time.perf_counter()
        every, first, again, seen = len(commands.heard), None, began + AGAIN_S, began
        self._shown_at = 0.0
        while missing := commands.missing():
            now = time.perf_counter()
            if stop():
                return "stopped"
            if first is None and len(missing) < every:
                first = now
            if first is not None and now > first + REST_S:
                break
            if now > again:
                self._send_state()
                again = now + AGAIN_S
                if self._is_driven():
                    seen = now
                elif now > seen + GONE_S:
                    return "bridge_gone"
            if now > began + self._session.patience_s:
                return "silent"
            self._hears.spin_once(AGAIN_S)
        if len(missing) == every:
            self._unanswered += 1
        elif not missing:
            now = time.perf_counter()
            self._waits.state.append(now - began)
            if self._shown_at:
                self._waits.picture.append(now - self._shown_at)
        return None

    def _spin_until(self, due: float, stop: Callable[[], bool]) -> Ended | None:
        """Hear commands until a moment of wall time."""
        while (left := due - time.monotonic()) > 0:
            self._hears.spin_once(left)
        if stop():
            return "stopped"
        if self._is_driven():
            self._alone = 0
        else:
            self._alone += 1
        return "bridge_gone" if self._alone > GONE_S * CONTROL_HZ else None

    def _is_driven(self) -> bool:
        """Whether anybody can send commands to the base."""
        return bool(self._node.count_publishers(self._bridge.settings.base.topic))

    # --- hearing

    def _hear_twist(self, topic: str, message: Twist) -> None:
        velocity = (message.linear.x, message.linear.y, message.angular.z)
        self._commands.drive(topic, 0, velocity)

    def _hear_stamped(self, topic: str, message: TwistStamped) -> None:
        twist = message.twist
        self._commands.drive(topic, _ns(message.header.stamp), (twist.linear.x, twist.linear.y, twist.angular.z))

    def _hear_trajectory(self, topic: str, message: JointTrajectory) -> None:
        times = [_ns(point.time_from_start) * 1e-9 for point in message.points]
        positions = [np.array(point.positions) for point in message.points]
        self._commands.follow(topic, _ns(message.header.stamp), message.joint_names, times, positions)

    # --- telling

    def _send_state(self) -> None:
        """Send the present state, with the time that it is of."""
        felt = self._world.robot.proprioception()
        stamp = time_message(stamp_ns(self._world.steps))
        self._clock_out.publish(Clock(clock=stamp))
        self._odometry_out.publish(messages.odometry(felt, stamp))
        self._joints_out.publish(messages.joint_state(self._world.robot.model, felt, stamp))
        self._sent += 1

    def _camera(self, name: str, topics: CameraTopics) -> Callable[[], None]:
        """Make the topics of a camera; what sends its picture of the present state on all of them."""
        color, depth = (
            self._node.create_publisher(Image, topics.color, 2),
            self._node.create_publisher(Image, topics.depth, 2),
        )
        info = self._node.create_publisher(CameraInfo, topics.info, 2)
        labels = self._node.create_publisher(Image, topics.labels, 2) if topics.labels else None
        names = self._node.create_publisher(String, topics.names, _LATCHED) if topics.names else None
        told: list[Mapping[int, str]] = []

        def send() -> None:
            picture = self._world.robot.look(name)
            stamp = time_message(stamp_ns(self._world.steps))
            if names is not None and told[-1:] != [picture.names]:
                told[:] = [dict(picture.names)]
                table = {str(label): thing for label, thing in picture.names.items()}
                names.publish(String(data=json.dumps({"names": table, "vocabulary": self._vocabulary})))
            if labels is not None and picture.labels is not None:
                labels.publish(messages.label_image(picture, stamp))
            info.publish(messages.camera_info(picture, stamp))
            depth.publish(messages.depth_image(picture, stamp))
            color.publish(messages.color_image(picture, stamp))
            self._drawn[name] += 1
            self._shown_at = time.perf_counter()

        if topics.request is not None:
            self._node.create_subscription(Header, topics.request, lambda _: send(), 2)
        return send

    def _stream(self) -> None:
        """Send every camera's picture, if it is time for it."""
        rate = self._session.stream_hz / CONTROL_HZ
        if int(self._world.steps * rate) > int((self._world.steps - 1) * rate):
            for send in self._pictures.values():
                send()


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def result_path(session: HouseSession, out: Path) -> Path:
    """Where the result goes."""
    return out / f"{Path(session.task).stem}_{session.instance}_house.json"
