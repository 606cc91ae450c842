"""`python -m benchmarks.collecting NAME FOLDER`: keep a suite's scores as `benchmarks/results/NAME.json`."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import click
from pydantic import ValidationError

from benchmarks.tables import RESULTS, ROOT, Episodes, Run, TaskScores
from mpvi_bt.episode.result import Result, read_result
from mpvi_bt.errors import UserError
from mpvi_bt.report.failures import reason
from mpvi_bt.suite.manifest import read_manifest

NAMED = 6  # reasons that a table names for each task


def read(folder: Path) -> dict[str, list[Result]]:
    """The results in a folder of one method, by task in the suite's order, then by instance and seed.

    Raises:
        UserError: There are none, or a file is no result.
    """
    results = []
    for file in folder.joinpath("json").glob("*.json"):
        result = read_result(file)
        if result is None:
            raise UserError(f"{file}: no result")
        results.append(result)
    if not results:
        raise UserError(f"{folder}: there are no results in json/; a suite of several methods has a folder for each")
    manifest = read_manifest(folder) or read_manifest(folder.parent)
    order = list(manifest.tasks) if manifest else sorted({result.task for result in results})
    results.sort(key=lambda result: (order.index(result.task), result.instance_id, result.rollout_id))
    by_task: dict[str, list[Result]] = {}
    for result in results:
        by_task.setdefault(result.task, []).append(result)
    return by_task


def gave_up(results: list[Result]) -> str:
    """Why units were given up in the episodes that missed something, the most frequent reason first."""
    missed = [result for result in results if not result.success]
    codes = (re.sub(r"^.*\((.+)\)$", r"\1", reason(failure)) for result in missed for failure in result.failures)
    common = Counter(codes).most_common(NAMED)
    text = ", ".join(code if count == 1 else f"{code} {count}" for code, count in common)
    late = sum(result.ended == "time_limit" for result in missed)
    return "; ".join(filter(None, [text, f"out of time {late}" if late else ""]))


def processor() -> str:
    """Model, cores and load of this machine."""
    info = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*: (.+)", info.read_text(encoding="utf-8")) if info.exists() else None
    return (
        f"{model[1].strip() if model else 'unknown processor'}, {os.cpu_count()} cores, load {os.getloadavg()[2]:.1f}"
    )


def commit() -> str:
    """The commit of the working tree.

    Raises:
        UserError: Files differ from it, so that it does not tell what was measured.
    """

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    if changed := git("status", "--porcelain", "--", "mpvi_bt", "tasks", "skills", "trees", "policies"):
        raise UserError(f"the working tree is not its commit ({changed.splitlines()[0].strip()}); give --commit")
    return git("rev-parse", "--short", "HEAD")


def dump(results: Episodes) -> str:
    """As the files are kept: a line a task."""
    data: dict[str, Any] = results.model_dump(exclude_defaults=True)
    tasks = ",\n".join(f"    {json.dumps(name)}: {json.dumps(scores)}" for name, scores in data.pop("tasks").items())
    return f'{json.dumps({"kind": "episodes", **data}, indent=2)[:-2]},\n  "tasks": {{\n{tasks}\n  }}\n}}\n'


@click.command()
@click.argument("name")
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--command", required=True, help="What made the results, as it was typed.")
@click.option("--commit", "given", help="That it was made at; the working tree's if left out.")
@click.option("--date", required=True, help="That it was made on, YYYY-MM-DD.")
def main(name: str, folder: Path, command: str, given: str | None, date: str) -> None:
    """Keep the scores and reasons of FOLDER, the results of one method of a suite, for `make results`."""
    try:
        tasks = {
            task: TaskScores(q=tuple(round(result.q, 4) for result in results), gave_up=gave_up(results))
            for task, results in read(folder).items()
        }
        run = Run(command=command, commit=given or commit(), date=date, processor=processor())
    except (UserError, ValidationError) as error:
        click.echo(f"collecting: {error}", err=True)
        sys.exit(2)
    RESULTS.joinpath(f"{name}.json").write_text(dump(Episodes(kind="episodes", runs=(run,), tasks=tasks)), "utf-8")
    click.echo(f"benchmarks/results/{name}.json: {len(tasks)} tasks, {sum(len(t.q) for t in tasks.values())} episodes")


if __name__ == "__main__":
    main()
