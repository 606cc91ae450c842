"""What one observation of a robot elsewhere says, whatever dialect it came in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mpvi_bt.executive.remote.joint_dialects import DIALECTS, joint_dialect
from mpvi_bt.executive.remote.observation import Vocabulary
from mpvi_bt.executive.remote.wire_mapping import MOST_ACTIONS
from mpvi_bt.ground.errors import BadMessage, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription

RESET, CHUNK = "reset", "__action_chunk_size__"  # keys that all dialects have


@dataclass(frozen=True, eq=False)
class Reading:
    """One observation.

    Attributes:
        body: What the robot feels. Where commands are not told, `gripper_command` and `arm_command` are empty.
        images: Pictures by camera.
        placed: Whether the base's pose is told. If not, `body.base_pose` means nothing, and the poses of cameras are
            those in the base frame.
        command: (A,) the targets that the robot has now; None: they are not told.
        task: Number of the task in BEHAVIOR's table; None: it is not told.
        instruction: What is to be done, "" if it is not told.
        vocabulary: What labels of pictures are called; None: it is not told.
        steps: Control steps until the next observation, each of which wants an action.
        skipped: Control steps before this observation that nobody was asked for.
    """

    body: Proprioception
    images: Mapping[str, CameraImage]
    placed: bool = True
    command: Array | None = None
    task: int | None = None
    instruction: str = ""
    vocabulary: Vocabulary | None = None
    steps: int = 1
    skipped: int = 0


class Dialect(Protocol):
    """What names, units and orders an evaluator, or a robot's driver, has for all this."""

    @property
    def name(self) -> str:
        """As `--protocol` has it."""
        ...

    def read(self, message: Mapping[str, Any], robot: RobotDescription) -> Reading:
        """Read an observation. Raises BadMessage: the mistake, its place, and a correct form."""
        ...

    def answer(
        self, actions: Array, asked: Mapping[str, Any], robot: RobotDescription, before: Array
    ) -> dict[str, Any]:
        """The answer (K, A) to an observation; only its number of wanted actions has to be valid.

        `before`: (A,) the command in force until then.
        """
        ...


def chunk_of(message: Mapping[str, Any]) -> int:
    """How many actions an observation wants. Raises BadMessage."""
    given = message.get(CHUNK, 1)
    try:
        count = int(np.asarray(given).reshape(()))
    except (TypeError, ValueError, OverflowError):
        count = 0
    if not 1 <= count <= MOST_ACTIONS:
        raise BadMessage(f"{CHUNK}: {shown(given)} is given, 1 to {MOST_ACTIONS} is wanted")
    return count


def spoken(message: Mapping[str, Any]) -> str:
    """The dialect that an observation seems to be of; "" if it is of none."""
    if "proprioception" in message:
        return "openpi"
    for key, value in message.items():
        if isinstance(key, str) and key.endswith("::proprio") and isinstance(value, np.ndarray):
            size = value.shape[-1:]
            return next((name for name in DIALECTS if size == (joint_dialect(name).state_size,)), "")
    return ""
