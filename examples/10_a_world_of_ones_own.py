"""Have the executive drive a robot of your own: a whole simulator in seventy lines, spoken for over a socket.

The world is a room of 6 x 4 m with a box in it; the robot goes where it is told to, without physics. `mpvi serve mpvi`
looks around, finds the box, builds a map on the way and drives up to it. A driver of a real robot would send the same.
"""

import json
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

import msgpack
import numpy as np
from websockets.sync.client import connect

from mpvi_bt.ground.geometry.kinematics import base
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.robots.r1 import R1  # for where its camera is; a driver of another robot knows that of its own

BOX, ROOM = np.array([[1.8, -1.4, 0.0], [2.2, -1.0, 0.8]]), np.array([[-3.0, -2.0, 0.0], [3.0, 2.0, 2.5]])
K = np.array([[117.0, 0, 80], [0, 117, 60], [0, 0, 1]])
LABELS = {"1": "wall", "2": "box"}


def encoded(value: Any) -> dict[bytes, Any]:
    """An array as openpi packs it."""
    array = np.asarray(value)
    return {b"__ndarray__": True, b"data": array.tobytes(), b"dtype": array.dtype.str, b"shape": array.shape}


def decoded(item: dict[Any, Any]) -> Any:
    """The inverse."""
    return np.frombuffer(item[b"data"], item[b"dtype"]).reshape(item[b"shape"]) if b"__ndarray__" in item else item


def picture(pose: Array, torso: Array) -> dict[str, Any]:
    """What the head sees, ray by ray: how far the box is, or else wall, floor or ceiling."""
    T = base(pose) @ R1.head_camera(torso)
    u, v = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
    rays = np.stack([(u - 80) / K[0, 0], (v - 60) / K[1, 1], np.ones_like(u)], -1) @ T[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (np.sort((side[:, None, None] - T[:3, 3]) / rays, axis=0) for side in (BOX, ROOM))
    enters, leaves = near[0].max(-1), near[1].min(-1)
    hit = (enters > 0) & (enters < leaves)
    depth, labels = np.where(hit, enters, far[1].min(-1)), np.where(hit, 2, 1)
    rgb = np.where(hit[..., None], [200, 60, 40], [180, 180, 180]).astype(np.uint8)
    told = {"rgb": rgb, "depth": depth.astype(np.float32), "labels": labels.astype(np.int32)}
    return {**told, "names": LABELS, "K": K, "T_world_camera": T}


def observation(pose: Array, action: Array, cameras: Iterable[str]) -> dict[str, Any]:
    """What the robot feels and sees, with the targets that it has."""
    arms = {"left": action[7:14], "right": action[15:22]}
    hands = {"left": float(action[14]), "right": float(action[22])}
    body = {
        "base_pose": pose, "base_velocity": action[:3], "torso": action[3:7], "arm": arms, "arm_command": arms,
        "arm_velocity": {side: np.zeros(7) for side in arms}, "gripper_command": hands,
        "gripper_width": {side: 0.05 * (command + 1) for side, command in hands.items()},
    }  # fmt: skip
    images = {camera: picture(pose, action[3:7]) for camera in cameras if camera == "head"}
    return {"proprioception": body, "images": images, "vocabulary": {"box": ["box"], "wall": ["wall"]}}


command = "serve mpvi --protocol openpi --robot r1 --port 0 --json --tree go_to --param place=box"
words = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()", *command.split()]
with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
    assert server.stdout is not None
    with connect(json.loads(server.stdout.readline())["address"], compression=None, max_size=None) as socket:
        print(msgpack.unpackb(socket.recv(), object_hook=decoded))
        answer: dict[str, Any] = {}
        pose, action, steps = np.zeros(3), np.zeros(23), 0
        action[3:7] = R1.travel_torso
        action[7:14], action[15:22] = R1.travel_arm["left"], R1.travel_arm["right"]
        while "ended" not in answer and steps < 3000:
            message = observation(pose, action, answer.get("look", ()))
            socket.send(msgpack.packb(message, default=encoded))
            answer = msgpack.unpackb(socket.recv(), object_hook=decoded)
            if "actions" in answer:  # else a picture is wanted first
                action, steps = answer["actions"][0], steps + 1
                c, s = np.cos(pose[2]), np.sin(pose[2])
                pose = pose + np.array([c * action[0] - s * action[1], s * action[0] + c * action[1], action[2]]) / 30
                pose[2] = np.arctan2(np.sin(pose[2]), np.cos(pose[2]))
    server.terminate()
    server.communicate()
distance = np.linalg.norm(pose[:2] - BOX[:, :2].mean(0))
print(f"{answer['ended']}: {distance:.2f} m from the middle of the box after {steps} steps")
sys.exit(0 if distance < 1.2 else 1)
