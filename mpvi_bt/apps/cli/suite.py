"""`mpvi suite run / status / report`."""

from __future__ import annotations

import json
import shlex
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from mpvi_bt.apps.cli import INTERRUPTED
from mpvi_bt.apps.cli.argument_types import Columns, File, Houses, Name, arguments
from mpvi_bt.apps.cli.argument_types import serve as serving
from mpvi_bt.apps.cli.setting_options import settings, shared
from mpvi_bt.executive.drawing.terminal import size, tell
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.runs.choices.config import EPISODE, EpisodeConfig
from mpvi_bt.runs.report.suite_report import SuiteReport

if TYPE_CHECKING:
    from mpvi_bt.apps.watch.address import Address
    from mpvi_bt.apps.watch.channel import Page
    from mpvi_bt.runs.suite.suites import Suite

_FILE = click.Path(dir_okay=False, path_type=Path)
_FOLDER = click.Path(file_okay=False, path_type=Path)
_NAMED = 20  # episodes at most that `status` names one by one

# The heavier modules load in the functions, so that `--help` is quick.


@click.group()
def suite() -> None:
    """Run many episodes, resume them, and tabulate the scores."""


def _named(command: Any) -> Any:
    """The argument and options that name a suite and its folder."""
    command = click.option("--json", "as_json", is_flag=True, help="Write the report as JSON.")(command)
    command = click.option("--out", type=_FOLDER, help="Folder of the results.  [default: runs/SUITE]")(command)
    return click.argument("name", type=File("tasks/suites"), metavar="SUITE")(command)


@suite.command()
@_named
@shared
@click.option(
    "--task",
    "tasks",
    type=Name("tasks"),
    metavar="NAME",
    multiple=True,
    help="Play only this one now; may be repeated.",
)
@click.option(
    "--instance",
    "instances",
    type=int,
    metavar="N",
    multiple=True,
    help="Play only this start state of each task now; may be repeated.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 4096),
    default=None,
    help="Episodes in parallel.  [default: one a core of the machine or cluster]",
)
@click.option(
    "--wall-limit",
    type=click.FloatRange(min=1),
    default=7200.0,
    show_default=True,
    metavar="SECONDS",
    help="Wall time after which an episode counts as hung.",
)
@click.option(
    "--engine",
    type=click.Choice(["processes", "ray"]),
    default="processes",
    show_default=True,
    help="Play episodes in processes of this machine, or on a Ray cluster.",
)
@click.option(
    "--ray-address",
    metavar="ADDRESS",
    help="Address of the cluster, such as auto or HOST:6379.  [default: start one on this machine]",
)
@click.option("--episode", default=EPISODE, hidden=True, help="module:function that runs one episode, for tests.")
@click.option("--trace/--no-trace", default=True, show_default=True, help="Write a trace of every episode.")
@click.option(
    "--video",
    type=click.Choice(["all", "failures"]),
    is_flag=False,
    flag_value="all",
    default=None,
    metavar="[all|failures]",
    help="Film every episode; failures: delete films of episodes that reach their goal.",
)
@click.option("--picture/--no-picture", default=False, help="Draw every episode's path from above.")
@click.option("--mcap/--no-mcap", default=False, help="Record every episode as ROS 2 messages, as mcap.")
@click.option("--demonstrations/--no-demonstrations", default=False, help="Record every episode, for `mpvi dataset`.")
@settings("demonstration_fps")
@click.option(
    "--houses",
    type=Houses(),
    metavar="N|HOUSE,...",
    help="Play each task in N houses that seeds draw, or in these, instead of the suite's.",
)
@serving
@click.option(
    "--suite-calls",
    type=click.IntRange(min=0),
    metavar="N",
    help="At most N questions to language models in all runs with this --out.",
)
@click.option("--suite-tokens", type=click.IntRange(min=0), metavar="N", help="The same for tokens.")
def run(
    name: str,
    out: Path | None,
    as_json: bool,
    tasks: tuple[str, ...],
    instances: tuple[int, ...],
    workers: int | None,
    wall_limit: float,
    engine: Literal["processes", "ray"],
    ray_address: str | None,
    episode: str,
    trace: bool,
    video: Literal["all", "failures"] | None,
    picture: bool,
    mcap: bool,
    demonstrations: bool,
    demonstration_fps: int,
    houses: int | tuple[str, ...] | None,
    serve: Address | None,
    suite_calls: int | None,
    suite_tokens: int | None,
    params: tuple[str, ...],
    **options: Any,
) -> int:
    """Run the episodes of SUITE that have no result.

    Prints the report of them at the end. Ends with 3 if an episode could not be finished for a fault of the machine; it
    is tried again by the next run.
    """
    from mpvi_bt.runs.choices.language_models import language_doubts
    from mpvi_bt.runs.report.suite_folders import SuiteFolder
    from mpvi_bt.runs.suite.play import Kept, Where, play
    from mpvi_bt.runs.suite.progress import SuiteProgress
    from mpvi_bt.runs.suite.store import RUNS, Store
    from mpvi_bt.runs.suite.suites import load_suite

    if paths.is_folder(Path(name)):
        raise UserError(f"{name}: is a folder. Name the suite or its file, and the folder with --out {name}.")
    loaded, title = load_suite(name), paths.title(name)
    store, episodes = Store(out or RUNS / title), _chosen(loaded, houses, options, params)
    for doubt in language_doubts(episodes):
        click.echo(f"mpvi: {doubt}", err=True)
    page = None if serve is None else _page(serve, store.out)
    try:
        outcome = play(
            title,
            store,
            episodes,
            lambda pace: SuiteProgress(sys.stderr, pace),
            tasks=tasks,
            instances=instances,
            where=Where(engine, workers, wall_limit, ray_address, episode),
            kept=Kept(trace, video, picture, mcap, demonstrations, demonstration_fps),
            calls=suite_calls,
            tokens=suite_tokens,
            about=loaded.about,
        )
    except KeyboardInterrupt:
        words = click.get_current_context().find_root().obj or ()
        again = f"; this goes on with what is left:\n  {shlex.join(('mpvi', *words))}" if words else ""
        click.echo(f"mpvi: interrupted{again}", err=True)
        return INTERRUPTED
    finally:
        if page is not None:
            page.close()
    part = SuiteFolder(title, store, outcome.episodes, outcome.results, outcome.faults, loaded.about)
    tell(SuiteReport.of([part]).told(as_json, _width()))
    return BackendError.exit_code if outcome.faults else 0


