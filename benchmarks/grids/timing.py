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
        most: How many cases it is given, where it is slow; those once, and its memory is not measured.
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
        memory_mb: How much the process grew at most during its first case.
    """

    side: Side
    seconds: dict[tuple[int, int], float] = field(default_factory=dict)
    results: list[Any] = field(default_factory=list)
    memory_mb: float = math.nan


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
                    one.memory_mb = growth_mb(lambda one=one, case=case: one.side.run(case))
                began = time.perf_counter()
                result = one.side.run(case)
                one.seconds[turn, at] = time.perf_counter() - began
                if not turn:
                    one.results.append(result)
    return timed


def ratio(one: Timed, other: Timed) -> float:
    """The median over rounds and cases of one side's time by the other's."""
    return statistics.median(one.seconds[key] / other.seconds[key] for key in one.seconds if key in other.seconds)


def growth_mb(run: Callable[[], object]) -> float:
    """By how much the process's memory grew at most while `run` ran [MB]; nan where the system does not tell."""
    status, peak = Path("/proc/self/status"), Path("/proc/self/clear_refs")
    try:
        peak.write_text("5")  # the highest so far is now
        before = _kilobytes(status, "VmRSS")
        run()
        return max(_kilobytes(status, "VmHWM") - before, 0) / 1024
    except OSError:
        run()
        return math.nan


def _kilobytes(status: Path, what: str) -> int:
    (found,) = re.findall(rf"{what}:\s+(\d+)", status.read_text())
    return int(found)
