"""YAML and JSON files read with the place of everything in them, and checked against a pydantic model.

`validate(path, Model)` is all that most callers need. Every problem of a file is reported at once, as file:line:col,
with the nearest valid name (Our choice: people and language models mend a file faster from the full list).
"""

from __future__ import annotations

import json
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from mpvi_bt.ground.errors import FileProblems, Problem, UserError, did_you_mean, nearest, shown
from mpvi_bt.ground.file_kinds import foreign
from mpvi_bt.ground.import_paths import IMPORT_PATH
from mpvi_bt.ground.near_file import near_file
from mpvi_bt.ground.yaml_reader import (
    MAX_BYTES,
    MAX_DEPTH,
    MAX_NODES,
    MAX_PROBLEMS,
    Location,
    SourceMarks,
    place_in,
    plain_scalar,
    pointer,
    read_yaml,
)

__all__ = [
    "MAX_BYTES",
    "MAX_DEPTH",
    "MAX_NODES",
    "MAX_PROBLEMS",
    "Amount",
    "Coordinate",
    "Count",
    "Location",
    "Record",
    "Share",
    "SourceMarks",
    "Synset",
    "choices_of",
    "fields_at",
    "load_marked",
    "parse_marked",
    "plain_scalar",
    "pointer",
    "problems_of",
    "read_bytes",
    "read_text",
    "validate",
    "validate_data",
]

Model = TypeVar("Model", bound=BaseModel)

Amount = Annotated[float, Field(ge=0.0, le=1e12, allow_inf_nan=False)]  # Our choice: sums of them stay finite
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0)]
SYNSET = r"^\S+\.[nvasr]\.\d\d$"
Synset = Annotated[str, StringConstraints(pattern=SYNSET)]  # of WordNet, as BDDL writes it
Coordinate = Annotated[float, Field(ge=-200, le=200, allow_inf_nan=False)]  # m

_SURROGATES = re.compile(r"\\u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}")


class Record(BaseModel):
    """Base of our file models: immutable, and unknown keys are problems."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def load_marked(path: str | Path) -> tuple[Any, SourceMarks]:
    """Plain data (dict, list, str, int, float, bool, None) of a YAML or JSON file, and the marks of all of it.

    Raises:
        UserError: There is no such file, or it cannot be read.
        FileProblems: It is not valid YAML (or JSON, if that is its name), has duplicate keys or is too large.
    """
    return parse_marked(read_text(path), str(path))


def read_text(path: str | Path) -> str:
    """The text of a file, whatever ends its lines there. Raises as `load_marked`."""
    content = read_bytes(path)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8", "replace")
        message = f"not UTF-8 text ({error.reason}: byte {content[error.start]:#04x})"
        raise FileProblems([Problem(str(path), *place_in(before, len(before)), "encoding", message)]) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_bytes(path: str | Path) -> bytes:
    """What a file holds. Raises UserError if it cannot be read, FileProblems if it is larger than `MAX_BYTES`."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: NUL in the name
        reason = getattr(error, "strerror", None) or "cannot be read"
        near = near_file(Path(path), ". ") if isinstance(error, FileNotFoundError) else ""
        raise UserError(f"{path}: {reason.lower()}{near}") from None
    if len(content) > MAX_BYTES:
        raise FileProblems([Problem(str(path), 0, 0, "too-large", f"larger than {MAX_BYTES >> 20} MiB")])
    return content


def parse_marked(text: str, name: str) -> tuple[Any, SourceMarks]:
    """As `load_marked`, of a text that `name` stands for in problems."""
    if other := list(foreign(text, name)):
        raise FileProblems(other)
    if name.endswith(".json"):
        _check_json(text, name)
        text = _SURROGATES.sub(lambda pair: json.loads(f'"{pair.group()}"'), text)  # YAML knows no surrogate pairs
    return read_yaml(text, name)


def _check_json(text: str, name: str) -> None:
    """Raise FileProblems if a text is YAML perhaps, but not JSON."""
    if not text.strip():
        return  # "empty" is said elsewhere
    try:
        json.loads(text, parse_int=float)
    except json.JSONDecodeError as error:
        message = f"not valid JSON: {error.msg[:1].lower()}{error.msg[1:]}"
        raise FileProblems([Problem(name, error.lineno, error.colno, "syntax", message)]) from None
    except RecursionError:
        return  # "too-deep" is said elsewhere


