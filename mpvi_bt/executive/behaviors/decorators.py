"""Decorators: subtree, invert, retry, repeat."""

from __future__ import annotations

from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Decorator
from mpvi_bt.executive.behaviors.saved_state import count


class Subtree(Decorator):
    """Its child's status: the place where the tree of another file hangs."""

    def __init__(self, name: str, child: Behaviour, **call: object) -> None:
        super().__init__(name, child)


class Invert(Decorator):
    """SUCCESS for the child's FAILURE, and FAILURE with reason "inverted" for its SUCCESS."""

    def update(self) -> Status:
        """The child's status, turned round."""
        status = self.decorated.status
        if status is Status.SUCCESS:
            said = self.decorated.feedback_message
            return self.fail("inverted", f"{self.decorated.name} succeeded" + (f" ({said})" if said else ""))
        return Status.SUCCESS if status is Status.FAILURE else status


class Retry(Decorator):
    """Begins a child that failed again at the next tick. The last failure makes it FAILURE, reason "out_of_tries".

    Args:
        name: In the tree.
        child: What is tried.
        tries: How often at most, 1 or more.
    """

    def __init__(self, name: str, child: Behaviour, tries: int) -> None:
        super().__init__(name, child)
        self.tries = tries
        self._failures = 0

    def initialise(self) -> None:
        """Start counting."""
        super().initialise()
        self._failures = 0

    def update(self) -> Status:
        """The child's status; RUNNING for a failure that is not the last."""
        if self.decorated.status is not Status.FAILURE:
            return self.decorated.status
        self._failures += 1
        last = self.blame()
        if self._failures < self.tries:
            self.feedback_message = f"try {self._failures + 1} of {self.tries}, after {last.reason}"
            return Status.RUNNING
        said = f"{last.reason}: {last.evidence}" if last.evidence else last.reason
        return self.fail("out_of_tries", f"{self.tries} failed, the last with {said}", last)

    def state(self) -> dict[str, Any]:
        """How many tries have failed."""
        return super().state() | ({"failures": self._failures} if self._failures else {})

    def restore(self, state: dict[str, Any]) -> None:
        """Count on from there."""
        super().restore(state)
        self._failures = count(state, "failures")


class Repeat(Decorator):
    """Begins a child that succeeded again at the next tick, until it has done so often enough; a failure ends it.

    Args:
        name: In the tree.
        child: What is repeated.
        times: How often it must succeed, 1 or more.
    """

    def __init__(self, name: str, child: Behaviour, times: int) -> None:
        super().__init__(name, child)
        self.times = times
        self._successes = 0

    def initialise(self) -> None:
        """Start counting."""
        super().initialise()
        self._successes = 0

    def update(self) -> Status:
        """The child's status; RUNNING for a success that is not the last."""
        if self.decorated.status is not Status.SUCCESS:
            return self.decorated.status
        self._successes += 1
        self.feedback_message = f"{self._successes} of {self.times} done"
        return Status.SUCCESS if self._successes >= self.times else Status.RUNNING

    def state(self) -> dict[str, Any]:
        """How often it has succeeded."""
        return super().state() | ({"successes": self._successes} if self._successes else {})

    def restore(self, state: dict[str, Any]) -> None:
        """Count on from there."""
        super().restore(state)
        self._successes = count(state, "successes")
