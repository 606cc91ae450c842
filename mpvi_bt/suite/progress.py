"""A suite's progress: one redrawn line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import shutil
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TextIO

from mpvi_bt.drawing.cells import one_line
from mpvi_bt.drawing.terminal import draw
from mpvi_bt.errors import bounded
from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.result import Result
from mpvi_bt.suite.schedule import Pace
from mpvi_bt.suite.store import Fault


class Progress:
    """Listens to a run and writes how it goes.

    Args:
        stream: Where to.
        pace: Says how much time is left.
    """

    def __init__(self, stream: TextIO, pace: Pace) -> None:
        self.stream, self.live, self.pace = stream, stream.isatty(), pace
        self.q: list[float] = []
        self.waiting: dict[EpisodeConfig, None] = {}
        self.running: dict[EpisodeConfig, float] = {}
        self.total = self.succeeded = 0
        self.faults: Counter[str] = Counter()
        self.workers, self.drawn = 1, ""

    def begin(self, results: Mapping[EpisodeConfig, Result], todo: Sequence[EpisodeConfig], workers: int) -> None:
        """Count what is there and say so."""
        self.total, self.workers, self.waiting = len(results) + len(todo), workers, dict.fromkeys(todo)
        for config, result in results.items():
            self._count(config, result)
        kept = f", {len(results)} already there" if results else ""
        processes = f" in {min(workers, len(todo))} worker processes" if todo and workers else ""
        self._print(f"{self.total} episodes{kept}, {len(todo)} to run{processes}")

    def corrupt(self, config: EpisodeConfig, moved: Path) -> None:
        """Say where the file is now."""
        self._print(f"{_name(config)}  its result file is broken; moved to {moved}, and to run again")

    def started(self, config: EpisodeConfig) -> None:
        """Note when."""
        self.waiting.pop(config, None)
        self.running[config] = time.monotonic()

    def finished(self, config: EpisodeConfig, result: Result) -> None:
        """Name the episode and its score."""
        self.running.pop(config, None)
        self._count(config, result)
        line = f"{_name(config)}  q {result.q:.2f}  {result.time.simulator_time:.0f} s simulated"
        self._print(line if self.live else f"{line}  | {self.summary()}")

    def broke(self, config: EpisodeConfig, fault: Fault, again: bool) -> None:
        """Name the episode and what broke."""
        self.running.pop(config, None)
        if again:
            self.waiting[config] = None
        self.faults[fault.kind] += not again
        self._print(f"{_name(config)}  {fault.kind}: {fault.message}; {'trying once more' if again else 'given up'}")

    def tick(self, workers: int) -> None:
        """Redraw the line, on a terminal."""
        self.workers = workers
        if self.live:
            line = self.summary()[: shutil.get_terminal_size().columns - 1]
            if line != self.drawn:
                self._write(f"\r\x1b[2K{line}")
                self.drawn = line

    def end(self) -> None:
        """Take the redrawn line away."""
        self._clear()

    def summary(self) -> str:
        """Such as "4/10 done, mean q 0.75, 3 reached the goal, 2 running, 2 min left"."""
        mean = sum(self.q) / len(self.q) if self.q else None
        parts = [standing(len(self.q), self.total, self.succeeded, mean, self.faults), f"{len(self.running)} running"]
        now = time.monotonic()
        left = self.pace.left_s(self.waiting, {c: now - then for c, then in self.running.items()}, self.workers)
        if left > 0 and math.isfinite(left):
            parts.append(f"{_duration(left)} left")
        return ", ".join(parts)

    def _count(self, config: EpisodeConfig, result: Result) -> None:
        self.q.append(result.q)
        self.succeeded += result.success
        if isinstance(wall := result.wall.get("total_s"), int | float):
            self.pace.learn(config, wall)

    def _print(self, line: str) -> None:
        self._clear()
        self._write(bounded(one_line(line)) + "\n")

    def _clear(self) -> None:
        if self.drawn:
            self._write("\r\x1b[2K")
            self.drawn = ""

    def _write(self, text: str) -> None:
        draw(self.stream, text)


def standing(done: int, total: int, succeeded: int, mean_q: float | None, faults: Mapping[str, int]) -> str:
    """How far a suite is: q and who reached the goal apart from what broke, which says nothing of any policy.

    Args:
        done, total: Episodes with a result, and all.
        succeeded: Of those done, that reached the whole goal.
        mean_q: Over those done.
        faults: How many episodes broke, by kind.
    """
    parts = [f"{done}/{total} done"]
    if mean_q is not None:
        parts += [f"mean q {mean_q:.2f}", f"{succeeded} reached the goal"]
    parts += [f"{number} {kind}{'s' * (number > 1)}" for kind, number in faults.items() if number]
    return ", ".join(parts)


def _name(config: EpisodeConfig) -> str:
    return f"{config.method} {config.name}" if config.method else config.name


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