def validate(path: str | Path, model: type[Model]) -> Model:
    """The file as a `model`.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return validate_data(*load_marked(path), model)


def validate_data(data: Any, marks: SourceMarks, model: type[Model], at: Location = ()) -> Model:
    """Like `validate`, for loaded data, or for the part of a file at the location `at`.

    Raises:
        FileProblems: Everything that is wrong with it.
    """
    try:
        made = model.model_validate(data)
    except ValidationError as error:
        raise FileProblems(problems_of(error, marks, model, at)) from None
    if loose := list(_loose(data, {model}, marks, at)):
        raise FileProblems(loose[:MAX_PROBLEMS])
    return made


def _loose(value: Any, hints: set[Any], marks: SourceMarks, at: Location) -> Iterator[Problem]:
    """Where pydantic takes `true` or a quoted "1" for a number. Tuples and models forbid its strict mode."""
    if isinstance(value, dict | list):
        parts: Iterable[tuple[Any, Any]] = value.items() if isinstance(value, dict) else enumerate(value)
        for part, inner in parts:
            yield from _loose(inner, {t for hint in hints for t in _inside(hint, part)}, marks, (*at, part))
    elif isinstance(value, bool | str) and hints & {int, float} and hints <= {int, float, type(None)}:
        wanted = "a number" if float in hints else "a whole number"
        yield marks.problem(at, "wrong-type", f"should be {wanted}, not {shown(value)}")


_CODES = {  # of pydantic to ours, which stay the same whatever pydantic does
    "missing": "missing-key",
    "extra_forbidden": "unknown-key",
    "literal_error": "unknown-value",
    "enum": "unknown-value",
    "union_tag_invalid": "unknown-value",
    "union_tag_not_found": "missing-key",
    "finite_number": "out-of-range",
    "greater_than": "out-of-range",
    "greater_than_equal": "out-of-range",
    "less_than": "out-of-range",
    "less_than_equal": "out-of-range",
    "too_long": "wrong-length",
    "too_short": "wrong-length",
    "string_too_long": "wrong-length",
    "string_too_short": "wrong-length",
}
_SHAPES = {
    "model_attributes_type": "a mapping",
    "model_type": "a mapping",
    "dict_type": "a mapping",
    "list_type": "a list",
    "tuple_type": "a list",
    "string_type": "text",
    "string_unicode": "text without halves of characters",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "none_required": "nothing",
}


def problems_of(
    error: ValidationError,
    marks: SourceMarks,
    model: type[BaseModel],
    at: Location = (),
    keys: Mapping[str, str] | None = None,
) -> list[Problem]:
    """A validation error as problems, each once; `MAX_PROBLEMS` at most.

    Args:
        error: What pydantic says.
        marks: Of the file.
        model: What was validated against.
        at: Where in the file the model's data stands.
        keys: Names of fields that the file writes otherwise, to what it writes.
    """
    found = {}
    for problem in _problems(error, marks, model, at, keys or {}):
        found[problem.line, problem.column, problem.message] = problem
        if len(found) >= MAX_PROBLEMS:
            break
    return list(_of_the_kind_meant(found.values()))


def _of_the_kind_meant(problems: Iterable[Problem]) -> Iterator[Problem]:
    """One message for a value of several possible kinds.

    A value of one of these kinds gets that kind's problems alone. A value of none gets one problem with all kinds.
    """
    places: dict[tuple[int, int, str], list[Problem]] = {}
    for problem in problems:
        places.setdefault((problem.line, problem.column, problem.pointer), []).append(problem)
    for found in places.values():
        fitting = [problem for problem in found if problem.code != "wrong-type"]
        kinds = [problem.message for problem in found[:1]] + [p.message.removeprefix("should be ") for p in found[1:]]
        yield from fitting or [replace(found[0], message=" or ".join(kinds))]


def _problems(
    error: ValidationError, marks: SourceMarks, model: type[BaseModel], at: Location, keys: Mapping[str, str]
) -> Iterator[Problem]:
    for item in error.errors(include_url=False):
        kind, context = item["type"], item.get("ctx", {})
        if kind == "too_short" and len(item["input"]) >= context["min_length"]:
            continue  # pydantic counts the valid items of a tuple only; the others have their own problems
        inner = item["loc"]
        if kind == "missing" and isinstance(inner[-1], int):  # a tuple that is too short lacks its last numbers
            if inner[-1] == len(item["input"]):
                lacking = sum(one["type"] == kind and one["loc"][:-1] == inner[:-1] for one in error.errors())
                message = f"should have {inner[-1] + lacking} items, not {inner[-1]}"
                yield marks.problem((*at, *inner[:-1]), "wrong-type", message)
            continue
        location: Location = (*at, *(keys.get(str(part), part) for part in inner[:1]), *inner[1:])
        last = str(location[-1]) if location else ""
        message = item["msg"].removeprefix("Value error, ").removeprefix("Input ")
        known: list[str] = []
        near = None
        if kind == "missing":
            about, known = _wanted(model, inner)
            message = f"missing key {last!r}{about}"
        elif kind == "extra_forbidden":
            known = sorted(fields_at(model, inner[:-1]))
            near = nearest(last, known)
            message = f"unknown key {shown(last)}.{did_you_mean(near, known, 99)}"
        elif kind == "union_tag_not_found":
            message = f"missing key {str(context.get('discriminator', '')).strip(chr(39))!r}"
        elif kind in ("literal_error", "enum", "union_tag_invalid"):
            given = context.get("tag", item["input"])
            expected = str(context.get("expected", context.get("expected_tags", "")))
            known = sorted(re.findall(r"'([^']*)'", expected) or re.findall(r"-?\d+", expected))  # words, or numbers
            near = nearest(str(given), known)
            message = f"{shown(given)} is not valid.{did_you_mean(near, known, 99)}"
            if kind == "union_tag_invalid":
                location = (*location, str(context["discriminator"]).strip("'"))
        elif kind == "value_error" or marks.known(location) != location:
            pass  # the validator's own words; or a part of a union that the file does not name
        else:
            message = f"{_words(kind, context, message)}, not {_given(kind, context, item['input'])}"
            message += _in_meters(location, item["input"])
        code = "wrong-type" if kind in _SHAPES else _CODES.get(kind, "invalid-value")
        yield marks.problem(location, code, message, kind == "extra_forbidden", nearest=near, known=tuple(known))


def _words(kind: str, context: Mapping[str, Any], message: str) -> str:
    """What a value should be."""
    if kind == "none_required":
        return "should hold nothing"
    if kind in _SHAPES:
        return f"should be {_SHAPES[kind]}"
    if kind in ("too_long", "too_short", "string_too_long", "string_too_short"):
        number = context["max_length" if kind.endswith("long") else "min_length"]
        part = ("character" if kind.startswith("string") else "item") + "s" * (number != 1)
        return f"should have {number} {part} {'at most' if kind.endswith('long') else 'or more'}"
    if kind == "string_pattern_mismatch":
        return f"should {_FORMS.get(context['pattern'], 'match the pattern ' + context['pattern'])}"
    return message


_FORMS = {  # of patterns, in words
    "^[a-z][a-z0-9_]*$": "be a name such as my_name",
    SYNSET: "be a synset such as stapler.n.01",
    f"^{IMPORT_PATH.pattern}$": "be an import path such as my_module:my_function",
}
_LENGTH = re.compile(r"""\s*(\d+(?:\.\d+)?)\s*(mm|cm|m|inches|inch|in|ft|feet|foot|"|')\s*""")
_METERS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048, "'": 0.3048}  # else inches


