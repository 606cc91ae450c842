"""Types of command-line arguments, with completion by Tab: names and files, values of parameters, paths of nodes."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from mpvi_bt.apps.watch.address import Address
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import MpviError, UnknownName, UserError
from mpvi_bt.runs.choices.backends import BACKENDS, choose
from mpvi_bt.runs.choices.config import SETTINGS
from mpvi_bt.runs.choices.settings import check_value


class File(click.ParamType[str]):
    """A file, or one of the known names in a folder, completed by Tab; it is looked for when it is read.

    Args:
        folder: Of the names, relative to a root, such as "trees"; "": only files.
    """

    name = "file"

    def __init__(self, folder: str = "") -> None:
        self.folder = folder

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """File names first, then names with this beginning. In bash the file entry must come first."""
        return [CompletionItem(incomplete, type="file"), *_items(_names(self.folder), incomplete)]


class Name(File):
    """The name of an existing file, shipped or own; with `file`, a path too."""

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
        """Names with this beginning; also files if paths are allowed."""
        items = super().shell_complete(ctx, param, incomplete)
        return items if self.file else items[1:]


class BackendType(click.ParamType[str]):
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
        """Names with this beginning, with a colon if an address follows."""
        known = BACKENDS[self.kind].items()
        return _items((f"{n}:" if b.address and not b.optional else n for n, b in known), incomplete)


class Written(click.ParamType[str]):
    """The value of a setting that is a text in a small language of its own.

    Args:
        name: Of the setting.
    """

    name = "text"

    def __init__(self, name: str) -> None:
        self.setting = name

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """As given, once it is known that it can be read. Raises UserError."""
        check_value(self.setting, value)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """How one of its parts begins, after those that are there."""
        before, comma, _ = incomplete.rpartition(",")
        return _items((before + comma + begin for begin in SETTINGS[self.setting].begins), incomplete)


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


class Columns(click.ParamType[tuple[str, ...]]):
    """Names of columns of a report, with commas between them."""

    name = "columns"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        """The names. Raises UserError where there is none such."""
        from mpvi_bt.runs.report.chosen_columns import read_columns

        return read_columns(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Completions for the last name in a comma-separated list."""
        from mpvi_bt.runs.report.chosen_columns import KNOWN

        before, comma, _ = incomplete.rpartition(",")
        return _items((before + comma + name for name in KNOWN), incomplete)


class Houses(click.ParamType[int | tuple[str, ...]]):
    """How many houses, or names of houses with commas between them."""

    name = "houses"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | tuple[str, ...]:
        """The number, or the names. Raises UserError where it is none, or there is no such house."""
        from mpvi_bt.runs.suite.suite_houses import read_houses

        return read_houses(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Completions for the last name in a comma-separated list."""
        before, comma, _ = incomplete.rpartition(",")
        return _items((before + comma + name for name in _names("tasks/houses")), incomplete)


def serve(command: Any) -> Any:
    """The option to serve a page while the command works; None if not given."""
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


def out_folder(default: str, help: str) -> Callable[[Any], Any]:
    """The option for the folder of results."""
    kind = click.Path(file_okay=False, path_type=Path)
    return click.option("--out", type=kind, default=default, show_default=True, metavar="DIR", help=help)


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
    from mpvi_bt.executive.tree.yaml_io import load_tree

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
