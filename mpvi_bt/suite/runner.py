"""Runs a suite in persistent worker processes: what is done stays done, and nothing runs twice.

A worker that dies is replaced and its episode tried once more; so is an episode that breaks or hangs. What breaks twice
is a machine fault: it gets no result, is reported as such, and the next run tries it again.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from typing import Protocol

from pebble import ProcessExpired, ProcessPool

from mpvi_bt.errors import BackendError, UserError
from mpvi_bt.suite.config import EPISODE, EpisodeConfig
from mpvi_bt.suite.result import Result
from mpvi_bt.suite.store import Fault, Store
from mpvi_bt.suite.worker import prepare, run_episode

WALL_LIMIT_S = 1800.0  # Our choice: only a hung episode takes that long
ATTEMPTS = 2
THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_POLL_S = 0.2


class Listener(Protocol):
    """Is told how a run goes."""

    def begin(self, results: Sequence[Result], todo: int, workers: int) -> None:
        """Results that were there already, and how many episodes are to run."""
        ...

    def finished(self, config: EpisodeConfig, result: Result) -> None:
        """An episode has a result."""
        ...

    def broke(self, config: EpisodeConfig, fault: Fault, again: bool) -> None:
        """An episode met a machine fault; it is tried again, or given up."""
        ...

    def tick(self, running: int) -> None:
        """A moment passed."""
        ...

    def end(self) -> None:
        """Nothing more will come."""
        ...


@dataclass(frozen=True)
class Outcome:
    """How the episodes of a suite stand, in their order."""

    results: dict[EpisodeConfig, Result]
    faults: dict[EpisodeConfig, Fault]


def run_suite(
    episodes: Iterable[EpisodeConfig],
    store: Store,
    workers: int,
    listener: Listener,
    function: str = EPISODE,
    wall_limit_s: float = WALL_LIMIT_S,
) -> Outcome:
    """Run every episode that has no valid result yet.

    Args:
        episodes: Each once.
        store: Where results are and go.
        workers: Processes at work at once.
        listener: Is told how it goes.
        function: "module:name" of the function that runs one episode.
        wall_limit_s: Wall time after which an episode counts as hung.

    Raises:
        UserError: Bad input; or the folder is in use, or holds results of another configuration.
        BackendError: Every episode would break alike, or workers cannot be started.
        KeyboardInterrupt: After the workers were stopped.
    """
    episodes = list(episodes)
    with store.locked():
        results = {config: result for config in episodes if (result := store.result(config)) is not None}
        todo = [config for config in episodes if config not in results]
        listener.begin(list(results.values()), len(todo), workers)
        try:
            run = _Run(store, listener, function, wall_limit_s)
            if todo:
                with _single_threads():
                    run.all(todo, min(workers, len(todo)))
        finally:
            listener.end()
        results |= run.results
    return Outcome({c: results[c] for c in episodes if c in results}, run.faults)


class _Run:
    """One pool's work."""

    def __init__(self, store: Store, listener: Listener, function: str, wall_limit_s: float) -> None:
        self.store, self.listener, self.function, self.wall_limit_s = store, listener, function, wall_limit_s
        self.results: dict[EpisodeConfig, Result] = {}
        self.faults: dict[EpisodeConfig, Fault] = {}
        self.waiting: dict[Future[Fault | None], tuple[EpisodeConfig, int]] = {}

    def all(self, todo: Sequence[EpisodeConfig], workers: int) -> None:
        pool = ProcessPool(workers, initializer=prepare, context=multiprocessing.get_context("spawn"))
        try:
            for config in todo:
                self._schedule(pool, config, 1)
            while self.waiting:
                done, _ = wait(self.waiting, timeout=_POLL_S, return_when=FIRST_COMPLETED)
                self.listener.tick(sum(future.running() for future in self.waiting))
                for future in done:
                    self._take(pool, future)
            pool.close()  # type: ignore[no-untyped-call]
        except BaseException:
            pool.stop()  # type: ignore[no-untyped-call]
            raise
        finally:
            pool.join()

    def _schedule(self, pool: ProcessPool, config: EpisodeConfig, attempt: int) -> None:
        try:
            future = pool.schedule(run_episode, args=(self.function, config, self.store.out), timeout=self.wall_limit_s)
        except RuntimeError as error:
            raise BackendError(f"the worker processes broke down: {error}") from error
        self.waiting[future] = (config, attempt)

    def _take(self, pool: ProcessPool, future: Future[Fault | None]) -> None:
        config, attempt = self.waiting.pop(future)
        fault = self._fault(future)
        # A worker that died right after it wrote its result has finished.
        result = self.store.result(config)
        if result is not None:
            self.results[config] = result
            self.listener.finished(config, result)
            return
        fault = fault or Fault("the result file vanished")
        if fault.hopeless:
            raise (UserError if fault.exit_code == UserError.exit_code else BackendError)(fault.message)
        again = attempt < ATTEMPTS
        self.listener.broke(config, fault, again)
        if again:
            self._schedule(pool, config, attempt + 1)
        else:
            self.faults[config] = fault
            self.store.write_fault(config, fault)

    def _fault(self, future: Future[Fault | None]) -> Fault | None:
        try:
            return future.result()
        except TimeoutError:
            return Fault(f"no result within {self.wall_limit_s:g} s of wall time")
        except ProcessExpired as error:
            return Fault(f"the worker process died (exit code {error.exitcode})")
        except (Exception, CancelledError) as error:
            return Fault(f"{type(error).__name__}: {error}")


@contextlib.contextmanager
def _single_threads() -> Iterator[None]:
    """Let numeric libraries in the workers, which inherit our environment, use one thread: each core has a worker."""
    added = [name for name in THREAD_LIMITS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
