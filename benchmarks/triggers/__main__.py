"""`python -m benchmarks.triggers`: episodes with triggers and with polling, and the table of what came of them."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from statistics import mean
from typing import Any

import click

from benchmarks.hands.__main__ import SEEDS
from benchmarks.rows import append, lines_of
from benchmarks.triggers.play import Job, Row, run_jobs
from mpvi_bt.ground.errors import MpviError, UserError
from mpvi_bt.runs.episode.prepare import prepare_episode

PAPER = -0.47  # change of q where polling takes the place of triggers (Paper, Ablation Study)
_POLLING = "periodic:300"


@click.command()
@click.option("--tasks", default="picking_up_trash", show_default=True, help="Names, joined by commas.")
@click.option("--instances", type=SEEDS, default="0-9", show_default=True)
@click.option("--triggers", default=f"proprioceptive,{_POLLING}", show_default=True,
              help="Joined by commas; q is compared with the first.")  # fmt: skip
@click.option("--checker", default="visual:fp=0.05,fn=0.1", show_default=True, help="As of mpvi run.")
@click.option("--policy", default="reactive", show_default=True, help="As of mpvi run.")
@click.option("--detector", default="segmentation", show_default=True, help="As of mpvi run.")
@click.option("--map", "map_", default="prior", show_default=True, help="As of mpvi run.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the mistakes, too.")
@click.option("--workers", "-j", type=click.IntRange(1, 64), default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), default="runs/triggers/results.jsonl",
              show_default=True, help="Rows go here; what is there is not played again.")  # fmt: skip
@click.option("--again", is_flag=True, help="Play what is there again.")
@click.option("--table", "only_table", is_flag=True, help="Play nothing: print the table of --out.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON.")
def main(
    tasks: str, instances: list[int], triggers: str, checker: str, policy: str, detector: str, map_: str, seed: int,
    workers: int, out: Path, again: bool, only_table: bool, as_json: bool,
) -> None:  # fmt: skip
    """Play every instance of every task with each of the triggers, and print what each was worth."""
    try:
        rows = {row.job: row for row in _read(out)}
        if not only_table:
            names = itertools.product(tasks.split(","), instances, triggers.split(","))
            jobs = [Job(task, i, trigger, checker, policy, detector, map_, seed) for task, i, trigger in names]
            for job in jobs:
                prepare_episode(job.config)  # what cannot be is refused before the first is played
            todo = [job for job in jobs if again or job not in rows]
            for row in _progress(run_jobs(todo, min(workers, max(len(todo), 1))), len(todo)):
                append(out, row.data())
                rows[row.job] = row
        wanted = list(rows.values()) if only_table else [rows[job] for job in jobs]
        records = table(wanted)
        click.echo(json.dumps(records, indent=2) if as_json else text(records))
    except MpviError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


def table(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """One record for each trigger over all tasks, and one for each task; of each checker, policy, detector and map.

    Returns:
        Keys "checker", "policy", "detector", "map", "task" ("all": of all that were played with every trigger),
        "trigger"; "n"; "q", mean; "success", "queries", "false_yes", "false_no": an episode's, a unit's likewise; "s",
        mean simulated time; "q_change", relative to the first trigger on the same instances, None for the first or
        where that has a q of 0; "broken".
    """
    groups: dict[tuple[str, ...], dict[str, list[Row]]] = {}
    for row in rows:
        job = row.job
        for task in ("all", job.task):
            key = (job.checker, job.policy, job.detector, job.map, task)
            groups.setdefault(key, {}).setdefault(job.trigger, []).append(row)
    return [record for key, by in groups.items() for record in _records(key, by)]


def text(records: list[dict[str, Any]]) -> str:
    """The tables for people."""
    lines: list[str] = []
    for run, members in itertools.groupby(records, key=lambda r: (r["checker"], r["policy"], r["detector"], r["map"])):
        lines += [""] if lines else []
        lines += [f"checker {run[0]}, policy {run[1]}, detector {run[2]}, map {run[3]}", ""]
        lines.append("| task | trigger | n | q | change of q | queries/unit | false yes/unit | false no/unit | s |")
        lines.append("|---|---|---|---|---|---|---|---|---|")
        for r in sorted(members, key=lambda r: (r["task"] != "all", r["task"])):
            change = "" if r["q_change"] is None else f"{r['q_change']:+.0%}"
            broken = f", {r['broken']} broken" if r["broken"] else ""
            lines.append(
                f"| {r['task']} | {r['trigger']} | {r['n']}{broken} | {r['q']:.3f} | {change} | "
                f"{r['queries']:.2f} | {r['false_yes']:.2f} | {r['false_no']:.2f} | {r['s']:.0f} |"
            )
    return "\n".join([*lines, "", f"the paper's change of q: {PAPER:+.0%}"])


def _records(key: tuple[str, ...], by_trigger: dict[str, list[Row]]) -> Iterator[dict[str, Any]]:
    """Of what was played with every trigger alone, so that the same instances are compared."""
    played = [{(row.job.task, row.job.instance, row.job.seed) for row in rows} for rows in by_trigger.values()]
    common = set.intersection(*played)
    first: float | None = None
    for trigger, rows in by_trigger.items():
        rows = [row for row in rows if (row.job.task, row.job.instance, row.job.seed) in common]
        if not rows:
            continue
        units = max(sum(row.queries.units for row in rows), 1)
        q = mean(row.q for row in rows)
        yield {
            **dict(zip(("checker", "policy", "detector", "map", "task"), key, strict=True)),
            "trigger": trigger, "n": len(rows), "q": q, "success": mean(row.success for row in rows),
            "queries": sum(row.queries.asked for row in rows) / units,
            "false_yes": sum(row.queries.false_yes for row in rows) / units,
            "false_no": sum(row.queries.false_no for row in rows) / units,
            "s": mean(row.simulated_s for row in rows),
            "q_change": q / first - 1 if first else None,
            "broken": sum(bool(row.problem) for row in rows),
        }  # fmt: skip
        first = q if first is None else first


def _read(path: Path) -> list[Row]:
    rows: dict[Job, Row] = {}
    for number, data in lines_of(path):
        try:
            row = Row.of(data)
        except (TypeError, KeyError, ValueError) as error:
            raise UserError(f"{path}:{number}: no result of an episode ({str(error).splitlines()[0]})") from None
        rows[row.job] = row
    return list(rows.values())


def _progress(rows: Iterable[Row], count: int) -> Iterator[Row]:
    """Pass rows on: a bar on a terminal, a line a row elsewhere."""
    with click.progressbar(rows, count, label="episodes", file=sys.stderr, hidden=not sys.stderr.isatty()) as bar:
        for done, row in enumerate(bar, start=1):
            if row.problem or not sys.stderr.isatty():
                clear = "\r\x1b[2K" if sys.stderr.isatty() else f"{done}/{count} "
                click.echo(clear + line(row), err=True)
            yield row


def line(row: Row) -> str:
    """A row for people."""
    job, asked = row.job, row.queries
    came = row.problem or f"q {row.q:.3f}, {asked.asked} asked, {asked.false_yes} false yes, {asked.false_no} false no"
    return f"{job.task} {job.instance} {job.trigger}: {row.ended}, {came}, {row.simulated_s:.0f} s"


if __name__ == "__main__":
    main()
