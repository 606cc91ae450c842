"""What an episode may be told in Python, by keyword: fields of `EpisodeConfig`, as the command line's options are."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict, TypeVar, get_type_hints

from pydantic import Field, create_model

from mpvi_bt.choices.config import EpisodeConfig
from mpvi_bt.errors import FileProblems
from mpvi_bt.marked_yaml import Marks, Record, validate_data

_Function = TypeVar("_Function", bound=Callable[..., Any])


class Settings(TypedDict, total=False):
    """The settings that every episode of a suite may share: fields of `EpisodeConfig`, which says what they mean."""

    split: Literal["public", "hidden"]
    policy: str
    detector: str
    checker: str
    trigger: str
    planner: str
    map: str
    drive: Literal["navigator", "policy"]
    while_asked: Literal["go_on", "hold"]
    on_failure: str
    policy_settings: str | None
    policy_horizon: int | None
    policy_ensemble: float | None
    policy_faults: str | None
    latency: str | None
    while_inferring: Literal["hold", "go_on"]
    unit: str | None
    calibration: str | None
    assisted: bool
    exchanges: Path | str | None
    offline: bool
    calls: int | None
    tokens: int | None


class EpisodeSettings(Settings, total=False):
    """What else one episode may be told."""

    instance: int
    seed: int
    robot: str
    sim: Literal["sapien", "maniskill"]
    substitute: str | None
    video: Path | str | None
    picture: Path | str | None
    rerun: Path | str | None
    demonstration: Path | str | None
    demonstration_fps: int


_AtLeast0 = Annotated[int, Field(ge=0)]
_BOUNDS: Mapping[str, Any] = {  # as the command line has them
    "instance": _AtLeast0,
    "seed": _AtLeast0,
    "calls": _AtLeast0 | None,
    "tokens": _AtLeast0 | None,
    "policy_horizon": Annotated[int, Field(ge=1)] | None,
    "policy_ensemble": Annotated[float, Field(ge=0, allow_inf_nan=False)] | None,
    "demonstration_fps": Literal[1, 2, 3, 5, 6, 10, 15, 30],
}


def checked(given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The same settings, each of its type.

    Args:
        given: Fields of `EpisodeConfig`.
        where: What was called, for problems.

    Raises:
        FileProblems: Settings that there are not, or values that they cannot have.
    """
    marks = Marks(where, {(name,): (0, 0) for name in given})
    try:
        found = validate_data(dict(given), marks, _model())
    except FileProblems as error:
        named = ((p, p.pointer.removeprefix("/")) for p in error.problems)
        raise FileProblems(
            [p if p.code == "unknown-key" else replace(p, message=f"{name}: {p.message}") for p, name in named]
        ) from None
    return {name: getattr(found, name) for name in found.model_fields_set}


@cache
def _model() -> type[Record]:
    """The fields of `EpisodeConfig`, each with what it may be."""
    hints = get_type_hints(EpisodeConfig)
    defined: dict[str, Any] = {name: (_BOUNDS.get(name, hint), None) for name, hint in hints.items()}
    return create_model("EpisodeSettings", __base__=Record, **defined)


def listed(settings: type[Any]) -> Callable[[_Function], _Function]:
    """Have `help` and notebooks show the keywords of `**settings` one by one, each with its default."""

    def show(function: _Function) -> _Function:
        signature = inspect.signature(function)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        more = [
            inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=getattr(EpisodeConfig, name), annotation=annotation
            )
            for name, annotation in get_type_hints(settings).items()
        ]
        function.__signature__ = signature.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
        return function

    return show
