"""`python -m benchmarks.grids`: ours beside libraries on the same maps, in turns, every result checked."""

from __future__ import annotations

import importlib.util
import json
import statistics
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.grids import edges, looks, paths
from benchmarks.grids.first import first_calls
from benchmarks.grids.maps import cell, costs, house, reachable
from benchmarks.grids.timing import Timed, in_turns, ratio
from mpvi_bt.finding.navigation.grid import cost_to_reach
from mpvi_bt.ground.extras import install

SIZES = "160x200,1000x1000,4000x4000"
LIBRARIES = {"tcod": "tcod", "skimage": "scikit-image", "pyastar2d": "pyastar2d", "cv2": "opencv-python"}


@dataclass(frozen=True)
class Row:
    """What is told of one side.

    Attributes:
        job: What it did.
        size: Of the map, in cells.
        side: Whose it is.
        median_ms: For a case.
        ours_by_this: Median of our time by its time in the same round.
        checked: What its results are worth.
        exact: Whether none of its results is beaten; None where that cannot be told.
        memory_mb: How much the process grew at most during a case; 0 where the system does not tell.
    """

    job: str
    size: str
    side: str
    median_ms: float
    ours_by_this: float
    checked: str
    exact: bool | None
    memory_mb: float


@click.command()
@click.option("--sizes", default=SIZES, show_default=True, help="Rows x columns of the maps; cells are 5 cm.")
@click.option("--seed", default=0, show_default=True, help="Of the maps and cases.")
@click.option("--json", "file", type=click.Path(path_type=Path, dir_okay=False), help="Write the rows here as well.")
@click.option("--first/--no-first", default=True, show_default=True, help="Measure first calls in new processes.")
def main(sizes: str, seed: int, file: Path | None, first: bool) -> None:
    """Time A*, visibility, frontiers and the nearest frontier, ours and libraries' in turns.

    The libraries are tcod, scikit-image, pyastar2d and OpenCV, as far as they are installed. The largest map takes some
    minutes and 4 GB.
    """
    for library, package in LIBRARIES.items():
        if importlib.util.find_spec(library) is None:
            click.echo(f"{package} is not installed and left out: {install('benchmarks')}", err=True)
    rows: list[Row] = []
    for shape in _shapes(sizes):
        for row in _rows(shape, seed):
            rows.append(row)
            if row.side == "ours":
                click.echo(f"\n{row.job}, {row.size}\n{'':30s}{'ms':>10s}{'ours/this':>10s}{'MB':>7s}  checked")
            mark = {True: "exact", False: "NOT EXACT", None: ""}[row.exact]
            figures = f"{row.median_ms:10.3f}{row.ours_by_this:10.3f}{row.memory_mb:7.0f}"
            click.echo(f"  {row.side:28s}{figures}  {row.checked}  {mark}")
    calls = []
    if first:
        click.echo(f"\n{'first call in a new process':42s}{'import s':>10s}{'first s':>10s}{'second ms':>10s}")
        for name, imported, called, again in first_calls():
            calls.append({"what": name, "import_s": imported, "first_s": called, "second_s": again})
            click.echo(f"  {name:40s}{imported:10.2f}{called:10.2f}{1e3 * again:10.2f}")
    if file is not None:
        told = {"rows": [asdict(row) for row in rows], "first_calls": calls}
        file.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def _shapes(sizes: str) -> list[tuple[int, int]]:
    """Of the maps. Raises click.BadParameter for what is none, or too small for a house."""
    shapes = []
    for word in sizes.split(","):
        rows, _, columns = word.partition("x")
        if not (rows.isdigit() and columns.isdigit() and min(int(rows), int(columns)) >= 120):
            raise click.BadParameter(f"{word!r} is no size of at least 120x120; write {SIZES}", param_hint="--sizes")
        shapes.append((int(rows), int(columns)))
    return shapes


def _rows(shape: tuple[int, int], seed: int) -> Iterator[Row]:
    """Every job on a map of one size."""
    size = f"{shape[0]}x{shape[1]}"
    large = shape[0] * shape[1] > 4_000_000
    pairs, rounds = (3, 2) if large else (10, 5)

    def told(job: str, timed: Sequence[Timed], verdicts: Mapping[str, tuple[str, bool | None]]) -> Iterator[Row]:
        for one in timed:
            took = 1e3 * statistics.median(one.seconds.values())
            yield Row(job, size, one.side.name, took, ratio(timed[0], one), *verdicts[one.side.name], one.memory_mb)

    def turns(job: str, sides: Iterator[Any], cases: Sequence[Any]) -> list[Timed]:
        timed = in_turns(list(sides), cases, rounds, lambda at: _progress(f"{size} {job}: {at}"))
        _progress("")
        return timed

    _progress(f"{size}: making a map")
    rng = np.random.default_rng([seed, 1])
    grid_map = house(*shape, seed)
    for kind, cost in costs(grid_map).items():
        cells = reachable(cost)
        ends = [(cell(cells[i]), cell(cells[j])) for i, j in rng.integers(0, len(cells), (pairs, 2))]
        timed = turns(f"A*, {kind}", paths.sides(cost, 1 if large else 2), ends)
        yield from told(f"A*, {kind} cost", timed, paths.judge(cost, timed))

    middle = cell(cells[len(cells) // 2])
    free = ~grid_map.occupied
    stands = [cell(cells[i]) for i in rng.integers(0, len(cells), 20)]
    views = [looks.Look.taken(grid_map, at, float(yaw)) for at, yaw in zip(stands, rng.uniform(-3, 3, 20), strict=True)]
    timed = turns("visibility", looks.sides(grid_map), views)
    yield from told("visibility update, 85 degrees to 4 m", timed, looks.judge(grid_map, views, timed))

    there = cost_to_reach(np.where(free, np.float32(1.0), np.float32(np.inf)), middle)
    seen = there < np.quantile(there[np.isfinite(there)], 0.4)  # what a robot has seen that searched from there
    timed = turns("frontier", edges.frontier_sides(), [(free, seen)] * pairs)
    yield from told("frontier of the whole map", timed, edges.judge_frontiers(timed))

    targets = timed[0].results[0] & np.isfinite(cost)
    inside = np.argwhere(seen & np.isfinite(cost) & ~targets)
    starts = [cell(inside[i]) for i in rng.integers(0, len(inside), pairs)]
    timed = turns("nearest frontier", edges.nearest_sides(cost, targets, 1 if large else 2), starts)
    yield from told("nearest frontier", timed, paths.judge(cost, timed))


def _progress(line: str) -> None:
    """On one line of a terminal."""
    if sys.stderr.isatty():
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)


if __name__ == "__main__":
    main()
