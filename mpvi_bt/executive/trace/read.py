"""Reading traces: the states of all nodes, tick by tick, as JSONL with changes only.

`docs/trace.md` is the contract of the format; `runs/recording/recorder.py` writes it. A trace may come from elsewhere,
or be cut off by a kill, so reading bounds and checks everything, and drops a last line that is not whole.
"""

from __future__ import annotations

import bisect
import dataclasses
import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, overload

from pydantic import TypeAdapter, ValidationError

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.drawing.endings import ended, is_plan
from mpvi_bt.executive.trace.lines import END, HEADER, TICK, End, Header, Tick
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.state import NodeState
from mpvi_bt.executive.tree.yaml_io import from_expanded
from mpvi_bt.ground.errors import FileProblems, Problem, UserError, shown
from mpvi_bt.ground.near_file import near_file

VERSION = 1
MAX_BYTES = 2**29
_MAX_PROBLEMS = 20
_SNAPSHOT_EVERY = 256  # ticks read again at most by a step back; Our choice: a few milliseconds
_SAME_S = 1e-6

_FIRST_KEY = re.compile(rb'\s*\{\s*"(\w+)"')


class Ticks(Sequence[Tick]):
    """The ticks of a trace, each parsed when it is asked for: a long trace need not fit in memory as objects."""

    def __init__(self, lines: Sequence[bytes]) -> None:
        self._lines = lines

    def __len__(self) -> int:
        return len(self._lines)

    @overload
    def __getitem__(self, i: int) -> Tick: ...

    @overload
    def __getitem__(self, i: slice) -> Sequence[Tick]: ...

    def __getitem__(self, i: int | slice) -> Tick | Sequence[Tick]:
        return Ticks(self._lines[i]) if isinstance(i, slice) else TICK.validate_json(self._lines[i], strict=True)


@dataclass
class Moment:
    """The full state after a tick; `apply` advances it to the next.

    Attributes:
        tree: In force.
        time_s: Simulated time.
        nodes: States by path as last recorded: times of running nodes are those of that record.
        blackboard: By key.
    """

    tree: TreeSpec
    time_s: float = 0.0
    nodes: dict[str, NodeState] = field(default_factory=dict)
    blackboard: dict[str, Value] = field(default_factory=dict)
    _began: dict[str, float] = field(default_factory=dict)  # of running nodes that count time

    def apply(self, tick: Tick) -> None:
        """Take in the next tick."""
        self.time_s = tick.time_s
        if tick.tree is not None:
            self.tree = from_expanded(tick.tree)
            kept = {placed.path for placed in self.tree.nodes}
            self.nodes = {path: state for path, state in self.nodes.items() if path in kept}
            self._began = {path: began for path, began in self._began.items() if path in kept}
        for path, state in tick.nodes.items():
            if state.status == "RUNNING" and state.elapsed_s is not None:
                began, before = tick.time_s - state.elapsed_s, self._began.get(path)
                if before is None or abs(began - before) > _SAME_S:
                    self._began[path] = began
            else:
                self._began.pop(path, None)
        self.nodes.update(tick.nodes)
        for key, value in tick.blackboard.items():
            if value is None:
                self.blackboard.pop(key, None)
            else:
                self.blackboard[key] = value

    def states(self, time_s: float | None = None) -> dict[str, NodeState]:
        """Every node's state; a running node's time goes on since the record, up to `time_s` if given."""
        now = self.time_s if time_s is None else time_s
        states = {placed.path: self.nodes.get(placed.path, _UNKNOWN) for placed in self.tree.nodes}
        for path, began in self._began.items():
            states[path] = dataclasses.replace(states[path], elapsed_s=now - began)
        return states

    def copy(self) -> Moment:
        """Independent of this one."""
        return Moment(self.tree, self.time_s, dict(self.nodes), dict(self.blackboard), dict(self._began))


_UNKNOWN = NodeState()


