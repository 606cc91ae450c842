"""Explains from a trace why a run ended as it did: the chain of causes from root to leaf, with evidence."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from mpvi_bt.executive.drawing.endings import WELL
from mpvi_bt.executive.monitors.causes import Cause, likely_cause
from mpvi_bt.executive.monitors.handoff import Handoff
from mpvi_bt.executive.trace.lines import Broken, CheckerAnswer, Replanned, Tick
from mpvi_bt.executive.trace.read import Moment, Trace
from mpvi_bt.executive.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.executive.tree.state import Ending, NodeState, Status
from mpvi_bt.executive.tree.yaml_io import from_expanded

_NEVER = NodeState()


@dataclass(frozen=True)
class Asked:
    """A question to the completion checker, and when it was asked in simulated time."""

    time_s: float
    answer: CheckerAnswer


@dataclass(frozen=True)
class Link:
    """A node in a chain of causes.

    Attributes:
        path, glyph, label: The node.
        status: What it came to.
        began_s, time_s: When it began, and when it came to that status, in simulated time.
        reason, evidence: Of a failure that is its own; "" where what is below explains it.
        feedback: Its last words.
        below: The nodes right below it that brought it there: of a selector every child that failed.
        interrupted: Where nothing below failed: what was still running there when it was cut off, deepest nodes only.
        earlier: Likewise: failures below that did not end it, such as those of earlier tries, in order.
        asked: Likewise: what the checker was asked there in the meantime.
        replanned: Of a node that gave up and asked for a new plan: what came of it.
    """

    path: str
    glyph: str
    label: str
    status: Status
    began_s: float
    time_s: float
    reason: str = ""
    evidence: str = ""
    feedback: str = ""
    below: tuple[Link, ...] = ()
    interrupted: tuple[Link, ...] = ()
    earlier: tuple[Link, ...] = ()
    asked: tuple[Asked, ...] = ()
    replanned: Replanned | None = None


@dataclass(frozen=True)
class Recovery:
    """A retry or a selector that succeeded though something below it had failed in the same round.

    Attributes:
        node: It, as it stood when it did.
        failed: What had failed, in order, each at the node where it began, without those that only pass it on.
        by: Label of the child that succeeded in the end.
        tries: How often a retry had begun its child; 0 of a selector.
    """

    node: Link
    failed: tuple[Link, ...]
    by: str
    tries: int = 0


@dataclass(frozen=True)
class Diagnosis:
    """One handoff to the policy: its figures, and the likely cause of its end, or None."""

    handoff: Handoff
    cause: Cause | None


@dataclass(frozen=True)
class Explanation:
    """Why a run ended as it did.

    Attributes:
        tree: Its name.
        ending: As the run says; "cut" where the trace ends before it does.
        told: The same in words, q first where there is one.
        q: Score of the goal, or None.
        unmet: Conditions of the goal that did not hold at the end; `conditions`: how many it has.
        tick, time_s: The last recorded.
        cause: The failed root; None if it did not fail.
        recovered: Retries and selectors that went on in spite of failures, in order; not those within a larger one.
        gave_up: Nodes that passed over a failure and went on (attempt), each as it stood when it did, in order.
        unanswered: Questions to the checker that got neither yes nor no.
        running: Deepest nodes that ran at the end, of a run that its tree did not end.
        error: The exception that ended it.
        diagnosis: Every handoff to the policy that is recorded, in order.
        undiagnosed: Nodes that handed over to a policy of which the trace does not tell what it did.
    """

    tree: str
    ending: Ending | Literal["cut"]
    told: str
    tick: int
    time_s: float
    q: float | None = None
    conditions: int = 0
    unmet: tuple[str, ...] = ()
    cause: Link | None = None
    recovered: tuple[Recovery, ...] = ()
    gave_up: tuple[Link, ...] = ()
    unanswered: tuple[Asked, ...] = ()
    running: tuple[Link, ...] = ()
    error: Broken | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    undiagnosed: tuple[str, ...] = ()


def explain(trace: Trace) -> Explanation:
    """Why the run ended as it did."""
    history = _History(trace.tree)
    gave_up: list[Link] = []
    recovered: list[Recovery] = []
    handoffs: list[Handoff] = []
    tick = 0
    for change in trace.ticks:
        history.add(change)
        for path, state in change.nodes.items():
            if state.status == "SUCCESS" and (recovery := history.recovery(path)) is not None:
                recovered = [*(r for r in recovered if not _within(r.node, recovery.node)), recovery]
        gave_up += [history.gave_up(path) for path, state in change.nodes.items() if state.gave_up]
        handoffs += change.diagnosis
        tick = change.tick
    end = trace.end
    untold = history.handed_over - {handoff.path for handoff in handoffs}
    root = history.moment.tree.nodes[0].path
    return Explanation(
        tree=trace.tree.name,
        ending=end.ending if end else "cut",
        told=trace.told,
        tick=end.tick if end else tick,
        time_s=end.time_s if end else history.moment.time_s,
        q=end.q if end else None,
        conditions=len(end.goal) if end else 0,
        unmet=tuple(c.condition for c in end.goal if not c.satisfied) if end else (),
        cause=history.link(root) if end and end.ending == "failure" else None,
        recovered=tuple(recovered),
        gave_up=tuple(gave_up),
        unanswered=tuple(asked for asked in history.asked if asked.answer.fault),
        running=history.running() if not end or end.ending not in ("failure", *WELL) else (),
        error=end.error if end else None,
        diagnosis=tuple(Diagnosis(handoff, likely_cause(handoff)) for handoff in handoffs),
        undiagnosed=tuple(sorted(untold)) if end and "policy" in trace.config else (),  # a dry run has none
    )


def _within(inner: Link, outer: Link) -> bool:
    """Whether a node's round is part of the round of one above it."""
    return inner.path.startswith(f"{outer.path}/") and outer.began_s <= inner.began_s


