"""Demonstrations of a robot that is not simulated: quick to record, and every number tells the step it is of."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.ground.paths import find
from mpvi_bt.ground.robot.protocol import Proprioception, Side
from mpvi_bt.runs.recording.demonstration_recorder import DemonstrationRecorder
from tests.layouts import ACTION_SIZE, CAMERAS

SIZES = {"head": (240, 320), "left": (224, 224), "right": (224, 224)}


class Moving:
    """A robot whose every sense and command tells the step it is at."""

    def __init__(self, robot_name: str = "r1") -> None:
        self.robot_name = robot_name
        self.steps = 0
        self.looked: list[str] = []

    @property
    def robot(self) -> Moving:
        return self

    @property
    def action(self) -> np.ndarray:
        return np.arange(ACTION_SIZE) + 100.0 * self.steps

    def proprioception(self) -> Proprioception:
        n = float(self.steps)
        sides: dict[Side, float] = {"left": 1.0, "right": 2.0}
        return Proprioception(
            base_pose=np.array([n, 1, 2]),
            base_velocity=np.array([n, 0, 0]),
            torso=np.full(4, n),
            arm={side: np.full(7, n + k) for side, k in sides.items()},
            arm_velocity={side: np.full(7, n + 10 * k) for side, k in sides.items()},
            gripper_width={side: k / 100 for side, k in sides.items()},
            gripper_command=dict.fromkeys(sides, 1.0),
            robot=self.robot_name,
        )

    def look(self, camera: str) -> SimpleNamespace:
        self.looked.append(camera)
        rgb = np.full((*SIZES[camera], 3), 8 * (self.steps // 3) % 256, np.uint8)
        return SimpleNamespace(rgb=rgb, T_world_camera=np.eye(4))


def recorded(
    folder: Path,
    frames: int,
    q: float = 1.0,
    fps: int = 10,
    cameras: Sequence[str] = CAMERAS,
    robot: str = "r1",
    **about: object,
) -> Path:
    """A demonstration of so many frames, in a folder."""
    tree, world = Tree(load_tree(find("trees", "hello"))), cast("Any", Moving(robot))
    told = {"task": "hello", "instance": 0, "seed": 0, "instruction": "Wave.", "config": {"robot": robot}, **about}
    demonstration = DemonstrationRecorder(folder, told, fps, cameras)
    demonstration.start(tree, world)
    for _ in range((frames - 1) * (30 // fps) + 1):
        demonstration.step(tree, world)
        world.steps += 1
    demonstration.end(Outcome("success"))
    demonstration.conclude(q, q == 1.0)
    return folder


def told(**changes: object) -> Callable[[Path], object]:
    """Write `episode.json` with other entries; None leaves one out."""

    def spoil(folder: Path) -> None:
        file = folder / "episode.json"
        about = {**json.loads(file.read_text()), **changes}
        file.write_text(json.dumps({key: value for key, value in about.items() if value is not None}))

    return spoil


def held(**changes: object) -> Callable[[Path], object]:
    """Write `frames.npz` with other arrays; None leaves one out."""

    def spoil(folder: Path) -> None:
        with np.load(folder / "frames.npz") as file:
            arrays: dict[str, Any] = {**file, **changes}
        np.savez(folder / "frames.npz", **{key: array for key, array in arrays.items() if array is not None})

    return spoil