def _page(serve: Address, folder: Path) -> Page:
    """Serve the page of the suite. Raises UserError if that is impossible."""
    from mpvi_bt.apps.cli.watch import require_server
    from mpvi_bt.apps.watch.channel import Page

    require_server()
    folder.mkdir(parents=True, exist_ok=True)
    page = Page(serve.bound(), folder)
    click.echo(f"mpvi: watch it at {page.url}", err=True)
    return page


@suite.command()
@_named
def status(name: str, out: Path | None, as_json: bool) -> None:
    """Say how far SUITE, or the folder of its results, is: what is done, broken, to do."""
    from mpvi_bt.runs.report.suite_folders import SuiteFolder
    from mpvi_bt.runs.suite.standing import spoken, under_way

    part = SuiteFolder.named(name, out)
    title, store, episodes, results, faults = part.suite, part.store, part.episodes, part.results, part.faults
    methods = list(dict.fromkeys(c.method for c in episodes))
    data = {"suite": title, "folder": str(store.out), "running": store.running(), **_stand(episodes, results, faults)}
    if len(methods) > 1:
        data["methods"] = {
            str(method): _stand([c for c in episodes if c.method == method], results, faults) for method in methods
        }
    to_do = [c for c in episodes if c not in results]
    data["to_do"] = [spoken(c) for c in to_do]
    data["at_work"], data["left_s"] = under_way(store, episodes, results) if data["running"] else ([], None)
    if as_json:
        _print_json(data)
        return
    tell(f"{title}: {_line(data)}" + (", a run is at work now" if data["running"] else ""))
    _print_at_work(data)
    for way, stand in data.get("methods", {}).items():
        tell(f"  {way}: {_line(stand)}")
    if 0 < len(to_do) <= _NAMED:
        tell("to do: " + ", ".join(data["to_do"]))
    elif to_do:
        left = Counter(c.task_name for c in to_do)
        tell("to do: " + ", ".join(f"{task} {number}" for task, number in left.items()))
    for config, fault in faults.items():
        tell(f"{spoken(config)}: {fault.kind}: {fault.message}")


