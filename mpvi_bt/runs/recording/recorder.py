"""Writes the trace of a run as it happens. `docs/trace.md` is the contract of the format."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import itertools
import json
import math
import operator
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TextIO

from py_trees.behaviour import Behaviour
from py_trees.common import Status

import mpvi_bt
from mpvi_bt.executive.behaviors.context import Context, Notice, Query, Replan
from mpvi_bt.executive.monitors.handoff import Handoff
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.ticking.saved_run import SavedRun
from mpvi_bt.executive.trace.read import VERSION, Trace, read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.saving import SavedNode
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.state import NOT_BEGUN, NodeState
from mpvi_bt.executive.tree.yaml_io import expanded
from mpvi_bt.ground.errors import MpviError, NodeError, UserError
from mpvi_bt.ground.writing import unwritable

_ALWAYS = ("criterion", "event", "complete", "reason", "path")  # of a query
_OF_HANDOFF = ("path", "prompt", "began_s", "ended_s", "stopped_reason")  # likewise
_JSON = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


class Recorder(Watcher):
    """Subscriber that writes the trace: a line for each tick with a change.

    Every line is handed to the operating system at once, so that a kill costs the line being written at most. It writes
    none where nothing changed: what it then costs is one comparison for each node that was ticked.

    Args:
        file: Where to write.
        config: Of the run, for the first line. What JSON does not have (infinity, paths) is written as text.
        seed: Of the run.
        saved: Where the run goes on from. If the file tells of the same run up to there, it is continued.
    """

    def __init__(
        self,
        file: str | Path,
        config: Mapping[str, Any] | None = None,
        seed: int | None = None,
        saved: SavedRun | None = None,
    ) -> None:
        self._path, self._config, self._seed = Path(file), dict(config or {}), seed
        self._saved = saved
        self._file: TextIO | None = None

    def start(self, tree: Tree, world: World) -> None:
        """Open the file and write the first line. Raises UserError if it cannot be written."""
        earlier = self._earlier(tree, self._saved) if self._saved else None
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open(
                "a" if earlier else "w", encoding="utf-8", errors="replace", newline="\n", buffering=1
            )
        except OSError as error:
            raise unwritable(self._path, error) from None
        self._tree, self._world, self._began = tree, world, time.perf_counter()
        self._resumed_s, self._queries, self._notices = world.time_s, 0, 0
        self._replans = len(self._saved.replans) if self._saved else 0
        self._handoffs = len(self._saved.diagnosis) if self._saved else 0
        self._states: dict[str, NodeState] = {}
        self._changes: _Changes | None = None
        self._spec, self._nodes = tree.spec, tree.nodes
        self._blackboard: dict[str, Any] = {}
        if earlier is not None:
            self._states, self._blackboard = earlier.states(-1), earlier.blackboard(-1)
            self._began -= earlier.ticks[-1].wall_s
            return
        header = {
            "trace": VERSION,
            "mpvi_bt": mpvi_bt.__version__,
            "tree": expanded(tree.spec),
            "kinds": _kinds(tree.spec) or None,
            "config": self._config or None,
            "seed": self._seed,
            "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        }
        self._write({key: value for key, value in header.items() if value is not None})

    def _earlier(self, tree: Tree, saved: SavedRun) -> Trace | None:
        """What the file tells of the ticks before, all else taken off; None if it does not tell of this run."""
        try:
            trace = read_trace(self._path)
        except UserError:
            return None
        last = trace.index_at(saved.tree.ticks)
        if last < 0 or (trace.config, trace.seed) != (_plain(self._config), self._seed):
            return None
        if expanded(trace.tree_at(last)) != expanded(tree.spec) or not _is_where(saved, trace, last):
            return None
        lines = self._path.read_bytes().splitlines()
        self._path.write_bytes(b"".join(line + b"\n" for line in lines[: last + 2]))  # the first, and one for each tick
        return read_trace(self._path)

    def step(self, tree: Tree, world: World) -> None:
        """Write what this tick changed, if anything."""
        if tree.spec is not self._spec or self._changes is None:
            self._record(tree.states())
            self._changes = _Changes(tree)
            return
        context, changed = tree.context, self._changes.of(tree.touched)
        log = context.log
        counts = len(log.queries), len(log.notices), len(log.replans), len(log.diagnosis)
        told = counts == (self._queries, self._notices, self._replans, self._handoffs)
        if not changed and told and context.blackboard == self._blackboard:
            return
        self._record({vars(node)["path"]: tree.state_of(node) for node in changed})

    def end(self, outcome: Outcome) -> None:
        """Write how it ended and close the file. Raises BackendError if it cannot be written."""
        if self._file is None:
            return
        try:
            self._end(outcome)
        finally:
            with contextlib.suppress(OSError):  # what was not written before is not now
                self._file.close()

    def _end(self, outcome: Outcome) -> None:
        self._record(self._tree.states())  # what changed at a tick that an exception cut short
        last: dict[str, Any] = {"end": outcome.ending, **self._now()}
        if outcome.goal is not None:
            last["q"] = outcome.goal.q
            last["goal"] = [{"condition": c.text, "satisfied": c.satisfied} for c in outcome.goal.conditions]
        if outcome.log.clipped:
            last["clipped"] = outcome.log.clipped
        if outcome.failure is not None:
            last["failure"] = {key: value for key, value in vars(outcome.failure).items() if key != "cause"}
        if outcome.error is not None:
            last["error"] = _described(outcome.error)
        self._write(last)

    def _record(self, states: Mapping[str, NodeState]) -> None:
        """Write the changes since the last line, if there are any."""
        line: dict[str, Any] = {}
        others: set[str] = set()  # paths at which another node stands than before
        if self._tree.spec is not self._spec:
            self._spec = self._tree.spec
            line["tree"] = expanded(self._spec)
            others = {path for path, node in self._tree.nodes.items() if node is not self._nodes.get(path)}
            self._nodes = self._tree.nodes
        before = self._states
        new = {
            path: state
            for path, state in states.items()
            if path in others or not _same(state, before.get(path, NOT_BEGUN))
        }
        if new:
            before.update(new)
            line["nodes"] = {path: state.told() for path, state in new.items()}
        context: Context | None = getattr(self._tree, "context", None)  # none where setup failed
        if context is not None:
            if context.blackboard != self._blackboard:
                line["blackboard"] = _difference(self._blackboard, context.blackboard)
                self._blackboard = dict(context.blackboard)
            if len(context.log.queries) > self._queries:
                asked = context.log.queries[self._queries :]
                now_s = self._world.time_s
                line["queries"] = [_answer(query, now_s) for query in asked if query.time_s >= self._resumed_s]
                self._queries = len(context.log.queries)
            if len(context.log.notices) > self._notices:
                felt = context.log.notices[self._notices :]
                line["notices"] = [_noticed(notice) for notice in felt if notice.time_s >= self._resumed_s]
                self._notices = len(context.log.notices)
            if plans := context.log.replans[self._replans :]:
                line["replans"] = [_replanned(plan, self._world.time_s) for plan in plans]
                self._replans += len(plans)
            if handoffs := context.log.diagnosis[self._handoffs :]:
                line["diagnosis"] = [_diagnosed(handoff) for handoff in handoffs]
                self._handoffs += len(handoffs)
        if line:
            self._write(self._now() | line)

    def _now(self) -> dict[str, Any]:
        wall_s = round(time.perf_counter() - self._began, 4)
        return {"tick": self._tree.ticks, "time_s": self._world.time_s, "wall_s": wall_s}

    def _write(self, line: dict[str, Any]) -> None:
        assert self._file is not None
        try:
            text = _JSON.encode(line)
        except (TypeError, ValueError):
            text = _JSON.encode(_plain(line))
        try:
            self._file.write(text + "\n")
        except OSError as error:
            raise unwritable(self._path, error) from None


class _Changes:
    """Finds the nodes that may stand differently than after the tick before, looking at each as briefly as can be."""

    def __init__(self, tree: Tree) -> None:
        self._seen = {node: (node.status, node.feedback_message) for node in tree.nodes.values()}
        self._last: tuple[list[Behaviour], list[Status], list[str]] = ([], [], [])
        self._timed: list[Any] = [node for node in self._seen if getattr(node, "limit_s", None) is not None]
        self._times = self._ended()

    def of(self, touched: list[Behaviour]) -> list[Behaviour]:
        """Those that may, of those touched at a tick and those above them."""
        statuses, words = [node.status for node in touched], [node.feedback_message for node in touched]
        before, was, said = self._last
        self._last = touched, statuses, words
        seen, times = self._seen, self._ended()
        if touched != before:
            found = [node for node in touched if seen.get(node) != (node.status, node.feedback_message)]
        else:  # most ticks: whole lists compare in a tenth of the time
            found = [] if statuses == was else [*itertools.compress(touched, map(operator.is_not, statuses, was))]
            found += [] if words == said else itertools.compress(touched, map(operator.ne, words, said))
        if touched != before and Status.INVALID in statuses:
            # One that began and was interrupted within the tick has the status that it had.
            found += [node for node, status in zip(touched, statuses, strict=True) if status is Status.INVALID]
        if times != self._times:  # one that ended as it did before, but after another time
            found += itertools.compress(self._timed, map(operator.ne, times, self._times))
            self._times = times
        for node in found:
            if node in seen:  # not one inside a node that another package made
                seen[node] = (node.status, node.feedback_message)
        return [node for node in _with_ended_above(found) if node in seen]

    def _ended(self) -> list[float | None]:
        """Times that no longer go on."""
        return [None if node.status is Status.RUNNING else node.elapsed_s for node in self._timed]


def _with_ended_above(nodes: list[Behaviour]) -> Iterable[Behaviour]:
    """The nodes, and those above them that have ended: their failure may have another origin now."""
    found = dict.fromkeys(nodes)  # a set that keeps its order: equal runs write equal traces
    passed: set[Behaviour] = set()
    for node in nodes:
        above = node.parent
        while above is not None and above not in passed:
            passed.add(above)
            if above.status is not Status.RUNNING:
                found[above] = None
            above = above.parent
    return found


def _is_where(saved: SavedRun, trace: Trace, i: int) -> bool:
    """Whether nodes and blackboard stood after a tick of the trace as they were saved."""

    def stood(state: NodeState | SavedNode) -> tuple[object, ...]:
        unseen = state.status == "INVALID" and not state.interrupted
        return state.status, state.interrupted, "" if unseen else state.feedback

    fresh, nodes = SavedNode(status="INVALID"), saved.tree.nodes
    same = all(stood(state) == stood(nodes.get(path, fresh)) for path, state in trace.states(i).items())
    return same and trace.blackboard(i) == _plain(saved.blackboard)


def _kinds(tree: TreeSpec) -> dict[str, str]:
    """Node kinds of other packages, with the package's name."""
    types = (placed.spec.type for placed in tree.nodes if placed.spec.own is None)
    modules = {node.kind: node.factory.partition(":")[0].partition(".")[0] for node in types}
    return {kind: module for kind, module in modules.items() if module not in ("", mpvi_bt.__name__)}


