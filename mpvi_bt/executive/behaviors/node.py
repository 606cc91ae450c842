"""The base of all nodes, on top of py_trees: path, context, reason of failure, state for resuming."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any, ClassVar

from py_trees import decorators
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.blackboard import NoValue, text_of
from mpvi_bt.executive.behaviors.context import Context, Failure

_RUNNING, _FAILURE, _INVALID = Status.RUNNING, Status.FAILURE, Status.INVALID


class Node(Behaviour):
    """A node of ours. The constructor is cheap; backends arrive in `setup(context=...)`.

    Attributes:
        path: Names from the root, joined by "/"; set when the tree is built.
        context: The run's backends, from setup on.
        failure: Why it failed, after a FAILURE.
        interrupted: It was RUNNING when it was cut off, and has not begun since.
        ended: How its last round ended, "SUCCESS" or "FAILURE", where that was reset and it has not begun since.
        resets: Where a node enters itself when it goes back to INVALID; the tree's, or None outside one.
    """

    path: str = ""
    context: Context
    failure: Failure | None = None
    interrupted: bool = False
    ended: str = ""
    resets: list[Behaviour] | None = None

    def setup(self, **kwargs: Any) -> None:
        """Take `context`, the run's Context."""
        self.context = kwargs["context"]

    def initialise(self) -> None:
        """Forget the last round."""
        self.failure = None
        self.interrupted = False
        self.ended = ""
        self.feedback_message = ""

    def stop(self, new_status: Status = _INVALID) -> None:
        """As py_trees; besides, note when and how a round was undone."""
        if new_status is _INVALID and self.status is not _INVALID:
            self._note_reset()
        super().stop(new_status)

    def fail(self, reason: str, evidence: str, cause: Failure | None = None) -> Status:
        """FAILURE, with a reason code, the evidence, and the failure behind it, if any."""
        self.failure = Failure(reason, evidence, self.path, self.context.clock.time_s, cause)
        self.feedback_message = f"{reason}: {evidence}" if evidence else reason
        return _FAILURE

    def resolve(self, text: str) -> str:
        """A text parameter with its references to blackboard keys filled in. Raises NoValue."""
        return text_of(text, self.context.blackboard)

    def state(self) -> dict[str, Any]:
        """The state, as JSON values, that another process needs to resume the node; {} if none."""
        return {} if self.failure is None else {"failure": asdict(self.failure)}

    def restore(self, state: dict[str, Any]) -> None:
        """Take what `state` gave. Called after setup; the clock may show another time than it did."""
        self.failure = Failure.of(state["failure"]) if "failure" in state else None

    def _note_reset(self) -> None:
        self.interrupted = self.status is _RUNNING
        self.ended = "" if self.interrupted else self.status.value
        if self.resets is not None:
            self.resets.append(self)


class Leaf(Node):
    """A node without children. However it ends, interrupted too, the robot is told to hold still.

    `initialise` and `update` may raise NoValue, which fails it with reason "no_value".

    Attributes:
        stops_robot: False of leaves that never command the robot.
    """

    stops_robot: ClassVar[bool] = True
    _beginning: bool = False  # in its first tick, when the status does not say yet that it is at work

    def tick(self) -> Iterator[Behaviour]:
        """As py_trees, without its log lines: formatting them takes most of a small leaf's time.

        Raises:
            TypeError: `update` returned no Status, or INVALID. (py_trees prints a line and goes on.)
        """
        try:
            if self.status is not _RUNNING:
                self._beginning = True
                self.initialise()
            status = self.update()
        except NoValue as missing:
            status = self.fail("no_value", str(missing))
        if status is not _RUNNING:
            self.stop(_checked(status, self))
        self.status = status
        self._beginning = False
        yield self

    def stop(self, new_status: Status = _INVALID) -> None:
        """As py_trees, likewise, but `terminate` is called once a round.

        py_trees calls it again when a node that has ended is reset; one that drives the robot would then stop what
        another node has begun since.
        """
        if new_status is not _INVALID or self._beginning or self.status is _RUNNING:
            self.terminate(new_status)
        if new_status is _INVALID and self.status is not _INVALID:
            self._note_reset()
        self._beginning = False
        self.status = new_status

    def terminate(self, new_status: Status) -> None:
        """Let base and arms rest; INVALID (interrupted) included."""
        if self.stops_robot and hasattr(self, "context"):
            self.context.robot.hold()


class Branch(Node):
    """A node with children. When it fails without a reason of its own, it takes the failed child's."""

    def blame(self) -> Failure:
        """Why it fails, by its children: as the first one that failed."""
        now = self.context.clock.time_s
        found = (failure for child in self.children if (failure := failure_of(child, now)))
        return next(found, None) or Failure("failed", "", self.path, now)


class Decorator(Branch, decorators.Decorator):
    """A node with one child, `decorated`. A subclass says in `update` what it makes of the child's status."""

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name=name, child=child)

    def tick(self) -> Iterator[Behaviour]:
        """As py_trees, without its log lines. Raises TypeError: `update` returned no Status."""
        if self.status is not _RUNNING:
            self.initialise()
        yield from self.decorated.tick()
        status = self.update()
        if status is not _RUNNING:
            self.stop(_checked(status, self))
        self.status = status
        yield self

    def stop(self, new_status: Status = _INVALID) -> None:
        """As py_trees, likewise; besides, keep what failed it before the child is reset."""
        if new_status is _INVALID and self.status is not _INVALID:
            self._note_reset()
        elif new_status is _FAILURE and self.failure is None:
            self.failure = self.blame()
        self.terminate(new_status)
        child = self.decorated
        if new_status is _INVALID or child.status is _RUNNING:
            child.stop(_INVALID)
        self.status = new_status

    def update(self) -> Status:
        """The child's status."""
        return self.decorated.status


def failure_of(node: Behaviour, time_s: float = 0.0) -> Failure | None:
    """Why a node that failed did, or None if it did not fail.

    That is its own reason, or that of the first failed node below it. One of another package that gives none has
    reason "failed" at `time_s`.
    """
    if node.status is not _FAILURE:
        return None
    if isinstance(own := getattr(node, "failure", None), Failure):
        return own
    below = (found for child in node.children if (found := failure_of(child, time_s)))
    return next(below, None) or Failure("failed", node.feedback_message, getattr(node, "path", node.name), time_s)


def _checked(status: object, node: Behaviour) -> Status:
    if not isinstance(status, Status) or status is _INVALID:
        raise TypeError(f"update() of {type(node).__name__} returned {status!r}, not SUCCESS, FAILURE or RUNNING")
    return status
