"""`python -m benchmarks.hands.demonstrations FOLDER`: the expert's demonstrations that `learned` is made from."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.hands.recorded_seeds import record as record_seeds
from benchmarks.hands.scenes import draw
from benchmarks.hands.trial import Trial
from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.finding.perception.segmentation import DetectionErrors, SegmentationDetector
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.learned.demonstration import find, record
from mpvi_bt.hands.learned.learned_motions import MOTIONS
from mpvi_bt.hands.learned.points import PointMemory
from mpvi_bt.house.sim.noise import NONE, REALISTIC, NoisyRobot
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.expert import ExpertPolicy
from mpvi_bt.runs.recording.demonstration_recorder import DemonstrationRecorder

# Scenes of a skill, and how often each is drawn.
MIXES: Mapping[str, Mapping[str, int]] = {
    "pick": {"floor": 2, "table": 3, "counter": 2, "clutter": 3},
    "place_in": {"bin": 2, "basket": 2, "basket_on_table": 2},
    "place_on": {"table": 2, "counter": 2, "clutter": 2},
    "place_next_to": {"floor": 1, "table": 1},
}
FIRST_SEED = 100_000  # far from those that policies are compared on
_LIMIT_S = 40.0
_STEADY = 3  # times in a row that the truth says yes, asked six times a second
_NOISY = 0.5  # of the episodes have the errors of `REALISTIC` senses, and a detector's
_DETECTOR = DetectionErrors(miss=0.05, jitter=1.0)


class _Watch:
    """Says when an episode has succeeded, or never will."""

    def __init__(self, trial: Trial, world: SimWorld, policy: ExpertPolicy) -> None:
        self._trial, self._world, self._policy = trial, world, policy
        self._good, self.ok = 0, False

    def __call__(self) -> bool:
        if self._world.steps % 5 == 4:
            self._world.wake()
        if self._world.steps % 5:
            return False
        missing = self._trial.done(self._world)
        self._good = 0 if missing else self._good + 1
        self.ok = self._good >= _STEADY
        done = self._policy.note == "done" and bool(missing)
        return self.ok or done or self._policy.gave_up or self._world.time_s > _LIMIT_S


def demonstrate(
    seed: int, folder: Path, skill: str, episodes: Path | None = None, chosen: Sequence[str] = ()
) -> dict[str, Any]:
    """Play one scene; keep the demonstration if it was done at the first attempt. Returns a row of what came of it.

    Args:
        seed: Of the scene.
        folder: Where the demonstration is kept.
        skill: Of `MIXES`.
        episodes: Where it is recorded with pictures too, as `mpvi dataset` reads it.
        chosen: Cases that are drawn; none: all of the skill's.
    """
    started = time.perf_counter()
    rng = np.random.default_rng([seed, 7])
    cases = [case for case, share in MIXES[skill].items() for _ in range(share) if not chosen or case in chosen]
    case = cases[rng.integers(len(cases))]
    row: dict[str, Any] = {"seed": seed, "case": case, "ok": False}
    try:
        trial = draw(skill, case, seed, "tuning")
        world = trial.world(render=True)
        skills = load_skills()
        held: list[Side] = list(trial.held)
        side: Side = held[0] if held else "right"
        call = match(trial.prompt, skills)
        assert call is not None
        assert call.target is not None
        noisy = bool(rng.random() < _NOISY)
        robot = NoisyRobot(world.robot, world.cameras, REALISTIC if noisy else NONE, seed)
        vocabulary = {e.name: e.phrases for e in world.knowledge()}
        errors = {"errors": _DETECTOR, "seed": seed} if noisy else {}
        detector = SegmentationDetector(vocabulary, 1, **errors)  # type: ignore[arg-type]
        memory = PointMemory(detector, call.target, rng)
        policy = ExpertPolicy(world, skills, seed)
        watch = _Watch(trial, world, policy)
        prompt = trial.prompt if held else f"{trial.prompt} with the {side} hand"
        about = {"task": f"{skill}_{case}", "seed": seed, "instruction": trial.prompt, "config": {"robot": "r1"}}
        episode = DemonstrationRecorder(episodes / f"{skill}_{seed}", about) if episodes is not None else None
        if episode is not None:
            episode.begin()

        def step(action: Array) -> None:
            if episode is not None:
                episode.note(world.steps, world.robot, action, lambda: prompt)
            world.robot.act(action)
            world.step()

        seen = find(robot, step, memory, side)
        shown = record(policy, robot, step, watch, memory, prompt, side, MOTIONS[skill])
        policy.close()
        row |= {"ok": watch.ok and policy.attempts == 1 and bool(len(shown.points)), "seen": seen, "side": side}
        row |= {"attempts": policy.attempts, "note": policy.note, "steps": len(shown.look)}
        if row["ok"]:
            shown.save(folder / f"{seed}.npz")
        if episode is not None:
            episode.end(Outcome("success"))
            episode.conclude(float(watch.ok), row["ok"])
    except BackendError as error:
        row["note"] = f"no scene: {error}"
    return row | {"wall_s": round(time.perf_counter() - started, 2)}


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--skill", type=click.Choice(list(MIXES)), default="pick", show_default=True)
@click.option("--case", "-c", "chosen", multiple=True, help="Only this case of the skill; may be repeated.")
@click.option("--count", type=click.IntRange(1), default=1000, show_default=True, help="Scenes that are tried.")
@click.option("--first", type=int, default=FIRST_SEED, show_default=True, help="Seed of the first.")
@click.option("--episodes", type=click.Path(path_type=Path, file_okay=False),
              help="Record pictures there, too, as `mpvi dataset` reads them.")  # fmt: skip
@click.option("--workers", "-j", type=click.IntRange(1, 64), default=2, show_default=True)
def main(
    folder: Path, skill: str, chosen: tuple[str, ...], count: int, first: int, episodes: Path | None, workers: int
) -> None:
    """Record demonstrations into FOLDER/SKILL, one file each; those that are there are not made again."""
    if unknown := set(chosen) - set(MIXES[skill]):
        raise click.UsageError(f"{skill} has no case {', '.join(sorted(unknown))}; it has {', '.join(MIXES[skill])}")
    folder /= skill
    play = partial(demonstrate, folder=folder, skill=skill, episodes=episodes, chosen=chosen)
    record_seeds(folder, play, first, count, workers)


if __name__ == "__main__":
    main()
