"""Suites of fake episodes, for the tests of what runs them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.suite.processes import ProcessEngine
from mpvi_bt.runs.suite.store import Fault

ROOT = Path(__file__).parent.parent
FAKE = "tests.fake_episodes:run"
EPISODES = [EpisodeConfig("picking_up_trash", instance) for instance in range(10)]


class Heard:
    """A listener that remembers."""

    def __init__(self) -> None:
        self.kept = self.todo = -1
        self.done: list[EpisodeConfig] = []
        self.faults: list[tuple[int, bool]] = []
        self.moved: list[Path] = []
        self.ended = False

    def begin(self, results: Mapping[EpisodeConfig, Result], todo: Sequence[EpisodeConfig], workers: int) -> None:
        self.kept, self.todo = len(results), len(todo)

    def corrupt(self, config: EpisodeConfig, moved: Path) -> None:
        self.moved.append(moved)

    def started(self, config: EpisodeConfig, worker: int) -> None:
        pass

    def finished(self, config: EpisodeConfig, result: Result) -> None:
        self.done.append(config)

    def broke(self, config: EpisodeConfig, fault: Fault, again: bool) -> None:
        self.faults.append((config.instance, again))

    def tick(self, workers: int) -> None:
        pass

    def end(self) -> None:
        self.ended = True


def processes(workers: int, wall_limit_s: float = 60.0) -> ProcessEngine:
    """Workers that play fake episodes."""
    return ProcessEngine(workers, FAKE, wall_limit_s)


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where fake episodes note that they ran."""
    folder = tmp_path / "log"
    folder.mkdir()
    monkeypatch.setenv("FAKE_LOG", str(folder))
    return folder


def started(log: Path, what: str = "start") -> Counter[str]:
    """How often each episode started (or ended)."""
    return Counter(path.name.split(f".{what}.")[0] for path in log.iterdir() if f".{what}." in path.name)


def alive(pid: int) -> bool:
    """Whether the process runs; one that only waits to be reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def wait_until(true: Callable[[], bool], seconds: float = 60) -> None:
    """Fail unless it comes true in time."""
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.02)


def launch(
    out: Path, log: Path, *words: str, suite: str = "trash10", workers: int = 2, **env: str
) -> subprocess.Popen[str]:
    """`mpvi suite run` over fake episodes, in a process group of its own."""
    command = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()", "suite", "run", suite, *words]
    return subprocess.Popen(
        [*command, "--out", str(out), "--workers", str(workers), "--episode", FAKE],
        cwd=ROOT,
        env={**os.environ, "FAKE_LOG": str(log), **env},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def running(log: Path) -> set[int]:
    """The processes that noted anything and still run."""
    return {pid for path in log.iterdir() if alive(pid := int(path.name.split(".")[-2]))}


def without_wall(path: Path) -> Any:
    """A result without its wall times."""
    return {key: value for key, value in json.loads(path.read_text()).items() if key != "wall"}
