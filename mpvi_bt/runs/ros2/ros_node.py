"""The bridge's node: subscriptions that fill what is heard, publishers of commands, and a thread that spins them."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from mpvi_bt.ground.errors import nearest
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge, Quality
from mpvi_bt.runs.ros2.camera_buffer import CameraBuffer
from mpvi_bt.runs.ros2.command_messages import time_message, trajectory_message, twist_message
from mpvi_bt.runs.ros2.goal_sender import GoalSender
from mpvi_bt.runs.ros2.heard_states import HeardStates
from mpvi_bt.runs.ros2.ros_packages import part, require_ros

_PARTING_S = 1.0
_NO_NAME = "_NODE_NAME_UNKNOWN_"  # rmw's, of a node whose topics were discovered before it was


class RobotNode:
    """A node of its own context, whose callbacks run in a thread of its own.

    Attributes:
        node: The rclpy node.
        heard: What was last heard.
        lost: Messages that the middleware reports lost.
    """

    def __init__(self, bridge: Bridge, robot: RobotDescription, base_is_shared: bool = False) -> None:
        """Subscribe to everything. Raises UserError: a package of ROS 2 is missing."""
        require_ros()
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        self._bridge, self._base_is_shared = bridge, base_is_shared
        self._began, self._closing = time.monotonic(), False
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        name = f"mpvi_bridge_{os.getpid()}_{id(self) % 10000}"
        self.node = rclpy.create_node(name, context=self._context, enable_rosout=False, start_parameter_services=False)
        self.lost = 0
        self.heard = HeardStates(bridge, robot, self._cameras(bridge))
        self._requests: dict[str, Any] = {}
        self._subscribe()
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name="ros", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and the node, once everyone has what was published last."""
        from rclpy.duration import Duration

        until = time.monotonic() + _PARTING_S
        for publisher in self.node.publishers:
            left_s = max(0.0, until - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left_s))
        self._closing = True
        self._executor.shutdown(timeout_sec=2.0)
        self._thread.join(timeout=2.0)
        self.node.destroy_node()
        self._context.try_shutdown()

    def commander(self) -> MessageWriter:
        """What publishes commands; made once motion is allowed."""
        return MessageWriter(self.node, self._bridge, self._quality(self._bridge.settings.qos.commands, "reliable"))

    def ask_picture(self, camera: str, stamp_ns: int) -> None:
        """Ask for a camera's picture of a moment."""
        from std_msgs.msg import Header

        self._requests[camera].publish(Header(stamp=time_message(stamp_ns)))

    def commanders(self) -> list[str]:
        """Other nodes that publish commands, as "NODE on TOPIC"."""
        topics = command_topics(self._bridge)[1 if self._base_is_shared else 0 :]
        return [f"{name} on {topic}" for topic in topics for name in self._others(topic)]

    def is_published(self, topic: str) -> bool:
        """Whether anybody publishes a topic."""
        return bool(self.node.count_publishers(topic))

    def told_of(self, topics: Iterable[str]) -> str:
        """Who publishes topics that nothing comes from, in words."""
        return "; ".join(self._told(topic) for topic in topics)

    def wait_discovered(self, seconds: float) -> None:
        """Give other nodes this time since the start to be discovered."""
        time.sleep(max(0.0, self._began + seconds - time.monotonic()))

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            self._executor.spin()
        except ExternalShutdownException:
            return
        except Exception as error:
            if not self._closing:  # at the end rclpy may find its own parts gone
                with self.heard.changed:
                    self.heard.blame("broken", f"the bridge hears no more: {type(error).__name__}: {error}")

    def _told(self, topic: str) -> str:
        if not topic.startswith("/") or " " in topic:
            return topic
        if others := self._others(topic):
            kinds = {kind for name, types in self.node.get_topic_names_and_types() if name == topic for kind in types}
            return f"{topic}: {', '.join(others)} publishes it ({', '.join(sorted(kinds))}), but nothing came"
        known = [name for name, _ in self.node.get_topic_names_and_types() if self._others(name)]
        near = nearest(topic, known)
        return f"{topic}: nobody publishes it" + (f"; there is {near}" if near else "")

    def _others(self, topic: str) -> list[str]:
        infos = self.node.get_publishers_info_by_topic(topic)
        own = self.node.get_name()
        names = {f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in infos if i.node_name != own}
        return sorted("a node that tells no name yet" if name.endswith(_NO_NAME) else name for name in names)

    def _quality(self, told: Quality, reliability: str, depth: int = 10, latched: bool = False) -> Any:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        kinds = {"reliable": ReliabilityPolicy.RELIABLE, "best_effort": ReliabilityPolicy.BEST_EFFORT}
        return QoSProfile(
            depth=told.depth or depth,
            reliability=kinds[told.reliability or reliability],
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )

    def _cameras(self, bridge: Bridge) -> dict[str, CameraBuffer]:
        from rclpy.serialization import deserialize_message
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image

        def deserialize(kinds: Mapping[str, Any], raw: bytes, name: str) -> Any:
            return deserialize_message(raw, kinds.get(name, Image))

        buffers = {}
        for camera, topics in bridge.cameras.items():
            kinds = {"info": CameraInfo, "color": CompressedImage if topics.compressed else Image}
            buffers[camera] = CameraBuffer(camera, topics, bridge.file, partial(deserialize, kinds))
        return buffers

    def _subscribe(self) -> None:
        from nav_msgs.msg import Odometry
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image, JointState
        from std_msgs.msg import Header, String

        settings, heard = self._bridge.settings, self.heard
        kept = "reliable" if settings.lockstep else "best_effort"
        states = self._quality(settings.qos.states, kept)
        pictures = self._quality(settings.qos.pictures, kept, 2)
        for topic in settings.state_topics:
            self._listen(JointState, topic, partial(heard.hear_joints, topic), states)
        if settings.odometry.topic:
            self._listen(
                Odometry, settings.odometry.topic, partial(heard.hear_odometry, settings.odometry.topic), states
            )
        if settings.odometry.tf or any(topics.frame for topics in self._bridge.cameras.values()):
            message = part("tf2_msgs.msg:TFMessage", f"tf in {self._bridge.file}")
            self._listen(message, "/tf", partial(heard.hear_transforms, "/tf"), self._quality(Quality(), kept, 100))
            static = self._quality(Quality(), "reliable", 100, latched=True)
            self._listen(message, "/tf_static", partial(heard.hear_transforms, "/tf_static"), static)
        if settings.clock == "sim":
            self._listen(Clock, "/clock", heard.hear_clock, states)
        for camera, topics in self._bridge.cameras.items():
            hear = partial(heard.hear_camera, camera)
            color = CompressedImage if topics.compressed else Image
            self._listen(color, topics.color, partial(hear, "color"), pictures, raw=True)
            self._listen(Image, topics.depth, partial(hear, "depth"), pictures, raw=True)
            self._listen(CameraInfo, topics.info, partial(hear, "info"), pictures, raw=True)
            if topics.labels and topics.names:
                self._listen(Image, topics.labels, partial(hear, "labels"), pictures, raw=True)
                latched = self._quality(Quality(), "reliable", 1, latched=True)
                self._listen(String, topics.names, partial(_hear_names, hear), latched)
            if topics.request:
                self._requests[camera] = self.node.create_publisher(
                    Header, topics.request, self._quality(Quality(), "reliable")
                )

    def _listen(self, kind: Any, topic: str, take: Callable[[Any], None], quality: Any, raw: bool = False) -> None:
        from rclpy.event_handler import SubscriptionEventCallbacks

        def count(event: Any) -> None:
            self.lost += int(event.total_count_change)

        events = SubscriptionEventCallbacks(message_lost=count)
        self.node.create_subscription(kind, topic, take, quality, raw=raw, event_callbacks=events)


