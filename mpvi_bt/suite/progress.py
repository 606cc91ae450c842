"""A suite's progress: one redrawn line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from typing import TextIO

from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.result import Result
from mpvi_bt.suite.store import Fault


class Progress:
    """Listens to a run and writes how it goes."""

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.live = stream, stream.isatty()
        self.q: list[float] = []
        self.failed = self.faults = self.running = self.fresh = 0
        self.total, self.workers, self.began, self.drawn = 0, 1, time.monotonic(), ""

    def begin(self, results: Sequence[Result], todo: int, workers: int) -> None:
        """Count what is there and say so."""
        self.total, self.workers, self.began = len(results) + todo, workers, time.monotonic()
        for result in results:
            self._count(result)
        kept = f", {len(results)} already there" if results else ""
        processes = f" in {min(workers, todo)} worker processes" if todo else ""
        self._print(f"{self.total} episodes{kept}, {todo} to run{processes}")

    def finished(self, config: EpisodeConfig, result: Result) -> None:
        """Name the episode and its score."""
        self._count(result)
        self.fresh += 1
        line = f"{config.name}  q {result.q:.2f}  {result.time.simulator_time:.0f} s simulated"
        self._print(line if self.live else f"{line}  | {self.summary()}")

    def broke(self, config: EpisodeConfig, fault: Fault, again: bool) -> None:
        """Name the episode and what broke."""
        self.faults += not again
        self._print(f"{config.name}  {fault.kind}: {fault.message}; {'trying once more' if again else 'given up'}")

    def tick(self, running: int) -> None:
        """Redraw the line, on a terminal."""
        self.running = running
        if self.live:
            line = self.summary()[: shutil.get_terminal_size().columns - 1]
            if line != self.drawn:
                self._write(f"\r\x1b[2K{line}")
                self.drawn = line

    def end(self) -> None:
        """Take the redrawn line away."""
        self._clear()

    def summary(self) -> str:
        """Such as "4/10 done, 2 running, 1 failed, mean q 0.75, 2 min left"."""
        parts = [f"{len(self.q)}/{self.total} done", f"{self.running} running", f"{self.failed} failed"]
        if self.faults:
            parts.append(f"{self.faults} machine fault{'s' * (self.faults > 1)}")
        if self.q:
            parts.append(f"mean q {sum(self.q) / len(self.q):.2f}")
        left = self.total - len(self.q) - self.faults
        if self.fresh and left:
            parts.append(f"{_duration(left * (time.monotonic() - self.began) / self.fresh)} left")
        return ", ".join(parts)

    def _count(self, result: Result) -> None:
        self.q.append(result.q)
        self.failed += not result.success

    def _print(self, line: str) -> None:
        self._clear()
        self._write(line + "\n")

    def _clear(self) -> None:
        if self.drawn:
            self._write("\r\x1b[2K")
            self.drawn = ""

    def _write(self, text: str) -> None:
        self.stream.write(text)
        self.stream.flush()


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
