"""What a row of a dataset holds: keys, numbers and their types."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.action_rows import of_kind
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.robot.trunk import LiftTrunk
from mpvi_bt.runs.datasets.demonstrations import CODEC, Demonstrated

_ARM = [f"arm_{joint}" for joint in range(1, 8)]
_POSTURE = ("lift", "waist_yaw", "waist_pitch", "head_tilt")
_GRID = 1e-4  # of targets before they become changes [rad or m]; our choice
Feature = dict[str, Any]


class Content(Protocol):
    """Keys and numbers of rows.

    Attributes:
        robot_type: What datasets call the robot.
        channels: What the third axis of a picture is called.
        time: Type of a row's time [s].
    """

    robot_type: str
    channels: str
    time: Literal["float32", "float64"]

    def picture(self, camera: str) -> str:
        """Key of a camera's pictures."""
        ...

    def vectors(self) -> dict[str, Feature]:
        """What numbers a row has."""
        ...

    def check(self, episode: Demonstrated) -> None:
        """Raise UserError if the episode cannot be told so."""
        ...

    def columns(self, episode: Demonstrated) -> dict[str, NDArray[Any]]:
        """The numbers of all its rows."""
        ...


class OwnContent:
    """Our own: state and action in one order, in m, rad and s (docs/demonstrations.md).

    Args:
        robot: The name of the robot.
        actions: What joints in actions are; `features.action.info.joints` says it of others than absolute ones.
    """

    channels: str = "channels"
    time: Literal["float32", "float64"] = "float32"

    def __init__(self, robot: str, actions: ActionKind = "absolute") -> None:
        self.robot_type, model = robot, robot_named(robot)
        self._actions, self._layout = actions, model.layout
        motors = list(model.layout.names)
        if isinstance(model, RobotModel):
            torso = _POSTURE if isinstance(model.trunk, LiftTrunk) else model.torso_joints
            base, hand = ("base_vx", "base_vy", "base_yaw_rate"), (*_ARM, "gripper")
            motors = [*base, *map(str, torso), *(f"{side}_{name}" for side in SIDES for name in hand)]
        self._from = {
            "observation.state": ("state", motors),
            "observation.base_pose": ("base_pose", ["x", "y", "yaw"]),
            "action": ("action", motors),
        }

    def picture(self, camera: str) -> str:
        """As LeRobot's own datasets have it."""
        return f"observation.images.{camera}"

    def vectors(self) -> dict[str, Feature]:
        """Each with what its numbers are called."""
        told = {key: vector(len(names), {"motors": names}) for key, (_, names) in self._from.items()}
        if self._actions != "absolute":
            told["action"]["info"] = {"joints": self._actions}
        return told

    def check(self, episode: Demonstrated) -> None:
        """Anything recorded can be told so."""

    def columns(self, episode: Demonstrated) -> dict[str, NDArray[Any]]:
        """As they were recorded, but for another kind of actions: the first one begins where the robot is."""
        told = {key: episode.frames[name] for key, (name, _) in self._from.items()}
        if self._actions != "absolute":
            targets, begin = (_on_grid(told[key]) for key in ("action", "observation.state"))
            told["action"] = of_kind(targets, self._actions, episode.about.fps, begin[0], self._layout)
        return {key: rows.astype(np.float32) for key, rows in told.items()}


def _on_grid(rows: NDArray[Any]) -> Array:
    """Rounded, so that joints at rest do not move by a millionth: a trainer scales all by how far they go."""
    return np.round(rows.astype(float) / _GRID) * _GRID


def features(
    content: Content, cameras: Mapping[str, Sequence[int]], fps: int, counters: Sequence[str], empty: Sequence[str] = ()
) -> dict[str, Any]:
    """What a frame has, as `info.json` tells it.

    Args:
        content: What rows hold.
        cameras: Height and width [px] of each camera's pictures.
        fps: Frames a second.
        counters: Keys of whole numbers.
        empty: Keys of columns that hold nothing.
    """
    videos = {
        content.picture(camera): {
            "dtype": "video",
            "shape": [height, width, 3],
            "names": ["height", "width", content.channels],
            "info": {
                "video.height": height,
                "video.width": width,
                "video.codec": CODEC,
                "video.pix_fmt": "yuv420p",
                "video.is_depth_map": False,
                "video.fps": fps,
                "video.channels": 3,
                "has_audio": False,
            },
        }
        for camera, (height, width) in cameras.items()
    }
    time = {"timestamp": {"dtype": content.time, "shape": [1], "names": None}}
    whole = {key: {"dtype": "int64", "shape": [1], "names": None} for key in counters}
    nothing = {key: {"dtype": "float32", "shape": [None], "names": None} for key in empty}
    return {**content.vectors(), **videos, **time, **whole, **nothing}


def vector(size: int, names: Any) -> Feature:
    """So many numbers, which may have names."""
    return {"dtype": "float32", "shape": [size], "names": names}
