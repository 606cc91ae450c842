"""Plays jobs in worker processes; one that crashes, hangs or raises is told and stops nothing else."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TypeVar

from pebble import ProcessExpired, ProcessPool

from mpvi_bt.runs.suite.worker import THREAD_LIMITS, prepare

JobT = TypeVar("JobT")
RowT = TypeVar("RowT")

_JOBS_A_PROCESS = 40  # the renderer keeps some memory of every scene


def play_all(
    play: Callable[[JobT], RowT],
    failed: Callable[[JobT, str], RowT],
    jobs: Iterable[JobT],
    workers: int,
    wall_limit_s: float,
) -> Iterator[RowT]:
    """The rows of jobs, as they end.

    Args:
        play: Makes the row of a job in a worker process; what it raises is raised here.
        failed: Makes the row of a job whose process hung or died, given what happened, such as "hung: ...".
        jobs: In the order in which they are begun.
        workers: How many processes.
        wall_limit_s: Wall time after which a job counts as hung.

    Raises:
        KeyboardInterrupt: After the workers were stopped.
    """
    os.environ.update({name: "1" for name in THREAD_LIMITS if name not in os.environ})  # each core has its worker
    context = multiprocessing.get_context("spawn")
    pool = ProcessPool(workers, max_tasks=_JOBS_A_PROCESS, initializer=prepare, context=context)
    try:
        waiting: dict[Future[RowT], JobT] = {
            pool.schedule(play, args=(job,), timeout=wall_limit_s): job for job in jobs
        }  # fmt: skip
        while waiting:
            done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in done:
                job = waiting.pop(future)
                try:
                    row = future.result()
                except TimeoutError:
                    row = failed(job, f"hung: no result within {wall_limit_s:g} s of wall time")
                except ProcessExpired as error:
                    row = failed(job, f"died: the worker process ended with exit code {error.exitcode}")
                yield row
        pool.close()  # type: ignore[no-untyped-call]
    except BaseException:
        pool.stop()  # type: ignore[no-untyped-call]
        raise
    finally:
        pool.join()
