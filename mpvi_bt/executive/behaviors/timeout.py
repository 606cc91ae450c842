"""Timeout: a limit on the simulation clock. py_trees' own counts wall time."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Decorator
from mpvi_bt.executive.behaviors.parameters import duration_text
from mpvi_bt.executive.behaviors.timer import Timed, Timer


class Timeout(Timed, Decorator):
    """FAILURE with reason "timeout" if the child has run for `limit` of simulated time.

    The late-success rule: at the tick in which the time is up the child is still ticked, and if that ends it, its own
    status stands; only a child that is RUNNING after it is cut off (and told, by terminate(INVALID)).

    Args:
        name: In the tree.
        child: What is limited.
        limit: Simulated time [s], above 0, or control steps such as "90 steps".

    Attributes:
        elapsed_s: How long the child has run in this round.
        limit_s: What that may reach; of steps, what they take at the control rate.
    """

    def __init__(self, name: str, child: Behaviour, limit: float | str) -> None:
        super().__init__(name, child)
        self._text = duration_text(limit)
        self._timer = Timer(limit)
        self.limit_s = self._timer.limit_s
        self.elapsed_s = 0.0

    def initialise(self) -> None:
        """Start counting."""
        super().initialise()
        self._timer.start(self.context.clock)
        self.elapsed_s = 0.0

    def update(self) -> Status:
        """The child's status, unless the time is up."""
        clock = self.context.clock
        self.elapsed_s = self._timer.elapsed_s(clock)
        status = self.decorated.status
        if status is Status.RUNNING and self._timer.is_up(clock):
            return self.fail("timeout", f"not done within {self._text}: still at {self._still_at()}")
        return status

    def _still_at(self) -> str:
        """The running leaves, by their paths from here, with their own messages."""
        leaves = list(_still_running(self.decorated))
        paths = [getattr(leaf, "path", leaf.name).removeprefix(f"{self.path}/") for leaf in leaves]
        said = [f" ({leaf.feedback_message})" if leaf.feedback_message else "" for leaf in leaves]
        # Of several side by side the first is told with its path, the others by their own names.
        names = [paths[0], *(path.rsplit("/", 1)[-1] for path in paths[1:])]
        return ", ".join(name + words for name, words in zip(names, said, strict=True))


def _still_running(node: Behaviour) -> Iterator[Behaviour]:
    """The deepest nodes below that are RUNNING, side by side."""
    running = [child for child in node.children if child.status is Status.RUNNING]
    if not running:
        yield node
    for child in running:
        yield from _still_running(child)
