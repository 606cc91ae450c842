"""Leaves that do not touch the robot: wait, say, set, test, succeed, fail."""

from __future__ import annotations

import sys

from py_trees.common import Status

from mpvi_bt.executive.behaviors.blackboard import Expectation, value_of
from mpvi_bt.executive.behaviors.node import Leaf
from mpvi_bt.executive.behaviors.parameters import Value, as_text
from mpvi_bt.executive.behaviors.timer import Timed, Timer


class Wait(Timed, Leaf):
    """RUNNING until so much simulated time has passed, then SUCCESS.

    Args:
        name: In the tree.
        duration: Simulated time [s], or control steps such as "90 steps".

    Attributes:
        elapsed_s: How long it has waited in this round.
        limit_s: What that will reach; of steps, what they take at the control rate.
    """

    stops_robot = False

    def __init__(self, name: str, duration: float | str) -> None:
        super().__init__(name)
        self._timer = Timer(duration)
        self.limit_s = self._timer.limit_s
        self.elapsed_s = 0.0

    def initialise(self) -> None:
        """Start counting."""
        super().initialise()
        self._timer.start(self.context.clock)

    def update(self) -> Status:
        """See whether the time is up."""
        clock = self.context.clock
        self.elapsed_s = self._timer.elapsed_s(clock)
        return Status.SUCCESS if self._timer.is_up(clock) else Status.RUNNING


class Say(Leaf):
    """Shows a text as its feedback, and succeeds.

    Args:
        name: In the tree.
        text: What to show.
    """

    stops_robot = False

    def __init__(self, name: str, text: str) -> None:
        super().__init__(name)
        self.text = text

    def update(self) -> Status:
        """Say it."""
        self.feedback_message = self.resolve(self.text)
        return Status.SUCCESS


class Set(Leaf):
    """Gives a blackboard key a value, or adds to it, and succeeds. Only a number can be added to.

    Args:
        name: In the tree.
        key: Of the blackboard.
        value: The new value; a text that is nothing but a reference to a key stands for that key's value.
        add: What to add instead; a key without a value counts as 0.
    """

    stops_robot = False

    def __init__(self, name: str, key: str, value: Value | None = None, add: float | None = None) -> None:
        super().__init__(name)
        self.key, self.value, self.add = key, value, add

    def update(self) -> Status:
        """Write it."""
        board = self.context.blackboard
        if self.add is not None:
            before = board.get(self.key, 0)
            if isinstance(before, str | bool):
                shown = f'"{before}"' if isinstance(before, str) else as_text(before)
                return self.fail("wrong_type", f"{self.key} is {shown}, not a number to add to")
            whole = isinstance(before, int) and self.add.is_integer()
            total = before + (int(self.add) if whole else self.add)
            if abs(total) > sys.float_info.max:
                return self.fail("out_of_range", f"{self.key} would be {total:g}")
            board[self.key] = total
        elif self.value is not None:
            board[self.key] = value_of(self.value, board)
        self.feedback_message = f"{self.key} = {as_text(board[self.key])}"
        return Status.SUCCESS


class Test(Leaf):
    """SUCCESS or FAILURE at once, by the value of a blackboard key; reason "test_false" if it is not as expected.

    Args:
        name: In the tree.
        key, equals, not_equals, at_least, at_most: What its value should be; see Expectation.
    """

    stops_robot = False
    __test__ = False  # for pytest, which takes everything of this name for its own

    def __init__(
        self,
        name: str,
        key: str,
        equals: Value | None = None,
        not_equals: Value | None = None,
        at_least: float | None = None,
        at_most: float | None = None,
    ) -> None:
        super().__init__(name)
        self._expected = Expectation(key, equals, not_equals, at_least, at_most)

    def update(self) -> Status:
        """Look."""
        unmet = self._expected.unmet(self.context.blackboard)
        return Status.SUCCESS if unmet is None else self.fail(unmet[0] or "test_false", unmet[1])


class Succeed(Leaf):
    """SUCCESS at once."""

    stops_robot = False

    def update(self) -> Status:
        """Succeed."""
        return Status.SUCCESS


class Fail(Leaf):
    """FAILURE at once.

    Args:
        name: In the tree.
        reason: The code that the failure carries.
    """

    stops_robot = False

    def __init__(self, name: str, reason: str | None = None) -> None:
        super().__init__(name)
        self.reason = reason or "failed"

    def update(self) -> Status:
        """Fail."""
        return self.fail(self.reason, "")
