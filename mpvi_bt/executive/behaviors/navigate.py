"""Navigate: drive the base to a named target."""

from __future__ import annotations

from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Leaf
from mpvi_bt.ground.protocols import Progress


class Navigate(Leaf):
    """RUNNING while the navigator drives, then what it reports (Paper, Navigation).

    Args:
        name: In the tree.
        target: Phrase such as "trash can".
        room: Where to look for it first.
        elsewhere: Whether to stop at another place than where the base stands now.
    """

    def __init__(self, name: str, target: str, room: str | None = None, elsewhere: bool = False) -> None:
        super().__init__(name)
        self.target, self.room, self.elsewhere = target, room, elsewhere

    def initialise(self) -> None:
        """Start driving."""
        super().initialise()
        target, room = self.resolve(self.target), self.room and self.resolve(self.room)
        with self.context.stopwatch("navigation"):
            if self.elsewhere:
                getattr(self.context.navigator, "leave", lambda: None)()
            self.context.navigator.start(target, room)

    def update(self) -> Status:
        """Drive one step."""
        with self.context.stopwatch("navigation"):
            report = self.context.navigator.step()
        self.feedback_message = report.feedback
        if report.progress is Progress.FAILED:
            return self.fail(report.reason or "navigation_failed", report.feedback)
        return Status.SUCCESS if report.progress is Progress.SUCCEEDED else Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Stop the base."""
        if hasattr(self, "context"):
            self.context.navigator.stop()
        super().terminate(new_status)
