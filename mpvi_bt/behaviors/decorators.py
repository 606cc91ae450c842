"""What may be wrapped around a child: retry, repeat, invert, condition, cooldown, subtree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.behaviors.blackboard import Expectation
from mpvi_bt.behaviors.node import Decorator
from mpvi_bt.behaviors.registry import Value, duration_text
from mpvi_bt.behaviors.timer import Timer


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
        self._failures = state.get("failures", 0)


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
        self._successes = state.get("successes", 0)


class _Guard(Decorator):
    """Looks before each tick whether the child may be ticked; if not, the child is interrupted and it fails."""

    def refusal(self) -> tuple[str, str] | None:
        """Reason and evidence for failing instead, or None if the child may be ticked."""
        raise NotImplementedError

    def tick(self) -> Iterator[Behaviour]:
        """Tick the child, if it may be."""
        refusal = self.refusal()
        if refusal is None:
            yield from super().tick()
            return
        if self.status is not Status.RUNNING:
            self.initialise()
        self.stop(self.fail(*refusal))
        yield self


class Condition(_Guard):
    """Ticks its child only while a blackboard key is as it should be; once it is not, fails with "condition_false".

    It looks before every tick of the child, which is interrupted in the middle of its work.

    Args:
        name: In the tree.
        child: What is guarded.
        key, equals, not_equals, at_least, at_most: What the key's value should be; see Expectation.
    """

    def __init__(
        self,
        name: str,
        child: Behaviour,
        key: str,
        equals: Value | None = None,
        not_equals: Value | None = None,
        at_least: float | None = None,
        at_most: float | None = None,
    ) -> None:
        super().__init__(name, child)
        self._expected = Expectation(key, equals, not_equals, at_least, at_most)

    def refusal(self) -> tuple[str, str] | None:
        """The key's value is another one, or cannot be compared."""
        unmet = self._expected.unmet(self.context.blackboard)
        return unmet and (unmet[0] or "condition_false", unmet[1])


class Cooldown(_Guard):
    """Fails with reason "cooling_down" if its child ended, in whatever way, too short a time ago. The first is free.

    Args:
        name: In the tree.
        child: What needs a rest.
        limit: Simulated time [s], above 0, or control steps such as "90 steps", from the end of the child's round.
    """

    def __init__(self, name: str, child: Behaviour, limit: float | str) -> None:
        super().__init__(name, child)
        self._text = duration_text(limit)
        self._timer = Timer(limit)
        self._ended = False

    def refusal(self) -> tuple[str, str] | None:
        """It would begin too early."""
        if self.status is Status.RUNNING or not self._ended or self._timer.is_up(self.context.clock):
            return None
        return "cooling_down", f"ended less than {self._text} ago"

    def update(self) -> Status:
        """The child's status; its end is noted."""
        if self.decorated.status is not Status.RUNNING:
            self._rest()
        return self.decorated.status

    def terminate(self, new_status: Status) -> None:
        """An interruption is an end too."""
        if new_status is Status.INVALID and self.status is Status.RUNNING:
            self._rest()

    def state(self) -> dict[str, Any]:
        """How long ago the child ended."""
        since = {"since_s": self._timer.elapsed_s(self.context.clock)} if self._ended else {}
        return super().state() | since

    def restore(self, state: dict[str, Any]) -> None:
        """Rest on."""
        super().restore(state)
        self._ended = "since_s" in state
        self._timer.start(self.context.clock, state.get("since_s", 0.0))

    def _rest(self) -> None:
        self._ended = True
        self._timer.start(self.context.clock)