def _in_meters(location: Location, value: Any) -> str:
    """The length in meters for a value with a unit, in fields of meters; else ""."""
    field = next((part for part in reversed(location) if isinstance(part, str)), "")
    given = _LENGTH.fullmatch(value) if isinstance(value, str) and field.endswith("_m") else None
    return (
        f"; lengths are in meters, without a unit: {float(given[1]) * _METERS.get(given[2], 0.0254):.4g}"
        if given
        else ""
    )


def _given(kind: str, context: Mapping[str, Any], value: Any) -> str:
    return str(context["actual_length"]) if kind in ("too_long", "too_short") else shown(value)


def _wanted(model: type[BaseModel], location: Sequence[str | int]) -> tuple[str, list[str]]:
    """What may stand under a missing key: in words, from the field's description or its choices, and the choices."""
    fields = (at.model_fields.get(str(location[-1])) for at in _models_at(model, location[:-1]))
    for info in filter(None, fields):
        choices = choices_of(info.annotation)
        about = info.description or " or ".join(choices)
        return (f": {about}" if about else ""), choices
    return "", []


def choices_of(hint: Any) -> list[str]:
    """The words allowed in a field of that type; [] if they cannot be listed."""
    members = list(_members(hint))
    words = [
        str(word) for part in members if typing.get_origin(part) is typing.Literal for word in typing.get_args(part)
    ]
    return words or (["true", "false"] if members == [bool] else [])


def fields_at(model: type[BaseModel], location: Iterable[str | int]) -> set[str]:
    """Keys allowed at a location in a file of `model` (of every fitting union member)."""
    return {f.alias or name for m in _models_at(model, location) for name, f in m.model_fields.items()}


def _models_at(model: type[BaseModel], location: Iterable[str | int]) -> list[type[BaseModel]]:
    at: set[Any] = {model}
    for part in location:
        inner = {t for hint in at for t in _inside(hint, part)}
        # No such part: pydantic names a union's member by its tag, which is not a key in the file.
        at = inner or {hint for hint in at if _tagged(hint, part)} or at
    return [hint for hint in at if _is_model(hint)]


def _is_model(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, BaseModel)


def _tagged(hint: Any, tag: str | int) -> bool:
    return _is_model(hint) and any(tag in typing.get_args(info.annotation) for info in hint.model_fields.values())


def _inside(hint: Any, part: str | int) -> Iterator[Any]:
    """The types found at `part` of a value of type `hint`."""
    if _is_model(hint):
        for name, info in hint.model_fields.items():
            if part in (name, info.alias):
                yield from _members(info.annotation)
        return
    arguments = typing.get_args(hint)
    origin = typing.get_origin(hint)
    if isinstance(origin, type) and arguments:
        if isinstance(part, str) and issubclass(origin, Mapping):
            yield from _members(arguments[1])
        elif isinstance(part, int) and issubclass(origin, Sequence | set | frozenset):
            yield from _members(arguments[0])


def _members(hint: Any) -> Iterator[Any]:
    """A union's members, through Annotated; anything else is its own member."""
    origin = typing.get_origin(hint)
    if origin is typing.Annotated:
        yield from _members(typing.get_args(hint)[0])
    elif origin in (Union, types.UnionType):
        for member in typing.get_args(hint):
            yield from _members(member)
    else:
        yield hint
