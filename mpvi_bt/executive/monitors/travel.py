"""How far the robot's parts have moved, and how long all stood still, by proprioception or by commands."""

from __future__ import annotations

import math

import numpy as np

from mpvi_bt.executive.monitors.handoff import STILL_S
from mpvi_bt.executive.monitors.signals import SignalParameters
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception, Side


class Travel:
    """Ways of base, torso and arms since the handoff, in constant memory.

    A part has moved once it is farther from where it last was than noise takes it: by `SignalParameters`.

    Attributes:
        base_m, base_rad, torso: Way so far.
        arm_rad: Of each arm; at each move the joint that turned most.
    """

    def __init__(self, felt: Proprioception, parameters: SignalParameters | None = None) -> None:
        self._least = parameters or SignalParameters()
        self._base, self._torso = felt.base_pose.copy(), felt.torso.copy()
        self._arm = {side: felt.arm[side].copy() for side in felt.sides}
        self._width = {side: felt.gripper_width[side] for side in felt.sides}
        self.base_m = self.base_rad = self.torso = 0.0
        self.arm_rad: dict[Side, float] = dict.fromkeys(felt.sides, 0.0)
        self._still = 0  # steps since anything moved
        self._stood = 0  # steps in stretches of `STILL_S` or longer that are over

    def update(self, felt: Proprioception) -> None:
        """Take in one step."""
        moved = [self._base_moved(felt.base_pose), self._torso_moved(felt.torso)]
        moved += [self._arm_moved(felt, side) for side in self._arm]
        if not any(moved):
            self._still += 1
            return
        self._stood += self._counted
        self._still = 0

    @property
    def still_s(self) -> float:
        """Time in stretches without motion, of `STILL_S` or longer each."""
        return (self._stood + self._counted) / CONTROL_HZ

    @property
    def last_still_s(self) -> float:
        """How long nothing has moved now."""
        return self._still / CONTROL_HZ

    @property
    def _counted(self) -> int:
        return self._still if self._still >= STILL_S * CONTROL_HZ else 0

    def _base_moved(self, pose: Array) -> bool:
        x, y, yaw = pose - self._base
        way, turned = math.hypot(x, y), abs(math.remainder(yaw, math.tau))
        if way <= self._least.base_m and turned <= self._least.base_rad:
            return False
        self.base_m += way
        self.base_rad += turned
        self._base = pose.copy()
        return True

    def _torso_moved(self, torso: Array) -> bool:
        way = float(np.abs(torso - self._torso).max(initial=0.0))
        if way <= self._least.torso:
            return False
        self.torso += way
        self._torso = torso.copy()
        return True

    def _arm_moved(self, felt: Proprioception, side: Side) -> bool:
        moved = False
        turned = float(np.abs(felt.arm[side] - self._arm[side]).max())
        if turned > self._least.arm_rad:
            self.arm_rad[side] += turned
            self._arm[side] = felt.arm[side].copy()
            moved = True
        if abs(felt.gripper_width[side] - self._width[side]) > self._least.grip_m:
            self._width[side] = felt.gripper_width[side]
            moved = True
        return moved
