"""Attempt: record a failure, then advance the plan or ask for a new one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Request
from mpvi_bt.executive.behaviors.node import Decorator


class Attempt(Decorator):
    """SUCCESS when the child ends, however it ends; a failure goes into the run's log with its reason and evidence.

    A module that fails its subtask is marked failed and the plan advances (Paper, Orchestrator). With "replan" the
    run's planner is asked first for what is left to do: the attempt stays RUNNING, and the robot stands still, until
    there is an answer and the loop has put the new plan behind it. Where there is none, the old plan advances.

    Args:
        name: In the tree.
        child: What is attempted.
        on_failure: "advance" or "replan".

    Attributes:
        failure: Why it was given up in this round, beside SUCCESS; None if it was not.
    """

    def __init__(self, name: str, child: Behaviour, on_failure: Literal["advance", "replan"] = "advance") -> None:
        super().__init__(name, child)
        self.on_failure = on_failure
        self._request: Request | None = None

    def tick(self) -> Iterator[Behaviour]:
        """As others do until the child has failed; from then on only the request is looked at."""
        if self.status is not Status.RUNNING or self.failure is None:
            yield from super().tick()
            return
        status = self._given_up()
        if status is not Status.RUNNING:
            self.stop(status)
        self.status = status
        yield self

    def update(self) -> Status:
        """The child's status, FAILURE turned into SUCCESS, which may have to wait for a new plan."""
        if self.decorated.status is not Status.FAILURE:
            return self.decorated.status
        self.failure = self.blame()
        self.context.log.failures.append(self.failure)
        return self._given_up()

    def terminate(self, new_status: Status) -> None:
        """Forget the request; a resumed run makes it anew."""
        self._request = None

    def _given_up(self) -> Status:
        """SUCCESS, once no new plan is waited for."""
        assert self.failure is not None
        self.feedback_message = f"gave up: {self.failure.reason}"
        planning = self.context.replanning
        if self.on_failure == "advance" or planning is None:
            return Status.SUCCESS
        if self._request is None:
            self._request = planning.ask(self.path, self.failure)
        waits = self._request.waits()
        self.feedback_message += f"; {self._request.note}"
        return Status.RUNNING if waits else Status.SUCCESS
