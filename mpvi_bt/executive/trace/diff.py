"""The first difference between two runs: the first tick with other node states or another blackboard."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from mpvi_bt.executive.drawing.cells import columns, cut, one_line
from mpvi_bt.executive.drawing.endings import ENDED
from mpvi_bt.executive.drawing.symbols import MARKS, standing
from mpvi_bt.executive.trace.lines import Tick
from mpvi_bt.executive.trace.read import Moment, Trace
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.state import NodeState

_NEVER = NodeState()
_SHOWN = 8  # of anything; --json has all
_CONTEXT = 3  # changes that both runs shared right before they parted


@dataclass(frozen=True)
class NodeDifference:
    """A node that stands differently in the two runs."""

    path: str
    a: NodeState
    b: NodeState


@dataclass(frozen=True)
class ValueDifference:
    """Something with a name that has another value in each run; None: none."""

    name: str
    a: Any
    b: Any


@dataclass(frozen=True)
class Shared:
    """A change that both runs made at the same tick."""

    tick: int
    time_s: float
    path: str
    state: NodeState


@dataclass(frozen=True)
class Difference:
    """How two runs differ. Wall time is not compared.

    Attributes:
        settings: Versions, seeds and configurations; runs that differ in nothing else are the same.
        trees: Labels of nodes by path, where the trees differ at the start.
        tick, time_s: The first tick at which the runs part, and its simulated time; None if there is none.
        nodes, blackboard: What stands differently after that tick.
        before: The last changes that both made before it.
        end: How each ended, where they part by that alone; "cut" for one whose trace was cut off there.
    """

    settings: tuple[ValueDifference, ...] = ()
    trees: tuple[ValueDifference, ...] = ()
    tick: int | None = None
    time_s: float | None = None
    nodes: tuple[NodeDifference, ...] = ()
    blackboard: tuple[ValueDifference, ...] = ()
    before: tuple[Shared, ...] = ()
    end: ValueDifference | None = None

    @property
    def same(self) -> bool:
        """The runs went the same way."""
        return self.tick is None and not self.trees and self.end is None


def diff(a: Trace, b: Trace) -> Difference:
    """How two runs differ."""
    found = Difference(settings=tuple(_settings(a, b)), trees=tuple(_trees(a.tree, b.tree)))
    one, other = Moment(a.tree), Moment(b.tree)
    before: list[Shared] = []
    for first, second in _together(a, b):
        for moment, change in ((one, first), (other, second)):
            if change is not None:
                moment.apply(change)
        change = first or second
        assert change is not None
        paths = dict.fromkeys(path for c in (first, second) if c for path in c.nodes)
        keys = dict.fromkeys(key for c in (first, second) if c for key in c.blackboard)
        nodes = tuple(_nodes(paths, one, other))
        values = tuple(_values(one.blackboard, other.blackboard, keys))
        swapped = any(c.tree is not None for c in (first, second) if c)
        trees = found.trees or (tuple(_trees(one.tree, other.tree)) if swapped else ())
        if nodes or values or trees != found.trees:
            return replace(
                found,
                trees=trees,
                tick=change.tick,
                time_s=change.time_s,
                nodes=nodes,
                blackboard=values,
                before=tuple(before),
            )
        before += [
            Shared(change.tick, change.time_s, path, state)
            for path, state in change.nodes.items()
            if state.status != "INVALID"  # what was reset tells little
        ]
        del before[:-_CONTEXT]
    ends = _ending(a), _ending(b)
    end = ValueDifference("end", *ends) if ends[0] != ends[1] else None
    return replace(found, end=end, before=tuple(before) if end else ())


def _together(a: Trace, b: Trace) -> Iterator[tuple[Tick | None, Tick | None]]:
    """The changes of both at each tick at which either has some, as far as both go."""
    last = min(_ending(a)["tick"], _ending(b)["tick"])
    ticks = iter(a.ticks), iter(b.ticks)
    first, second = (next(t, None) for t in ticks)
    while first or second:
        tick = min(change.tick for change in (first, second) if change)
        if tick > last:
            return
        now = tuple(change if change and change.tick == tick else None for change in (first, second))
        yield now[0], now[1]
        first = next(ticks[0], None) if now[0] else first
        second = next(ticks[1], None) if now[1] else second


def _ending(trace: Trace) -> dict[str, Any]:
    if trace.end is None:
        return {"ending": "cut", "tick": trace.ticks[-1].tick if trace.ticks else 0}
    error = {"error": trace.end.error.message} if trace.end.error else {}
    score = {"q": trace.end.q} if trace.end.q is not None else {}
    return {"ending": trace.end.ending, "tick": trace.end.tick} | score | error


def _settings(a: Trace, b: Trace) -> Iterator[ValueDifference]:
    versions = [{"mpvi_bt": trace.mpvi_bt, "seed": trace.seed} for trace in (a, b)]
    yield from _values(*versions)
    yield from _values(_flat(a.config), _flat(b.config))


def _flat(config: Mapping[str, Any], prefix: str = "config") -> dict[str, Any]:
    """Values by their names joined with dots."""
    flat: dict[str, Any] = {}
    for key, value in config.items():
        name = f"{prefix}.{key}"
        flat |= _flat(value, name) if isinstance(value, dict) and value else {name: value}
    return flat


def _trees(a: TreeSpec, b: TreeSpec) -> Iterator[ValueDifference]:
    yield from _values(*({n.path: f"{n.spec.glyph} {n.spec.label}" for n in tree.nodes} for tree in (a, b)))


def _values(a: Mapping[str, Any], b: Mapping[str, Any], keys: Iterable[str] | None = None) -> Iterator[ValueDifference]:
    for key in {**a, **b} if keys is None else keys:
        if a.get(key) != b.get(key):
            yield ValueDifference(key, a.get(key), b.get(key))


def _nodes(paths: Iterable[str], a: Moment, b: Moment) -> list[NodeDifference]:
    """The deepest first, as what is above follows from it."""
    states = ((path, a.nodes.get(path, _NEVER), b.nodes.get(path, _NEVER)) for path in paths)
    found = [
        NodeDifference(path, one, other)
        for path, one, other in states
        if one != other and replace(one, elapsed_s=None) != replace(other, elapsed_s=None)
    ]
    if len(found) > 1:
        order = {node.path: (-node.depth, i) for i, node in enumerate((*b.tree.nodes, *a.tree.nodes))}
        found.sort(key=lambda node: order[node.path])
    return found


def difference_text(difference: Difference, names: tuple[str, str] = ("first", "second"), width: int = 80) -> str:
    """The difference for a person, no line wider than `width`.

    Args:
        difference: What to tell.
        names: Of the two traces, such as their files.
        width: Columns.
    """
    d = difference
    text = _CutLines(width)
    text.add(f"A  {names[0]}")
    text.add(f"B  {names[1]}")
    text.section("settings that differ:", [(v.name, _value(v.a), _value(v.b)) for v in d.settings])
    text.section("the trees differ:", [(v.name, _value(v.a), _value(v.b)) for v in d.trees])
    if d.before:
        text.add("", "the last that both did:")
        for shared in d.before:
            text.add(f"  {shared.time_s:7.1f} s  {text.path(shared.path, width // 2)}: {_stands(shared.state)}")
    if d.tick is not None:
        text.section(
            f"they part at {d.time_s:.1f} s, tick {d.tick}:", [(n.path, _stands(n.a), _stands(n.b)) for n in d.nodes]
        )
        text.section("blackboard:", [(v.name, _value(v.a), _value(v.b)) for v in d.blackboard])
    elif d.end is not None:
        text.section("they went the same way, and part by their ends:", [("end", _ended(d.end.a), _ended(d.end.b))])
    else:
        text.add("", "apart from that they went the same way" if d.trees else "they went the same way")
    return "\n".join(text.lines)


class _CutLines:
    """Lines that are cut at a width."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.lines: list[str] = []

    def add(self, *lines: str) -> None:
        self.lines += [cut(line, self.width) for line in lines]

    def section(self, title: str, rows: list[tuple[str, str, str]]) -> None:
        """A title, and what something is in either run; the first few."""
        if not rows:
            return
        self.add("", title)
        for name, a, b in rows[:_SHOWN]:
            self.add(f"  {self.path(name, self.width - 2)}", f"    A  {a}", f"    B  {b}")
        if len(rows) > _SHOWN:
            self.add(f"  ... and {len(rows) - _SHOWN} more")

    def path(self, path: str, width: int) -> str:
        """A path that is too long loses its first names."""
        names = [one_line(name) for name in path.split("/")]
        short = "/".join(names)
        while len(names) > 1 and columns(short) > width:
            del names[0]
            short = "/".join(["...", *names])
        return cut(short, width)


def _value(value: Any) -> str:
    return "-" if value is None else one_line(value if isinstance(value, str) else json.dumps(value))


def _stands(state: NodeState) -> str:
    why = ": ".join(filter(None, (state.reason, state.evidence)))
    return f"{MARKS[standing(state)].word}  {one_line(state.feedback or why)}".rstrip()


def _ended(end: Mapping[str, Any]) -> str:
    how = (f"q = {end['q']:.3f}, " if "q" in end else "") + ENDED[end["ending"]]
    error = f": {one_line(end['error'])}" if "error" in end else ""
    return f"{how} after tick {end['tick']}{error}"
