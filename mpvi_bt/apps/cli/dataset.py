"""`mpvi dataset`: a LeRobot dataset of recorded demonstrations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from mpvi_bt.executive.drawing.terminal import tell

_FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)


def _even(ctx: click.Context, param: click.Parameter, given: int | None) -> int | None:
    if given is not None and given % 2:
        raise click.BadParameter(f"{given} is odd; videos have an even number of pixels: {given - 1} or {given + 1}")
    return given


@click.command()
@click.argument("folders", type=_FOLDER, nargs=-1, required=True, metavar="FOLDER...")
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="New folder for the dataset."
)
@click.option("--all", "every", is_flag=True, help="Include episodes that missed their goal.")
@click.option(
    "--format",
    type=click.Choice(("v3.0", "v2.1")),
    default="v3.0",
    show_default=True,
    help="Format of LeRobot: v3.0 for lerobot 0.4 and newer, v2.1 for older ones, openpi and openpi-comet.",
)
@click.option(
    "--like",
    type=click.Choice(("behavior",)),
    help="Keys and numbers of BEHAVIOR's demonstrations of 2025, and in v2.1 their folders. Needs r1pro, 30 Hz.",
)
@click.option(
    "--base-velocity",
    type=click.Choice(("zero", "world")),
    default="zero",
    show_default=True,
    help="With --like behavior: 0, as in its demonstrations, or as its evaluator sends it.",
)
@click.option(
    "--actions",
    type=click.Choice(("absolute", "delta", "velocity")),
    default="absolute",
    show_default=True,
    help="A row's joints: their targets, how far these move in the row, or how fast.",
)
@click.option(
    "--prompt",
    type=click.Choice(("instruction", "subtask")),
    default="instruction",
    show_default=True,
    help="A row's `task`: the whole instruction, or the present subtask.",
)
@click.option(
    "--prompts",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="File with each task's instruction, such as openpi-comet's task_mapping.json.",
)
@click.option(
    "--size",
    type=click.IntRange(16, 2048),
    callback=_even,
    metavar="PIXELS",
    help="Scale and pad all pictures to this width and height.",
)
@click.option("--json", "as_json", is_flag=True, help="For programs: a summary of the dataset, as JSON.")
def dataset(
    folders: tuple[Path, ...], out: Path, every: bool, prompts: Path | None, as_json: bool, **form: Any
) -> None:
    """Make a LeRobot dataset of the demonstrations in each FOLDER.

    `mpvi run --demonstration DIR` records one, `mpvi suite run --demonstrations` one an episode.
    """
    from mpvi_bt.runs.datasets.demonstrations import Demonstrated, find_demonstrations
    from mpvi_bt.runs.datasets.lerobot import DatasetForm, write_dataset
    from mpvi_bt.runs.datasets.parquet import require_pandas

    require_pandas()
    found = find_demonstrations(folders)
    reached = [episode for episode in found if every or episode.about.success]
    taken = reached if prompts is None else [episode.told_as_in(prompts) for episode in reached]

    def note(what: str, number: int, episode: Demonstrated) -> None:
        click.echo(f"{what} {number + 1}/{len(taken)}  {episode.folder.name}  {episode.about.frames} frames", err=True)

    write_dataset(taken, out, DatasetForm(**form), note)
    frames = sum(episode.about.frames for episode in taken)
    if as_json:
        left = [str(episode.folder) for episode in found if episode not in reached]
        said = {"dataset": str(out), "episodes": len(taken), "frames": frames, "left_out": left}
        tell(json.dumps(said | form, indent=1, ensure_ascii=False))
        return
    without = f"; {len(found) - len(taken)} that missed their goal left out" if len(found) > len(taken) else ""
    tell(f"{out}: {len(taken)} episode{'s' * (len(taken) != 1)}, {frames} frames{without}")
