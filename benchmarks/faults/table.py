"""`python -m benchmarks.faults.table FILES`: rows of trials as `benchmarks/results/faults.json`, for `make results`."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from pydantic import ValidationError

from benchmarks.collecting import commit, processor
from benchmarks.faults.trials import BAD
from benchmarks.origin import Run
from benchmarks.rows import lines_of
from benchmarks.tables import RESULTS, Table
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.writing import write_whole

HEADS = ("what", "trials", "refused with a reason", "went on", *BAD)
WHAT = {  # by file and, where several are told apart, by what comes before the colon
    "mutants": "broken files, of {kinds} kinds",
    "answers planner": "answers to a planner",
    "answers checker": "answers to a checker",
    "answers server": "bodies of a model's server",
    "servers openpi": "failing policy servers, openpi's wire",
    "servers vla_eval": "failing policy servers, vla_eval's wire",
    "kills": "kills of a suite",
    "soak": "episodes in one process, {minutes:.0f} min",
}


def rows_of(stem: str, rows: Sequence[Mapping[str, Any]]) -> list[list[str | int]]:
    """The table's rows of one file of trials."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        part = row["of"].partition(":")[0]
        groups.setdefault(f"{stem} {part}" if f"{stem} {part}" in WHAT else stem, []).append(row)
    made: list[list[str | int]] = []
    for name in (name for name in WHAT if name in groups):
        group = groups[name]
        ends = Counter(row["ended"] for row in group)
        kinds = len({row["of"].partition(":")[0] for row in group})
        told = WHAT[name].format(kinds=kinds, minutes=group[-1].get("minutes", 0.0))
        made.append([told, len(group), *(ends[end] for end in ("refused", "went on", *BAD))])
    return made


def table(files: Mapping[Path, str], date: str, where: str, mixed: str = "") -> Table:
    """The data file of the rows in some files.

    Args:
        files: File to the commit that its trials were made at.
        date, where: That they were made on: day and processor.
        mixed: Why trials of several commits are in one table.

    Raises:
        UserError: A file is none of trials, or has none; or they are of several commits, and nobody says why.
    """
    runs, rows = [], []
    for file, made_at in files.items():
        stem = file.stem
        if not any(name.split()[0] == stem for name in WHAT):
            raise UserError(f"{file}: no trials; they are {', '.join(sorted({name.split()[0] for name in WHAT}))}")
        trials = [row for _, row in lines_of(file)]
        if not trials:
            raise UserError(f"{file}: there are no trials in it yet")
        seeds = sorted({row["seed"] for row in trials})
        command = f"python -m benchmarks.faults.{stem} --seed {' and '.join(map(str, seeds))}"
        command += f" --minutes {trials[-1]['minutes']:.0f}" if stem == "soak" else f" --count {len(trials)}"
        runs.append(Run(command=command, commit=made_at, date=date, processor=where))
        rows += rows_of(stem, trials)
    columns = [{"head": head, "format": "" if head == "what" else ",d"} for head in HEADS]
    try:
        return Table.model_validate({"kind": "table", "runs": runs, "mixed": mixed, "columns": columns, "rows": rows})
    except ValidationError as error:
        raise UserError(error.errors()[0]["msg"]) from None


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE[@COMMIT]...")
@click.option("--date", required=True, help="That they were made on, YYYY-MM-DD.")
@click.option("--processor", "where", help="That they were made on; this machine's if left out.")
@click.option("--mixed", default="", help="Why trials of several commits stand together.")
def main(files: tuple[str, ...], date: str, where: str | None, mixed: str) -> None:
    """Keep the trials in files such as runs/faults/kills.jsonl as a table; COMMIT: by default the working tree's."""
    try:
        given = {Path(file): made_at or commit() for file, _, made_at in (one.partition("@") for one in files)}
        made = table(given, date, where or processor(), mixed)
        data = made.model_dump(mode="json", exclude_defaults=True)
        columns, rows = data.pop("columns"), data.pop("rows")
        lines = [",\n".join(f"    {json.dumps(one)}" for one in part) for part in (columns, rows)]
        text = json.dumps({"kind": "table", **data}, indent=2)[:-2]
        text += f',\n  "columns": [\n{lines[0]}\n  ],\n  "rows": [\n{lines[1]}\n  ]\n}}\n'
        write_whole(RESULTS / "faults.json", text)
    except UserError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
