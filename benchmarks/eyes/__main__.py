"""`python -m benchmarks.eyes FOLDER`: how well eyes see in houses that they were not trained in."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Mapping
from pathlib import Path

import click
import numpy as np

from benchmarks.eyes.figures import by_draw, by_kind, by_score, by_size
from benchmarks.eyes.seen import look_at_all
from benchmarks.eyes.sheet import write_sheet
from benchmarks.tables import RESULTS, ROOT, Run, Table
from mpvi_bt.finding.eyes.picture_file import LabeledPicture, pictures_in
from mpvi_bt.finding.eyes.segmenter import SHIPPED, LearnedSegmenter
from mpvi_bt.finding.eyes.tiles import disturbed

_SHOWN, _WORST = 30, 10  # pictures of the sheet


def with_noise(picture: LabeledPicture, seed: int) -> LabeledPicture:
    """As pictures are disturbed in training."""
    h, w = picture.labels.shape
    return disturbed(picture, np.arange(h), np.arange(w), np.random.default_rng(seed))


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--weights", type=click.Path(exists=True, dir_okay=False, path_type=Path), default=SHIPPED)
@click.option("--every", type=click.IntRange(1), default=1, show_default=True, help="Only each so-many-th picture.")
@click.option("--noisy", is_flag=True, help="With noise of depth, holes, other light and poses a little off.")
@click.option(
    "--sheet", type=click.Path(dir_okay=False, path_type=Path), help="Draw forty pictures with segments there."
)
@click.option("--keep", is_flag=True, help="Write the tables to benchmarks/results/, for `make results`.")
@click.option("--processor", default="", help="What it runs on, for the tables.")
def main(folder: Path, weights: Path, every: int, noisy: bool, sheet: Path | None, keep: bool, processor: str) -> None:
    """Print how well eyes see the pictures of `python -m benchmarks.eyes.pictures FOLDER --split held_out`."""
    eyes = LearnedSegmenter.load(weights)
    pictures = pictures_in(folder)
    chosen = range(0, len(pictures), every)
    seen = look_at_all(eyes, (with_noise(pictures[k], k) if noisy else pictures[k] for k in chosen))
    typed = "python -m benchmarks.eyes FOLDER" + (f" --every {every}" if every > 1 else "") + " --noisy" * noisy
    settings = (f"{len(chosen)} pictures, one training; mIoU {seen.mean_overlap:.2f}, "
                f"{np.median(seen.ms):.0f} ms a picture of processor time (median)")  # fmt: skip
    commit = subprocess.run(["git", "rev-parse", "--short=8", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    run = Run(command=typed, commit=commit.stdout.strip() or None, date=time.strftime("%Y-%m-%d"),
              processor=processor or None, settings=settings)  # fmt: skip
    tables: Mapping[str, Table] = {
        "eyes": by_size(seen, [run]), "eyes_draws": by_draw(seen, [run]), "eyes_scores": by_score(seen, [run]),
        "eyes_kinds": by_kind(seen, [run]),
    }  # fmt: skip
    for name, table in tables.items():
        click.echo(f"{name}\n{table.render()}\n")
        if keep:
            (RESULTS / f"{name}.json").write_text(
                table.model_dump_json(indent=1, exclude={"name"}, exclude_defaults=True) + "\n", encoding="utf-8"
            )
    if sheet is not None:
        order = np.argsort(seen.shares, kind="stable")
        rng = np.random.default_rng(0)
        some = rng.permutation(order[_WORST:])[:_SHOWN]
        picked = [pictures[chosen[int(k)]] for k in (*some, *order[:_WORST])]
        write_sheet(sheet, eyes, picked)


if __name__ == "__main__":
    main()
