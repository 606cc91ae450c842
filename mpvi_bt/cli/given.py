"""What people give on the command line: names and files, values of parameters, paths of nodes; completed by Tab."""

from __future__ import annotations

import importlib
import math
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from mpvi_bt import paths
from mpvi_bt.choices.backends import BACKENDS, choose
from mpvi_bt.choices.config import EpisodeConfig
from mpvi_bt.errors import MpviError, UnknownName, UserError
from mpvi_bt.watch.address import Address

_FAULTS = ("freeze", "jitter", "drift", "late", "wrong_object")


class File(click.ParamType[str]):
    """A file, or one of the known names in a folder, completed by Tab; it is looked for when it is read.

    Args:
        folder: Of the names, relative to a root, such as "trees"; "": only files.
    """

    name = "file"

    def __init__(self, folder: str = "") -> None:
        self.folder = folder

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Files, which the shell knows, then the names that begin so; bash forgets what comes before files."""
        return [CompletionItem(incomplete, type="file"), *_items(_names(self.folder), incomplete)]


class Name(File):
    """The name of a shipped or own file, which must be there; where `file` is set, a path does as well."""

    name = "name"

    def __init__(self, folder: str, file: bool = False) -> None:
        super().__init__(folder)
        self.file = file

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name itself, once it is known that its file exists.

        Raises:
            UserError: There is none.
        """
        if self.file:
            paths.find_or_file(self.folder, value)
            return value
        try:
            paths.find(self.folder, value)
        except UnknownName as error:
            if self.folder == "tasks" and value in paths.names("trees"):
                raise UserError(f"{error} It is a tree: mpvi run --dry --tree {value}.") from None
            raise
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The names that begin with what is typed; files too where they do."""
        items = super().shell_complete(ctx, param, incomplete)
        return items if self.file else items[1:]


class Choice(click.ParamType[str]):
    """A backend, by name or by name and address.

    Args:
        kind: Such as "policy".
    """

    name = "backend"

    def __init__(self, kind: str) -> None:
        self.kind = kind

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """As given, once it is known that there is such a backend.

        Raises:
            UserError: There is none, or its address is missing.
        """
        choose(self.kind, value)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The names that begin with what is typed, with the colon before an address."""
        known = BACKENDS[self.kind].items()
        return _items((f"{n}:" if b.address and not b.optional else n for n, b in known), incomplete)


class Written(click.ParamType[str]):
    """A text in a small language of its own.

    Args:
        reader: "module:function" that reads it, and raises UserError.
        begins: How it may begin, for Tab.
    """

    name = "text"

    def __init__(self, reader: str, begins: Iterable[str]) -> None:
        self.reader, self.begins = reader, tuple(begins)

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """As given, once it is known that it can be read. Raises UserError."""
        module, _, function = self.reader.partition(":")
        getattr(importlib.import_module(module), function)(value)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """How one of its parts begins, after those that are there."""
        before, comma, _ = incomplete.rpartition(",")
        return _items((before + comma + begin for begin in self.begins), incomplete)


class Reaction(click.ParamType[str]):
    """What becomes of a unit that fails, such as "retry:2"."""

    name = "reaction"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """As given. Raises UserError if there is no such thing."""
        from mpvi_bt.tree.compile import parse_on_failure

        parse_on_failure(value)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """What it may be; of "retry:" the number is missing."""
        return _items(["advance", "retry:", "replan"], incomplete)


