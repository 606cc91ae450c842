"""`python -m benchmarks.searches`: searches over houses, and the table of what came of them."""

from __future__ import annotations

import itertools
import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

import click

from benchmarks.hands.__main__ import SEEDS
from benchmarks.rows import append, lines_of
from benchmarks.searches.play import BUMP_N, Job, Row
from benchmarks.searches.runner import run_jobs
from mpvi_bt.apps.cli.argument_types import Houses
from mpvi_bt.ground.errors import MpviError, UserError
from mpvi_bt.house.generated.seeded_name import seeded
from mpvi_bt.runs.suite.suite_houses import suite_houses


@click.command()
@click.option("--seeds", type=SEEDS, default="0-19", show_default=True, help="100-299 are for final tables only.")
@click.option("--map", "maps", default="prior", show_default=True, help="Maps, joined by commas: prior, online.")
@click.option("--detector", default="segmentation", show_default=True, help="As of mpvi run.")
@click.option(
    "--houses",
    type=Houses(),
    default="family_house",
    show_default=True,
    help="How many are drawn, or which, joined by commas; seeds take them in turn.",
)
@click.option("--workers", "-j", type=click.IntRange(1, 64), default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), default="runs/searches/results.jsonl",
              show_default=True, help="Rows go here; what is there is not played again.")  # fmt: skip
@click.option("--again", is_flag=True, help="Play what is there again.")
@click.option("--table", "only_table", is_flag=True, help="Play nothing: print the table of --out.")
@click.option("--worst", type=click.IntRange(min=0), default=10, show_default=True, help="How many to list by SPL.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON.")
def main(
    seeds: list[int], maps: str, detector: str, houses: int | tuple[str, ...], workers: int, out: Path, again: bool,
    only_table: bool, worst: int, as_json: bool,
) -> None:  # fmt: skip
    """Search houses for things in unknown places, and print how the searches ended."""
    try:
        rows = {row.job: row for row in _read(out)}
        if not only_table:
            names = suite_houses(houses)
            jobs = [
                Job(seed, given, detector, names[seed % len(names)])
                for given, seed in itertools.product(maps.split(","), seeds)
            ]
            todo = [job for job in jobs if again or job not in rows]
            for row in _progress(run_jobs(todo, min(workers, max(len(todo), 1))), len(todo)):
                append(out, {**asdict(row.job), **{k: v for k, v in asdict(row).items() if k != "job"}})
                rows[row.job] = row
        wanted = list(rows.values()) if only_table else [rows[job] for job in jobs]
        click.echo(json.dumps(table(wanted, worst), indent=2) if as_json else text(wanted, worst))
    except MpviError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


def table(rows: Iterable[Row], worst: int) -> list[dict[str, Any]]:
    """One record for each kind of house, map and detector, and for those of its searches whose target was hidden."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        house = "drawn" if seeded(row.job.house) else row.job.house
        for targets in ("all", "hidden" if row.hidden else "open"):
            groups.setdefault((house, row.job.map, row.job.detector, targets), []).append(row)
    return [_record(group, members, worst) for group, members in sorted(groups.items())]


def text(rows: list[Row], worst: int) -> str:
    """The table for people."""
    lines = [
        "| houses | map | detector | targets | found | median SPL | median s | pictures/s | over 20 N | failures |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    records = table(rows, worst)
    for r in records:
        failures = ", ".join(f"{n} {reason}" for reason, n in r["failures"].items())
        lines.append(
            f"| {r['houses']} | {r['map']} | {r['detector']} | {r['targets']} | {r['found']}/{r['n']} | "
            f"{r['median_spl']:.2f} | {r['median_s']:.0f} | {r['pictures_a_second']:.1f} | {r['bumps']} | {failures} |"
        )
    shares = [row.wall_s["navigation"] / row.wall_s["stepping"] for row in rows if row.wall_s.get("stepping")]
    if shares:
        lines.append(f"\nnavigation without rendering, over stepping: median {median(shares):.1%}")
    for r in records:
        if r["targets"] == "all" and worst:
            lines.append(f"\nworst {worst} by SPL, {r['houses']}, map {r['map']}, detector {r['detector']}:")
            lines += [f"  {line}" for line in r["worst"]]
    return "\n".join(lines)


def _record(group: tuple[str, ...], rows: list[Row], worst: int) -> dict[str, Any]:
    found = [row for row in rows if row.found]
    return {
        **dict(zip(("houses", "map", "detector", "targets"), group, strict=True)),
        "found": len(found), "n": len(rows),
        "median_spl": median(row.spl for row in rows),
        "median_s": median(row.simulated_s for row in rows),
        "pictures_a_second": sum(r.pictures for r in rows) / max(sum(sum(r.wall_s.values()) for r in rows), 1e-9),
        "bumps": sum(row.bump_n > BUMP_N for row in rows),
        "failures": dict(Counter(row.reason for row in rows if not row.found).most_common()),
        "worst": [_line(row) for row in sorted(rows, key=lambda row: row.spl)[:worst]],
    }  # fmt: skip


def _line(row: Row) -> str:
    hidden = ", hidden" if row.hidden else ""
    came = "found" if row.found else f"{row.reason}: {row.evidence}"
    way = f"{row.path_m:.1f} m of {row.shortest_m:.1f} m in {row.simulated_s:.0f} s"
    bump = f", {row.bump_n:.0f} N on {row.bumped}" if row.bump_n > BUMP_N else ""
    where = "" if row.job.house == Job.house else f" of {row.job.house}"
    return (
        f"{row.job.seed}: {row.target} in {row.room}{where} on {row.on}{hidden}: SPL {row.spl:.2f}, {way}{bump}; {came}"
    )


def _read(path: Path) -> list[Row]:
    rows: dict[Job, Row] = {}
    for number, data in lines_of(path):
        try:
            job = Job(**{key: data.pop(key) for key in ("seed", "map", "detector", "house") if key in data})
            rows[job] = Row(job=job, **data)
        except (TypeError, KeyError) as error:
            raise UserError(f"{path}:{number}: no result of a search ({error})") from None
    return list(rows.values())


def _progress(rows: Iterable[Row], count: int) -> Iterator[Row]:
    """Pass rows on: a bar on a terminal, a line a row elsewhere."""
    failed = 0
    with click.progressbar(rows, count, label="searches", file=sys.stderr, item_show_func=lambda _: f"{failed} failed",
                           hidden=not sys.stderr.isatty()) as bar:  # fmt: skip
        for done, row in enumerate(bar, start=1):
            failed += not row.found
            if not row.found or not sys.stderr.isatty():
                clear = "\r\x1b[2K" if sys.stderr.isatty() else f"{done}/{count} "
                click.echo(f"{clear}{_line(row)}", err=True)
            yield row


if __name__ == "__main__":
    main()
