"""`mpvi suite run / status / report`."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from mpvi_bt.cli.given import File, Name, backends
from mpvi_bt.errors import BackendError
from mpvi_bt.suite.config import EPISODE, EpisodeConfig, SuiteBudget

# The heavier modules load in the functions, so that `--help` is quick.


@click.group()
def suite() -> None:
    """Run many episodes, resume them, and tabulate the scores."""


def _shared(command: Any) -> Any:
    """The argument and options that name a suite's episodes and their folder."""
    command = backends(command)
    command = click.option(
        "--tree", type=Name("trees", file=True), metavar="FILE", help="Run this tree instead of the plan's."
    )(command)
    command = click.option(
        "--plan",
        type=Name("tasks/plans", file=True),
        metavar="FILE",
        help="Compile this plan instead of the task's own.",
    )(command)
    command = click.option("--json", "as_json", is_flag=True, help="Write the report as JSON.")(command)
    out = click.Path(file_okay=False, path_type=Path)
    command = click.option("--out", type=out, help="Folder of the results.  [default: runs/SUITE]")(command)
    return click.argument("name", type=File("tasks/suites"), metavar="SUITE")(command)


@suite.command()
@_shared
@click.option("--workers", type=click.IntRange(1, 256), default=None, help="Worker processes.  [default: one a core]")
@click.option(
    "--wall-limit",
    type=click.FloatRange(min=1),
    default=1800.0,
    show_default=True,
    metavar="SECONDS",
    help="Wall time after which an episode counts as hung.",
)
@click.option("--episode", default=EPISODE, hidden=True, help="module:function that runs one episode, for tests.")
@click.option("--trace/--no-trace", default=True, show_default=True, help="Write what happened in every episode.")
@click.option("--video/--no-video", default=False, help="Film every episode.")
@click.option("--picture/--no-picture", default=False, help="Draw every episode's path from above.")
@click.option(
    "--suite-calls",
    type=click.IntRange(min=0),
    metavar="N",
    help="Ask language models N questions at most, in all episodes of all runs with this --out together.",
)
@click.option(
    "--suite-tokens", type=click.IntRange(min=0), metavar="N", help="Likewise, of what questions and answers take."
)
def run(
    name: str,
    out: Path | None,
    as_json: bool,
    workers: int | None,
    wall_limit: float,
    episode: str,
    trace: bool,
    video: bool,
    picture: bool,
    suite_calls: int | None,
    suite_tokens: int | None,
    **options: Any,
) -> int:
    """Run the episodes of SUITE that have no result.

    Prints the report at the end. Ends with 3 if an episode could not be finished for a fault of the machine; it is
    tried again by the next run.
    """
    from mpvi_bt.suite.prepare import check_episode
    from mpvi_bt.suite.progress import Progress
    from mpvi_bt.suite.report import report_data, report_text
    from mpvi_bt.suite.runner import run_suite

    title, store, episodes = _open(name, out, options)
    budget = SuiteBudget(store.out / "asked.json", suite_calls, suite_tokens)
    episodes = [replace(c, suite_budget=budget, planned=store.out / "plans" / f"{c.name}.json") for c in episodes]
    for config in {c.task: c for c in episodes}.values():
        check_episode(config)  # what is wrong with a tree or a plan is said once, and before workers start
    if trace:
        episodes = [replace(c, trace=store.out / "traces" / f"{c.name}.jsonl") for c in episodes]
    if video:
        episodes = [replace(c, video=store.out / "videos" / f"{c.name}.mp4") for c in episodes]
    if picture:
        episodes = [replace(c, picture=store.out / "pictures" / f"{c.name}.png") for c in episodes]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    outcome = run_suite(episodes, store, workers or cores, Progress(sys.stderr), episode, wall_limit)
    if as_json:
        _print_json(report_data(title, episodes, outcome.results, outcome.faults))
    else:
        click.echo(report_text(title, episodes, outcome.results, outcome.faults))
    return BackendError.exit_code if outcome.faults else 0


@suite.command()
@_shared
def status(name: str, out: Path | None, as_json: bool, **options: Any) -> None:
    """Say how far SUITE is: what is done, broken, to do."""
    title, store, episodes = _open(name, out, options)
    results = {c: r for c in episodes if (r := store.result(c)) is not None}
    faults = [c for c in episodes if c not in results and store.fault(c)]
    data = {
        "suite": title,
        "folder": str(store.out),
        "running": store.running(),
        "episodes": len(episodes),
        "done": len(results),
        "failed": sum(not r.success for r in results.values()),
        "faults": len(faults),
        "mean_q": sum(r.q for r in results.values()) / len(results) if results else None,
        "to_do": [c.name for c in episodes if c not in results],
    }
    if as_json:
        _print_json(data)
        return
    line = f"{title}: {len(results)}/{len(episodes)} done, {data['failed']} failed"
    line += f", mean q {data['mean_q']:.2f}" if results else ""
    line += f", {len(faults)} machine fault{'s' * (len(faults) > 1)}" if faults else ""
    click.echo(line + (", a run is at work now" if data["running"] else ""))
    if data["to_do"]:
        click.echo("to do: " + ", ".join(data["to_do"]))
    for config in faults:
        fault = store.fault(config)
        click.echo(f"{config.name}: {fault.kind}: {fault.message}" if fault else config.name)


@suite.command()
@_shared
def report(name: str, out: Path | None, as_json: bool, **options: Any) -> None:
    """Tabulate the results of SUITE so far.

    One line an episode with its q, time, distances and failures, then their means.
    """
    from mpvi_bt.suite.report import report_data, report_text

    title, store, episodes = _open(name, out, options)
    results = {c: r for c in episodes if (r := store.result(c)) is not None}
    faults = {c: f for c in episodes if c not in results and (f := store.fault(c)) is not None}
    if as_json:
        _print_json(report_data(title, episodes, results, faults))
    else:
        click.echo(report_text(title, episodes, results, faults))


def _open(name: str, out: Path | None, options: dict[str, Any]) -> tuple[str, Any, list[EpisodeConfig]]:
    """The suite's title, its store and its episodes, all names checked."""
    from mpvi_bt.suite.store import Store
    from mpvi_bt.suite.tasks import load_suite

    loaded = load_suite(name)
    title = Path(name).stem
    return title, Store(out or Path("runs") / title), loaded.episodes(**options)


def _print_json(data: Any) -> None:
    click.echo(json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))
