"""A robot of its own over ROS 2 for tests: it goes where it is told at once, and can be made to misbehave."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robots import robot_named

BRIDGE = """\
clock: CLOCK
joint_states: /joint_states
odometry: { topic: /odom }
cameras:
  head: { color: /head/color, depth: /head/depth, info: /head/info }
base: { topic: /cmd_vel, type: TwistStamped }
joints:
  - { topic: /arm_controller/joint_trajectory }
grippers:
  right: { topic: /gripper_controller/joint_trajectory }
wait_s: 5
watchdog_s: 5
"""
SIDE: Side = "right"
FETCH = robot_named("fetch")


def write_bridge(folder: Path, clock: str = "system", **old_to_new: str) -> str:
    """The bridge file of the robot, with lines in place of others."""
    text = BRIDGE.replace("CLOCK", clock)
    for key, value in old_to_new.items():
        lines = [line for line in text.splitlines() if line.startswith(f"{key}:")]
        text = text.replace(lines[0], value) if lines else text + value + "\n"
    path = folder / "bridge.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


class TestRobot:
    """A fetch that publishes 100 states and 10 pictures a second, in a thread of its own.

    Attributes:
        pose: (3,) of its base.
        drives: Commands of the base: when they came [monotonic], and the velocity.
        moves: Likewise of arm and torso: positions by joint.
        shift_s: Added to all its stamps and to its clock.
        silent: Topics that it does not publish.
        spoil: Called with each JointState before it is published.
        old_s: How much older than now its pictures are.
        size: Height and width of its pictures.
        timeout_s: Its base stands by itself so long after the last command, as that of a real robot should.
        moved: When its base last moved [monotonic].
    """

    __test__ = False

    def __init__(self, clock: str = "system") -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        self.pose = np.zeros(3)
        self.drives: list[tuple[float, tuple[float, float, float]]] = []
        self.moves: list[tuple[float, dict[str, float]]] = []
        self.shift_s, self.old_s, self.size = 0.0, 0.0, (48, 64)
        self.silent: set[str] = set()
        self.spoil: Any = lambda message: None
        self.timeout_s, self.moved = float("inf"), float("-inf")
        self._simulated = clock == "sim"
        self._velocity = np.zeros(3)
        names = [name for name in (*FETCH.torso_joints, *FETCH.arm_joints[SIDE]) if name]
        self.joints = dict.fromkeys((*names, *FETCH.finger_joints[SIDE], "wheel_joint"), 0.0)
        travel = [q for name, q in zip(FETCH.torso_joints, FETCH.travel_torso, strict=True) if name]
        self.joints.update(zip(names, [*travel, *FETCH.travel_arm[SIDE]], strict=True))
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("test_robot", context=self._context)
        self._publishers: dict[str, Any] = {}
        self._make()
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._over = threading.Event()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._spin, self._work)]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> TestRobot:
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._threads[1].join()
        self._executor.shutdown()
        self._threads[0].join(timeout=2)
        self.node.destroy_node()
        self._context.try_shutdown()

    def last_motion(self) -> float:
        """When the base was last told to move [monotonic]; -inf: never."""
        return max((at for at, velocity in self.drives if any(velocity)), default=float("-inf"))

    def comes_to_stand(self) -> bool:
        """Whether the last command that arrives is to stand; on a busy machine it is some time on its way."""
        until = time.monotonic() + 20.0
        while any(self.drives[-1][1]) and time.monotonic() < until:
            time.sleep(0.02)
        return not any(self.drives[-1][1])

    def _make(self) -> None:
        from geometry_msgs.msg import TwistStamped
        from nav_msgs.msg import Odometry
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import CameraInfo, Image, JointState
        from trajectory_msgs.msg import JointTrajectory

        kinds = {"/joint_states": JointState, "/odom": Odometry, "/head/color": Image, "/head/depth": Image}
        kinds |= {"/head/info": CameraInfo} | ({"/clock": Clock} if self._simulated else {})
        self._publishers = {topic: self.node.create_publisher(kind, topic, 10) for topic, kind in kinds.items()}
        self.node.create_subscription(TwistStamped, "/cmd_vel", self._drive, 1000)
        for topic in ("/arm_controller/joint_trajectory", "/gripper_controller/joint_trajectory"):
            self.node.create_subscription(JointTrajectory, topic, self._move, 10)

    def _drive(self, message: Any) -> None:
        twist = message.twist
        self._velocity = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        self.drives.append((time.monotonic(), tuple(map(float, self._velocity))))  # type: ignore[arg-type]

    def _move(self, message: Any) -> None:
        told = dict(zip(message.joint_names, message.points[-1].positions, strict=True))
        self.joints.update(told)
        self.moves.append((time.monotonic(), told))

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _work(self) -> None:
        count = 0
        while not self._over.wait(0.01):
            if self.drives and time.monotonic() - self.drives[-1][0] > self.timeout_s:
                self._velocity = np.zeros(3)
            if self._velocity.any():
                self.moved = time.monotonic()
            c, s = np.cos(self.pose[2]), np.sin(self.pose[2])
            vx, vy, turn = self._velocity
            self.pose = self.pose + np.array([c * vx - s * vy, s * vx + c * vy, turn]) * 0.01
            now = time.time_ns() + int(self.shift_s * 1e9)
            for topic, message in self._messages(now, count % 10 == 0):
                if topic not in self.silent:
                    self._publishers[topic].publish(message)
            count += 1

    def _messages(self, now: int, pictures: bool) -> Any:
        from builtin_interfaces.msg import Time
        from nav_msgs.msg import Odometry
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import CameraInfo, Image, JointState

        stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
        if self._simulated:
            yield "/clock", Clock(clock=stamp)
        state = JointState(name=list(self.joints), position=list(self.joints.values()))
        state.header.stamp = stamp
        self.spoil(state)
        yield "/joint_states", state
        odometry = Odometry()
        odometry.header.stamp = stamp
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        place.x, place.y = float(self.pose[0]), float(self.pose[1])
        turn.z, turn.w = float(np.sin(self.pose[2] / 2)), float(np.cos(self.pose[2] / 2))
        speed = odometry.twist.twist
        speed.linear.x, speed.angular.z = float(self._velocity[0]), float(self._velocity[2])
        yield "/odom", odometry
        if not pictures:
            return
        then = now - int(self.old_s * 1e9)
        stamp = Time(sec=then // 10**9, nanosec=then % 10**9)
        h, w = self.size
        color = Image(height=h, width=w, encoding="rgb8", step=3 * w, data=bytes(3 * h * w))
        depth = Image(height=h, width=w, encoding="16UC1", step=2 * w, data=np.full(h * w, 3000, np.uint16).tobytes())
        info = CameraInfo(height=48, width=64, k=[60.0, 0.0, 31.5, 0.0, 60.0, 23.5, 0.0, 0.0, 1.0])
        for topic, message in (("/head/color", color), ("/head/depth", depth), ("/head/info", info)):
            message.header.stamp = stamp
            yield topic, message
