"""What our house's robot feels and sees, as messages of ROS 2."""

from __future__ import annotations

import math

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, JointState

from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.recording import ros_values

ODOM = "odom"


def joint_state(model: RobotDescription, felt: Proprioception, stamp: Time) -> JointState:
    """Every joint of torso, arms and fingers by its name [m, rad, m/s, rad/s]."""
    told = ros_values.joint_states(0.0, model, felt)
    message = JointState(name=told["name"], position=told["position"], velocity=told["velocity"])
    message.header.stamp = stamp
    return message


def odometry(felt: Proprioception, stamp: Time) -> Odometry:
    """The base's true pose in the world, and its velocity in its own frame."""
    x, y, yaw = (float(value) for value in felt.base_pose)
    message = Odometry()
    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, ODOM, ros_values.BASE
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
    told = ros_values.camera_info(0.0, picture)
    message = CameraInfo(**{key: told[key] for key in ("height", "width", "distortion_model", "d", "k", "r", "p")})
    message.header.stamp, message.header.frame_id = stamp, ros_values.optical_frame(picture.camera)
    return message


def _image(picture: CameraImage, pixels: NDArray[np.generic], encoding: str, stamp: Time) -> Image:
    height, width = pixels.shape[:2]
    message = Image(height=height, width=width, encoding=encoding, step=pixels.nbytes // height)
    message.header.stamp, message.header.frame_id = stamp, ros_values.optical_frame(picture.camera)
    message.data = np.ascontiguousarray(pixels).tobytes()
    return message
