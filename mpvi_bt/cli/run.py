"""`mpvi run`: one episode, with the tree shown live, then its score."""

from __future__ import annotations

import json
import shlex
import sys
import tempfile
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from mpvi_bt import paths
from mpvi_bt.cli import INTERRUPTED
from mpvi_bt.errors import NodeError, UserError
from mpvi_bt.suite.backends import BACKENDS
from mpvi_bt.suite.config import EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.executive.loop import Subscriber
    from mpvi_bt.executive.stop import Stop
    from mpvi_bt.suite.prepare import Prepared


class Name(click.ParamType[str]):
    """The name of a shipped or own file, completed by Tab; where `file` is set, a path does as well."""

    name = "name"

    def __init__(self, folder: str, file: bool = False) -> None:
        self.folder, self.file = folder, file

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name itself, once it is known that its file exists.

        Raises:
            UserError: There is none.
        """
        if self.file:
            paths.find_or_file(self.folder, value)
        else:
            paths.find(self.folder, value)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The names that begin with what is typed."""
        return [CompletionItem(name) for name in paths.names(self.folder) if name.startswith(incomplete)]


def _backend(kind: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """The option that chooses a backend."""
    choices = BACKENDS[kind]
    about = "; ".join(f"{name}: {backend.about}" for name, backend in choices.items())
    default = EpisodeConfig.__dataclass_fields__[kind].default
    return click.option(f"--{kind}", type=click.Choice(list(choices)), default=default, show_default=True, help=about)


_OUTPUT = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.argument("task", type=Name("tasks"), required=False)
@click.option("--instance", type=click.IntRange(min=0), default=0, show_default=True, help="Start state of the task.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@_backend("planner")
@_backend("map")
@_backend("detector")
@_backend("policy")
@_backend("checker")
@click.option("--tree", type=Name("trees", file=True), help="Run this tree, by name or file, instead of a plan's.")
@click.option("--param", "params", multiple=True, metavar="NAME=VALUE", help="Fill in a parameter of that tree.")
@click.option("--plan", type=Name("tasks/plans", file=True), help="Compile this plan, by name or file.")
@click.option("--dry", is_flag=True, help="No robot, no simulator: stand-ins do the work. Needs no TASK with --tree.")
@click.option(
    "--substitute",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Put stand-ins in the place of nodes, by the rules of this file.",
)
@click.option("--break", "breaks", multiple=True, metavar="PATH", help="Pause where such a node begins; * is any text.")
@click.option("--step", is_flag=True, help="Pause wherever something changes.")
@click.option("--video", type=_OUTPUT, metavar="FILE", help="Film the episode, as mp4.")
@click.option("--picture", type=_OUTPUT, metavar="FILE", help="Draw the way taken, from above, as png.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default="runs",
    show_default=True,
    metavar="DIR",
    help="Where result and trace go.",
)
@click.option("--trace/--no-trace", default=True, show_default=True, help="Write what happened tick by tick.")
@click.option("--watch/--no-watch", default=True, show_default=True, help="Show the tree while it runs.")
@click.option("--unicode", is_flag=True, help="Draw it with lines and signs beyond ASCII.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON; what is watched goes to stderr.")
def run(
    task: str | None,
    params: tuple[str, ...],
    dry: bool,
    breaks: tuple[str, ...],
    step: bool,
    out: Path,
    trace: bool,
    watch: bool,
    unicode: bool,
    as_json: bool,
    **settings: Any,
) -> int:
    """Run one episode of TASK with the tree shown live, then print its score.

    Exit code 0 where the goal is true at the end, 1 where it is not; of a dry run, where the tree succeeds or not.
    """
    if task is None and not dry:
        raise click.UsageError("Missing argument 'TASK'; only with --dry a tree runs without one.")
    if dry and (settings["video"] or settings["picture"]):
        raise click.UsageError("A dry run has nothing to film or to draw.")
    arguments = tuple(_arguments(params).items())
    config = EpisodeConfig(task or "", arguments=arguments, **settings)
    stem = config.name if not dry else f"{Path(config.tree or config.plan or task or '').stem}_dry"
    config = replace(config, trace=out / f"{stem}.trace.jsonl" if trace else None)
    from mpvi_bt.suite.prepare import prepare, prepare_episode

    if dry:
        prepared = prepare(task, config.tree, config.plan, dict(arguments), config.substitute)
    else:
        prepared = prepare_episode(config)
    if prepared.doubt:
        click.echo(f"mpvi: {prepared.doubt}", err=True)
    from mpvi_bt.executive.debugger import Debugger
    from mpvi_bt.executive.live import LiveTree
    from mpvi_bt.executive.stop import Stop
    from mpvi_bt.tree.globs import require_match

    for glob in breaks:
        require_match(glob, prepared.spec, "--break")
    for folder in (out, *(file.parent for file in (config.video, config.picture) if file is not None)):
        _check_writable(folder)  # now, not when a minute's work is lost
    if not dry:
        click.echo(f"mpvi: {config.task}, instance {config.instance}, seed {config.seed}: setting up", err=True)
    stop = Stop()
    debugs = bool(breaks or step)
    watchers: list[Subscriber] = []
    if watch:
        live = LiveTree(sys.stderr if as_json else sys.stdout, stem, unicode, redraw=not debugs)
        live.show(prepared.spec)  # the world takes a moment
        watchers.append(live)
    if debugs:
        watchers.append(Debugger(sys.stdin, sys.stderr, breaks, step, stop.request))
    try:
        if dry:
            return _dry(config, prepared, watchers, stop, as_json)
        return _episode(config, prepared, watchers, stop, out / f"{stem}.json", as_json)
    except NodeError:
        if config.trace:
            click.echo(f"mpvi: why: mpvi explain {shlex.quote(str(config.trace))}", err=True)
        raise


def _episode(
    config: EpisodeConfig, prepared: Prepared, watchers: list[Subscriber], stop: Stop, path: Path, as_json: bool
) -> int:
    """Run in the simulator; print and write the result."""
    from mpvi_bt.suite.episode import run as run_episode
    from mpvi_bt.suite.result import write_result

    result = run_episode(config, watchers, prepared, stop)
    write_result(path, result)
    if as_json:
        click.echo(json.dumps(result, indent=2))
    else:
        click.echo(f"{score(result, config.trace)}\n  result    {path}")
    if result["ended"] == "interrupted":
        return INTERRUPTED
    return 0 if result["success"] else 1


def _dry(config: EpisodeConfig, prepared: Prepared, watchers: list[Subscriber], stop: Stop, as_json: bool) -> int:
    """Run without robot and simulator, and print how it went."""
    from mpvi_bt.executive.dry import dry_tree, run_dry
    from mpvi_bt.executive.recorder import Recorder

    tree = dry_tree(prepared.spec, prepared.rules)
    if config.trace is not None:
        used = {key: config.record().get(key) for key in ("task", "tree", "plan", "arguments", "substitute")}
        told = {"dry": True, **{key: value for key, value in used.items() if value}}
        watchers = [Recorder(config.trace, told, config.seed), *watchers]
    budget_s = prepared.task.budget_s if prepared.task else 3600.0
    with stop:
        outcome = run_dry(tree, prepared.skills, watchers, budget_s, stop)
    failures = [*outcome.log.failures, *filter(None, [outcome.failure])]
    result = {
        "tree": prepared.spec.name,
        "success": outcome.ending == "success",
        "ended": outcome.ending,
        "ticks": outcome.ticks,
        "time": {"simulator_time": outcome.time_s},
        "failures": [
            {"node": f.path, "reason": f.reason, "feedback": f.evidence, "time_s": f.time_s} for f in failures
        ],
        "trace": str(config.trace) if config.trace else None,
    }
    if as_json:
        click.echo(json.dumps(result, indent=2))
    else:
        click.echo(dry_score(result))
    return INTERRUPTED if outcome.ending == "interrupted" else 0 if result["success"] else 1


def _arguments(params: Iterable[str]) -> dict[str, str]:
    """Names and values of `--param name=value`. Raises UsageError."""
    arguments: dict[str, str] = {}
    for param in params:
        name, equals, value = param.partition("=")
        if not equals or not name:
            raise click.UsageError(f"--param wants NAME=VALUE, not {param!r}.")
        if name in arguments:
            raise click.UsageError(f"--param {name} is given twice.")
        arguments[name] = value
    return arguments


def _check_writable(folder: Path) -> None:
    """Make a folder for results. Raises UserError if it cannot be made or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise UserError(f"{folder}: cannot write there: {(error.strerror or str(error)).lower()}") from None


def score(result: Mapping[str, Any], trace: Path | None = None) -> str:
    """What a person wants to know of a result, in lines of at most 80 columns; `trace` says where to read why."""
    normalized = result["time"]["normalized_time"]
    human = f", {normalized:.2f} of human speed" if result["success"] and normalized is not None else ""
    moved = result["agent_distance"]
    met = sum(condition["satisfied"] for condition in result["goal"])
    ended = result["ended"].replace("_", " ")
    entries = [
        ("goal", f"{met} of {len(result['goal'])} conditions"),
        *(("", f"[{'x' if c['satisfied'] else ' '}] {c['condition']}") for c in result["goal"]),
        ("time", f"{result['time']['simulator_time']:.1f} s simulated{human}"),
        ("distance", f"base {moved['base']:.1f} m, left hand {moved['left']:.1f} m, right hand {moved['right']:.1f} m"),
        *_failed(result),
        ("wall", _wall(result["wall"])),
        ("truth", f"read by {', '.join(result['privileged']) or 'none'}"),
    ]
    head = f"{'SUCCESS' if result['success'] else 'FAILURE'}  q = {result['q_score']['final']:.3f}, tree: {ended}"
    return "\n".join([head, *(_entry(name, text) for name, text in entries), *_why(result, trace)])


def dry_score(result: Mapping[str, Any]) -> str:
    """The same of a dry run."""
    ended = result["ended"].replace("_", " ")
    head = f"{'SUCCESS' if result['success'] else 'FAILURE'}  dry run, tree: {ended}"
    ticks = "1 tick" if result["ticks"] == 1 else f"{result['ticks']} ticks"
    time = f"{result['time']['simulator_time']:.1f} s simulated, {ticks}"
    entries = [("time", time), *_failed(result)]
    return "\n".join([head, *(_entry(name, text) for name, text in entries), *_why(result, result["trace"])])


def _failed(result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for failure in result["failures"]:
        said = failure["feedback"] or failure["reason"]
        yield "failed", f"{failure['time_s']:.1f} s: {_part(failure['node'])}: {said}"


def _why(result: Mapping[str, Any], trace: object) -> list[str]:
    """The command that says why, after a failure; a line to copy, whatever its length."""
    failed = not result["success"] or result["failures"]
    return [f"  why       mpvi explain {shlex.quote(str(trace))}"] if failed and trace else []


def _part(path: str) -> str:
    """The part of the plan that a node belongs to: the child of the root that it is below."""
    below_root = path.split("/")[1:]
    return below_root[0] if below_root else path


def _entry(name: str, text: str) -> str:
    return textwrap.fill(text, 80, initial_indent=f"  {name:10}", subsequent_indent=" " * 12, break_on_hyphens=False)


def _wall(wall: Mapping[str, Any]) -> str:
    """Where the wall time went, the largest part first; what took less than a hundredth of it is left out."""
    total = wall["total_s"]
    parts = {"setting up": wall["setup_s"], **wall["loop"]}
    parts.pop("total", None)
    shares = sorted(((seconds / total, name) for name, seconds in parts.items()), reverse=True)
    return f"{total:.1f} s: " + ", ".join(f"{name} {share:.0%}" for share, name in shares if share >= 0.01)
