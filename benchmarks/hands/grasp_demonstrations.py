"""`python -m benchmarks.hands.grasp_demonstrations FOLDER`: picks that are recorded from the pre-grasp on.

What `--pregrasp` leaves to a policy is shown here: the hand is before the thing, and takes it. Whoever shows it has
looked and planned like `--pregrasp`, so a policy begins later where its demonstrations begin.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.hands.recorded_seeds import record as record_seeds
from benchmarks.hands.scenes import draw
from benchmarks.hands.trial import Trial
from mpvi_bt.executive.plan.skills import SkillCall, load_skills
from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.carry import come_out
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.policies.pregrasp import PregraspPolicy
from mpvi_bt.hands.skills.pick import come_before, pick, take_hold
from mpvi_bt.house.sim.noise import NONE, REALISTIC, NoisyRobot
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.runs.recording.demonstration_recorder import DemonstrationRecorder

FIRST_SEED = 200_000  # far from those that policies are compared on
_LIMIT_S = 60.0
_STEADY = 6  # times in a row that the truth says yes, asked six times a second
_NOISY = 0.5  # of the episodes have the errors of `REALISTIC` senses


class Taker(PregraspPolicy):
    """Comes before a thing by sight as `--pregrasp` does, and then takes it.

    Attributes:
        there: Whether the hand is before the thing, or has taken it since.
    """

    there = False

    def attempt(self, work: Work, call: SkillCall) -> Any:
        """Try it; yields actions, returns whether the thing is in hand."""
        yield from come_out(work)
        try:
            yield from pick(work, self.words(call), [], self._take)
        except MotionFailure as failure:
            self.note = f"{call.skill.name}: {work.explained(failure)}"
            return False
        return True

    def _take(self, work: Work, name: str, side: Side, tried: list[Array]) -> Actions:
        stance = yield from come_before(work, name, side, tried)
        self.there = True
        yield from take_hold(work, name, side, stance)


def demonstrate(seed: int, folder: Path, cases: tuple[str, ...], hand: Side, fps: int) -> dict[str, Any]:
    """Play one scene, and record it from the pre-grasp on. Returns a row of what came of it.

    Args:
        seed: Of the scene.
        folder: Where it is recorded, as `mpvi dataset` reads it.
        cases: Of picking up; one of them is drawn.
        hand: That picks up.
        fps: Rows a second.
    """
    started = time.perf_counter()
    rng = np.random.default_rng([seed, 11])
    case = cases[rng.integers(len(cases))]
    row: dict[str, Any] = {"seed": seed, "case": case, "ok": False}
    try:
        trial = draw("pick", case, seed, "tuning")
        world = trial.world(render=True)
    except BackendError as error:
        return row | {"note": f"no scene: {error}"}
    robot = NoisyRobot(world.robot, world.cameras, REALISTIC if rng.random() < _NOISY else NONE, seed)
    vocabulary = {e.name: e.phrases for e in world.knowledge()}
    policy = Taker(load_skills(), seed, vocabulary=vocabulary)
    prompt = f"{trial.prompt} with the {hand} hand"
    about = {"task": f"pick_{case}", "seed": seed, "instruction": trial.prompt, "config": {"robot": "r1"}}
    episode = DemonstrationRecorder(folder / f"pick_{seed}", about, fps, ("head", hand))
    ok, rows = False, 0
    while not ok and not policy.ended and world.time_s < _LIMIT_S:
        images = {camera: robot.look(camera) for camera in policy.cameras}
        action = policy.infer({"prompt": prompt, "proprioception": robot.proprioception(), "images": images})[0]
        if policy.there:
            if rows == 0:
                episode.begin()
            episode.note(rows, world.robot, action, lambda: prompt)
            rows += 1
        world.robot.act(action)
        world.step()
        if policy.there:
            ok = _steady(trial, world, row)
    if rows:
        episode.end(Outcome("success"))
        episode.conclude(float(ok), ok)
    row |= {"ok": ok, "note": policy.note, "steps": rows, "simulated_s": round(world.time_s, 2)}
    policy.close()
    return row | {"wall_s": round(time.perf_counter() - started, 2)}


def _steady(trial: Trial, world: SimWorld, row: dict[str, Any]) -> bool:
    """Whether the truth has said yes often enough; asked after every step."""
    if world.steps % 5 == 4:
        world.wake()
    if world.steps % 5 == 0:
        row["good"] = 0 if trial.done(world) else row.get("good", 0) + 1
    return bool(row.get("good", 0) >= _STEADY)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--case", "-c", "cases", type=click.Choice(["floor", "table", "counter", "clutter"]), multiple=True,
              default=("floor", "table"), show_default=True, help="May be repeated.")  # fmt: skip
@click.option("--hand", type=click.Choice(["left", "right"]), default="right", show_default=True)
@click.option("--fps", type=click.Choice([10, 15, 30]), default=10, show_default=True, help="Rows a second.")
@click.option("--count", type=click.IntRange(1), default=250, show_default=True, help="Scenes that are tried.")
@click.option("--first", type=int, default=FIRST_SEED, show_default=True, help="Seed of the first.")
@click.option("--workers", "-j", type=click.IntRange(1, 64), default=2, show_default=True)
def main(
    folder: Path, cases: tuple[str, ...], hand: Side, fps: int, count: int, first: int, workers: int
) -> None:  # fmt: skip
    """Record picks into FOLDER, an episode each; those that were tried are not tried again."""
    record_seeds(folder, partial(demonstrate, folder=folder, cases=cases, hand=hand, fps=fps), first, count, workers)


if __name__ == "__main__":
    main()
