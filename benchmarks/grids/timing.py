"""Sides that do the same job, timed in turns."""

from __future__ import annotations

import math
import re
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Side:
    """One way to do a job.

    Attributes:
        name: Whose it is.
        run: Takes a case, gives a result.
        group: Only results of one group can be compared.
        most: How many cases it is given, where it is slow; those once.
    """

    name: str
    run: Callable[[Any], Any]
    group: str = ""
    most: int | None = None


@dataclass
class Timed:
    """What came of one side.

    Attributes:
        side: That side.
        seconds: By round and case.
        results: By case.
        memory_mb: How much the process grew at most during a case; 0 where the system does not tell.
    """

    side: Side
    seconds: dict[tuple[int, int], float] = field(default_factory=dict)
    results: list[Any] = field(default_factory=list)
    memory_mb: float = 0.0


def in_turns(sides: Sequence[Side], cases: Sequence[Any], rounds: int, tell: Callable[[str], None]) -> list[Timed]:
    """Time every side on every case, in turns: noise meets all of them."""
    timed = [Timed(side) for side in sides]
    for turn in range(rounds):
        for at, case in enumerate(cases):
            tell(f"round {turn + 1} of {rounds}, case {at + 1} of {len(cases)}")
            for one in timed if (turn + at) % 2 else reversed(timed):
                if one.side.most is not None and (turn or at >= one.side.most):
                    continue
                if not turn and not at and one.side.most is None:
                    one.side.run(case)  # compiled, loaded
                before = _start_peak()
                began = time.perf_counter()
                result = one.side.run(case)
                one.seconds[turn, at] = time.perf_counter() - began
                one.memory_mb = max(one.memory_mb, _peak_mb() - before)  # nan is no more than it was
                if not turn:
                    one.results.append(result)
    return timed


def ratio(one: Timed, other: Timed) -> float:
    """The median over rounds and cases of one side's time by the other's."""
    return statistics.median(one.seconds[key] / other.seconds[key] for key in one.seconds if key in other.seconds)


_STATUS = Path("/proc/self/status")


def _start_peak() -> float:
    """Measure the process's highest memory from now on; what it is now [MB], nan where the system does not tell."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
        return _megabytes("VmRSS")
    except OSError:
        return math.nan


def _peak_mb() -> float:
    try:
        return _megabytes("VmHWM")
    except OSError:
        return math.nan


def _megabytes(what: str) -> float:
    (found,) = re.findall(rf"{what}:\s+(\d+)", _STATUS.read_text())
    return int(found) / 1024
