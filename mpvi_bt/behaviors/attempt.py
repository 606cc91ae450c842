"""Attempt: record a failure, then let the plan go on."""

from __future__ import annotations

from py_trees.common import Status

from mpvi_bt.behaviors.node import Decorator


class Attempt(Decorator):
    """SUCCESS when the child ends, however it ends; a failure goes into the run's log with its reason and evidence.

    A module that fails its subtask is marked failed and the plan advances (Paper, Orchestrator).

    Args:
        name: In the tree.
        child: What is attempted.

    Attributes:
        failure: Why it was given up in this round, beside SUCCESS; None if it was not.
    """

    def update(self) -> Status:
        """The child's status, FAILURE turned into SUCCESS."""
        if self.decorated.status is not Status.FAILURE:
            return self.decorated.status
        self.failure = self.blame()
        self.context.log.failures.append(self.failure)
        self.feedback_message = f"gave up: {self.failure.reason}"
        return Status.SUCCESS
