"""Timeout: a limit on the simulation clock. py_trees' own counts wall time."""

from __future__ import annotations

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from mpvi_bt.behaviors.node import Node

_SLACK_S = 1e-6  # a step's time is a sum of thirtieths: let rounding not cost a step


class Timeout(Node, Decorator):
    """FAILURE with reason "timeout" if the child has run for `limit` seconds of simulated time.

    The late-success rule: at the tick in which the time is up the child is still ticked, and if that ends it, its own
    status stands; only a child that is RUNNING after it is cut off (and told, by terminate(INVALID)).

    Args:
        name: In the tree.
        child: What is limited.
        limit: Simulated time [s], above 0.

    Attributes:
        elapsed_s: How long the child has run in this round.
    """

    def __init__(self, name: str, child: Behaviour, limit: float) -> None:
        super().__init__(name=name, child=child)
        self.limit_s = limit
        self.elapsed_s = 0.0
        self._started_s = 0.0

    def initialise(self) -> None:
        """Start counting."""
        super().initialise()
        self._started_s = self.context.clock.time_s
        self.elapsed_s = 0.0

    def update(self) -> Status:
        """The child's status, unless the time is up."""
        self.elapsed_s = self.context.clock.time_s - self._started_s
        status = self.decorated.status
        if status == Status.RUNNING and self.elapsed_s >= self.limit_s - _SLACK_S:
            tip = self.decorated.tip()
            last = tip.feedback_message if tip else ""
            return self.fail("timeout", f"not done within {self.limit_s:g} s" + (f" ({last})" if last else ""))
        return status
