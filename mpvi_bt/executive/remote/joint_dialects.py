"""Dialects that are the numbers of one known robot: each is loaded from its home when it is first asked for."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Literal, Protocol, get_args

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Proprioception

Dialect = Literal["behavior-2025", "behavior-2026"]
DIALECTS: tuple[Dialect, ...] = get_args(Dialect)
BaseVelocity = Literal["world", "robot", "zero"]
_HOME = "mpvi_bt.hands.behavior_robot"


class JointDialect(Protocol):
    """What a state and an action are in the numbers of the robot that a dialect is about."""

    @property
    def robot(self) -> str:
        """Name of that robot."""
        ...

    @property
    def title(self) -> str:
        """What people call it."""
        ...

    @property
    def state_size(self) -> int:
        """How many numbers its proprioception has."""
        ...

    @property
    def action_size(self) -> int:
        """How many numbers its action has."""
        ...

    def encoded(self, body: Proprioception, base_velocity: BaseVelocity | None) -> Array:
        """(state_size,) what a robot feels, as that one would. Raises UserError if the robot is too unlike it."""
        ...

    def actions(self, theirs: Array, body: Proprioception) -> Array:
        """(H, A) actions of the robot that feels `body`, of that one's (H, action_size). Raises UserError likewise."""
        ...


def joint_dialect(name: Dialect) -> JointDialect:
    """The dialect of that name."""
    known: Mapping[Dialect, JointDialect] = importlib.import_module(f"{_HOME}.joint_numbers").JOINT_DIALECTS
    return known[name]


def camera_numbers(T_base_camera: Mapping[str, Array]) -> Array:
    """BEHAVIOR's `cam_rel_poses`, of T_base_camera (4, 4), optical frames."""
    numbers: Array = importlib.import_module(f"{_HOME}.behavior_layout").camera_poses(T_base_camera)
    return numbers
