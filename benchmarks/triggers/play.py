"""Plays one episode with a trigger and a checker that errs, and keeps what the comparison needs of its result."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.pool import play_all
from mpvi_bt.ground.errors import MpviError, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.queries import Queries

_WALL_LIMIT_S = 7200.0  # only one that hangs takes that long


@dataclass(frozen=True)
class Job:
    """One episode; the names are those of `mpvi run`.

    Attributes:
        task, instance, seed, policy, detector, map, checker, trigger: As of `EpisodeConfig`.
    """

    task: str
    instance: int
    trigger: str
    checker: str
    policy: str
    detector: str = "segmentation"
    map: str = "prior"
    seed: int = 0

    @property
    def config(self) -> EpisodeConfig:
        """The episode."""
        return EpisodeConfig(**asdict(self))


@dataclass(frozen=True)
class Row:
    """What came of an episode.

    Attributes:
        job: What was played.
        q: At the end; 0 of an episode that broke.
        success: The goal was true at the end.
        ended: As of the result; "raised", "hung" or "died" of an episode that broke.
        simulated_s: How long it took.
        queries: Of the checker, counted.
        problem: What broke; "" if nothing did.
        wall_s: In which it was played.
    """

    job: Job
    q: float
    success: bool
    ended: str
    simulated_s: float
    queries: Queries
    problem: str = ""
    wall_s: float = 0.0

    def data(self) -> dict[str, Any]:
        """As a line of the file."""
        rest = {key: value for key, value in vars(self).items() if key not in ("job", "queries")}
        return {**asdict(self.job), **rest, "queries": self.queries.model_dump()}

    @classmethod
    def of(cls, data: dict[str, Any]) -> Row:
        """From a line of the file. Raises TypeError, KeyError or ValueError if it is none."""
        job = Job(**{key: data.pop(key) for key in Job.__dataclass_fields__})
        return cls(job, queries=Queries.model_validate(data.pop("queries")), **data)


def run_jobs(jobs: Iterable[Job], workers: int) -> Iterator[Row]:
    """The rows of episodes, played in worker processes, as they end. Raises UserError where all would end like that."""
    for row in play_all(_guarded, _failed, jobs, workers, _WALL_LIMIT_S):
        if isinstance(row, MpviError):
            raise row
        yield row


def play(job: Job) -> Row:
    """Play one episode."""
    from mpvi_bt.runs.episode.episode import run

    result = run(job.config)
    return Row(
        job,
        result["q_score"]["final"],
        result["success"],
        result["ended"],
        round(result["time"]["simulator_time"], 1),
        Queries.model_validate(result["queries"]),
        wall_s=round(result["wall"]["total_s"], 1),
    )


def _guarded(job: Job) -> Row | MpviError:
    try:
        return play(job)
    except UserError as error:
        return error
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return _failed(job, f"raised: {type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {error}")


def _failed(job: Job, cause: str) -> Row:
    ended, _, problem = cause.partition(": ")
    return Row(job, 0.0, False, ended, 0.0, Queries(), problem)