def _brought(failure: Link, above: Link) -> bool:
    """Whether a failure is what made one above it fail."""
    return failure.path.startswith(f"{above.path}/") and failure.time_s == above.time_s


class _Failed(NamedTuple):
    """When a node failed, how it stood then, and what it was: another may stand at its path since."""

    time_s: float
    state: NodeState
    spec: NodeSpec


class _History:
    """How everything stands, and what a single moment does not say: when rounds began, failures since passed over."""

    def __init__(self, tree: TreeSpec) -> None:
        self.moment = Moment(tree)
        self.placed: dict[str, Placed] = {placed.path: placed for placed in tree.nodes}
        self.began: dict[str, float] = {}
        self.since: dict[str, float] = {}
        self.failures: defaultdict[str, list[_Failed]] = defaultdict(list)
        self.asked: list[Asked] = []
        self.replanned: dict[str, Replanned] = {}
        self.handed_over: set[str] = set()

    def add(self, tick: Tick) -> None:
        """Take in the next tick."""
        if tick.tree is not None:
            self._swap(from_expanded(tick.tree))
        for path, new in tick.nodes.items():
            swapped_in = tick.tree is not None and new.elapsed_s == 0
            old = _NEVER if swapped_in else self.moment.nodes.get(path, _NEVER)
            if new.status != old.status:
                self.since[path] = tick.time_s
            if old.status != "RUNNING" and (new.status != "INVALID" or new.interrupted):
                self.began[path] = tick.time_s
                if self.placed[path].spec.kind == "manipulate":
                    self.handed_over.add(path)
            if new.status == "FAILURE":
                self.failures[path].append(_Failed(tick.time_s, new, self.placed[path].spec))
        self.asked += [Asked(tick.time_s if a.asked_s is None else a.asked_s, a) for a in tick.queries]
        self.replanned |= {replanned.path: replanned for replanned in tick.replans}
        self.moment.apply(tick)

    def gave_up(self, path: str) -> Link:
        """A node that passed over a failure, and the result of the new plan if it asked for one."""
        return replace(self.link(path), replanned=self.replanned.pop(path, None))

    def recovery(self, path: str) -> Recovery | None:
        """The recovery of a successful retry or selector; None for other nodes or without a failure."""
        placed = self.placed[path]
        if placed.spec.kind not in ("retry", "selector"):
            return None
        node = self._bare(path)
        all_failed = self._earlier(node)
        failed = tuple(f for f in all_failed if not any(_brought(g, f) for g in all_failed))
        if not failed:
            return None
        good = [c for c in placed.children if self.moment.nodes.get(c, _NEVER).status == "SUCCESS"]
        tries = 0
        if placed.spec.kind == "retry":
            tries = 1 + sum(node.began_s <= f.time_s <= node.time_s for f in self.failures[placed.children[0]])
        return Recovery(node, failed, self.placed[good[-1]].spec.label if good else "", tries)

    def _swap(self, tree: TreeSpec) -> None:
        """Forget the states of replaced nodes. Their failures stay: they are part of the history."""
        before, self.placed = self.placed, {placed.path: placed for placed in tree.nodes}
        for path, placed in before.items():
            now = self.placed.get(path)
            if now is None or (now.spec.kind, now.spec.label) != (placed.spec.kind, placed.spec.label):
                for kept in (self.moment.nodes, self.began, self.since):
                    kept.pop(path, None)

    def link(self, path: str, failed: _Failed | None = None) -> Link:
        """A node and what brought it there.

        Args:
            path: The node.
            failed: When it failed and how, if it has been reset since.
        """
        bare = self._bare(path, failed)
        origin = (failed.state if failed else self.moment.nodes.get(path, _NEVER)).origin
        below = self._failed_below(bare)
        if below and origin != path:
            return replace(bare, reason="", evidence="", below=below)
        if below or bare.status == "SUCCESS":
            return replace(bare, below=below)
        return replace(
            bare,
            interrupted=tuple(self._deepest(path, "INVALID", bare.time_s)),
            earlier=self._earlier(bare),
            asked=self._asked(bare),
        )

    def running(self) -> tuple[Link, ...]:
        """The deepest running nodes, with the checker's questions since they began."""
        links = self._deepest(self.moment.tree.nodes[0].path, "RUNNING")
        return tuple(replace(link, asked=self._asked(replace(link, time_s=self.moment.time_s))) for link in links)

    def _bare(self, path: str, failed: _Failed | None = None) -> Link:
        """A node without what is below it."""
        if failed is None:
            since = self.since.get(path, self.moment.time_s)
            failed = _Failed(since, self.moment.nodes.get(path, _NEVER), self.placed[path].spec)
        time_s, state, spec = failed
        began_s = min(self.began.get(path, time_s), time_s)
        return Link(
            path, spec.glyph, spec.label, state.status, began_s, time_s, state.reason, state.evidence, state.feedback
        )

    def _failed_below(self, link: Link) -> tuple[Link, ...]:
        """The children that failed in this round of a node, also those since reset (by a selector)."""
        found = []
        for child in self.placed[link.path].children:
            state = self.moment.nodes.get(child, _NEVER)
            last = self.failures[child][-1] if self.failures[child] else None
            if state.status == "FAILURE":
                found.append(self.link(child))
            elif (
                last
                and state.status == "INVALID"
                and not state.interrupted
                and link.began_s <= last.time_s <= link.time_s
            ):
                found.append(self.link(child, last))
        return tuple(found)

    def _deepest(self, path: str, status: Status, since_s: float | None = None) -> Iterator[Link]:
        """The deepest nodes at or below `path` that run, or were interrupted at a time."""
        inner = [found for child in self.placed[path].children for found in self._deepest(child, status, since_s)]
        yield from inner
        state = self.moment.nodes.get(path, _NEVER)
        cut_off = state.interrupted and self.since.get(path) == since_s
        if not inner and state.status == status and (status == "RUNNING" or cut_off):
            yield self._bare(path)

    def _earlier(self, link: Link) -> tuple[Link, ...]:
        """Failures below a node in its round that did not end it, each at the node of its origin."""
        found = [
            self._bare(path, failed)
            for path, failures in self.failures.items()
            if path.startswith(f"{link.path}/")
            for failed in failures
            if failed.state.origin in ("", path) and link.began_s <= failed.time_s <= link.time_s
        ]
        return tuple(sorted(found, key=lambda earlier: earlier.time_s))

    def _asked(self, link: Link) -> tuple[Asked, ...]:
        return tuple(
            asked
            for asked in self.asked
            if f"{asked.answer.path}/".startswith(f"{link.path}/") and link.began_s <= asked.time_s <= link.time_s
        )
