"""One hand of a robot that a learned policy moves: what it feels and commands, as if it were the right one."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Proprioception, Side
from mpvi_bt.ground.robot.robots import layout_of
from mpvi_bt.hands.learned import mirroring
from mpvi_bt.hands.learned.features import Moments
from mpvi_bt.hands.learned.mirroring import SIDE


class LearnedHand:
    """The left one is mirrored in what goes in and what comes out."""

    def __init__(self, side: Side, felt: Proprioception) -> None:
        """Begin from what is felt: the torso's command is taken to be where it is."""
        self.side = side
        self.feel(felt)
        self.layout = layout_of(felt)
        self.action = np.zeros(self.layout.size)
        self.action[self.layout.torso] = felt.torso
        for s in felt.sides:
            self.action[self.layout.arm[s]] = felt.arm_command.get(s, felt.arm[s])
            self.action[self.layout.gripper[s]] = felt.gripper_command[s]

    def feel(self, felt: Proprioception) -> None:
        """Take in what is felt now."""
        self.felt = felt

    @property
    def mirrored(self) -> bool:
        """Whether it is not the hand that was learned with."""
        return self.side != SIDE

    def points(self, points: Array) -> Array:
        """Points (n, 3) as it sees them."""
        return mirroring.points(points) if self.mirrored else points

    def now(self) -> Moments:
        """What it feels, and the commands in force: one moment."""
        felt, told, layout = self.felt, self.action, self.layout
        base, speed, torso, told_torso = felt.base_pose, felt.base_velocity, felt.torso, told[layout.torso]
        arm, told_arm = felt.arm[self.side], told[layout.arm[self.side]]
        if self.mirrored:
            base, speed = mirroring.base(base), mirroring.base(speed)
            torso, told_torso = mirroring.torso(torso), mirroring.torso(told_torso)
            arm, told_arm = mirroring.arm(arm), mirroring.arm(told_arm)
        width, grip = felt.gripper_width[self.side], told[layout.gripper[self.side]]
        rows = (base, torso, arm, np.array(width), speed, told_torso, told_arm, np.array(grip))
        return Moments(*(np.asarray(row, float)[None] for row in rows))

    def command(self, base: Array, torso: Array, arm: Array, grip: float) -> Array:
        """(A,) the action that moves it so; everything else keeps its command.

        Args:
            base: (3,) velocity in the base's frame [m/s, rad/s].
            torso: (4,), arm: (7,) joints.
            grip: -1 closed ... 1 open.
        """
        if self.mirrored:
            base, torso, arm = mirroring.base(base), mirroring.torso(torso), mirroring.arm(arm)
        self.layout.set_velocity(self.action, base)
        self.action[self.layout.torso] = torso
        self.action[self.layout.arm[self.side]], self.action[self.layout.gripper[self.side]] = arm, grip
        return self.action.copy()

    def still(self, steps: int, grip: float | None = None) -> Array:
        """(steps, A) standing still; the fingers come to `grip` bit by bit."""
        now = self.action[self.layout.gripper[self.side]]
        self.layout.set_velocity(self.action, 0.0)
        rows = np.repeat(self.action[None], steps, 0)
        if grip is not None:
            rows[:, self.layout.gripper[self.side]] = now + (grip - now) * np.arange(1, steps + 1) / steps
            self.action = rows[-1].copy()
        return rows
