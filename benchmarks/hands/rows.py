"""Results of trials: one JSON object a line, so that a killed run goes on where it stopped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from benchmarks.hands.trial import Shapes
from benchmarks.rows import append, lines_of
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.protocol import Side


@dataclass(frozen=True)
class Job:
    """One trial and how it is to be played.

    Attributes:
        skill, case: The scene.
        policy: Who plays.
        seed: Of the scene and of the policy.
        shapes: The set that the things come from.
        noise: Error model of the senses: "none" or "realistic".
        perception_cm: Standard deviation of the error of where things are believed to be.
        assisted: Whether grasps are assisted.
        robot: Whose hands.
        pregrasp: Whether a planned motion brings the hand before what is to be picked up, before the policy plays.
        pregrasp_hand: Which hand that is; None: the one on the thing's side.
    """

    skill: str
    case: str
    policy: str
    seed: int
    shapes: Shapes
    noise: str = "none"
    perception_cm: float = 0.0
    assisted: bool = False
    robot: str = "r1"
    pregrasp: bool = False
    pregrasp_hand: Side | None = None

    @property
    def name(self) -> str:
        """Such as "pick/clutter expert 3"."""
        return f"{self.skill}/{self.case} {self.policy} {self.seed}"


@dataclass(frozen=True)
class Row:
    """What came of a job.

    Attributes:
        job: What was played.
        ok: Whether it succeeded.
        cause: Of the failure: what the truth still lacked, and what the policy said last; or what broke.
        simulated_s: Until success began, or all that was played.
        steps: Control steps played.
        retries: Attempts after the first, None if the policy does not count them.
        wall_s, cpu_s: Of playing.
        realtime: Simulated time over CPU time, all that was played.
        objects: Kind of every thing, by name.
        samples: The monitors' signals every half second, if they were asked for.
    """

    job: Job
    ok: bool
    cause: str = ""
    simulated_s: float = 0.0
    steps: int = 0
    retries: int | None = None
    wall_s: float = 0.0
    cpu_s: float = 0.0
    realtime: float = 0.0
    objects: Mapping[str, str] = field(default_factory=dict)
    samples: Sequence[Sequence[float]] = field(default_factory=list)

    @property
    def code(self) -> str:
        """The stable part of the cause."""
        return self.cause.partition(":")[0]


def read_rows(path: Path) -> list[Row]:
    """The rows of a file, the last of each job; a line that was cut short does not count.

    Raises:
        UserError: A line is no row.
    """
    rows: dict[Job, Row] = {}
    for number, data in lines_of(path):
        try:
            row = _row(data)
        except (ValueError, TypeError, KeyError) as error:
            raise UserError(f"{path}:{number}: no result of a trial ({error})") from None
        rows[row.job] = row
    return list(rows.values())


def add_row(path: Path, row: Row) -> None:
    """Append a row, whole. Raises UserError if the file cannot be written."""
    append(path, _flat(row))


def _flat(row: Row) -> dict[str, Any]:
    data = asdict(row)
    return {**data.pop("job"), **data}


def _row(data: Mapping[str, Any]) -> Row:
    before = {"robot": "r1", "pregrasp": False, "pregrasp_hand": None, "samples": []}  # of rows without these
    data = {**before, **data}
    job = Job(**{f.name: data[f.name] for f in fields(Job)})
    return Row(job, **{f.name: data[f.name] for f in fields(Row) if f.name != "job"})
