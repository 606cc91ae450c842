"""Sequence, selector, parallel and until_complete: py_trees' composites, with our paths, failures and state."""

from __future__ import annotations

from collections.abc import Sequence as List
from typing import Any

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from mpvi_bt.executive.behaviors.context import Failure
from mpvi_bt.executive.behaviors.node import Branch, failure_of
from mpvi_bt.executive.behaviors.saved_state import count


class _Composite(Branch, composites.Composite):
    """Common parts of our composites: py_trees' ticks, a stop without log lines, and the state for resuming."""

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """As py_trees; besides, keep what failed it before its children are reset."""
        if new_status is Status.INVALID:
            if self.status is not Status.INVALID:
                self._note_reset()
            self.current_child = None
            for child in self.children:
                if child.status is not Status.INVALID:
                    child.stop(Status.INVALID)
        elif new_status is Status.FAILURE:
            self.failure = self.blame()
        self.terminate(new_status)
        self.status = new_status

    def state(self) -> dict[str, Any]:
        """The index of the current child, from which one with memory goes on."""
        current = self.current_child
        return super().state() | ({} if current is None else {"current": self.children.index(current)})

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from there."""
        super().restore(state)
        current = count(state, "current", len(self.children))
        self.current_child = self.children[current] if "current" in state else None


class Sequence(_Composite, composites.Sequence):
    """Children in order, until one fails. With memory a child that succeeded is not ticked again in this round."""

    def __init__(self, name: str, children: List[Behaviour], memory: bool) -> None:
        super().__init__(name=name, memory=memory, children=list(children))


class Selector(_Composite, composites.Selector):
    """Children in order, until one succeeds. With memory a child that failed is not ticked again in this round.

    One whose children all failed has reason "all_failed" and lists theirs; an only child's failure is its own.
    """

    def __init__(self, name: str, children: List[Behaviour], memory: bool) -> None:
        super().__init__(name=name, memory=memory, children=list(children))

    def blame(self) -> Failure:
        """All of its children."""
        if len(self.children) == 1:
            return super().blame()
        now = self.context.clock.time_s
        reasons = ", ".join(f"{_own_name(child)}: {_reason(child)}" for child in self.children)
        last = failure_of(self.children[-1], now)
        return Failure("all_failed", reasons, self.path, now, last)


class _SideBySide(_Composite, composites.Parallel):
    """Common to parallels: at their end, children that still run are interrupted."""

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """As py_trees, likewise."""
        for child in self.children:
            if child.status is Status.RUNNING:
                child.stop(Status.INVALID)
        super().stop(new_status)


class Parallel(_SideBySide):
    """Children side by side: each is ticked at every tick, in order, until it succeeds; any failure fails it.

    Args:
        name: In the tree.
        children: Those that still run when it ends are interrupted.
        policy: "success_on_all" or "success_on_one" of them.
    """

    def __init__(self, name: str, children: List[Behaviour], policy: str) -> None:
        every = policy == "success_on_all"
        chosen = ParallelPolicy.SuccessOnAll(synchronise=True) if every else ParallelPolicy.SuccessOnOne()
        super().__init__(name=name, policy=chosen, children=list(children))


class UntilComplete(_SideBySide):
    """All children side by side until the last one succeeds, which interrupts the others; any failure fails it.

    Children are ticked in order, so that a completion check sees the step's new state after the policy has acted, and
    its SUCCESS has the last word on the robot's command: hold.
    """

    def __init__(self, name: str, children: List[Behaviour]) -> None:
        policy = ParallelPolicy.SuccessOnSelected(children=[children[-1]], synchronise=True)
        super().__init__(name=name, policy=policy, children=list(children))


def _reason(child: Behaviour) -> str:
    # One with memory has reset the children that failed before, but those keep their failure until they begin again.
    failure = getattr(child, "failure", None)
    return failure.reason if isinstance(failure, Failure) else "failed"


def _own_name(node: Behaviour) -> str:
    """The last part of its path, which tells it from its siblings."""
    return str(getattr(node, "path", "")).rpartition("/")[2] or node.name
