"""Plays episodes in persistent processes of this machine, through pebble."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker

from pebble import ProcessExpired, ProcessPool

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.runs.choices.config import EPISODE, EpisodeConfig
from mpvi_bt.runs.suite.store import Fault
from mpvi_bt.runs.suite.worker import EPISODES_A_PROCESS, THREAD_LIMITS, Played, play, prepare

WALL_LIMIT_S = 7200.0  # Our choice: four times the longest time of a task, 1737 s, at the pace of life
_MOST_BROKEN = 8  # pools in a row that end before they begin an episode
_JOIN_S = 10.0


class ProcessEngine:
    """As `runner.Engine`: each worker is a pebble pool of one process.

    The processes of one pool share a queue and its locks, which a process that is killed at the wrong moment never
    gives back. Alone in its pool it harms nobody else, and its pool is thrown away.

    Args:
        workers: Processes at work at once.
        function: "module:name" of the function that plays one episode.
        wall_limit_s: Wall time after which an episode counts as hung and its process is replaced.
    """

    def __init__(self, workers: int, function: str = EPISODE, wall_limit_s: float = WALL_LIMIT_S) -> None:
        self.workers, self._function, self._wall_limit_s = workers, function, wall_limit_s
        self._idle: list[ProcessPool] = []
        self._busy: dict[Future[Played], tuple[ProcessPool, EpisodeConfig]] = {}
        self._ending: list[threading.Thread] = []
        self._broken = 0
        self._limited: list[str] = []

    def open(self) -> None:
        """Let numeric libraries in the workers, which inherit our environment, use one thread."""
        self._limited = [name for name in THREAD_LIMITS if name not in os.environ]
        os.environ.update(dict.fromkeys(self._limited, "1"))
        resource_tracker.ensure_running()  # it unblocks SIGINT when it starts, and must not in `start`

    def start(self, config: EpisodeConfig) -> None:
        """Begin an episode. Raises BackendError if no process can be started."""
        context = multiprocessing.get_context("spawn")
        pool = self._idle.pop() if self._idle else ProcessPool(1, EPISODES_A_PROCESS, prepare, context=context)
        # Ctrl-C is for us, who stop the workers: they inherit that they do not hear it, while they import, too.
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            future = pool.schedule(play, args=(self._function, config), timeout=self._wall_limit_s)
        except RuntimeError as error:
            raise BackendError(f"no worker process can be started: {error.__cause__ or error}") from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)
        self._busy[future] = (pool, config)

    def wait(self, seconds: float) -> Iterator[tuple[EpisodeConfig, Played]]:
        """Episodes that ended, as soon as one has. Raises BackendError if processes end as soon as they start."""
        done, _ = wait(self._busy, timeout=seconds, return_when=FIRST_COMPLETED)
        for future in done:
            pool, config = self._busy.pop(future)
            sound, played = self._taken(future)
            if sound:
                self._idle.append(pool)
            else:
                self._end(pool)
            yield config, played

    def close(self) -> None:
        """Stop every process, whatever it is at."""
        for pool in (*self._idle, *(pool for pool, _ in self._busy.values())):
            self._end(pool)
        for thread in self._ending:
            thread.join(_JOIN_S)
        for name in self._limited:
            os.environ.pop(name, None)

    def _taken(self, future: Future[Played]) -> tuple[bool, Played]:
        """Whether the pool can go on, and what came of the episode."""
        try:
            played = future.result()
        except TimeoutError:  # pebble has ended the process, between messages
            return True, Played(fault=Fault(f"no result within {self._wall_limit_s:g} s of wall time"))
        except ProcessExpired as error:
            return False, Played(fault=Fault(f"the worker process died (exit code {error.exitcode})"))
        except BrokenProcessPool:
            self._broken += 1
            if self._broken >= _MOST_BROKEN:
                raise BackendError("the worker processes end as soon as they start") from None
            return False, Played(fault=Fault("the worker process died before it began"))
        except (Exception, CancelledError) as error:
            return False, Played(fault=Fault(f"{type(error).__name__}: {error}"))
        self._broken = 0
        return True, played

    def _end(self, pool: ProcessPool) -> None:
        """Stop a pool aside: a thread of one whose process died while it sent never ends."""
        pool.stop()  # type: ignore[no-untyped-call]
        thread = threading.Thread(target=pool.join, daemon=True)
        thread.start()
        self._ending.append(thread)
