"""What is between the fingers in a wrist camera's picture: pixels of one thing, whatever it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.ground.geometry.kinematics import inverse
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import CameraImage, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription


@dataclass(frozen=True)
class FingerSpace:
    """What counts as between the fingers, and as one thing with that. Our choice."""

    reach_m: float = 0.03  # half height and half depth of the space between the fingertips [m]
    seen_px: int = 15  # fewer pixels there are nothing
    far_m: float = 0.35  # of a thing that is held, what is within so much of the fingertips [m]
    step: tuple[float, float] = (0.04, 0.04)  # neighbors whose depth differs by more are two things [m, and part of it]


SPACE = FingerSpace()


def hand_points(image: CameraImage, robot: RobotDescription) -> tuple[Array, float]:
    """(H, W, 3) pixels of a wrist camera's picture in the hand's frame [m], and how far the tcp is along its z [m]."""
    T_hand_camera, tcp_m = _seen_from_hand(robot, image.camera)
    to_hand = matmul(T_hand_camera, inverse(image.T_world_camera))
    return matmul(image.points_world(), to_hand[:3, :3].T) + to_hand[:3, 3], tcp_m


def between_fingers(image: CameraImage, own: NDArray[np.bool_], robot: RobotDescription) -> NDArray[np.bool_]:
    """(H, W) the pixels of what is between the fingertips: those there, and what they join without a step of depth.

    Args:
        image: A wrist camera's.
        own: (H, W) the robot's own pixels.
        robot: Whose camera took it.

    Returns:
        None of the pixels where hardly anything is there.
    """
    points, tcp_m = hand_points(image, robot)
    free = (image.depth > 0) & ~own & (norm(points - (0.0, 0.0, tcp_m), axis=-1) < SPACE.far_m)
    low, high = np.abs(points - (0.0, 0.0, tcp_m - 0.01)), robot.opening_m / 2
    there = free & (low[..., 0] < SPACE.reach_m) & (low[..., 1] < high) & (low[..., 2] < SPACE.reach_m)
    parts, _ = ndimage.label(free & ~_steps(image.depth))
    count = np.bincount(parts[there], minlength=2)
    count[0] = 0
    return parts == count.argmax() if count.max() >= SPACE.seen_px else np.zeros_like(free)


def _steps(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) pixels right behind a nearer neighbor's edge."""
    behind = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        d = np.moveaxis(depth, axis, 0)
        step = np.diff(d, axis=0)
        least = SPACE.step[0] + SPACE.step[1] * np.minimum(d[1:], d[:-1])
        out = np.moveaxis(behind, axis, 0)
        out[1:] |= step > least
        out[:-1] |= -step > least
    return behind


def _seen_from_hand(robot: RobotDescription, camera: str) -> tuple[Array, float]:
    """T_hand_camera (4, 4) of a wrist's camera, and how far the tcp is along z of that frame [m]."""
    if isinstance(robot, RobotModel):
        return robot.hand_to_camera, robot.tcp_m
    side: Side = "left" if camera == "left" else "right"
    joints = robot.travel_torso, robot.travel_arm[side]
    return matmul(inverse(robot.tcp(*joints, side)), robot.wrist_camera(*joints, side)), 0.0
