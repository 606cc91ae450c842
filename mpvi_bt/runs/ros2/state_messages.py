"""What messages of joint states and odometry say, checked, and the robot's body put together from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mpvi_bt.ground.errors import BadMessage
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge, joint_names

NS = 1_000_000_000


@dataclass(frozen=True)
class FeltJoint:
    """One joint.

    Attributes:
        position, velocity: [m or rad], a second; no velocity: 0.
        stamp_ns: When it was measured, in the robot's time.
    """

    position: float
    velocity: float
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class FeltBase:
    """The base.

    Attributes:
        pose: (3,) x, y [m], yaw [rad] in the fixed frame.
        velocity: (3,) vx, vy [m/s], yaw rate [rad/s] in the frame of the base.
        stamp_ns: When it was measured, in the robot's time.
    """

    pose: Array
    velocity: Array
    stamp_ns: int


def stamp_of(header: Any) -> int:
    """The stamp of a header [ns]; 0: none was written."""
    return int(header.stamp.sec) * NS + int(header.stamp.nanosec)


def read_joints(message: Any, topic: str, now_ns: int) -> dict[str, FeltJoint]:
    """A sensor_msgs/JointState, by name of the joint. Raises BadMessage: it is no such thing.

    Args:
        message: What came.
        topic: Where, for messages.
        now_ns: The stamp of what has none.
    """
    names, positions, velocities = list(message.name), list(message.position), list(message.velocity)
    if len(positions) != len(names) or len(velocities) not in (0, len(names)):
        raise BadMessage(
            f"{topic}: {len(names)} names, {len(positions)} positions and {len(velocities)} velocities do not fit"
        )
    wrong = [name for name, q in zip(names, positions, strict=True) if not np.isfinite(q)]
    wrong += [name for name, v in zip(names, velocities, strict=False) if not np.isfinite(v)]
    if wrong:
        raise BadMessage(f"{topic}: the joint {wrong[0]} is not a finite number")
    stamp = stamp_of(message.header) or now_ns
    speeds = velocities or [0.0] * len(names)
    return {name: FeltJoint(float(q), float(v), stamp) for name, q, v in zip(names, positions, speeds, strict=True)}


def read_odometry(message: Any, topic: str, now_ns: int) -> FeltBase:
    """A nav_msgs/Odometry. Raises BadMessage: it has numbers that are not finite, or no rotation."""
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    speed = message.twist.twist
    pose = np.array([place.x, place.y, yaw_of(turn.x, turn.y, turn.z, turn.w, topic)])
    velocity = np.array([speed.linear.x, speed.linear.y, speed.angular.z])
    if not (np.isfinite(pose).all() and np.isfinite(velocity).all()):
        raise BadMessage(f"{topic}: the base's place or speed is not a finite number")
    return FeltBase(pose, velocity, stamp_of(message.header) or now_ns)


def next_place(before: FeltBase | None, T: Array, stamp_ns: int) -> FeltBase:
    """The base at T_fixed_base (4, 4), with the speed since it was placed before."""
    pose = np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
    if before is None:
        return FeltBase(pose, np.zeros(3), stamp_ns)
    if stamp_ns <= before.stamp_ns:
        return FeltBase(pose, before.velocity, stamp_ns)
    step, seconds = pose - before.pose, (stamp_ns - before.stamp_ns) / NS
    c, s = np.cos(before.pose[2]), np.sin(before.pose[2])
    moved = np.array([c * step[0] + s * step[1], c * step[1] - s * step[0], kin.wrap(step[2])])
    return FeltBase(pose, moved / seconds, stamp_ns)


def yaw_of(x: float, y: float, z: float, w: float, topic: str) -> float:
    """The yaw [rad] of a quaternion. Raises BadMessage: it is not finite, or all 0."""
    length = x * x + y * y + z * z + w * w
    if not 0.5 < length < 2.0:
        raise BadMessage(f"{topic}: the quaternion ({x:g}, {y:g}, {z:g}, {w:g}) is no rotation")
    return float(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))


def needed_joints(robot: RobotDescription, bridge: Bridge) -> tuple[str, ...]:
    """The joints that have to be felt: those of torso, arms and grippers."""
    return (*joint_names(robot), *(name for fingers in bridge.fingers.values() for name in fingers.names))


def body_of(robot: RobotDescription, bridge: Bridge, joints: Mapping[str, FeltJoint], base: FeltBase) -> Proprioception:
    """What the robot feels; every needed joint is there."""

    def at(names: tuple[str | None, ...]) -> Array:
        return np.array([joints[name].position if name else 0.0 for name in names])

    def speed(names: tuple[str | None, ...]) -> Array:
        return np.array([joints[name].velocity if name else 0.0 for name in names])

    return Proprioception(
        base_pose=base.pose,
        base_velocity=base.velocity,
        torso=at(robot.torso_joints),
        arm={side: at(robot.arm_joints[side]) for side in robot.sides},
        arm_velocity={side: speed(robot.arm_joints[side]) for side in robot.sides},
        gripper_width={side: fingers.width(at(fingers.names)) for side, fingers in bridge.fingers.items()},
        gripper_command={},
        torso_velocity=speed(robot.torso_joints),
        gripper_velocity={side: fingers.widening(speed(fingers.names)) for side, fingers in bridge.fingers.items()},
        robot=robot.name,
        open_m=robot.opening_m,
    )
