"""`mpvi run`: one episode, with the tree shown live, then its score."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mpvi_bt.apps.cli import INTERRUPTED
from mpvi_bt.apps.cli.argument_types import (
    File,
    Name,
    arguments,
    check_writable,
    complete_path,
    given_here,
    out_folder,
    serve,
)
from mpvi_bt.apps.cli.score import brief_score, score
from mpvi_bt.apps.cli.setting_options import settings, shared
from mpvi_bt.executive.drawing.terminal import results, tell
from mpvi_bt.ground.compiled import compiling
from mpvi_bt.ground.errors import BackendError, NodeError, UserError
from mpvi_bt.runs.choices.config import ASKING, OUTPUTS, EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.apps.watch.address import Address
    from mpvi_bt.apps.watch.channel import Page
    from mpvi_bt.executive.ticking.loop import Subscriber
    from mpvi_bt.executive.ticking.stop import Stop
    from mpvi_bt.runs.episode.prepare import Prepared


_COMPILED = ("method", "drive", "on_failure")  # what changes the tree of a plan, or says why
_COMPILING = "compiling loops for this machine, once: some 20 s"
_FILES = ("video", "picture", "rerun", "mcap", "times", "profile")
_OF_THIS_RUN = (*_FILES, *ASKING)  # of an episode that goes on, what may be said anew


@click.command()
@click.argument("task", type=Name("tasks"), required=False)
@settings("instance", "seed")
@shared
@settings(*OUTPUTS)
@click.option("--dry", is_flag=True, help="No robot, no simulator: stand-ins do the work. Needs no TASK with --tree.")
@click.option("--resume", type=File(), metavar="FILE", help="Continue a stopped episode from its saved file.")
@click.option(
    "--break",
    "breaks",
    multiple=True,
    metavar="PATH",
    help="Pause when a matching node begins; * is any text.",
    shell_complete=complete_path,
)
@click.option("--step", is_flag=True, help="Pause at every change.")
@out_folder("runs", "Folder of result and trace.")
@click.option("--trace/--no-trace", default=True, show_default=True, help="Write a trace, tick by tick.")
@click.option("--watch/--no-watch", default=True, show_default=True, help="Show the tree while it runs.")
@serve
@click.option("--unicode", is_flag=True, help="Draw it with lines and signs beyond ASCII.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON; the live view goes to stderr.")
def run(
    task: str | None,
    params: tuple[str, ...],
    dry: bool,
    resume: str | None,
    breaks: tuple[str, ...],
    step: bool,
    out: Path,
    trace: bool,
    watch: bool,
    serve: Address | None,
    unicode: bool,
    as_json: bool,
    **given: Any,
) -> int:
    """Run one episode of TASK with the tree shown live, then print its score.

    Exit code 0 where the goal is true at the end, 1 where it is not; of a dry run, where the tree succeeds or not. 3
    where the policy's server or a language model failed.
    """
    if serve is not None and not trace:
        raise click.UsageError("--serve shows the trace while it is written; it can't be given with --no-trace.")
    if given["rerun"]:
        from mpvi_bt.runs.recording.rerun_log import require_sdk

        require_sdk()
    if given["profile"]:
        from mpvi_bt.runs.recording.profile import require_profiler

        require_profiler()
    if given["mcap"]:
        from mpvi_bt.runs.recording.mcap_log import require_mcap

        require_mcap()
    config, prepared, dry = _resumed(resume, given) if resume else _asked_for(task, arguments(params), dry, out, given)
    files = [file for name in _FILES if (file := getattr(config, name)) is not None]
    if dry and (files or config.demonstration):
        raise click.UsageError("A dry run has nothing to film, to draw, to log, to record or to time.")
    stem = config.name if not dry else f"{Path(config.tree or config.plan or config.task).stem}_dry"
    config = config.kept_in(out, stem, trace)
    from mpvi_bt.runs.episode.prepare import doubts

    for doubt in doubts(config, prepared, dry):
        _note(doubt)
    from mpvi_bt.executive.ticking.live import LiveTree
    from mpvi_bt.executive.ticking.loop import Last
    from mpvi_bt.executive.ticking.stop import Stop
    from mpvi_bt.executive.tree.globs import require_match

    for glob in breaks:
        require_match(glob, prepared.spec, "--break")
    try:
        for folder in (out, *(file.parent for file in files)):
            check_writable(folder)  # now, not when a minute's work is lost
    except UserError:
        if trace or not dry:
            raise
        config = replace(config, saved=None)  # it leaves nothing else
    if resume is None and config.saved is not None:
        config.saved.unlink(missing_ok=True)  # of an earlier run: what it would go on with is overwritten now
    if not dry:
        from mpvi_bt.runs.episode.result import other_run

        if resume is None and (other := other_run(out / f"{stem}.json", config)):
            _note(f"{out / f'{stem}.json'} is of a run with {other}; it is replaced, with its trace (--out keeps both)")
        click.echo(f"mpvi: {config.task}, instance {config.instance}, seed {config.seed}: setting up", err=True)
    stop = Stop()
    debugs = bool(breaks or step)
    watchers: list[Subscriber] = [last := Last()]
    if watch:
        live = LiveTree(sys.stderr if as_json else results(), stem, unicode, redraw=not debugs)
        live.show(prepared.spec)  # the world takes a moment
        watchers.append(live)
    compiling.told = partial(live.wait if watch else _note, _COMPILING)
    page = None
    if serve is not None and config.trace is not None:
        if resume is None:
            config.trace.unlink(missing_ok=True)  # the page would show that run until this one begins
        page = _page(serve, config.trace, debugs, config.tree is not None)
        watchers.append(_pictures(page, prepared, dry))
        if config.tree is not None:
            watchers.append(_reloading(page, config))
    if debugs:
        watchers.append(_debugger(page, breaks, step, stop))
    try:
        if dry:
            code = _dry(config, prepared, watchers, stop, as_json)
        else:
            code = _episode(config, prepared, watchers, stop, out / f"{stem}.json", as_json)
        if config.saved is not None and code != INTERRUPTED:
            config.saved.unlink(missing_ok=True)  # that it went on from: it has come to its end
        return code
    except NodeError as error:
        from mpvi_bt.runs.episode.unscored_result import unscored_result

        click.echo(f"mpvi: {error}", err=True)
        broken = {"node": error.path, "message": error.message, "place": error.place}
        _tell({**unscored_result(config, prepared, last.outcome), "error": broken}, config, dry, as_json)
        return error.exit_code
    finally:
        if page is not None:
            page.close()


def _page(serve: Address, trace: Path, debugs: bool, reloads: bool) -> Page:
    """Serve the page of the run. Raises UserError if that is impossible."""
    from mpvi_bt.apps.cli.watch import require_server

    require_server()
    from mpvi_bt.apps.watch.channel import DEBUGGING, Page

    page = Page(serve.bound(), trace, [*(DEBUGGING if debugs else ()), *(["reload"] if reloads else ())])
    _note(f"watch it at {page.url}")
    return page


def _pictures(page: Page, prepared: Prepared, dry: bool) -> Subscriber:
    """What sends the page pictures."""
    from mpvi_bt.apps.watch.pictures import LivePictures
    from mpvi_bt.house.layout.house import load_house
    from mpvi_bt.house.layout.prior_map import prior_map

    known = None if dry or prepared.task is None else prior_map(load_house(prepared.task.house))
    return LivePictures(page, known)


def _reloading(page: Page, config: EpisodeConfig) -> Subscriber:
    """What takes the tree's file again."""
    from mpvi_bt.apps.watch.reloading import Reloading
    from mpvi_bt.runs.episode.prepare import prepare

    return Reloading(page, lambda: prepare(config).spec)


