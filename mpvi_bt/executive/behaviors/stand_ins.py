"""Stand-ins for nodes, for dry runs and for injected faults."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.blackboard import NoValue
from mpvi_bt.executive.behaviors.context import Failure
from mpvi_bt.executive.behaviors.node import Node
from mpvi_bt.executive.behaviors.saved_state import count, number
from mpvi_bt.executive.behaviors.timer import Timer

Act = Literal["succeed", "fail", "raise", "run", "delay"]

_WAITING = {
    "succeed": "will succeed",
    "fail": "will fail",
    "raise": "will raise an exception",
    "run": "runs",
    "delay": "delays it",
}


class Substituted(Exception):
    """The exception of a stand-in whose rule says to raise."""


class StandIn(Node):
    """Takes a node's place and name and does as told instead, on the simulation clock.

    Args:
        name: In the tree.
        act: Succeed, fail or raise; run forever; or delay: let `other` wait, then let it do its work.
        after: RUNNING so long before; None: at once. Simulated seconds, or control steps such as "90 steps".
        text: Reason code of fail; what raise says.
        source: Who told it, such as "rules.yaml:12", for the evidence.
        times: Only in its first so many rounds; None: in every round.
        other: What stands there in all other rounds, and after a delay.
        texts: Texts of the real node's parameters; a blackboard key in them without a value fails it, as it would fail
            the real node.

    Attributes:
        elapsed_s, limit_s: How long it has been waiting in this round and will, or those of `other` while that works.
    """

    def __init__(
        self,
        name: str,
        act: Act,
        after: float | str | None = None,
        text: str = "",
        source: str = "",
        times: int | None = None,
        other: Behaviour | None = None,
        texts: tuple[str, ...] = (),
    ) -> None:
        super().__init__(name)
        self._act, self._text, self._source, self._times = act, text, source, times
        self._texts = texts
        self._timer = None if after is None else Timer(after)
        self._rounds = 0
        self._acting = False
        self.elapsed_s: float | None = None
        self.limit_s: float | None = None
        if other is not None:
            vars(other)["resets"] = None  # nobody sees it; its resets are ours
            other.parent = self
            self.children.append(other)

    @property
    def other(self) -> Behaviour:
        """The node to run when the stand-in does not act."""
        (other,) = self.children
        return other

    def setup(self, **kwargs: Any) -> None:
        """Hand the run's backends on."""
        super().setup(**kwargs)
        for child in self.children:
            child.setup(**kwargs)

    def initialise(self) -> None:
        """Begin a round, and see whether it is one to act in. Raises NoValue, which fails it."""
        super().initialise()
        self._rounds += 1
        self._acting = self._times is None or self._rounds <= self._times
        self.elapsed_s, self.limit_s = (0.0, self._timer.limit_s) if self._timer and self._acting else (None, None)
        if self._timer:
            self._timer.start(self.context.clock)
        if self._acting:
            for text in self._texts:
                self.resolve(text)

    def tick(self) -> Iterator[Behaviour]:
        """Act, or let the other node work and report as it does."""
        try:
            if self.status is not Status.RUNNING:
                self.initialise()
            status = self.update() if self._acting else Status.RUNNING
        except NoValue as missing:
            status = self.fail("no_value", str(missing))
        if not self._acting:
            vars(self.other)["path"] = self.path  # it stands there too, and its failures name that place
            for node in self.other.tick():
                if node is not self.other:
                    yield node
            status = self._follow()
        if status is not Status.RUNNING:
            self.stop(status)
        self.status = status
        yield self

    def update(self) -> Status:
        """One tick of its act, which may end by leaving the work to the other node."""
        if self._timer is not None:
            self.elapsed_s = self._timer.elapsed_s(self.context.clock)
        if self._act == "run" or (self._timer is not None and not self._timer.is_up(self.context.clock)):
            self.feedback_message = f"stand-in: {_WAITING[self._act]}"
            return Status.RUNNING
        if self._act == "delay":
            self._acting = False
            return Status.RUNNING
        if self._act == "raise":
            raise Substituted(f"{self._text} ({self._evidence()})")
        if self._act == "fail":
            return self.fail(self._text, self._evidence())
        self.feedback_message = "stand-in"
        return Status.SUCCESS

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """As py_trees; the other node is interrupted with it."""
        if new_status is Status.INVALID:
            for child in self.children:
                child.stop(new_status)
        super().stop(new_status)

    def state(self) -> dict[str, Any]:
        """Its rounds so far, how far it is in this one, and how the other node stands."""
        elapsed_s = self.elapsed_s
        if self._timer and self._acting and self.status is Status.RUNNING:
            elapsed_s = self._timer.elapsed_s(self.context.clock)
        state = {**super().state(), "rounds": self._rounds, "acting": self._acting, "elapsed_s": elapsed_s}
        for other in self.children:
            own = other.state() if isinstance(other, Node) else {}
            state["other"] = {"status": other.status.value, "feedback": other.feedback_message, "state": own}
        return state

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from there; another node that was driving the robot begins anew."""
        super().restore(state)
        self._rounds = count(state, "rounds")
        self._acting = bool(state.get("acting")) or not self.children
        self.elapsed_s = None if state.get("elapsed_s") is None else number(state, "elapsed_s")
        if self._timer and self._acting and self._rounds:
            self.limit_s = self._timer.limit_s
            self._timer.start(self.context.clock, self.elapsed_s or 0.0)
        if "other" not in state:
            return
        other, stood = self.other, state["other"]
        if stood["status"] != "RUNNING" or not getattr(other, "stops_robot", False):
            other.status, other.feedback_message = Status(stood["status"]), str(stood["feedback"])
            if isinstance(other, Node):
                other.restore(stood["state"])
        if self._rounds and not self._acting:
            self.limit_s = getattr(other, "limit_s", None)

    def _follow(self) -> Status:
        """Report what the other node does as if it stood here."""
        self.feedback_message = self.other.feedback_message
        self.elapsed_s, self.limit_s = getattr(self.other, "elapsed_s", None), getattr(self.other, "limit_s", None)
        own = getattr(self.other, "failure", None)
        self.failure = own if isinstance(own, Failure) else None
        return self.other.status

    def _evidence(self) -> str:
        return f"substituted by {self._source}" if self._source else "substituted"
