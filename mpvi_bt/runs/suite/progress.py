"""A suite's progress: on a terminal a few redrawn lines, one of them a worker's; plain lines elsewhere."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TextIO

from mpvi_bt.executive.drawing.cells import cut, one_line
from mpvi_bt.executive.drawing.terminal import draw
from mpvi_bt.ground.errors import bounded
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.suite.schedule import EpisodeTimes
from mpvi_bt.runs.suite.store import Fault


class SuiteProgress:
    """Listens to a run and writes how it goes.

    Args:
        stream: Where to.
        pace: Says how much time is left.
    """

    def __init__(self, stream: TextIO, pace: EpisodeTimes) -> None:
        self.stream, self.live, self.pace = stream, stream.isatty(), pace
        self.q: list[float] = []
        self.waiting: dict[EpisodeConfig, None] = {}
        self.running: dict[EpisodeConfig, tuple[int, float]] = {}
        self.total = self.succeeded = 0
        self.faults: Counter[str] = Counter()
        self.workers, self.drawn = 1, list[str]()

    def begin(self, results: Mapping[EpisodeConfig, Result], todo: Sequence[EpisodeConfig], workers: int) -> None:
        """Count what is there and say so."""
        self.total, self.workers, self.waiting = len(results) + len(todo), workers, dict.fromkeys(todo)
        for config, result in results.items():
            self._count(config, result)
        kept = f", {len(results)} already there" if results else ""
        at_once = min(workers, len(todo))
        processes = f" in {at_once} worker process{'es' * (at_once > 1)}" if at_once else ""
        left_s = self.pace.left_s(todo, {}, at_once or 1) if todo else None
        takes = f", {span(*left_s)}" if left_s else ""
        self._print(f"{self.total} episode{'s' * (self.total != 1)}{kept}, {len(todo)} to run{processes}{takes}")

    def corrupt(self, config: EpisodeConfig, moved: Path) -> None:
        """Say where the file is now."""
        self._print(f"{_name(config)}  its result file is broken; moved to {moved}, and to run again")

    def started(self, config: EpisodeConfig, worker: int) -> None:
        """Note when, and who plays it."""
        self.waiting.pop(config, None)
        self.running[config] = worker, time.monotonic()
        if not self.live:
            self._print(f"{_name(config)}  begins, worker {worker}")

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
        """Redraw the lines, on a terminal."""
        self.workers = workers
        if self.live:
            size = shutil.get_terminal_size()
            lines = [cut(one_line(line), size.columns - 1) for line in (self.summary(), *self.at_work(size.lines - 3))]
            if lines != self.drawn:
                self._clear()
                self._write("\n".join(lines))
                self.drawn = lines

    def at_work(self, room: int = 1000) -> list[str]:
        """A line for each worker; the last counts those for which there is no room."""
        now = time.monotonic()
        lines = [
            at_work_text(worker, _name(config), now - then, self.pace.expected_s(config))
            for config, (worker, then) in sorted(self.running.items(), key=lambda item: item[1])
        ]
        room = max(room, 1)
        return lines if len(lines) <= room else [*lines[: room - 1], f"  and {len(lines) - room + 1} more"]

    def end(self) -> None:
        """Take the redrawn lines away."""
        self._clear()

    def summary(self) -> str:
        """Such as "4/10 done, 2 to 5 min left, mean q 0.75, 3 reached the goal, 2 running"."""
        mean = sum(self.q) / len(self.q) if self.q else None
        now = time.monotonic()
        running = {c: now - then for c, (_, then) in self.running.items()}
        left_s = self.pace.left_s(self.waiting, running, self.workers) if self.waiting or running else None
        stand = standing(len(self.q), self.total, self.succeeded, mean, self.faults, left_s)
        return f"{stand}, {len(self.running)} running"

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
            up = f"\x1b[{len(self.drawn) - 1}A" if len(self.drawn) > 1 else ""
            self._write(f"\r{up}\x1b[J")
            self.drawn = []

    def _write(self, text: str) -> None:
        draw(self.stream, text)


def standing(
    done: int,
    total: int,
    succeeded: int,
    mean_q: float | None,
    faults: Mapping[str, int],
    left_s: tuple[float, float] | None = None,
) -> str:
    """Progress of a suite in words. Crashed episodes are counted apart: they say nothing about a policy.

    Args:
        done, total: Episodes with a result, and all.
        succeeded: Of those done, that reached the whole goal.
        mean_q: Over those done.
        faults: How many episodes broke, by kind.
        left_s: Wall time until all are through, from and to; None: it is not told.
    """
    parts = [f"{done}/{total} done"]
    parts += [f"{span(*left_s)} left"] if left_s is not None else []
    if mean_q is not None:
        parts += [f"mean q {mean_q:.2f}", f"{succeeded} reached the goal"]
    parts += [f"{number} {kind}{'s' * (number > 1)}" for kind, number in faults.items() if number]
    return ", ".join(parts)


def at_work_text(worker: int, episode: str, since_s: float, expected_s: float | None) -> str:
    """Such as "  worker 1: picking_up_trash_0_0, 12 s of about 40 s"; before any episode ran only the first time."""
    of = "" if expected_s is None else f" of about {duration(expected_s)}"
    return f"  worker {worker}: {episode}, {duration(since_s)}{of}"


def _name(config: EpisodeConfig) -> str:
    return f"{config.method} {config.name}" if config.method else config.name


def duration(seconds: float) -> str:
    """In words of about two digits."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def span(low_s: float, high_s: float) -> str:
    """From and to, such as "2 to 5 min", "40 s to 3 min", or "about 2 min"."""
    low, high = duration(low_s), duration(high_s)
    if low == high:
        return f"about {low}"
    number, _, unit = low.partition(" ")
    return f"{number if high.endswith(f' {unit}') else low} to {high}"
