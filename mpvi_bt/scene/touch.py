"""How touch tells what the hands take of what is known, and where they put it."""

from __future__ import annotations

from dataclasses import dataclass

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul
from mpvi_bt.robot.protocol import Proprioception, Side
from mpvi_bt.robot.robots import robot_named
from mpvi_bt.robot.solids import Array


@dataclass(frozen=True)
class Touch:
    """How near a hand has to be to what it takes.

    Our choice: a hand closes on what it was led to. Shapes are off by some centimeters, boxes about things that were
    seen from one side by more, those of large things by most.

    Attributes:
        grasped_m: From a hand to what it takes, at the most [m].
        pressed_m: Likewise from two hands to what they press [m].
        outer: What contains a thing covers that much more floor than it [ratio].
    """

    grasped_m: float
    pressed_m: float
    outer: float = 1.2


BY_BOX = Touch(0.08, 0.15)
BY_SHAPE = Touch(0.06, 0.06)


def tcp(felt: Proprioception, side: Side) -> Array:
    """T_world_tcp (4, 4) of a hand, as felt."""
    return matmul(kin.base(felt.base_pose), robot_named(felt.robot).tcp(felt.torso, felt.arm[side], side))