def _debugger(page: Page | None, breaks: tuple[str, ...], step: bool, stop: Stop) -> Subscriber:
    """The debugger of the run. With a served page, the page can answer it too."""
    from mpvi_bt.executive.ticking.debugger import Debugger

    if page is None:
        return Debugger(sys.stdin, sys.stderr, breaks, step, stop.request)
    from mpvi_bt.apps.watch.console import Console

    console = Console(sys.stdin, sys.stderr, page)
    debugger = Debugger(console, console, breaks, step, stop.request)
    console.attend(debugger)
    return debugger


def _asked_for(
    task: str | None, values: dict[str, str], dry: bool, out: Path, settings: dict[str, Any]
) -> tuple[EpisodeConfig, Prepared, bool]:
    """What the command line asks for, and whether it is dry."""
    from mpvi_bt.runs.choices.named_task import task_named
    from mpvi_bt.runs.episode.prepare import check_watched, prepare, prepare_episode

    if task is None and not dry:
        raise click.UsageError("Missing argument 'TASK'; only with --dry a tree runs without one.")
    if task is None and settings["instance"]:
        raise click.UsageError("--instance is one of a TASK, and none is given.")
    if dry:
        _refuse_in_a_dry_run()
    config = EpisodeConfig(task or "", arguments=tuple(values.items()), **settings)
    config = config.kept_in(out)
    if dry and task is not None:
        task_named(task).check_instance(config.instance)
    prepared = prepare(config, _note) if dry else prepare_episode(config, _note)
    check_watched(config, [prepared])
    return config, prepared, dry