class Finite(click.FloatRange):
    """A number in a range, and neither infinite nor none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number. Raises BadParameter for inf and nan."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is no finite number.", param, ctx)
        return number


class At(click.ParamType[Address]):
    """Where a page is served: a port, or an address and a port."""

    name = "address"

    def convert(self, value: str | Address, param: click.Parameter | None, ctx: click.Context | None) -> Address:
        """The address. Raises UserError."""
        return value if isinstance(value, Address) else Address.parse(value)


def serve(command: Any) -> Any:
    """The option that has a page served while the command works; it is None where it is not given."""
    return click.option(
        "--serve",
        "serve",
        type=At(),
        is_flag=False,
        flag_value="",
        default=None,
        metavar="[[HOST:]PORT]",
        help="Serve a page that shows it live; without a port at 8420 or the next free one.",
    )(command)


def _take_method(ctx: click.Context, param: click.Parameter, given: str | None) -> str | None:
    """The name of the method that is given; what it says holds wherever the command line says nothing else."""
    if given is None:
        return None
    from mpvi_bt.choices.methods import load_method

    fields = dict(load_method(given))
    name = str(fields.pop("method"))
    ctx.default_map = {**(ctx.default_map or {}), **fields}
    return name


def method(command: Any) -> Any:
    """The option that names a method."""
    return click.option(
        "--method",
        type=Name("tasks/methods", file=True),
        is_eager=True,
        callback=_take_method,
        metavar="NAME",
        help="Set the backends below by a method, by name or file; other options override it.",
    )(command)


def demonstration_fps(command: Any) -> Any:
    """The option that says how often what is demonstrated is noted: at a rate that divides the control rate."""
    return click.option(
        "--demonstration-fps",
        type=click.Choice((1, 2, 3, 5, 6, 10, 15, 30)),
        default=10,
        show_default=True,
        help="Recorded rows and pictures a second.",
    )(command)


def drive(command: Any) -> Any:
    """The option that says who drives."""
    return click.option(
        "--drive",
        type=click.Choice(["navigator", "policy"]),
        default="navigator",
        show_default=True,
        help="Who drives: the navigator, or the policy, with the segment's description as its prompt.",
    )(command)


def on_failure(command: Any) -> Any:
    """The option that says what becomes of a unit that fails."""
    return click.option(
        "--on-failure",
        type=Reaction(),
        default="advance",
        show_default=True,
        metavar="WHAT",
        help="After a unit of the plan has failed: advance: go on with the next one; retry:N: try it N more times "
        "first; replan: make a new plan for the rest, or without a model, go on and try it once more at the end.",
    )(command)


def backends(command: Any) -> Any:
    """The options that choose the backends of an episode, and how policy and language models are asked."""
    options = [
        click.option(
            f"--{kind}",
            type=Choice(kind),
            default=EpisodeConfig.__dataclass_fields__[kind].default,
            show_default=True,
            metavar="NAME",
            help="; ".join(f"{b.spelled(n)}: {b.about}" for n, b in choices.items()),
        )
        for kind, choices in BACKENDS.items()
    ]
    options += [
        click.option(
            "--policy-settings",
            type=File("policies"),
            metavar="NAME",
            help="Settings of a policy server, by name or file.",
        ),
        click.option(
            "--policy-horizon",
            type=click.IntRange(min=1),
            metavar="N",
            help="Execute N actions of each chunk, then ask again.  [default: all]",
        ),
        click.option(
            "--policy-ensemble",
            type=Finite(min=0),
            metavar="DECAY",
            help="Ask at every step, and average overlapping chunks with weights exp(-DECAY i).",
        ),
        click.option(
            "--policy-faults",
            type=Written(
                "mpvi_bt.disturbances.faults:read_faults", ("freeze", "jitter", "drift", "late", "wrong_object")
            ),
            metavar="FAULTS",
            help='Give the policy faults, such as "freeze:p=0.01, jitter:0.02, drift, late:400ms, wrong_object".',
        ),
        click.option(
            "--latency",
            type=Written("mpvi_bt.disturbances.latency:read_latencies", ("policy=", "checker=", "planner=")),
            metavar="TIMES",
            help="Simulated seconds that answers take: policy=0.4,checker=0.5..2,planner=@FILE.",
        ),
        click.option(
            "--while-inferring",
            type=click.Choice(["hold", "go_on"]),
            default="hold",
            show_default=True,
            help="What the robot does until a late chunk is there: hold, or go on with the one before.",
        ),
        click.option(
            "--unit",
            type=Name("trees", file=True),
            metavar="TREE",
            help="Run each unit of manipulation in this tree, such as monitored or intervene.",
        ),
        click.option(
            "--calibration",
            type=File(),
            metavar="FILE",
            help="Thresholds of the monitors, as `mpvi calibrate` writes them.",
        ),
        click.option("--assisted", is_flag=True, help="Fix a grasped object to the hand; every report says so."),
        click.option(
            "--while-asked",
            type=click.Choice(["go_on", "hold"]),
            default="go_on",
            show_default=True,
            help="What the robot does until the checker answers.",
        ),
    ]
    command = language(drive(on_failure(command)))
    for option in reversed(options):
        command = option(command)
    return method(split(command))


def split(command: Any) -> Any:
    """The option that chooses the instances that are meant."""
    return click.option(
        "--split",
        type=click.Choice(["public", "hidden"]),
        default="public",
        show_default=True,
        help="Which instances: hidden ones are drawn from the secret in MPVI_HIDDEN_SEED.",
    )(command)


def language(command: Any) -> Any:
    """The options that say how language models are asked."""
    options = [
        click.option(
            "--exchanges",
            type=click.Path(file_okay=False, path_type=Path),
            metavar="DIR",
            help="Keep questions and answers of language models, and reuse them.",
        ),
        click.option("--offline", is_flag=True, help="Ask no language model; use kept answers only."),
        click.option(
            "--calls",
            type=click.IntRange(min=0),
            metavar="N",
            help="At most N questions to language models in an episode.",
        ),
        click.option(
            "--tokens",
            type=click.IntRange(min=0),
            metavar="N",
            help="No more questions after N tokens.",
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


def arguments(params: Iterable[str]) -> dict[str, str]:
    """Names and values of `--param name=value`. Raises UsageError."""
    found: dict[str, str] = {}
    for param in params:
        name, _, value = param.partition("=")
        if not name or not value:
            raise click.UsageError(f"--param wants NAME=VALUE, not {param!r}.")
        if name in found:
            raise click.UsageError(f"--param {name} is given twice.")
        found[name] = value
    return found


def given_here() -> list[click.Parameter]:
    """The parameters that are on the command line."""
    context = click.get_current_context()
    said = click.core.ParameterSource.COMMANDLINE
    return [p for p in context.command.params if context.get_parameter_source(str(p.name)) == said]


def check_writable(folder: Path) -> None:
    """Make a folder for results. Raises UserError if it cannot be made or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise UserError(f"{folder}: cannot write there: {(error.strerror or str(error)).lower()}") from None


def complete_param(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The parameters of the tree that is given."""
    tree = _tree(ctx)
    return _items([f"{name}=" for name in tree.parameters], incomplete) if tree else []


def complete_path(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The paths of the nodes of the tree that is given."""
    tree = _tree(ctx)
    return _items([node.path for node in tree.nodes], incomplete) if tree else []


def _tree(ctx: click.Context) -> Any:
    """The tree that is named, or None."""
    from mpvi_bt.tree.yaml_io import load_tree

    try:
        given = ctx.params.get("tree") or next(iter(ctx.args), "")  # where an option has no value yet: not read so far
        return load_tree(paths.find_or_file("trees", given)) if given else None
    except MpviError:
        return None


def _names(folder: str) -> list[str]:
    try:
        return paths.names(folder) if folder else []
    except MpviError:
        return []


def _items(words: Iterable[str], incomplete: str) -> list[CompletionItem]:
    return [CompletionItem(word) for word in words if word.startswith(incomplete)]
