"""`mpvi run`: one episode, with the tree shown live, then its score."""

from __future__ import annotations

import json
import sys
import tempfile
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from mpvi_bt import paths
from mpvi_bt.cli import INTERRUPTED
from mpvi_bt.errors import UserError
from mpvi_bt.suite.backends import BACKENDS
from mpvi_bt.suite.config import EpisodeConfig


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
@click.argument("task", type=Name("tasks"))
@click.option("--instance", type=click.IntRange(min=0), default=0, show_default=True, help="Start state of the task.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@_backend("planner")
@_backend("map")
@_backend("detector")
@_backend("policy")
@_backend("checker")
@click.option("--tree", type=Name("trees", file=True), help="Run this tree, by name or file, instead of a plan's.")
@click.option("--plan", type=Name("tasks/plans", file=True), help="Compile this plan, by name or file.")
@click.option("--video", type=_OUTPUT, metavar="FILE", help="Film the episode, as mp4.")
@click.option("--picture", type=_OUTPUT, metavar="FILE", help="Draw the way taken, from above, as png.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default="runs",
    show_default=True,
    metavar="DIR",
    help="Where the result file goes.",
)
@click.option("--watch/--no-watch", default=True, show_default=True, help="Show the tree while it runs.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON; what is watched goes to stderr.")
def run(out: Path, watch: bool, as_json: bool, **settings: Any) -> int:
    """Run one episode of TASK with the tree shown live, then print its score.

    Exit code 0 where the goal is true at the end, 1 where it is not.
    """
    config = EpisodeConfig(**settings)
    for folder in (out, *(file.parent for file in (config.video, config.picture) if file is not None)):
        _check_writable(folder)  # now, not when a minute's work is lost
    click.echo(f"mpvi: {config.task}, instance {config.instance}, seed {config.seed}: setting up", err=True)
    # What follows loads the simulator.
    from mpvi_bt.executive.live import LiveTree
    from mpvi_bt.suite.episode import run as run_episode
    from mpvi_bt.suite.result import write_result

    watchers = [LiveTree(sys.stderr if as_json else sys.stdout, config.name)] if watch else []
    result = run_episode(config, subscribers=watchers)
    path = out / f"{config.name}.json"
    write_result(path, result)
    if as_json:
        click.echo(json.dumps(result, indent=2))
    else:
        click.echo(f"{score(result)}\n  result    {path}")
    if result["ended"] == "interrupted":
        return INTERRUPTED
    return 0 if result["success"] else 1


def _check_writable(folder: Path) -> None:
    """Make a folder for results. Raises UserError if it cannot be made or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise UserError(f"{folder}: cannot write there: {(error.strerror or str(error)).lower()}") from None


def score(result: Mapping[str, Any]) -> str:
    """What a person wants to know of a result, in lines of at most 80 columns."""
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
        *(
            ("failed", f"{f['time_s']:.1f} s: {_part(f['node'])}: {f['feedback'] or f['reason']}")
            for f in result["failures"]
        ),
        ("wall", _wall(result["wall"])),
        ("truth", f"read by {', '.join(result['privileged']) or 'none'}"),
    ]
    head = f"{'SUCCESS' if result['success'] else 'FAILURE'}  q = {result['q_score']['final']:.3f}, tree: {ended}"
    return "\n".join([head, *(_entry(name, text) for name, text in entries)])


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