class Trace:
    """A recorded run.

    Attributes:
        file: Path as the user gave it.
        tree: As it was at the start.
        mpvi_bt: The version that wrote it.
        config: Of the run.
        seed: Of the run, or None.
        started: Date and time, ISO 8601, or "".
        ticks: Those at which something changed.
        end: How it ended; None where the trace was cut off.
    """

    def __init__(self, file: str, header: Header, tree: TreeSpec, ticks: Ticks, end: End | None) -> None:
        self.file, self.tree, self.ticks, self.end = file, tree, ticks, end
        self.mpvi_bt, self.config = header.mpvi_bt, header.config
        self.seed, self.started = header.seed, header.started
        self._every = max(_SNAPSHOT_EVERY, len(tree.nodes))  # so that snapshots take no more memory than the trace
        self._snapshots = [Moment(tree)]  # before tick 0, every, 2 every, ...
        self._at, self._moment = 0, Moment(tree)  # before tick _at

    @property
    def cut(self) -> bool:
        """Whether the end is missing: the run was killed, or still goes on."""
        return self.end is None

    @functools.cached_property
    def gave_up(self) -> int:
        """How many units were given up."""
        return sum(state.gave_up for tick in self.ticks for state in tick.nodes.values())

    @property
    def told(self) -> str:
        """How the run ended, in a line, q first where there is one."""
        end = self.end
        if end is None:
            return ended("cut", self.gave_up, time_s=self.time_at(self.last_tick))
        return ended(end.ending, self.gave_up, is_plan(self.tree), end.time_s, end.q)

    @property
    def last_tick(self) -> int:
        """Number of the last recorded tick; 0 if there is none."""
        return max(self.ticks[-1].tick if self.ticks else 0, self.end.tick if self.end else 0)

    def require_tick(self, tick: int) -> None:
        """Raise UserError if the trace has no tick of that number; 0 is before the first."""
        if tick > self.last_tick:
            raise UserError(f"{self.file}: there is no tick {tick}; the last is {self.last_tick}.")

    def time_at(self, tick: int) -> float:
        """Simulated time of a tick, by the changes before and after it."""
        i = self.index_at(tick)
        if i < 0:
            return 0.0
        here, after = self.ticks[i], self.ticks[i + 1] if i + 1 < len(self.ticks) else self.end
        if after is None or after.tick <= here.tick:
            return here.time_s
        share = min((tick - here.tick) / (after.tick - here.tick), 1.0)
        return here.time_s + share * (after.time_s - here.time_s)

    def states_at(self, tick: int) -> dict[str, NodeState]:
        """Every node's state at a tick, by its number; a running node's state has the time until then."""
        i = self.index_at(tick)
        return self._after(i).states(self.time_at(tick)) if i >= 0 else {}

    def states(self, i: int) -> dict[str, NodeState]:
        """Every node's state after `ticks[i]`, by path, in the order of drawing."""
        return self._after(i).states()

    def blackboard(self, i: int) -> dict[str, Value]:
        """The blackboard after `ticks[i]`."""
        return dict(self._after(i).blackboard)

    def tree_at(self, i: int) -> TreeSpec:
        """The tree that was ticked at `ticks[i]`."""
        return self._after(i).tree

    def index_at(self, tick: int) -> int:
        """Index of the last of `ticks` at or before a tick's number; -1 if there is none."""
        return bisect.bisect_right(self.ticks, tick, key=lambda change: change.tick) - 1

    def moments(self) -> Iterator[tuple[Tick, Moment]]:
        """Each tick with the full state after it. The moment is one object, updated in place."""
        moment = Moment(self.tree)
        for tick in self.ticks:
            moment.apply(tick)
            yield tick, moment

    def _after(self, i: int) -> Moment:
        if not -len(self.ticks) <= i < len(self.ticks):
            raise IndexError(f"tick {i} of {len(self.ticks)}")
        goal = i % len(self.ticks) + 1
        nearest = min(goal // self._every, len(self._snapshots) - 1)
        if not nearest * self._every <= self._at <= goal:
            self._at, self._moment = nearest * self._every, self._snapshots[nearest].copy()
        while self._at < goal:
            self._moment.apply(self.ticks[self._at])
            self._at += 1
            if self._at == len(self._snapshots) * self._every:
                self._snapshots.append(self._moment.copy())
        return self._moment


def read_trace(path: str | Path) -> Trace:
    """The trace in a file ("-": the standard input), up to its last whole line.

    Raises:
        UserError: There is no such file, or it cannot be read.
        FileProblems: It is no trace, of another version, too large, or broken before its last line.
    """
    lines: list[bytes] = []
    room = MAX_BYTES
    try:
        with Path("/dev/stdin" if str(path) == "-" else path).open("rb") as file:
            first = _FIRST_KEY.match(file.peek(200))
            if first is None or first[1] != b"trace":
                what = 'no trace of a run: its first line would begin with {"trace": 1'
                what = what + _trace_near(Path(path)) if file.peek(1) else "the file is empty"
                raise FileProblems([Problem(str(path), 1, 1, "no-trace", what)])
            while line := file.readline(room + 1):
                room -= len(line)
                if room < 0:
                    what = f"larger than {MAX_BYTES >> 20} MiB"
                    raise FileProblems([Problem(str(path), 0, 0, "too-large", what)])
                lines.append(line)
    except OSError as error:
        said = (error.strerror or "cannot be read").lower()
        near = _trace_near(Path(path))
        if not near and isinstance(error, FileNotFoundError):
            near = near_file(Path(path), ". ")
        raise UserError(f"{path}: {said}{near}") from None
    return _read(str(path), lines)


def _trace_near(path: Path) -> str:
    """The end of a message about what is no trace: that of the same run, or a folder's newest; "": there is none."""
    if path.is_dir():
        newest = max(path.glob("*.trace.jsonl"), key=lambda file: file.stat().st_mtime, default=None)
        return f"; its newest trace is {newest}" if newest else ""
    beside = path.with_suffix(".trace.jsonl")
    return f"; the trace of that run is {beside}" if beside != path and beside.is_file() else ""


def _read(file: str, lines: Sequence[bytes]) -> Trace:
    """The trace of these lines. Raises FileProblems."""
    reader = LineReader(file)
    header, tree = reader.first(lines[0], alone=len(lines) == 1)
    end: End | None = None
    kept: list[bytes] = []
    for number, line in enumerate(lines[1:], 2):
        read = reader.next(line, torn=number == len(lines) and not line.endswith(b"\n"))
        if isinstance(read, End):
            end = read
        elif read is not None:
            kept.append(line)
        if len(reader.problems) >= _MAX_PROBLEMS:
            break
    if reader.problems:
        raise FileProblems(reader.problems)
    return Trace(file, header, tree, Ticks(kept), end)


class LineReader:
    """Checks the lines of a trace one after the other.

    Attributes:
        problems: Found so far.
    """

    def __init__(self, file: str) -> None:
        """Read what is called `file` in problems."""
        self.file = file
        self.problems: list[Problem] = []
        self._number = 1
        self._tick = 0
        self._paths: set[str] = set()
        self._ended = False

    def first(self, line: bytes, alone: bool = False) -> tuple[Header, TreeSpec]:
        """The first line, and its tree; `alone`: nothing follows, so it may be cut off. Raises FileProblems."""
        header, tree = self._header(line, alone)
        self._paths = {placed.path for placed in tree.nodes}
        return header, tree

    def next(self, line: bytes, torn: bool = False) -> Tick | End | None:
        """The next line, or None if it is wrong, or `torn`: cut off while it was written."""
        self._number += 1
        if self._ended and not torn:
            self._problem("after-end", "a line after the one that ends the trace")
        first = _FIRST_KEY.match(line)
        read: Tick | End | None = self._parse(END if first and first[1] == b"end" else TICK, line, torn)
        if isinstance(read, End):
            self._ended = True
        elif read is not None:
            if read.tree is not None and (swapped := self._tree(read.tree)):
                self._paths = {placed.path for placed in swapped.nodes}
            if read.tick < self._tick:
                self._problem("order", f"tick {read.tick} after tick {self._tick}")
            if not read.nodes.keys() <= self._paths:
                stranger = next(iter(read.nodes.keys() - self._paths))
                self._problem("unknown-path", f"the tree has no node {stranger!r}")
            self._tick = read.tick
        return read

    def _header(self, line: bytes, alone: bool) -> tuple[Header, TreeSpec]:
        if alone and not line.endswith(b"\n") and not _is_json(line):
            raise FileProblems([Problem(self.file, 1, 1, "no-trace", "cut off within its first line")])
        header = self._parse(HEADER, line)
        if header is not None and header.trace != VERSION:
            self._problem("version", f"version {header.trace} of the format; this mpvi_bt reads version {VERSION}")
        for kind, package in header.kinds.items() if header else ():
            if kind not in node_types():
                message = f"its nodes of kind {shown(kind)} are of package {shown(package)}, which is not installed"
                self._problem("unknown-node", message)
        tree = self._tree(header.tree) if header is not None and not self.problems else None
        if header is None or tree is None:
            raise FileProblems(self.problems)
        return header, tree

    def _tree(self, data: dict[str, Any]) -> TreeSpec | None:
        try:
            return from_expanded(data)
        except FileProblems as error:
            for problem in error.problems[:_MAX_PROBLEMS]:
                self._problem(problem.code, f"tree: {problem.message}")
            return None

    def _parse(self, adapter: TypeAdapter[Any], line: bytes, torn: bool = False) -> Any:
        try:
            return adapter.validate_json(line, strict=True)
        except ValidationError as error:
            if torn and not _is_json(line):
                return None
            for item in error.errors(include_url=False, include_input=False)[:_MAX_PROBLEMS]:
                where = ".".join(map(str, item["loc"]))
                column = re.search(r"at line 1 column (\d+)", item["msg"])
                message = item["msg"].removesuffix(column[0]).strip() if column else item["msg"]
                code = "syntax" if item["type"] == "json_invalid" else "invalid-value"
                self._problem(code, f"{where}: {message}" if where else message, int(column[1]) if column else 1)
            return None

    def _problem(self, code: str, message: str, column: int = 1) -> None:
        self.problems.append(Problem(self.file, self._number, column, code, message))


def _is_json(line: bytes) -> bool:
    try:
        TypeAdapter(Any).validate_json(line)
    except ValidationError:
        return False
    return True
