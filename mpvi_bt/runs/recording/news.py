"""What a recording over time tells: values where they change, failures with their reasons, and how it ended."""

from __future__ import annotations

from collections.abc import Iterator

from mpvi_bt.executive.behaviors.context import Query
from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground.words.spoken import spoken_text


class News:
    """Remembers values by name, so that each is told only where it changes."""

    def __init__(self) -> None:
        self._last: dict[str, object] = {}

    def __call__(self, name: str, value: object) -> bool:
        """Whether this is other than it was last under that name."""
        if name in self._last and self._last[name] == value:
            return False
        self._last[name] = value
        return True

    def forget(self, *names: str) -> None:
        """Have these count as never told."""
        for name in names:
            self._last.pop(name, None)

    def failures(self, tree: Tree) -> Iterator[tuple[str, str]]:
        """Path of each node that failed at this tick, or gave something up, and its reason code with evidence."""
        for node in tree.touched:
            path = str(vars(node)["path"])
            if not self(f"status of {path}", node.status):
                continue
            state = tree.state_of(node)
            if state.reason and state.origin == path:
                yield path, f"{state.reason}: {state.evidence or state.feedback}"


def answer(query: Query) -> str:
    """What prompted a question to the completion checker, the question, the answer and its reason."""
    return f"{query.event}: {query.criterion}? {query.said.capitalize()}: {spoken_text(query.reason)}"


def ending(outcome: Outcome, tree: TreeSpec) -> tuple[str, bool]:
    """How an episode ended, in one line, and whether well."""
    why = "" if outcome.failure is None else f": {outcome.failure.reason}: {outcome.failure.evidence}"
    good = outcome.goal.satisfied if outcome.goal else outcome.complete
    return outcome.told(tree) + why, good
