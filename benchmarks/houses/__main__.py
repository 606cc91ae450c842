"""`python -m benchmarks.houses`: generated houses, checked apart from their generator, and a sheet of how they look."""

from __future__ import annotations

import json
import statistics
import time
from pathlib import Path

import click

from benchmarks.houses.validity import faults
from mpvi_bt.ground.errors import BackendError, FileProblems
from mpvi_bt.house.layout.house import load_house

TILE_PX = (600, 600)


@click.command()
@click.option("--kind", default="family", show_default=True, help="Kind of the houses.")
@click.option("--first", default=0, show_default=True, help="Seed of the first house.")
@click.option("--count", default=200, show_default=True, help="How many houses.")
@click.option("--sheet", type=click.Path(path_type=Path, dir_okay=False), help="Draw houses into this picture.")
@click.option("--drawn", default=50, show_default=True, help="How many houses the picture has.")
@click.option("--json", "file", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures here as well.")
def main(kind: str, first: int, count: int, sheet: Path | None, drawn: int, file: Path | None) -> None:
    """Draw houses by their seeds and check each; with --sheet, draw pictures of them."""
    wrong: dict[str, list[str]] = {}
    seconds = []
    names = [f"generated:{kind}:{first + k}" for k in range(max(count, drawn))]
    for name in names[:count]:
        began = time.perf_counter()
        try:
            house = load_house(name)
        except (BackendError, FileProblems) as error:
            wrong[name] = [str(error)]
        else:
            seconds.append(time.perf_counter() - began)
            if found := faults(house):
                wrong[name] = found
        for fault in wrong.get(name, []):
            click.echo(f"{name}: {fault}")
    figures = {
        "houses": count,
        "valid": count - len(wrong),
        "seconds_median": round(statistics.median(seconds), 2),
        "seconds_most": round(max(seconds), 2),
    }
    click.echo(json.dumps(figures))
    if file is not None:
        file.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    if sheet is not None:
        from benchmarks.houses.sheet import write_sheet

        write_sheet(names[:drawn], sheet, TILE_PX)


if __name__ == "__main__":
    main()
