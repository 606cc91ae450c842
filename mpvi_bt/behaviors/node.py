"""What all our nodes share on top of py_trees: a path, the run's context, a reason for failure."""

from __future__ import annotations

from typing import Any, ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.behaviors.context import Context, Failure


class Node(Behaviour):
    """A node of ours. The constructor is cheap; backends arrive in `setup(context=...)`.

    Attributes:
        path: Names from the root, joined by "/"; set when the tree is built.
        context: The run's backends, from setup on.
        failure: Why it failed, after a FAILURE.
    """

    path: str = ""
    context: Context
    failure: Failure | None = None

    def setup(self, **kwargs: Any) -> None:
        """Take `context`, the run's Context."""
        self.context = kwargs["context"]

    def initialise(self) -> None:
        """Forget the last round."""
        self.failure = None
        self.feedback_message = ""

    def fail(self, reason: str, evidence: str) -> Status:
        """FAILURE, with a reason code and what was seen."""
        self.failure = Failure(reason, evidence, self.path, self.context.clock.time_s)
        self.feedback_message = f"{reason}: {evidence}" if evidence else reason
        return Status.FAILURE


class Leaf(Node):
    """A node that drives the robot. However it ends, interrupted too, the robot is told to hold still."""

    stops_robot: ClassVar[bool] = True

    def terminate(self, new_status: Status) -> None:
        """Let base and arms rest; INVALID (interrupted) included."""
        if self.stops_robot and hasattr(self, "context"):
            self.context.robot.hold()


def failure_of(node: Behaviour) -> Failure | None:
    """Why a node that failed did: its own reason, or that of the first failed node below it."""
    if node.status != Status.FAILURE:
        return None
    if isinstance(own := getattr(node, "failure", None), Failure):
        return own
    return next((found for child in node.children if (found := failure_of(child))), None)
