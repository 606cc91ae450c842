"""`python -m benchmarks.collecting NAME FOLDER`: keep a suite's episodes as `benchmarks/results/NAME.json`."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
from pydantic import ValidationError

from benchmarks.origin import Run
from benchmarks.played import Episode, Played
from benchmarks.tables import RESULTS, ROOT, load
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.episode.result import read_result
from mpvi_bt.runs.report.failures import reason
from mpvi_bt.runs.suite.manifest import Manifest, read_manifest
from mpvi_bt.runs.suite.suites import load_suite


def episodes_of(folder: Path, manifest: Manifest, run: int) -> Iterator[Episode]:
    """The episodes in the folder of a suite.

    Args:
        folder: Of the suite, or of one method of it.
        manifest: What they are of.
        run: Which run of the data file they are of.

    Raises:
        UserError: There are none, or a file is no result.
    """
    files = sorted(folder.glob("json/*.json")) or sorted(folder.glob("*/json/*.json"))
    if not files:
        raise UserError(f"{folder}: there are no results in json/")
    for file in files:
        result = read_result(file)
        if result is None:
            raise UserError(f"{file}: no result")
        yield Episode(
            method=result.config["method"] or manifest.suite,
            task=result.task,
            instance=result.instance_id,
            seed=result.rollout_id,
            q=round(result.q, 4),
            ended=result.ended,
            time_s=round(result.time.simulator_time, 1),
            reasons=tuple(re.sub(r"^.*\((.+)\)$", r"\1", reason(failure)) for failure in result.failures),
            steps={name: policy.steps for name, policy in (result.policies or {}).items()},
            answers=result.queries.model_dump(include={"asked", "yes", "false_yes", "false_no"}),
            run=run,
        )


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

    if changed := git("status", "--porcelain", "--", "mpvi_bt", "tasks", "skills", "trees", "policies", "robots"):
        raise UserError(f"the working tree is not its commit ({changed.splitlines()[0].strip()}); give --commit")
    return git("rev-parse", "--short", "HEAD")


def dump(results: Played) -> str:
    """As the files are kept: a line an episode."""
    data: dict[str, Any] = results.model_dump(mode="json", exclude_defaults=True)
    lines = ",\n".join(f"    {json.dumps(one)}" for one in data.pop("episodes"))
    return f'{json.dumps({"kind": "suite", **data}, indent=2)[:-2]},\n  "episodes": [\n{lines}\n  ]\n}}\n'


def collected(
    folders: Sequence[Path], run: Run, kept: Played | None, methods: Sequence[str], tasks: Sequence[str], mixed: str
) -> Played:  # fmt: skip
    """The data file of the episodes in some folders, or of these and of what another run has brought already.

    Args:
        folders: Of suites.
        run: That played them.
        kept: What the data file has; episodes that are in it stay as they are.
        methods: Only these, if any are given.
        tasks: Only these, if any are given, in this order.
        mixed: Why episodes of several runs are in one file.

    Raises:
        UserError: A folder has no manifest or no results; or there is nothing new.
        ValidationError: Runs of several commits or processors, and `mixed` does not say why.
    """
    settings: dict[str, dict[str, Any]] = dict(kept.methods) if kept else {}
    order, episodes = list(kept.tasks if kept else tasks), list(kept.episodes if kept else ())
    there, place = {one.key for one in episodes}, len(kept.runs) if kept else 0
    for folder in folders:
        manifest = read_manifest(folder)
        if manifest is None:
            raise UserError(f"{folder}: is no folder of a suite's results; there is no manifest.json")
        for method, own in manifest.methods.items():
            if not methods or method in methods:
                settings.setdefault(method or manifest.suite, own)
        if not tasks:
            order += [task for task in manifest.tasks if task not in order]
        episodes += [
            one
            for one in episodes_of(folder, manifest, place)
            if one.method in settings and one.task in order and one.key not in there
        ]
    if len(episodes) == len(there):
        raise UserError("there is no episode that the data file does not have")
    runs = (*(kept.runs if kept else ()), run)
    return Played(
        kind="suite", runs=runs, mixed=mixed or (kept.mixed if kept else ""), methods=settings, tasks=tuple(order),
        episodes=tuple(episodes),
    )  # fmt: skip


@click.command()
@click.argument("name")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--command", required=True, help="What made the results, as it was typed.")
@click.option("--commit", "given", help="That it was made at; the working tree's if left out.")
@click.option("--date", required=True, help="That it was made on, YYYY-MM-DD.")
@click.option("--processor", "where", help="That it was made on; this machine's if left out.")
@click.option("--of", default="", help="Which of the episodes, where there are several runs.")
@click.option("--settings", default="", help="What else has a bearing on the figures.")
@click.option("--method", "methods", multiple=True, help="Only this one of the folder's methods; may be repeated.")
@click.option("--suite", help="Only the tasks of this suite.")
@click.option("--add", is_flag=True, help="Add to the episodes that the file has, as a further run.")
@click.option("--mixed", default="", help="Why episodes of several commits or processors stand together.")
def main(
    name: str, folders: tuple[Path, ...], command: str, given: str | None, date: str, where: str | None, of: str,
    settings: str, methods: tuple[str, ...], suite: str | None, add: bool, mixed: str,
) -> None:  # fmt: skip
    """Keep every episode in FOLDERS, the results of suites, as benchmarks/results/NAME.json for `make results`."""
    try:
        run = Run(
            command=command, commit=given or commit(), date=date, processor=where or processor(), of=of,
            settings=settings,
        )  # fmt: skip
        kept = load(name) if add else None
        if kept is not None and not isinstance(kept, Played):
            raise UserError(f"benchmarks/results/{name}.json has no episodes to add to")
        tasks = load_suite(suite).tasks if suite else []
        played = collected(folders, run, kept, methods, tasks, mixed)
    except (UserError, ValidationError) as error:
        click.echo(f"collecting: {error}", err=True)
        sys.exit(2)
    RESULTS.joinpath(f"{name}.json").write_text(dump(played), "utf-8")
    click.echo(
        f"benchmarks/results/{name}.json: {len(played.methods)} methods, {len(played.tasks)} tasks, "
        f"{len(played.episodes)} episodes"
    )


if __name__ == "__main__":
    main()