def _same(new: NodeState, old: NodeState) -> bool:
    """Whether nothing changed but the time of a node that runs on."""
    if new.status == old.status == "RUNNING" and new.elapsed_s is not None and old.elapsed_s is not None:
        return dataclasses.replace(new, elapsed_s=old.elapsed_s) == old
    return new == old


def _difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """New values, and None for keys that are gone."""
    gone = dict.fromkeys(old.keys() - new.keys())
    return {key: value for key, value in new.items() if key not in old or old[key] != value} | gone


def _answer(query: Query, now_s: float) -> dict[str, Any]:
    """A query without default values; its time is written only if it was asked in an earlier tick."""
    data = dataclasses.asdict(query)
    asked_s = data.pop("time_s")
    told = {key: value for key, value in data.items() if key in _ALWAYS or value not in (None, "", 0)}
    return told | ({"asked_s": asked_s} if asked_s != now_s else {})


def _noticed(notice: Notice) -> dict[str, Any]:
    return {key: value for key, value in vars(notice).items() if key != "time_s"}


def _replanned(replan: Replan, now_s: float) -> dict[str, Any]:
    """Likewise; of no segments the number tells."""
    data = dataclasses.asdict(replan)
    asked_s = data.pop("time_s")
    told = {key: value for key, value in data.items() if key == "segments" or value not in ("", 0)}
    told = {key: value for key, value in told.items() if value is not None}
    return told | ({"asked_s": asked_s} if asked_s != now_s else {})


def _diagnosed(handoff: Handoff) -> dict[str, Any]:
    """The figures of a handoff without what is at its default."""
    told = {key: value for key, value in dataclasses.asdict(handoff).items() if value or key in _OF_HANDOFF}
    hands = {side: {key: value for key, value in hand.items() if value} for side, hand in told.get("hands", {}).items()}
    return told | ({"hands": hands} if hands else {})


def _described(error: Exception) -> dict[str, str]:
    """The exception that ended the run, and the path of the node that raised it."""
    if not isinstance(error, NodeError):
        return {"message": str(error) if isinstance(error, MpviError) else f"{type(error).__name__}: {error}"}
    optional = {"place": error.place, "reason": getattr(error.__cause__, "reason", "")}
    return {"path": error.path, "message": error.message, **{key: text for key, text in optional.items() if text}}


def _plain(value: Any) -> Any:
    """JSON data of anything: what JSON does not have becomes text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(inner) for inner in value]
    if isinstance(value, bool | int | str | None) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return str(value)
