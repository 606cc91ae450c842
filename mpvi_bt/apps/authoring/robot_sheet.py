"""A robot's data sheet, as `mpvi show ROBOT` prints it: what its file and its URDF tell together."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import load_marked
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.outermost import joint_places, reach, tcp_heights
from mpvi_bt.ground.robot.protocol import Side

_DOES = ("lifts", "turns", "bends", "tilts the head")  # parts of a posture


def robot_sheet(robot: DescribedRobot, file: Path) -> dict[str, Any]:
    """What there is to say of the robot of a file, as data for JSON."""
    layout = robot.layout
    return {
        "robot": robot.name,
        "about": str(load_marked(file)[0].get("about", "")),
        "file": str(file),
        "urdf": os.path.normpath(robot.tree.file),
        "base": _base(robot),
        "torso": _torso(robot),
        "arms": {side: _arm(robot, side) for side in robot.sides},
        "grippers": {side: _gripper(robot, side) for side in robot.sides},
        "cameras": _cameras(robot),
        "actions": {"kind": layout.kind, "rate_hz": layout.rate_hz, "numbers": list(_numbers(robot))},
    }


def _base(robot: DescribedRobot) -> dict[str, Any]:
    ahead, sideways, turn = _plain(robot.base_speed)
    straight, turning = _plain(robot.drive_acceleration)
    corners = robot.base.corners
    return {
        "kind": "holonomic" if robot.sideways else "differential",
        "link": robot.link,
        "above_floor_m": robot.above_floor_m,
        "footprint_m": _plain(corners) if len(corners) else robot.base.radius_m,
        "kept_clear_m": robot.base.folded_m,
        "speed": {"ahead": ahead, **({"sideways": sideways} if robot.sideways else {}), "turn": turn},
        "acceleration": {"ahead": straight, "turn": turning},
    }


def _joints(robot: DescribedRobot, names: Sequence[str], limits: Array, speed: Array, travel: Array) -> list[Any]:
    told = zip(names, _plain(limits), _plain(speed), _plain(travel), strict=True)
    return [
        {"name": name, "unit": _unit(robot, name), "limits": ends, "top_speed": top, "travel": rest}
        for name, ends, top, rest in told
    ]


def _torso(robot: DescribedRobot) -> list[Any]:
    real = [i for i, name in enumerate(robot.torso_joints) if name is not None]
    names = [str(robot.torso_joints[i]) for i in real]
    joints = _joints(robot, names, robot.torso_limits[real], robot.torso_top_speed[real], robot.travel_torso[real])
    does = {i: word for i, word in zip(robot.trunk.parts, _DOES, strict=True) if i is not None}
    return [{**joint, **({"does": does[i]} if i in does else {})} for i, joint in zip(real, joints, strict=True)]


def _arm(robot: DescribedRobot, side: Side) -> dict[str, Any]:
    names, limits = robot.arm_joints[side], robot.arm_limits[side]
    places = joint_places(robot, side)
    return {
        "joints": _joints(robot, names, limits, robot.arm_top_speed[side], robot.travel_arm[side]),
        "shoulder_m": _plain(places[0]),
        "reach_m": round(reach(robot, side), 3),
        "tcp_heights_m": [round(z, 3) for z in tcp_heights(robot, side)],
    }


def _gripper(robot: DescribedRobot, side: Side) -> dict[str, Any]:
    ends = zip(robot.finger_joints[side], _plain(robot.finger_range[side]), strict=True)
    return {
        "joints": [{"name": name, "unit": _unit(robot, name), "closed": a, "open": b} for name, (a, b) in ends],
        "opening_m": robot.opening_m,
        "grasp_m": robot.grasp_m,
    }


def _cameras(robot: DescribedRobot) -> dict[str, Any]:
    found = {}
    for name, T in robot.camera_poses(robot.travel_torso, robot.travel_arm).items():
        camera = robot.cameras[name]
        found[name] = {
            "link": camera.link,
            "on": robot.carried[name],
            "size": [camera.width, camera.height],
            "fov_rad": list(camera.angles_rad),
            "depth_m": [camera.near_m, camera.far_m] if camera.depth else None,
            "height_m": float(T[2, 3]),
            "down_rad": float(-np.arcsin(np.clip(T[2, 2], -1, 1))),
        }
    return found


def _numbers(robot: DescribedRobot) -> Iterator[dict[str, Any]]:
    """The numbers of an action, in order."""
    layout = robot.layout
    grippers = set(layout.gripper.values())
    for i, name in enumerate(layout.names):
        unit = ""
        if i in layout.base:
            unit = ("m/s", "m/s", "rad/s")[layout.base.index(i)]
        elif i in grippers:
            unit = "-1 closed, 1 open"
        elif i in layout.joints and name in robot.tree.joints:
            unit = _unit(robot, name)
        yield {"name": name, "unit": unit}


def _unit(robot: DescribedRobot, joint: str) -> str:
    return "m" if robot.tree.joints[joint].kind == "prismatic" else "rad"


def _plain(numbers: Array) -> Any:
    return np.round(numbers, 6).tolist()
