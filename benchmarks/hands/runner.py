"""Runs trials in worker processes; one that crashes, hangs or raises is a row that says so."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from benchmarks.hands.felt import Felt
from benchmarks.hands.policies import maker_of
from benchmarks.hands.rows import Job, Row
from benchmarks.hands.scenes import draw
from benchmarks.hands.show import Film
from benchmarks.hands.trial import play
from benchmarks.pool import play_all
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.errors import BackendError, NoRenderingDevice, UserError
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.house.sim.noise import NONE, REALISTIC, NoisyRobot
from mpvi_bt.runs.choices.policies import PolicyInputs, with_pregrasp

ERRORS = {"none": NONE, "realistic": REALISTIC}  # of the senses of policies that see
WALL_LIMIT_S = 600.0  # Our choice: only a hung trial takes that long


def run_job(job: Job, show: Path | None = None, video: bool = False, signals: bool = False) -> Row:
    """Play one trial.

    Args:
        job: The trial.
        show: A folder for pictures of its start and end.
        video: Whether to film it, too.
        signals: Whether the monitors' signals are measured.

    Raises:
        UserError: The scene cannot be set up.
        NoRenderingDevice: Pictures are needed and cannot be drawn.
    """
    trial = draw(job.skill, job.case, job.seed, job.shapes)
    maker = maker_of(job.policy)
    try:
        world = trial.world(
            render=maker.pictures or job.pregrasp or show is not None,
            assisted=job.assisted,
            robot=robot_named(job.robot),
        )
    except BackendError as error:
        if isinstance(error, NoRenderingDevice):
            raise
        return Row(job, False, f"no_scene: {error}")
    off_m = job.perception_cm / 100
    alone = policy = maker.make(world, job.seed, off_m)
    if job.pregrasp:
        vocabulary = {e.name: e.phrases for e in world.knowledge()}
        policy = with_pregrasp(alone, PolicyInputs(load_skills(), vocabulary, seed=job.seed), job.pregrasp_hand)
    errors = replace(ERRORS[job.noise], offset_m=off_m)
    robot = NoisyRobot(world.robot, world.cameras, errors, job.seed) if maker.pictures or job.pregrasp else world.robot
    film = None if show is None else Film(world, show / job.name.replace("/", "-").replace(" ", "_"), video)
    felt = Felt(world.robot) if signals else None
    watching = [of.step for of in (film, felt) if of is not None]
    played = play(trial, world, policy, robot, watching)
    getattr(alone, "close", lambda: None)()  # what it breaks off now still finds its world
    if film is not None:
        film.end()
    attempts = getattr(alone, "attempts", None)
    note = played.note.partition(" (")[0]  # without what candidates died of
    cause = f"{played.missing}: {note}" if note else played.missing
    return Row(
        job, not played.missing, cause if played.missing else "", round(played.simulated_s, 2), played.steps,
        None if attempts is None else max(attempts - 1, 0), round(played.wall_s, 2), round(played.cpu_s, 2),
        round(played.steps / CONTROL_HZ / max(played.cpu_s, 1e-9), 1),
        {name: thing.entry.name for name, thing in trial.objects.items()},
        [] if felt is None else felt.samples,
    )  # fmt: skip


def run_jobs(
    jobs: Iterable[Job], workers: int, wall_limit_s: float = WALL_LIMIT_S, show: Path | None = None,
    video: bool = False, signals: bool = False,
) -> Iterator[Row]:  # fmt: skip
    """The rows of jobs, as they end.

    Raises:
        UserError: A scene cannot be set up: its trials would all be like that.
        KeyboardInterrupt: After the workers were stopped.
    """
    played = partial(_guarded, show=show, video=video, signals=signals)
    for row in play_all(played, _failed, jobs, workers, wall_limit_s):
        if isinstance(row, str):
            raise UserError(row)
        yield row


def _failed(job: Job, cause: str) -> Row | str:
    return Row(job, False, cause)


def _guarded(job: Job, show: Path | None, video: bool, signals: bool) -> Row | str:
    """A row; or the message of an error that every trial would meet."""
    try:
        return run_job(job, show, video, signals)
    except (UserError, NoRenderingDevice) as error:
        return f"{job.name}: {error}"
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        return Row(job, False, f"raised: {type(error).__name__} at {place}: {' '.join(str(error).split())[:200]}")
