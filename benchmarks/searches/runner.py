"""Plays searches in worker processes."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path

from benchmarks.pool import play_all
from benchmarks.searches.play import Job, Row, play
from mpvi_bt.ground.errors import MpviError

_WALL_LIMIT_S = 900.0  # only one that hangs takes that long


def run_jobs(jobs: Iterable[Job], workers: int) -> Iterator[Row]:
    """The rows of searches, as they end. Raises MpviError where every search would end like that."""
    for row in play_all(_guarded, _failed, jobs, workers, _WALL_LIMIT_S):
        if isinstance(row, MpviError):
            raise row
        yield row


def _guarded(job: Job) -> Row | MpviError:
    try:
        return play(job)
    except MpviError as error:
        return error
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return _failed(job, f"raised: {type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {error}")


def _failed(job: Job, cause: str) -> Row:
    reason, _, evidence = cause.partition(": ")
    return Row(job, "", "", "", False, False, reason, evidence, 0.0, 0.0, 0.0, 0, 0.0, "", {})
