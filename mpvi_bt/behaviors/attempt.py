"""Attempt: record a failure, then let the plan go on."""

from __future__ import annotations

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from mpvi_bt.behaviors.context import Failure
from mpvi_bt.behaviors.node import Node, failure_of


class Attempt(Node, Decorator):
    """SUCCESS when the child ends, however it ends; a failure goes into the run's log with its reason and evidence.

    A module that fails its subtask is marked failed and the plan advances (Paper, Orchestrator).

    Args:
        name: In the tree.
        child: What is attempted.

    Attributes:
        failure: Why it was given up in this round, beside SUCCESS; None if it was not.
    """

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name=name, child=child)

    def update(self) -> Status:
        """The child's status, FAILURE turned into SUCCESS."""
        if self.decorated.status != Status.FAILURE:
            return self.decorated.status
        self.failure = failure_of(self.decorated)
        if self.failure is None:
            self.failure = Failure("failed", "", self.path, self.context.clock.time_s)
        self.context.log.failures.append(self.failure)
        self.feedback_message = f"gave up: {self.failure.reason}"
        return Status.SUCCESS
