"""What a monitor would make of a trial: its signals, step by step, whatever the policy is."""

from __future__ import annotations

from mpvi_bt.executive.monitors.signals import SAMPLE_STEPS, Signals
from mpvi_bt.ground.robot.grip import GripWatch
from mpvi_bt.ground.robot.protocol import Robot


class Felt:
    """The signals of one trial.

    Attributes:
        samples: Every half second, as of `monitors.signals.SIGNALS`, rounded as a result's are.

    Args:
        robot: Without errors of the senses: asking a robot with them would change what they are.
    """

    def __init__(self, robot: Robot) -> None:
        felt = robot.proprioception()
        self._robot, self._signals, self._grip, self._steps = robot, Signals(felt), GripWatch(felt), 0
        self.samples: list[list[float]] = []

    def step(self) -> None:
        """Take in a step that was just played."""
        felt = self._robot.proprioception()
        self._signals.update(felt, self._robot.action, notices=len(list(self._grip.update(felt))))
        if self._steps % SAMPLE_STEPS == 0:
            self.samples.append([round(value, 4) for value in self._signals.values])
        self._steps += 1
