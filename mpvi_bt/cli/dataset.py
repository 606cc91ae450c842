"""`mpvi dataset`: a LeRobot dataset of recorded demonstrations."""

from __future__ import annotations

import json
from pathlib import Path

import click

_FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)


@click.command()
@click.argument("folders", type=_FOLDER, nargs=-1, required=True, metavar="FOLDER...")
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder of the dataset, a new one."
)
@click.option("--all", "every", is_flag=True, help="Take episodes, too, that did not reach their goal.")
@click.option("--json", "as_json", is_flag=True, help="Say as JSON what was written.")
def dataset(folders: tuple[Path, ...], out: Path, every: bool, as_json: bool) -> None:
    """Make a LeRobot dataset (v3.0) of the demonstrations in each FOLDER.

    `mpvi run --demonstration DIR` records one, `mpvi suite run --demonstrations` one an episode.
    """
    from mpvi_bt.suite.dataset import require_pandas, write_dataset
    from mpvi_bt.suite.demonstrations import Demonstrated, find_demonstrations

    require_pandas()
    found = find_demonstrations(folders)
    taken = [episode for episode in found if every or episode.about.success]

    def tell(what: str, number: int, episode: Demonstrated) -> None:
        click.echo(f"{what} {number + 1}/{len(taken)}  {episode.folder.name}  {episode.about.frames} frames", err=True)

    write_dataset(taken, out, tell)
    frames = sum(episode.about.frames for episode in taken)
    if as_json:
        left = [str(episode.folder) for episode in found if episode not in taken]
        said = {"dataset": str(out), "episodes": len(taken), "frames": frames, "left_out": left}
        click.echo(json.dumps(said, indent=1, ensure_ascii=False))
        return
    without = f"; {len(found) - len(taken)} that missed their goal left out" if len(found) > len(taken) else ""
    click.echo(f"{out}: {len(taken)} episodes, {frames} frames{without}")
