"""Four signals of a failing policy, each a number that grows, from actions and proprioception of one handoff."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robots import layout_of

SIGNALS = ("reversals", "disagreement", "stall", "grip")
SAMPLE_S = 0.5  # between two samples of the signals. Our choice: a grasp takes about that long
SAMPLE_STEPS = round(SAMPLE_S * CONTROL_HZ)


@dataclass(frozen=True)
class SignalParameters:
    """Parameters of the signals. Our choice."""

    window_s: float = 2.0  # window for counting reversals and for the largest disagreement [s]
    deadband_rad: float = 0.001  # a joint target that moves by less in a step stands still [rad]; 0.03 rad/s
    arm_rad: float = 0.05  # a larger turn of an arm joint is progress [rad]; about 3 cm at the hand
    base_m: float = 0.03  # a longer way of the base is progress [m]
    base_rad: float = 0.05  # a larger turn of the base is progress [rad]
    torso: float = 0.03  # a larger move of a torso joint is progress [m or rad]
    grip_m: float = 0.005  # a larger change of the gap between the fingers is progress [m]


class Signals:
    """The signals of one handoff, step by step.

    - reversals [1/s]: how often a commanded arm joint turns back, in a window, on average over the joints.
    - disagreement [rad]: the most, in a window, by which a new chunk differs from what the one before foresaw for the
      same steps; 0 where chunks do not overlap.
    - stall [s]: time since base, torso, arm or fingers last got anywhere.
    - grip: how often a hand closed on nothing or lost what it held.

    Args:
        felt: The robot as it stands at the handoff.
        parameters: Of the measurement.
    """

    def __init__(self, felt: Proprioception, parameters: SignalParameters | None = None) -> None:
        self._parameters = parameters or SignalParameters()
        self._arms = layout_of(felt).arm_joints
        self._told: Array | None = None
        self._ways = np.zeros(len(self._arms))
        steps = round(self._parameters.window_s * CONTROL_HZ)
        self._turned: deque[int] = deque(maxlen=steps)
        self._differed: deque[float] = deque(maxlen=steps)
        self._reference = felt
        self._stalled_steps = 0
        self._grip = 0

    def update(self, felt: Proprioception, action: Array, disagreement: float = 0.0, notices: int = 0) -> None:
        """Take in one step.

        Args:
            felt: The robot at this step.
            action: (A,) the command in force.
            disagreement: Of the chunk that begins at this step with the one before [rad].
            notices: Empty and lost grasps at this step.
        """
        told = action[self._arms]
        moved = told - (told if self._told is None else self._told)
        ways = np.where(np.abs(moved) > self._parameters.deadband_rad, np.sign(moved), 0.0)
        self._turned.append(int(np.count_nonzero(ways * self._ways < 0)))
        self._ways = np.where(ways != 0, ways, self._ways)
        self._told = told.copy()
        self._differed.append(disagreement)
        if self._got_anywhere(felt):
            self._reference, self._stalled_steps = felt, 0
        else:
            self._stalled_steps += 1
        self._grip += notices

    @property
    def values(self) -> tuple[float, float, float, float]:
        """As of `SIGNALS`."""
        reversals = sum(self._turned) / max(len(self._arms), 1) / self._parameters.window_s
        return reversals, max(self._differed, default=0.0), self._stalled_steps / CONTROL_HZ, float(self._grip)

    def _got_anywhere(self, felt: Proprioception) -> bool:
        """Whether anything is another place than when something last was."""
        was, least = self._reference, self._parameters
        if any(np.abs(felt.arm[side] - was.arm[side]).max() > least.arm_rad for side in felt.sides):
            return True
        if any(abs(felt.gripper_width[side] - was.gripper_width[side]) > least.grip_m for side in felt.sides):
            return True
        x, y, yaw = felt.base_pose - was.base_pose
        if math.hypot(x, y) > least.base_m or abs(math.remainder(yaw, math.tau)) > least.base_rad:
            return True
        return bool(np.abs(felt.torso - was.torso).max(initial=0.0) > least.torso)
