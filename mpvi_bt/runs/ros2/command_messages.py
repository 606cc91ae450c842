"""Commands as messages: the base's velocity, and trajectories of one point for joints and grippers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import BaseCommands, Bridge
from mpvi_bt.runs.ros2.state_messages import NS

PERIOD_NS = round(NS / CONTROL_HZ)


def time_message(nanoseconds: int) -> Any:
    """A builtin_interfaces/Time."""
    from builtin_interfaces.msg import Time

    return Time(sec=nanoseconds // NS, nanosec=nanoseconds % NS)


def twist_message(base: BaseCommands, velocity: Array, stamp_ns: int) -> Any:
    """The velocity (3,) as the message that the base takes."""
    from geometry_msgs.msg import Twist, TwistStamped

    twist = Twist()
    twist.linear.x, twist.linear.y, twist.angular.z = (float(v) for v in velocity)
    if base.type == "Twist":
        return twist
    message = TwistStamped(twist=twist)
    message.header.stamp, message.header.frame_id = time_message(stamp_ns), base.frame
    return message


def trajectory_message(names: Sequence[str], targets: Mapping[str, float], stamp_ns: int) -> Any:
    """A trajectory_msgs/JointTrajectory that is at its targets after one control period; stamp 0: from now on."""
    from builtin_interfaces.msg import Duration
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    point = JointTrajectoryPoint(positions=[float(targets[name]) for name in names])
    point.time_from_start = Duration(sec=0, nanosec=PERIOD_NS)
    message = JointTrajectory(joint_names=list(names), points=[point])
    message.header.stamp = time_message(stamp_ns)
    return message


def targets_of(robot: RobotDescription, bridge: Bridge, action: Array) -> dict[str, float]:
    """Positions by joint that an action (A,) asks for, those of the grippers' joints too."""
    layout = robot.layout
    told = dict(zip(robot.torso_joints, action[layout.torso], strict=True))
    for side in robot.sides:
        told.update(zip(robot.arm_joints[side], action[layout.arm[side]], strict=True))
        fingers, share = bridge.fingers[side], (float(action[layout.gripper[side]]) + 1) / 2
        told.update(zip(fingers.names, fingers.positions(share * fingers.opening_m), strict=True))
    return {name: float(value) for name, value in told.items() if name is not None}
