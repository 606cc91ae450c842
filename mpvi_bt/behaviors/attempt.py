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
    """

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name=name, child=child)

    def update(self) -> Status:
        """The child's status, FAILURE turned into SUCCESS."""
        if self.decorated.status != Status.FAILURE:
            return self.decorated.status
        failure = failure_of(self.decorated)
        if failure is None:
            failure = Failure("failed", "", self.path, self.context.clock.time_s)
        self.context.log.failures.append(failure)
        self.feedback_message = f"gave up: {failure.reason}"
        return Status.SUCCESS
