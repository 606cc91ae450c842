"""`python -m benchmarks.hands`: trials of skills, and the table of what came of them."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Iterable
from pathlib import Path

import click

from benchmarks.hands.policies import maker_of
from benchmarks.hands.rows import Job, Row, add_row, read_rows
from benchmarks.hands.runner import ERRORS, WALL_LIMIT_S, run_jobs
from benchmarks.hands.scenes import choose
from benchmarks.hands.table import markdown, table
from benchmarks.hands.trial import Shapes
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.robots import ROBOTS

_SHAPES = ("tuning", "held_out", "half")


class _Seeds(click.ParamType[list[int]]):
    name = "seeds"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> list[int]:
        if isinstance(value, list):
            return value
        seeds: list[int] = []
        for part in str(value).split(","):
            low, _, high = part.partition("-")
            if not low.isdigit() or (high and not high.isdigit()):
                self.fail(f"{part!r} is no seed; write 7, 0-19 or 0-3,8", param, ctx)
            seeds += range(int(low), int(high or low) + 1)
        return seeds


SEEDS = _Seeds()


@click.command()
@click.option("--skill", "-s", multiple=True, help="Only this skill; may be repeated.")
@click.option("--case", "-c", multiple=True, help="Only this case of the skills; may be repeated.")
@click.option("--policy", "-p", default="expert", show_default=True, help="Policies, joined by commas.")
@click.option("--seeds", type=SEEDS, default="0-19", show_default=True, help="200-219 are for the final table only.")
@click.option("--shapes", type=click.Choice(_SHAPES), default="tuning", show_default=True,
              help="half: even seeds take tuning shapes, odd ones held-out shapes.")  # fmt: skip
@click.option("--noise", type=click.Choice(list(ERRORS)), default="none", show_default=True,
              help="Error model of the senses of policies that see.")  # fmt: skip
@click.option("--perception-error", "perception_cm", type=click.FloatRange(0, 20), default=0.0, metavar="CM",
              help="Error of where things are believed to be, standard deviation.")  # fmt: skip
@click.option("--assisted", is_flag=True, help="Fix what a closing hand pinches to the hand.")
@click.option("--pregrasp", is_flag=True, help="A planned motion brings the hand before what is to be picked up.")
@click.option(
    "--pregrasp-hand",
    "hand",
    type=click.Choice(list(SIDES)),
    help="With --pregrasp: this hand, not the one on the thing's side.",
)
@click.option("--signals", is_flag=True, help="Keep the monitors' signals in the rows.")
@click.option("--robot", type=click.Choice(list(ROBOTS)), default="r1", show_default=True)
@click.option("--workers", "-j", type=click.IntRange(1, 64), default=2, show_default=True)
@click.option("--wall-limit", type=click.FloatRange(1), default=WALL_LIMIT_S, show_default=True,
              help="Wall time [s] after which a trial counts as hung.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), default="runs/hands/results.jsonl",
              show_default=True, help="Rows go here; what is there is not played again.")  # fmt: skip
@click.option("--again", is_flag=True, help="Play what is there again.")
@click.option("--show", type=click.Path(path_type=Path, file_okay=False), metavar="FOLDER",
              help="Pictures of the start and the end of every trial.")  # fmt: skip
@click.option("--video", is_flag=True, help="With --show: films, too; they count as playing time.")
@click.option("--list", "listing", is_flag=True, help="Name every skill and case.")
@click.option("--table", "only_table", is_flag=True, help="Play nothing: print the table of --out.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON.")
def main(
    skill: tuple[str, ...], case: tuple[str, ...], policy: str, seeds: list[int], shapes: str, noise: str,
    perception_cm: float, assisted: bool, pregrasp: bool, hand: Side | None, signals: bool, robot: str,
    workers: int, wall_limit: float, out: Path, again: bool, show: Path | None, video: bool, listing: bool,
    only_table: bool, as_json: bool,
) -> None:  # fmt: skip
    """Play trials of single skills and print the table of what came of them."""
    try:
        pairs = choose(skill, case)
        for name in (policies := policy.split(",")):
            maker_of(name)
        if listing:
            for pair in pairs:
                click.echo(f"{pair[0]}/{pair[1]}")
            return
        rows = {row.job: row for row in read_rows(out)}
        if only_table:
            wanted = [row for row in rows.values() if (row.job.skill, row.job.case) in pairs]
        else:
            jobs = [
                Job(s, c, p, seed, _shapes(shapes, seed), noise, perception_cm, assisted, robot, pregrasp, hand)
                for (s, c), p, seed in itertools.product(pairs, policies, seeds)
            ]
            todo = [job for job in jobs if again or show or job not in rows]
            workers = min(workers, max(len(todo), 1))
            for row in _progress(run_jobs(todo, workers, wall_limit, show, video, signals), len(todo)):
                add_row(out, row)
                rows[row.job] = row
            wanted = [rows[job] for job in jobs]
        click.echo(json.dumps(table(wanted), indent=2) if as_json else markdown(wanted))
    except MpviError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


def _shapes(wanted: str, seed: int) -> Shapes:
    if wanted == "half":
        return "held_out" if seed % 2 else "tuning"
    return "held_out" if wanted == "held_out" else "tuning"


def _progress(rows: Iterable[Row], count: int) -> Iterable[Row]:
    """Pass rows on: a bar on a terminal, a line a row elsewhere."""
    failed = 0
    with click.progressbar(rows, count, label="trials", file=sys.stderr, item_show_func=lambda _: f"{failed} failed",
                           hidden=not sys.stderr.isatty()) as bar:  # fmt: skip
        for done, row in enumerate(bar, start=1):
            failed += not row.ok
            if not row.ok or not sys.stderr.isatty():
                clear = "\r\x1b[2K" if sys.stderr.isatty() else f"{done}/{count} "
                came = "ok" if row.ok else row.cause
                click.echo(f"{clear}{row.job.name}: {came}, {row.simulated_s:.1f} s", err=True)
            yield row


if __name__ == "__main__":
    main()
