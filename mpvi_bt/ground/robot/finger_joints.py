"""The finger joints of a gripper: their positions, and how wide it is open then."""

from __future__ import annotations

from dataclasses import dataclass

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robot_description import RobotDescription


@dataclass(frozen=True, eq=False)
class FingerJoints:
    """Fingers that slide or turn, each in proportion to the opening.

    Attributes:
        names: Of the joints.
        ends: (n, 2) closed and open position of each [m or rad].
        opening_m: Between the fingers when open.
    """

    names: tuple[str, ...]
    ends: Array
    opening_m: float

    @property
    def rates(self) -> Array:
        """(n,) of each joint, by the speed of the opening [m/m or rad/m]."""
        rates: Array = (self.ends[:, 1] - self.ends[:, 0]) / self.opening_m
        return rates

    def positions(self, width_m: float) -> Array:
        """(n,) of the gripper that is so far open."""
        positions: Array = self.ends[:, 0] + self.rates * width_m
        return positions

    def width(self, positions: Array) -> float:
        """How far the gripper is open [m]: the mean of what its joints (n,) tell."""
        return self.widening(positions - self.ends[:, 0])

    def widening(self, speeds: Array) -> float:
        """How fast it opens [m/s] at speeds (n,) of its joints."""
        return float((speeds / self.rates).mean())


def fingers_of(robot: RobotDescription, side: Side) -> FingerJoints:
    """Those of a robot's gripper."""
    return FingerJoints(robot.finger_joints[side], robot.finger_range[side], robot.opening_m)
