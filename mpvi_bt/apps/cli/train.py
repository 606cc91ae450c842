"""`mpvi train`: weights of the learned policy, and of learned eyes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from mpvi_bt.executive.drawing.terminal import tell


@click.group()
def train() -> None:
    """Make a policy of your own from demonstrations, or eyes from labeled pictures."""


@train.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), required=True, metavar="FILE.npz",
              help="File for the weights; curves and progress are written beside it.")  # fmt: skip
@click.option("--skills", default="pick", show_default=True, help="Folders in FOLDER, joined by commas.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of everything random.")
@click.option("--actor-steps", type=click.IntRange(1), help="Training steps of the actor; fewer for a first try.")
@click.option("--proposer-steps", type=click.IntRange(1), help="Training steps of the proposer; fewer for a first try.")
@click.option("--device", default="cpu", show_default=True, help="Device for torch, such as cuda.")
@click.option("--json", "as_json", is_flag=True, help="For programs: a summary of the training, as JSON.")
def learned(
    folder: Path, out: Path, skills: str, seed: int, actor_steps: int | None, proposer_steps: int | None, device: str,
    as_json: bool,
) -> None:  # fmt: skip
    """Train the policy `learned` from the demonstrations in FOLDER/SKILL/.

    What is interrupted goes on where it was when it is started again; what FILE.npz holds of other skills stays in it.
    The same demonstrations and seed make the same weights on the CPU of one machine. `mpvi run TASK --policy
    learned:FILE.npz` runs with them.
    """
    _check_out(out)
    from mpvi_bt.hands.learned.mirroring import BODY
    from mpvi_bt.hands.learned.network import Weights
    from mpvi_bt.hands.learned.training import ACTOR_STEPS, PROPOSER_STEPS, Training
    from mpvi_bt.hands.learned.training import train as train_networks
    from mpvi_bt.hands.learned.training_set import read_frames

    kept = Weights.load(out) if out.exists() else Weights(BODY.name, {}, {})
    networks, about = dict(kept.skills), dict(kept.about)
    for skill in skills.split(","):
        frames = read_frames(folder, skill, lambda line: click.echo(line, err=True))
        job = Training(frames, seed, actor_steps or ACTOR_STEPS, proposer_steps or PROPOSER_STEPS, device)

        def note(row: dict[str, Any], skill: str = skill) -> None:
            figures = ", ".join(f"{k} {v:g}" for k, v in row.items() if k not in ("network", "step", "of"))
            click.echo(f"{skill} {row['network']} {row['step']}/{row['of']}: {figures}", err=True)

        networks[skill] = train_networks(job, out.with_suffix(f".{skill}.pt"), note)
        about[skill] = {"demonstrations": int(frames.episode[-1]) + 1, "frames": len(frames.look), "seed": seed,
                        "actor_steps": job.actor_steps, "proposer_steps": job.proposer_steps}  # fmt: skip
        out.with_suffix(f".{skill}.json").write_text(json.dumps(job.curves, indent=1), encoding="utf-8")
    Weights(BODY.name, networks, about).save(out)
    if as_json:
        tell(json.dumps({"weights": str(out), "skills": about}))
        return
    tell(f"{out}: {', '.join(networks)}, {out.stat().st_size / 1e6:.1f} MB")


@train.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--check", type=click.Path(exists=True, file_okay=False, path_type=Path), required=True,
              help="Folder of other pictures, by which scores are made to mean what they say.")  # fmt: skip
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), required=True, metavar="FILE.npz",
              help="File for the weights; curves and progress are written beside it.")  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of everything random.")
@click.option("--first-steps", type=click.IntRange(1), help="Training steps of the first network; fewer for a try.")
@click.option("--second-steps", type=click.IntRange(1), help="Training steps of the second look; fewer for a try.")
@click.option("--device", default="cpu", show_default=True, help="Device for torch, such as cuda.")
@click.option("--json", "as_json", is_flag=True, help="For programs: a summary of the training, as JSON.")
def eyes(
    folder: Path, check: Path, out: Path, seed: int, first_steps: int | None, second_steps: int | None, device: str,
    as_json: bool,
) -> None:  # fmt: skip
    """Train eyes from the labeled pictures in FOLDER, as `python -m benchmarks.eyes.pictures` makes them.

    What is interrupted goes on where it was when it is started again. The same pictures and seed make the same weights
    on the CPU of one machine.
    """
    _check_out(out)
    import numpy as np

    from mpvi_bt.finding.eyes.eyes_network import EyesNetwork
    from mpvi_bt.finding.eyes.first_look_training import FirstLook
    from mpvi_bt.finding.eyes.look_training import EyesTraining, Look, train_look
    from mpvi_bt.finding.eyes.picture_file import pictures_in
    from mpvi_bt.finding.eyes.score_calibration import calibrated
    from mpvi_bt.finding.eyes.second_look_training import SecondLook
    from mpvi_bt.finding.eyes.segmenter import EVIDENCE

    looks: dict[str, Look] = {}
    about: dict[str, Any] = {"pictures": len(pictures_in(folder)), "seed": seed}

    def network() -> EyesNetwork:
        weights = {key: w.astype(np.float32) for look in looks.values() for key, w in look.weights().items()}
        movable = looks["second"].kinds if "second" in looks else ()
        return EyesNetwork(looks["first"].kinds, movable, weights, (0.0,) * (2 * EVIDENCE), about)

    def second_look(kinds: Sequence[str] | None, job: EyesTraining) -> SecondLook:
        return SecondLook(kinds, job, network())

    for name, of, steps in (("first", FirstLook, first_steps), ("second", second_look, second_steps)):
        job = EyesTraining(folder, seed, steps, device)

        def note(row: dict[str, Any], name: str = name) -> None:
            figures = ", ".join(f"{k} {v:g}" for k, v in row.items() if k not in ("step", "of"))
            click.echo(f"{name} {row['step']}/{row['of']}: {figures}", err=True)

        looks[name] = train_look(partial(of, job=job), job, out.with_suffix(f".{name}.pt"), note)
        about[f"{name}_steps"] = looks[name].steps
        out.with_suffix(f".{name}.json").write_text(json.dumps(job.curves, indent=1), encoding="utf-8")
    made = calibrated(network(), pictures_in(check))
    made.save(out)
    if as_json:
        tell(json.dumps({"weights": str(out), "eyes": about}))
        return
    tell(f"{out}: {len(made.still)} kinds of furniture, {len(made.movable)} of things, "
         f"{out.stat().st_size / 1e6:.1f} MB")  # fmt: skip


def _check_out(out: Path) -> None:
    """Raise UserError where no weights can be written to."""
    from mpvi_bt.ground.errors import UserError

    if out.suffix != ".npz" or not out.parent.is_dir():
        raise UserError(f"--out {out}: name a file FILE.npz in a folder that there is.")
