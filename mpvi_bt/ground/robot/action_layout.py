"""Where the parts of a robot stand in its action: one vector of A numbers a row, A as the robot's file says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side

ActionKind = Literal["absolute", "delta", "velocity"]
KINDS: tuple[ActionKind, ...] = get_args(ActionKind)


@dataclass(frozen=True, eq=False)
class ActionLayout:
    """The layout of an action (A,). Numbers that belong to no part stay 0.

    Attributes:
        names: (A,) of the numbers, in their order, such as "base_vx", "elbow_joint" or "gripper_right".
        base: Where vx, vy [m/s] and yaw rate [rad/s] of the base frame stand; None of a velocity that the base lacks.
        torso: Absolute targets of the joints of torso and head [m or rad].
        arm: Joint targets [rad or m] of each arm.
        gripper: -1 closed ... 1 fully open, of each gripper.
        kind: What joints are in the rows that the robot's own side is sent; in here they are absolute targets.
        rate_hz: How many of these rows a second; it divides 30.
    """

    names: tuple[str, ...]
    base: tuple[int | None, int | None, int | None]
    torso: slice
    arm: Mapping[Side, slice]
    gripper: Mapping[Side, int]
    kind: ActionKind = "absolute"
    rate_hz: float = CONTROL_HZ

    @property
    def size(self) -> int:
        """How many numbers an action has."""
        return len(self.names)

    @property
    def joints(self) -> Array:
        """(J,) indices of all joint targets: torso, then arms."""
        every = np.arange(self.size)
        return np.concatenate([every[self.torso], *(every[arm] for arm in self.arm.values())])

    @property
    def arm_joints(self) -> Array:
        """(J,) indices of the joint targets of all arms."""
        every = np.arange(self.size)
        return np.concatenate([every[:0], *(every[arm] for arm in self.arm.values())])

    def part(self, index: int) -> str:
        """What a number of the action is, for a person, such as "torso joint 2" or "right gripper"."""
        if index in self.base:
            return f"base {('forward', 'sideways', 'turn')[self.base.index(index)]}"
        parts = [("torso", self.torso), *((f"{side} arm", arm) for side, arm in self.arm.items())]
        for name, where in parts:
            numbers = range(self.size)[where]
            if index in numbers:
                return f"{name} joint {numbers.index(index) + 1}"
        return next((f"{side} gripper" for side, at in self.gripper.items() if at == index), self.names[index])

    def velocity(self, action: Array) -> Array:
        """(..., 3) vx, vy [m/s] and yaw rate [rad/s] of actions (..., A); 0 of what the base lacks. A copy."""
        out = np.zeros((*action.shape[:-1], 3))
        for k, i in enumerate(self.base):
            if i is not None:
                out[..., k] = action[..., i]
        return out

    def set_velocity(self, action: Array, velocity: Array | float) -> None:
        """Write vx, vy [m/s] and yaw rate [rad/s], (..., 3) or one number for all, into actions (..., A), in place."""
        told = np.asarray(velocity, float)
        for k, i in enumerate(self.base):
            if i is not None:
                action[..., i] = told[..., k] if told.ndim else told
