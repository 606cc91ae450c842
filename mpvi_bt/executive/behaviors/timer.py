"""Durations on the simulation clock, in seconds or in control steps."""

from __future__ import annotations

from typing import Any

from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Node
from mpvi_bt.executive.behaviors.parameters import steps_of
from mpvi_bt.executive.behaviors.saved_state import number
from mpvi_bt.ground.protocols import Clock
from mpvi_bt.ground.robot.protocol import CONTROL_HZ

_SLACK_S = 1e-6  # a step's time is a sum of thirtieths: let rounding not cost a step


class Timer:
    """How long ago something was, against a duration.

    Args:
        duration: Simulated seconds, or control steps such as "90 steps".

    Attributes:
        limit_s: The duration in seconds; of steps, what they take at the control rate.
    """

    def __init__(self, duration: float | str) -> None:
        steps = steps_of(duration)
        self.limit_s = float(duration) if steps is None else steps / CONTROL_HZ
        self._counts_steps = steps is not None
        self._since = 0.0

    def start(self, clock: Clock, elapsed_s: float = 0.0) -> None:
        """Count from now, or from so long ago."""
        self._since = self._now(clock) - elapsed_s

    def elapsed_s(self, clock: Clock) -> float:
        """Since the start."""
        return self._now(clock) - self._since

    def is_up(self, clock: Clock) -> bool:
        """Whether the whole duration has passed since the start."""
        return self.elapsed_s(clock) >= self.limit_s - _SLACK_S

    def _now(self, clock: Clock) -> float:
        return clock.steps / CONTROL_HZ if self._counts_steps else clock.time_s


class Timed(Node):
    """A node that counts its time in a round, and goes on counting after a stop.

    Attributes:
        elapsed_s: How long it has run in this round.
    """

    _timer: Timer
    elapsed_s: float

    def state(self) -> dict[str, Any]:
        """How long it has run."""
        if self.status is Status.INVALID and not self.interrupted:
            return super().state()
        running = self.status is Status.RUNNING
        elapsed_s = self._timer.elapsed_s(self.context.clock) if running else self.elapsed_s
        return {**super().state(), "elapsed_s": elapsed_s}

    def restore(self, state: dict[str, Any]) -> None:
        """Count on from there."""
        super().restore(state)
        self.elapsed_s = number(state, "elapsed_s")
        self._timer.start(self.context.clock, self.elapsed_s)
