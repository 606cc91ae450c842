"""Runs a suite: what is done stays done, and nothing runs twice.

An episode whose worker dies, breaks or hangs is tried once more. What breaks twice is a machine fault: it gets no
result, is reported as such, and the next run tries it again. Only this process writes results, so that a worker that
outlives it for a moment, or a machine that was thought to be lost, never writes one a second time.
"""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.version import __version__
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.suite.at_work import AtWork, note
from mpvi_bt.runs.suite.manifest import Manifest
from mpvi_bt.runs.suite.store import Fault, Store
from mpvi_bt.runs.suite.worker import Played

ATTEMPTS = 2
_POLL_S = 0.2


class Engine(Protocol):
    """Where episodes are played: `processes.ProcessEngine`, `ray_engine.RayEngine`."""

    @property
    def workers(self) -> int:
        """How many episodes may be at work at once, now."""
        ...

    def open(self) -> None:
        """Make ready to start."""
        ...

    def start(self, config: EpisodeConfig) -> None:
        """Begin an episode."""
        ...

    def wait(self, seconds: float) -> Iterator[tuple[EpisodeConfig, Played]]:
        """Yield episodes as they end, each once; return after that many seconds at the latest."""
        ...

    def close(self) -> None:
        """Stop whatever is at work."""
        ...


class RunListener(Protocol):
    """Is told how a run goes."""

    def begin(self, results: Mapping[EpisodeConfig, Result], todo: Sequence[EpisodeConfig], workers: int) -> None:
        """Called at the start, with earlier results and the episodes left to play."""
        ...

    def corrupt(self, config: EpisodeConfig, moved: Path) -> None:
        """A file that was to be an episode's result and is none was put aside; the episode is run again."""
        ...

    def started(self, config: EpisodeConfig, worker: int) -> None:
        """An episode begins, with the worker of that number, from 1."""
        ...

    def finished(self, config: EpisodeConfig, result: Result) -> None:
        """An episode has a result."""
        ...

    def broke(self, config: EpisodeConfig, fault: Fault, again: bool) -> None:
        """An episode met a machine fault; it is tried again, or given up."""
        ...

    def tick(self, workers: int) -> None:
        """A moment passed; how many may be at work now."""
        ...

    def end(self) -> None:
        """Nothing more will come."""
        ...


@dataclass(frozen=True)
class SuiteOutcome:
    """How the episodes of a suite stand, in their order."""

    episodes: list[EpisodeConfig]
    results: dict[EpisodeConfig, Result]
    faults: dict[EpisodeConfig, Fault]


def run_suite(
    episodes: Iterable[EpisodeConfig],
    store: Store,
    engine: Engine,
    listener: RunListener,
    order: Callable[[Sequence[EpisodeConfig]], Iterable[EpisodeConfig]] = iter,
    manifest: Manifest | None = None,
) -> SuiteOutcome:
    """Run every episode that has no valid result yet.

    Args:
        episodes: Each once.
        store: Where results are and go.
        engine: Plays them; it is opened only if there is anything to run.
        listener: Is told how it goes.
        order: In which episodes are begun; those that have a result are passed over.
        manifest: What the results are of; the folder must hold no others.

    Raises:
        UserError: Bad input; or the folder is in use, or holds results of another configuration.
        BackendError: Every episode would break alike, or none can be started, or the disk is full.
        KeyboardInterrupt: After the workers were stopped.
    """
    episodes = list(episodes)
    with store.locked(episodes):
        if manifest is not None:
            manifest.claim(store.out)
        results = {config: result for config in episodes if (result := store.result(config)) is not None}
        for config, result in results.items():
            if result.version != __version__:
                raise UserError(
                    f"{store.path(config)}: a result of version {result.version}, this is {__version__}; "
                    "choose another --out"
                )
        todo = [config for config in order(episodes) if config not in results]
        listener.begin(results, todo, engine.workers)
        try:
            for config in todo:
                if moved := store.quarantine(config):
                    listener.corrupt(config, moved)
            run = _Run(store, listener, engine)
            if todo:
                run.all(todo)
        finally:
            listener.end()
        results |= run.results
    return SuiteOutcome(episodes, {c: results[c] for c in episodes if c in results}, run.faults)


class _Run:
    """One engine's work."""

    def __init__(self, store: Store, listener: RunListener, engine: Engine) -> None:
        self.store, self.listener, self.engine = store, listener, engine
        self.results: dict[EpisodeConfig, Result] = {}
        self.faults: dict[EpisodeConfig, Fault] = {}
        self.waiting: deque[tuple[EpisodeConfig, int]] = deque()
        self.running: dict[EpisodeConfig, int] = {}
        self.at_work: dict[EpisodeConfig, AtWork] = {}

    def all(self, todo: Sequence[EpisodeConfig]) -> None:
        self.waiting.extend((config, 1) for config in todo)
        try:
            self.engine.open()
            while self.waiting or self.running:
                while self.waiting and len(self.running) < self.engine.workers:
                    config, attempt = self.waiting.popleft()
                    self.engine.start(config)
                    self.running[config] = attempt
                    self._begin(config)
                self.listener.tick(self.engine.workers)
                for config, played in self.engine.wait(_POLL_S):
                    self._take(config, played)
        finally:
            self.engine.close()
            note(self.store.out, ())

    def _begin(self, config: EpisodeConfig) -> None:
        """Give a starting episode the number of a free worker."""
        busy = {work.worker for work in self.at_work.values()}
        worker = next(number for number in itertools.count(1) if number not in busy)
        self.at_work[config] = AtWork(
            worker=worker, method=config.method or "", episode=config.name, since=round(time.time(), 1)
        )
        note(self.store.out, list(self.at_work.values()))
        self.listener.started(config, worker)

    def _take(self, config: EpisodeConfig, played: Played) -> None:
        attempt = self.running.pop(config)
        del self.at_work[config]
        if played.result is not None:
            self.store.write(config, played.result)
        fault = played.fault
        if fault is None:
            self.results[config] = Result.model_validate(played.result)
            self.listener.finished(config, self.results[config])
            return
        if fault.hopeless:
            raise (UserError if fault.exit_code == UserError.exit_code else BackendError)(fault.message)
        again = attempt < ATTEMPTS
        self.listener.broke(config, fault, again)
        if again:
            self.waiting.appendleft((config, attempt + 1))
        else:
            self.faults[config] = fault
            self.store.write_fault(config, fault)
