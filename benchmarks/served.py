"""Whether an episode behind the socket is the one of `mpvi run`: every action compared.

    python -m benchmarks.served TASK [--plan FILE] [--robot r1pro] [--policy reactive] [--dialect D ...] [--instance N]

The task is played by `mpvi run` with an online map, and then in each dialect by `mpvi serve mpvi`, driven by `mpvi
evaluate` with labels and pictures on demand. An episode that is in the folder `--out` is not played again.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.origin import grid
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.serving.evaluator import Evaluation, evaluate
from mpvi_bt.runs.serving.served import DIALECTS, ServedWork, executive_server
from tests.driven import Acts, Ear
from tests.serving import running

APART = 1e-3  # m/s, rad/s, m, rad: more is another action; BEHAVIOR's dialects round to float32


@dataclass(frozen=True)
class Played:
    """An episode.

    Attributes:
        actions: That were carried out, (N, 23).
        q: Of the goal at its end.
    """

    actions: Array
    q: float

    @classmethod
    def of(cls, path: Path) -> Played:
        """From a file of `save`."""
        with np.load(path) as data:
            return cls(data["actions"], float(data["q"]))

    def save(self, path: Path) -> None:
        """As a file of NumPy's."""
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, actions=self.actions, q=self.q)


class Progress(Ear):
    """Tells how far it is."""

    def said(self, line: str) -> None:
        """What a person should know."""
        click.echo(line, err=True)

    def stepped(self, instance: int, step: int, most: int) -> None:
        """A control step was carried out."""
        if step % 300 == 0:
            click.echo(f"step {step} of at most {most}", err=True)


def played_here(task: str, instance: int, choices: dict[str, Any]) -> Played:
    """By `mpvi run`."""
    acts = Acts()
    result = run(EpisodeConfig(task, instance, **choices), [acts])
    return Played(np.array(acts.actions), Result.model_validate(result).q)


def played_behind(dialect: Any, task: str, instance: int, choices: dict[str, Any]) -> Played:
    """By `mpvi serve mpvi`, up to where the goal is true, as the evaluators do."""
    ear = Progress()
    with running(executive_server(dialect, ServedWork(EpisodeConfig("", **choices)))) as server:
        asked = Evaluation(
            f"127.0.0.1:{server.port}", dialect, task, (instance,), choices["robot"], labels=True, on_demand=True
        )
        (rollout,) = evaluate(asked, ear)
    return Played(np.array(ear.actions), rollout.goal.q)


def row(dialect: str, here: Played, there: Played) -> list[str]:
    """Of the table: how far both go together."""
    both = min(len(here.actions), len(there.actions))
    off = np.abs(here.actions[:both] - there.actions[:both]).max(axis=1)
    parted = np.flatnonzero(off > APART)
    return [
        dialect,
        f"{len(there.actions)} ({len(there.actions) / 30:.0f} s)",
        f"{there.q:.2f}",
        f"{np.mean(off == 0):.0%}",
        f"{parted[0]} ({parted[0] / 30:.0f} s)" if len(parted) else "none",
    ]


@click.command()
@click.argument("task")
@click.option("--instance", type=int, default=0, show_default=True)
@click.option("--robot", default="r1pro", show_default=True)
@click.option("--policy", default="reactive", show_default=True)
@click.option("--plan", help="Of the task; default: its own.")
@click.option("--dialect", multiple=True, type=click.Choice(list(DIALECTS)), help="Only this; may be repeated.")
@click.option("--out", type=click.Path(path_type=Path), default="runs/served", show_default=True)
def main(
    task: str, instance: int, robot: str, policy: str, plan: str | None, dialect: tuple[str, ...], out: Path
) -> None:
    """Play TASK here and behind the socket, and print how far the actions are the same."""
    choices = {"robot": robot, "policy": policy, "map": "online", "plan": plan}
    folder = out / f"{task}_{instance}_{robot}"

    def episode(name: str) -> Played:
        if not (path := folder / f"{name}.npz").exists():
            here = name == "run"
            played = played_here(task, instance, choices) if here else played_behind(name, task, instance, choices)
            played.save(path)
        return Played.of(path)

    here = episode("run")
    rows = [["`mpvi run`", f"{len(here.actions)} ({len(here.actions) / 30:.0f} s)", f"{here.q:.2f}", "", ""]]
    rows += [row(name, here, episode(name)) for name in dialect or DIALECTS]
    head = ["dialect", "steps", "q", "actions equal to the bit", f"first that differs by more than {APART}"]
    click.echo(grid(head, rows))


if __name__ == "__main__":
    main()
