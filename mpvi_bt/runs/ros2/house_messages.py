"""What our house's robot feels and sees, as messages of ROS 2."""

from __future__ import annotations

import math

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, JointState

from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception
from mpvi_bt.runs.recording.ros_values import BASE, intrinsics, optical_frame

ODOM = "odom"


def time_message(ns: int) -> Time:
    """A time given in nanoseconds."""
    return Time(sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000)


def joint_state(model: RobotModel, felt: Proprioception, stamp: Time) -> JointState:
    """Every joint of torso, arms and fingers by its name [m, rad, m/s, rad/s]; fingers share the opening evenly."""
    rows = [(n, q, v) for n, q, v in zip(model.torso_joints, felt.torso, felt.torso_velocity, strict=True) if n]
    for side in model.sides:
        rows += zip(model.arm_joints[side], felt.arm[side], felt.arm_velocity[side], strict=True)
        fingers = model.finger_joints[side]
        q, v = felt.gripper_width[side] / len(fingers), felt.gripper_velocity[side] / len(fingers)
        rows += [(name, q, v) for name in fingers]
    message = JointState()
    message.header.stamp = stamp
    message.name = [name for name, _, _ in rows]
    message.position = [float(q) for _, q, _ in rows]
    message.velocity = [float(v) for _, _, v in rows]
    return message


def odometry(felt: Proprioception, stamp: Time) -> Odometry:
    """The base's true pose in the world, and its velocity in its own frame."""
    x, y, yaw = (float(value) for value in felt.base_pose)
    message = Odometry()
    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, ODOM, BASE
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    twist.linear.x, twist.linear.y, twist.angular.z = (float(value) for value in felt.base_velocity)
    return message


def color_image(picture: CameraImage, stamp: Time) -> Image:
    """Its colors."""
    return _image(picture, picture.rgb, "rgb8", stamp)


def depth_image(picture: CameraImage, stamp: Time) -> Image:
    """Its depth [m] along the optical axis, 0 = nothing seen."""
    return _image(picture, picture.depth.astype(np.float32), "32FC1", stamp)


def label_image(picture: CameraImage, stamp: Time) -> Image:
    """The label of what each pixel shows."""
    assert picture.labels is not None
    return _image(picture, picture.labels.astype(np.int32), "32SC1", stamp)


def camera_info(picture: CameraImage, stamp: Time) -> CameraInfo:
    """Its intrinsics; there is no distortion."""
    height, width = picture.depth.shape
    message = CameraInfo(height=height, width=width, distortion_model="plumb_bob", d=[0.0] * 5)
    message.header.stamp, message.header.frame_id = stamp, optical_frame(picture.camera)
    K = intrinsics(picture)
    message.k = K.ravel().tolist()
    message.r = np.eye(3).ravel().tolist()
    message.p = np.column_stack([K, np.zeros(3)]).ravel().tolist()
    return message


def _image(picture: CameraImage, pixels: NDArray[np.generic], encoding: str, stamp: Time) -> Image:
    height, width = pixels.shape[:2]
    message = Image(height=height, width=width, encoding=encoding, step=pixels.nbytes // height)
    message.header.stamp, message.header.frame_id = stamp, optical_frame(picture.camera)
    message.data = np.ascontiguousarray(pixels).tobytes()
    return message