def _print_at_work(data: Mapping[str, Any]) -> None:
    from mpvi_bt.runs.suite.progress import at_work_text

    for work in data["at_work"]:
        tell(at_work_text(work["worker"], work["episode"], work["since_s"], work["expected_s"]))


def _stand(
    episodes: Sequence[EpisodeConfig], results: Mapping[EpisodeConfig, Any], faults: Mapping[EpisodeConfig, Any]
) -> dict[str, Any]:
    """How far some episodes are."""
    done = [results[c] for c in episodes if c in results]
    return {
        "episodes": len(episodes),
        "done": len(done),
        "succeeded": sum(result.success for result in done),
        "broke": dict(Counter(faults[c].kind for c in episodes if c in faults)),
        "mean_q": sum(result.q for result in done) / len(done) if done else None,
    }


def _line(stand: dict[str, Any]) -> str:
    from mpvi_bt.runs.suite.progress import standing

    counts = (stand["done"], stand["episodes"], stand["succeeded"], stand["mean_q"], stand["broke"])
    return standing(*counts, stand.get("left_s"))


@suite.command()
@click.argument("names", type=File("tasks/suites"), nargs=-1, required=True, metavar="SUITE...")
@click.option("--out", type=_FOLDER, help="Folder of the results of the one SUITE.  [default: runs/SUITE]")
@click.option("--json", "as_json", is_flag=True, help="Write the report as JSON.")
@click.option("--html", type=_FILE, help="Write one self-contained page with plots and every episode.")
@click.option("--markdown", type=_FILE, help="Write Markdown, with its plots as SVG files beside it.")
@click.option("--csv", type=_FILE, help="Write a row for every episode, for spreadsheets, pandas and R.")
@click.option("--latex", type=_FILE, help="Write the tables of a paper.")
@click.option(
    "--columns",
    type=Columns(),
    metavar="NAME,...",
    help="Columns of --csv and --latex, such as method,task,q_score,success. A row is the mean of episodes with the "
    "same method, task, house, instance, seed and ended, as far as these columns are chosen.",
)
@click.option("--baseline", metavar="METHOD", help="Method to compare with.  [default: e2e, or the first method]")
def report(
    names: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    columns: tuple[str, ...] | None,
    baseline: str | None,
    **files: Path | None,
) -> None:
    """Tabulate the results of SUITE, or of the folder that they are in, so far; of several, side by side.

    One line an episode with its q, time, distances and failures, then their means. Several methods are compared on the
    episodes that both have finished, be they in one folder or in several.
    """
    from mpvi_bt.runs.report.suite_folders import SuiteFolder

    if out is not None and len(names) > 1:
        raise click.UsageError("--out is the folder of one SUITE; name several by their folders.")
    if columns is not None and not (files["csv"] or files["latex"]):
        raise click.UsageError("--columns chooses those of --csv and --latex; give one of them.")
    report = SuiteReport.of([SuiteFolder.named(name, out) for name in names], baseline)
    written: list[Path] = []
    for kind, file in files.items():
        if file is not None:
            chosen = (columns,) if columns is not None and kind in ("csv", "latex") else ()
            written += getattr(report, f"write_{kind}")(file, *chosen)
    tell(report.told(as_json, _width()) if as_json or not written else "\n".join(f"wrote {path}" for path in written))


def _chosen(
    suite: Suite, houses: int | Sequence[str] | None, options: Mapping[str, Any], params: Sequence[str]
) -> list[EpisodeConfig]:
    """A suite's episodes as the command line has them: what is not on it is left to the suite and its methods."""
    context = click.get_current_context()
    given = {
        key: value
        for key, value in options.items()
        if context.get_parameter_source(key) is not click.core.ParameterSource.DEFAULT
    }
    if houses is not None and given.get("house"):
        raise click.UsageError("--house is one house and --houses are several; give one of them.")
    return suite.episodes(houses, **given, arguments=tuple(arguments(params).items()))


def _width() -> int:
    """Columns of the terminal, or what a pipe is given."""
    return size().columns


def _print_json(data: Any) -> None:
    tell(json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))
