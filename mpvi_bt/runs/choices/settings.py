"""What values the settings of an episode may have, and records of some of them, for files and callers."""

from __future__ import annotations

import importlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, get_type_hints

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import Problem, UnknownName, UserError
from mpvi_bt.runs.choices.backends import BACKENDS, choose
from mpvi_bt.runs.choices.config import SETTINGS, EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.ground.yaml_reader import SourceMarks


@cache
def hints() -> Mapping[str, Any]:
    """The type of every field of `EpisodeConfig`."""
    return get_type_hints(EpisodeConfig)


def check_value(name: str, value: Any) -> None:
    """Raise UserError if a setting cannot have this value, UnknownName if the value names nothing known."""
    known = SETTINGS[name]
    if name in BACKENDS:
        choose(name, value)
    elif value is not None and known.folder:
        paths.find_or_file(known.folder, value)
    elif value is not None and known.reader:
        module, _, function = known.reader.partition(":")
        getattr(importlib.import_module(module), function)(value)


def value_problems(values: Mapping[str, Any], marks: SourceMarks) -> Iterator[Problem]:
    """What is wrong with values of the right types, of a file with those marks."""
    for name, value in values.items():
        try:
            check_value(name, value)
        except UnknownName as error:
            yield marks.unknown((name,), "backend" if name in BACKENDS else error.kind, value, error.known)
        except UserError as error:
            yield marks.problem((name,), "invalid-value", str(error))


def settings_record(names: Iterable[str], required: Collection[str] = ()) -> Any:
    """A class of records with those fields of `EpisodeConfig`, of the same types, bounds and defaults."""
    from pydantic import ConfigDict, Field, create_model

    from mpvi_bt.ground.marked_yaml import Record

    class Settings(Record):
        model_config = ConfigDict(allow_inf_nan=False)

    defined: dict[str, Any] = {}
    for name in names:
        default = ... if name in required else EpisodeConfig.__dataclass_fields__[name].default
        least = SETTINGS[name].least if name in SETTINGS else None
        defined[name] = (hints()[name], Field(default, ge=least))
    return create_model("Settings", __base__=Settings, **defined)
