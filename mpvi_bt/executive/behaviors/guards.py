"""Guards: decorators that decide before each tick whether to tick their child: condition, cooldown."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.blackboard import Expectation
from mpvi_bt.executive.behaviors.node import Decorator
from mpvi_bt.executive.behaviors.parameters import Value, duration_text
from mpvi_bt.executive.behaviors.saved_state import number
from mpvi_bt.executive.behaviors.timer import Timer


class Guard(Decorator):
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


class Condition(Guard):
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


class Cooldown(Guard):
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
        if not self._ended or self._timer.is_up(self.context.clock):
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
        self._timer.start(self.context.clock, number(state, "since_s"))

    def _rest(self) -> None:
        self._ended = True
        self._timer.start(self.context.clock)
