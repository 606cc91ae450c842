"""Have the executive drive a robot of your own in a world of your own: eighty lines of it, spoken for over a socket.

The world is a room of 6 x 4 m with a box in it, without physics; the robot is described by `four_joints/robot.yaml`.
`mpvi serve mpvi` looks around, finds the box, builds a map on the way and drives up to it; the policy in
`four_joints/box_parts.py` picks it up. A driver of a real robot would send the same.
"""

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import connect

from mpvi_bt.executive.remote.codec import pack, unpack  # openpi has the same
from mpvi_bt.ground.geometry.kinematics import base
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.limits import travel_action
from mpvi_bt.ground.robot.robots import robot_named

HOME = Path(__file__).parent / "four_joints"
ROBOT = robot_named(str(HOME / "robot.yaml"))
LAYOUT, CAMERA = ROBOT.layout, ROBOT.cameras["head"]
ARM, GRIPPER = LAYOUT.arm["right"], LAYOUT.gripper["right"]
SIZE, ROOM = np.array([0.08, 0.08, 0.4]), np.array([[-3.0, -2.0, 0.0], [3.0, 2.0, 2.5]])
LABELS = {"1": "wall", "2": "box"}


class World:
    """The robot goes where it is told to; what it closes its gripper on comes along."""

    def __init__(self) -> None:
        self.pose, self.box, self.action = np.zeros(3), np.array([2.0, -1.2, 0.2]), travel_action(ROBOT)
        self.width, self.held = ROBOT.opening_m, False

    def step(self, action: Array) -> None:
        """Move for a step of 1/30 s."""
        vx, _, turn = LAYOUT.velocity(action) / 30
        self.pose = self.pose + [vx * np.cos(self.pose[2]), vx * np.sin(self.pose[2]), turn]
        before, self.action = self.hand(), action
        self.width = float(np.clip((action[GRIPPER] + 1) / 2 * ROBOT.opening_m, self.width - 0.01, self.width + 0.01))
        self.held = self.width < 0.09 and (self.held or bool((np.abs(self.hand() - self.box) < SIZE).all()))
        self.width = max(self.width, 0.08 * self.held)
        self.box = self.box + (self.hand() - before) * self.held

    def hand(self) -> Array:
        """(3,) where the point between the fingers is."""
        return (base(self.pose) @ ROBOT.tcp(np.zeros(0), self.action[ARM], "right"))[:3, 3]

    def picture(self) -> dict[str, Any]:
        """What the head sees, ray by ray: how far the box is, or else wall, floor or ceiling."""
        T = base(self.pose) @ ROBOT.head_camera(np.zeros(0))
        u, v = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
        rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(CAMERA.K).T @ T[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = (np.array([self.box - SIZE / 2, self.box + SIZE / 2]), ROOM)
            near, far = (np.sort((side[:, None, None] - T[:3, 3]) / rays, axis=0) for side in sides)
        enters, leaves = near[0].max(-1), near[1].min(-1)
        hit = (enters > 0) & (enters < leaves)
        depth, labels = np.where(hit, enters, far[1].min(-1)), np.where(hit, 2, 1)
        rgb = np.where(hit[..., None], [200, 60, 40], [180, 180, 180]).astype(np.uint8)
        told = {"rgb": rgb, "depth": depth.astype(np.float32), "labels": labels.astype(np.int32)}
        return {**told, "names": LABELS, "K": CAMERA.K, "T_world_camera": T}

    def observation(self, cameras: Iterable[str]) -> dict[str, Any]:
        """What the robot feels and sees, with the targets that it has."""
        arm = {"right": self.action[ARM]}
        body = {
            "base_pose": self.pose, "base_velocity": LAYOUT.velocity(self.action), "torso": np.zeros(0), "arm": arm,
            "arm_command": arm, "arm_velocity": {"right": np.zeros(3)}, "gripper_width": {"right": self.width},
            "gripper_command": {"right": float(self.action[GRIPPER])},
        }  # fmt: skip
        images = {"head": self.picture()} if "head" in cameras else {}
        return {"proprioception": body, "images": images, "vocabulary": {"box": ["box"], "wall": ["wall"]}}


parts = "--policy box_parts:Pick --checker box_parts:Lifted"
command = f"serve mpvi --protocol openpi --robot {HOME}/robot.yaml --tree {HOME}/tree.yaml --port 0 --json {parts}"
start = f"import sys; sys.path.append({str(HOME)!r}); from mpvi_bt.apps.cli import main; main()"
words = [sys.executable, "-c", start, *command.split()]
with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
    assert server.stdout is not None
    with connect(json.loads(server.stdout.readline())["address"], compression=None, max_size=None) as socket:
        print(unpack(bytes(socket.recv(decode=False))))
        answer: dict[str, Any] = {}
        world, steps = World(), 0
        while "ended" not in answer and steps < 6000:
            socket.send(pack(world.observation(answer.get("look", ()))))
            answer = unpack(bytes(socket.recv(decode=False)))
            if "actions" in answer:  # else a picture is wanted first
                world.step(answer["actions"][0])
                steps += 1
    server.terminate()
    server.communicate()
print(f"{answer['ended']}: the box is {world.box[2] - SIZE[2] / 2:.2f} m above the floor after {steps} steps")
sys.exit(0 if world.held and world.box[2] > 0.4 else 1)