def _hear_names(hear: Callable[[str, Any], None], message: Any) -> None:
    hear("names", message.data)


def command_topics(bridge: Bridge) -> list[str]:
    """The topics that commands go out on."""
    entries = [*bridge.joints, *bridge.grippers.values()]
    return [bridge.settings.base.topic, *(entry.topic for entry in entries if entry.topic)]


class MessageWriter:
    """Publishes commands as a `CommandWriter`."""

    def __init__(self, node: Any, bridge: Bridge, quality: Any) -> None:
        """Make the publishers."""
        from geometry_msgs.msg import Twist, TwistStamped
        from trajectory_msgs.msg import JointTrajectory

        self._base, self._lockstep = bridge.settings.base, bridge.settings.lockstep
        kind = Twist if self._base.type == "Twist" else TwistStamped
        self._drives = node.create_publisher(kind, self._base.topic, quality)
        self._moves: list[tuple[tuple[str, ...], Callable[[Any], None]]] = []
        for entry in (*bridge.joints, *bridge.grippers.values()):
            if entry.action:
                taken = GoalSender(node, entry.action, bridge.file).publish
            else:
                taken = node.create_publisher(JointTrajectory, entry.topic, quality).publish
            self._moves.append((entry.joints or (), taken))

    def drive(self, velocity: Array, stamp_ns: int) -> None:
        """As of `CommandWriter`."""
        self._drives.publish(twist_message(self._base, velocity, stamp_ns))

    def move(self, targets: Mapping[str, float], stamp_ns: int) -> None:
        """As of `CommandWriter`. Controllers of a real robot begin at once, whatever its clock says."""
        for names, publish in self._moves:
            publish(trajectory_message(names, targets, stamp_ns if self._lockstep else 0))
