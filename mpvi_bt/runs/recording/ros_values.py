"""Values of ROS 2's messages, as dictionaries: of robots, pictures, maps and transforms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.rotations import quaternion
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.finger_joints import fingers_of
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.recording.search_view import Mask

MAP, BASE = "map", "base_link"  # frames (REP 105); localization is assumed, so none drifts between them
_NO_COVARIANCE = [0.0] * 36
_JPEG = 80  # quality of color pictures

Value = dict[str, Any]


def optical_frame(camera: str) -> str:
    """The frame of a camera: x right, y down, z forward (REP 103)."""
    return f"{camera}_camera_optical_frame"


def intrinsics(image: CameraImage) -> Array:
    """(3, 3) [px], as ROS has them: the middle of the first pixel is at 0, by ours at 0.5."""
    K = image.K.copy()
    K[:2, 2] -= 0.5
    return K


def nanoseconds(time_s: float) -> int:
    """Whole nanoseconds of a time."""
    return round(time_s * 1e9)


def stamp(time_s: float) -> Value:
    """`builtin_interfaces/Time`."""
    sec, nanosec = divmod(nanoseconds(time_s), 10**9)
    return {"sec": sec, "nanosec": nanosec}


def header(time_s: float, frame: str = "") -> Value:
    """`std_msgs/Header`."""
    return {"stamp": stamp(time_s), "frame_id": frame}


def _vector(xyz: Array) -> Value:
    return dict(zip("xyz", map(float, xyz), strict=True))


def _rotation(R: Array) -> Value:
    return dict(zip("xyzw", map(float, quaternion(R)), strict=True))


def _pose(T: Array) -> Value:
    return {"position": _vector(T[:3, 3]), "orientation": _rotation(T[:3, :3])}


def twist(velocity: Array) -> Value:
    """`geometry_msgs/Twist` of vx, vy [m/s] and yaw rate [rad/s], (3,)."""
    vx, vy, turn = map(float, velocity)
    return {"linear": {"x": vx, "y": vy, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": turn}}


def transform(time_s: float, parent: str, child: str, T: Array) -> Value:
    """`geometry_msgs/TransformStamped` of T_parent_child (4, 4)."""
    moved = {"translation": _vector(T[:3, 3]), "rotation": _rotation(T[:3, :3])}
    return {"header": header(time_s, parent), "child_frame_id": child, "transform": moved}


def odometry(time_s: float, felt: Proprioception) -> Value:
    """`nav_msgs/Odometry`: the base in the world, and its velocity in its own frame."""
    return {
        "header": header(time_s, MAP),
        "child_frame_id": BASE,
        "pose": {"pose": _pose(kin.base(felt.base_pose)), "covariance": _NO_COVARIANCE},
        "twist": {"twist": twist(felt.base_velocity), "covariance": _NO_COVARIANCE},
    }


def _joints(robot: RobotDescription, torso: Array, arm: Mapping[Side, Array], fingers: Mapping[Side, Array]) -> Value:
    """Name to value: of torso, arms and fingers."""
    values = {name: float(value) for name, value in zip(robot.torso_joints, torso, strict=True) if name is not None}
    for side in robot.sides:
        if side in arm:
            values |= zip(robot.arm_joints[side], map(float, arm[side]), strict=True)
        if side in fingers:
            values |= zip(robot.finger_joints[side], map(float, fingers[side]), strict=True)
    return values


def joint_states(time_s: float, robot: RobotDescription, felt: Proprioception) -> Value:
    """`sensor_msgs/JointState` of what is felt [m or rad, m/s or rad/s]."""
    apart = {side: fingers_of(robot, side).positions(width) for side, width in felt.gripper_width.items()}
    positions = _joints(robot, felt.torso, felt.arm, apart)
    opening = {side: fingers_of(robot, side).rates * speed for side, speed in felt.gripper_velocity.items()}
    velocities = _joints(robot, felt.torso_velocity, felt.arm_velocity, opening)
    told = [velocities.get(name, 0.0) for name in positions]
    return {"header": header(time_s), "name": list(positions), "position": list(positions.values()), "velocity": told}


def joint_commands(time_s: float, robot: RobotDescription, felt: Proprioception, action: Array) -> Value:
    """`sensor_msgs/JointState` of the targets in an action (A,) [m or rad]."""
    layout = robot.layout
    arm = {side: action[joints] for side, joints in layout.arm.items()}
    told = {side: (float(action[i]) + 1) / 2 * felt.open_m for side, i in layout.gripper.items()}
    apart = {side: fingers_of(robot, side).positions(width) for side, width in told.items()}
    targets = _joints(robot, action[layout.torso], arm, apart)
    return {"header": header(time_s), "name": list(targets), "position": list(targets.values())}


def color_picture(time_s: float, image: CameraImage) -> Value:
    """`sensor_msgs/CompressedImage`, as JPEG."""
    import cv2

    bgr = np.ascontiguousarray(image.rgb[..., ::-1])
    ok, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG])
    assert ok
    return {"header": header(time_s, optical_frame(image.camera)), "format": "jpeg", "data": data.tobytes()}


def depth_picture(time_s: float, image: CameraImage) -> Value:
    """`sensor_msgs/Image` of whole millimeters (REP 118), 0 where nothing is seen."""
    height, width = image.depth.shape
    millimeters = np.clip(np.round(image.depth * 1000), 0, 65535).astype("<u2")
    return {
        "header": header(time_s, optical_frame(image.camera)),
        "height": height,
        "width": width,
        "encoding": "16UC1",
        "is_bigendian": 0,
        "step": 2 * width,
        "data": millimeters.tobytes(),
    }


def camera_info(time_s: float, image: CameraImage) -> Value:
    """`sensor_msgs/CameraInfo` of pictures without distortion."""
    height, width = image.rgb.shape[:2]
    K = intrinsics(image)
    return {
        "header": header(time_s, optical_frame(image.camera)),
        "height": height,
        "width": width,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": K.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": np.column_stack([K, np.zeros(3)]).ravel().tolist(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0) | {"do_rectify": False},
    }


def occupancy_grid(time_s: float, grid_map: OccupancyMap, known: Mask) -> Value:
    """`nav_msgs/OccupancyGrid`: 100 occupied, 0 free, -1 not known; (H, W) `known` has the map's cells."""
    height, width = grid_map.occupied.shape
    origin = pose((float(grid_map.origin_m[0]), float(grid_map.origin_m[1]), 0.0), 0.0)
    info = {
        "map_load_time": stamp(time_s),
        "resolution": float(grid_map.resolution_m),
        "width": width,
        "height": height,
        "origin": _pose(origin),
    }
    cells = np.where(known, np.where(grid_map.occupied, 100, 0), -1)
    return {"header": header(time_s, MAP), "info": info, "data": cells.ravel().tolist()}
