"""Options for an episode's settings, made from each field's type and `Setting` in `EpisodeConfig`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import click
from click.shell_completion import CompletionItem

from mpvi_bt.apps.cli.argument_types import BackendType, File, Finite, Name, Written, complete_param
from mpvi_bt.ground.errors import UnknownName, UserError, shown
from mpvi_bt.runs.choices.backends import BACKENDS
from mpvi_bt.runs.choices.config import METHOD, SETTINGS, SHARED, EpisodeConfig
from mpvi_bt.runs.choices.settings import hints


def settings(*names: str) -> Callable[[Any], Any]:
    """The options of those settings, in that order. Settings without an option are skipped."""

    def add(command: Any) -> Any:
        for name in reversed([name for name in names if name in SETTINGS]):
            command = _option(name)(command)
        return command

    return add


def shared(command: Any) -> Any:
    """Options shared by one episode and all episodes of a suite, with those of their trees' parameters."""
    return method(*METHOD)(settings(*SHARED)(parameters(command)))


def parameters(command: Any) -> Any:
    """The option for the parameters of a tree."""
    return click.option(
        "--param",
        "params",
        multiple=True,
        metavar="NAME=VALUE",
        help="Fill in a parameter of the tree.",
        shell_complete=complete_param,
    )(command)


def _option(name: str) -> Callable[[Any], Any]:
    kinds = BACKENDS.get(name, {}).items()
    default = getattr(EpisodeConfig, name)
    return click.option(
        f"--{name.replace('_', '-')}",
        type=_type(name),
        is_flag=default is False,
        default=default,
        show_default=default is not None and default is not False,
        metavar=SETTINGS[name].metavar,
        help="; ".join(f"{backend.spelled(kind)}: {backend.about}" for kind, backend in kinds) or SETTINGS[name].help,
    )


def _type(name: str) -> click.ParamType[Any]:
    """What reads a setting's value from the command line."""
    known = SETTINGS[name]
    hint = hints()[name]
    kind = hint if get_origin(hint) is Literal else next(p for p in get_args(hint) or (hint,) if p is not NoneType)
    if name in BACKENDS:
        return BackendType(name)
    if get_origin(kind) is Literal:
        return click.Choice(get_args(kind))
    if known.folder is not None:
        return Name(known.folder, file=True) if known.folder else File()
    if kind is Path:
        return click.Path(file_okay=known.metavar == "FILE", dir_okay=known.metavar == "DIR", path_type=Path)
    if kind is bool:
        return click.BOOL
    if kind is str:
        return Written(name)
    return click.IntRange(min=known.least) if kind is int else Finite(min=known.least)


def method(*names: str) -> Callable[[Any], Any]:
    """Options `--method` and `--set` for those settings, also for settings without an option of their own."""

    def take(ctx: click.Context, values: Mapping[str, Any]) -> None:
        """Have values hold wherever the command line says nothing else."""
        own = {option.name for option in ctx.command.params}
        values = {name: value for name, value in values.items() if name in names}
        ctx.default_map = {**(ctx.default_map or {}), **{name: values[name] for name in values if name in own}}
        ctx.params.update({name: values[name] for name in values if name not in own})

    def take_method(ctx: click.Context, param: click.Parameter, given: str | None) -> str | None:
        if given is None:
            return None
        from mpvi_bt.runs.choices.methods import load_method

        fields = load_method(given)
        take(ctx, fields)
        return str(fields["method"])

    def take_settings(ctx: click.Context, param: click.Parameter, given: tuple[str, ...]) -> None:
        take(ctx, dict(_read(text, names) for text in given))

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return [CompletionItem(f"{name}=") for name in names if name.startswith(incomplete)]

    def add(command: Any) -> Any:
        command = click.option(
            "--set",
            multiple=True,
            expose_value=False,
            callback=take_settings,
            metavar="NAME=VALUE",
            help="Set one setting by its name in method files; may be repeated. Other options override it.",
            shell_complete=complete,
        )(command)
        return click.option(
            "--method",
            type=Name("tasks/methods", file=True),
            is_eager=True,  # --set overrides it
            callback=take_method,
            metavar="NAME",
            help="Set the backends below by a method, by name or file; other options override it.",
        )(command)

    return add


def _read(text: str, names: Sequence[str]) -> tuple[str, Any]:
    """Name and value of "name=value". Raises UserError."""
    name, equals, value = text.partition("=")
    if not equals:
        raise UserError(f"--set wants NAME=VALUE, not {shown(text)}.")
    if name not in names:
        raise UnknownName("setting", name, names, "--set")
    try:
        return name, _type(name).convert(value, None, None)
    except (click.BadParameter, UserError) as error:
        raise UserError(f"--set {name}: {getattr(error, 'message', error)}") from None