def _note(line: str) -> None:
    click.echo(f"mpvi: {line}", err=True)


def _resumed(file: str, settings: dict[str, Any]) -> tuple[EpisodeConfig, Prepared, bool]:
    """What a stopped episode goes on with, and whether it was dry."""
    _refuse_beside_resume()
    from mpvi_bt.runs.episode.prepare import prepare_saved
    from mpvi_bt.runs.episode.saved_episode import load_saved

    saved = load_saved(file)
    config = replace(saved.episode, **{key: value for key, value in settings.items() if key in _OF_THIS_RUN})
    return config, prepare_saved(saved, config), saved.dry


def _episode(
    config: EpisodeConfig, prepared: Prepared, watchers: list[Subscriber], stop: Stop, path: Path, as_json: bool
) -> int:
    """Run in the simulator; print and write the result."""
    from mpvi_bt.runs.episode.episode import run as run_episode
    from mpvi_bt.runs.episode.result import write_result

    result = run_episode(config, watchers, prepared, stop)
    write_result(path, result)
    if as_json:
        tell(json.dumps(result, indent=2))
    else:
        tell(f"{score(result, config.trace, _left(config))}\n  result    {path}")
    if result["ended"] == "interrupted":
        return INTERRUPTED
    if result["ended"] == "backend_error":
        return BackendError.exit_code
    return 0 if result["success"] else 1


def _dry(config: EpisodeConfig, prepared: Prepared, watchers: list[Subscriber], stop: Stop, as_json: bool) -> int:
    """Run without robot and simulator, and print how it went."""
    from mpvi_bt.executive.ticking.dry import LIMIT_S, EmptyWorld, dry_tree, run_dry
    from mpvi_bt.runs.episode.saved_episode import Keeper
    from mpvi_bt.runs.episode.unscored_result import unscored_result
    from mpvi_bt.runs.recording.recorder import Recorder

    tree = dry_tree(prepared.spec, prepared.rules)
    saved = prepared.saved.run if prepared.saved else None
    if config.trace is not None:
        used = {
            key: config.record().get(key) for key in ("task", "tree", "plan", "arguments", "substitute", *_COMPILED)
        }
        told = {"dry": True, **{key: value for key, value in used.items() if value}}
        watchers = [Recorder(config.trace, told, config.seed, saved), *watchers]
    budget_s = prepared.task.budget_s if prepared.task else LIMIT_S
    world = EmptyWorld()
    with stop:
        keeper = Keeper(stop, config, tree, world)
        outcome = run_dry(
            tree, prepared.skills, watchers, budget_s, keeper, world, saved, prepared.planner, config.drive
        )
    result = unscored_result(config, prepared, outcome)
    _tell(result, config, True, as_json)
    return INTERRUPTED if outcome.ending == "interrupted" else 0 if result["success"] else 1


def _tell(result: dict[str, Any], config: EpisodeConfig, dry: bool, as_json: bool) -> None:
    if as_json:
        tell(json.dumps(result, indent=2))
    else:
        tell(brief_score(result, dry, config.trace, _left(config)))


def _left(config: EpisodeConfig) -> Path | None:
    """What a stopped episode has left to go on from."""
    return config.saved if config.saved and config.saved.is_file() else None


def _refuse_beside_resume() -> None:
    """Raises UsageError if anything was given that the saved episode says itself."""
    own = {"resume", "breaks", "step", "out", "trace", "watch", "serve", "unicode", "as_json", *_OF_THIS_RUN}
    for parameter in given_here():
        if parameter.name not in own:
            given = parameter.opts[0] if parameter.param_type_name == "option" else "TASK"
            raise click.UsageError(f"--resume takes all settings from FILE; {given} can't be given beside it.")


def _refuse_in_a_dry_run() -> None:
    """Raises UsageError if it was said how to drive a policy: stand-ins do its work."""
    for parameter in given_here():
        if str(parameter.name).startswith("policy_"):
            raise click.UsageError(f"A dry run asks no policy; {parameter.opts[0]} can't be given with it.")
