"""What an episode may be told in Python, by keyword: fields of `EpisodeConfig`, as the command line's options are."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, TypeVar

from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.marked_yaml import SourceMarks, validate_data
from mpvi_bt.runs.choices.config import EpisodeConfig, names
from mpvi_bt.runs.choices.settings import hints, settings_record

_Function = TypeVar("_Function", bound=Callable[..., Any])
_record = cache(lambda: settings_record(names(EpisodeConfig)))


def checked(given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The same settings, each of its type.

    Args:
        given: Fields of `EpisodeConfig`.
        where: What was called, for problems.

    Raises:
        FileProblems: Settings that there are not, or values that they cannot have.
    """
    marks = SourceMarks(where, {(name,): (0, 0) for name in given})
    try:
        found = validate_data(dict(given), marks, _record())
    except FileProblems as error:
        named = ((p, p.pointer.removeprefix("/")) for p in error.problems)
        raise FileProblems(
            [p if p.code == "unknown-key" else replace(p, message=f"{name}: {p.message}") for p, name in named]
        ) from None
    return {name: getattr(found, name) for name in found.model_fields_set}


def listed(settings: Iterable[str]) -> Callable[[_Function], _Function]:
    """Have `help` and notebooks show the keywords of `**settings` one by one, each with its default."""

    def show(function: _Function) -> _Function:
        signature = inspect.signature(function)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        more = [
            inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=getattr(EpisodeConfig, name), annotation=hints()[name]
            )
            for name in settings
            if name not in signature.parameters
        ]
        function.__signature__ = signature.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
        return function

    return show
