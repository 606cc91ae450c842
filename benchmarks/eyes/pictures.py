"""`python -m benchmarks.eyes.pictures FOLDER`: labeled pictures that eyes are trained and tested on."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import click
import numpy as np

from benchmarks.eyes.scenes import PictureScene, Split, draw_scene
from benchmarks.eyes.views import look_around
from benchmarks.pool import play_all
from mpvi_bt.finding.eyes.picture_file import LabeledPicture, write_pictures
from mpvi_bt.finding.perception.segments import FLOOR, kind_of
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.robot.protocol import CameraImage

_A_SCENE = 80  # pictures
_MOST_LABELS = 255
_WALL_LIMIT_S = 180.0


def labeled(image: CameraImage, scene: PictureScene) -> LabeledPicture:
    """A picture with its own short list of labels: the robot is one thing, and so are all floors."""
    assert image.labels is not None
    ids, flat = np.unique(image.labels, return_inverse=True)
    things: dict[str, int] = {}
    kinds, drawn, table = [], [], np.zeros(len(ids), np.uint8)
    for k, id_ in enumerate(ids.tolist()):
        name = image.names.get(id_, "")
        kind = kind_of(name)
        one = kind if kind in ("robot", FLOOR) else name
        if not kind or (one not in things and len(things) == _MOST_LABELS):
            continue
        if one not in things:
            things[one] = len(things) + 1
            kinds.append(kind)
            drawn.append(scene.drawn.get(name, "fixture"))
        table[k] = things[one]
    labels = table[flat].reshape(image.labels.shape)
    return LabeledPicture(
        image.rgb, image.depth, labels, tuple(kinds), tuple(drawn), image.K, image.T_world_camera, image.camera
    )


def pictures_of(seed: int, split: Split, count: int = _A_SCENE) -> list[LabeledPicture]:
    """Pictures of the scene of a seed."""
    scene = draw_scene(seed, split)
    rng = np.random.default_rng([seed, split == "held_out", 1])
    return [labeled(image, scene) for image in look_around(scene, count, rng)]


def keep(seed: int, folder: Path, split: Split) -> tuple[int, str]:
    """Write the pictures of a seed's scene; how many, and what went wrong."""
    try:
        pictures = pictures_of(seed, split)
    except BackendError as error:
        return 0, f"scene {seed}: {error}"
    if pictures:
        write_pictures(file_of(folder, split, seed), pictures)
    return len(pictures), ""


def file_of(folder: Path, split: Split, seed: int) -> Path:
    """Where the pictures of a scene are."""
    return folder / f"{split}-{seed:05d}.npz"


def _failed(seed: int, cause: str) -> tuple[int, str]:
    return 0, f"scene {seed}: {cause}"


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--split", type=click.Choice(["train", "held_out"]), default="train", show_default=True)
@click.option("--scenes", type=click.IntRange(1), default=250, show_default=True, help=f"Of {_A_SCENE} pictures each.")
@click.option("--first", type=click.IntRange(0), default=0, show_default=True, help="Seed of the first scene.")
@click.option("--workers", "-j", type=click.IntRange(1, 64), default=1, show_default=True)
def main(folder: Path, split: Split, scenes: int, first: int, workers: int) -> None:
    """Draw scenes and keep pictures of them in FOLDER, a file a scene; files that are there are not made again."""
    folder.mkdir(parents=True, exist_ok=True)
    seeds = [seed for seed in range(first, first + scenes) if not file_of(folder, split, seed).exists()]
    began, made = time.perf_counter(), 0
    rows = play_all(partial(keep, folder=folder, split=split), _failed, seeds, workers, _WALL_LIMIT_S)
    for done, (count, wrong) in enumerate(rows, start=1):
        made += count
        if wrong:
            click.echo(wrong, err=True)
        if done % 10 == 0 or done == len(seeds):
            spent = time.perf_counter() - began
            click.echo(f"{done} of {len(seeds)} scenes: {made} pictures in {spent:.0f} s", err=True)


if __name__ == "__main__":
    main()
