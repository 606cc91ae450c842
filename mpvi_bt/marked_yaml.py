"""YAML and JSON files read with the place of everything in them, and checked against a pydantic model.

`validate(path, Model)` is all that most callers need. Every problem of a file is reported at once, as file:line:col,
with the nearest valid name (Our choice: people and language models mend a file faster from the full list).

Scalars follow YAML 1.2's core schema, not PyYAML's 1.1: `on`, `no` and `12:30` stay text, `1e-3` is a number; so JSON
reads the same. Keys are always text. Tags are refused; files are bounded in size, depth and number of nodes (with
aliases written out), because plans and trees may come from elsewhere.
"""

from __future__ import annotations

import json
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, Union

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from mpvi_bt.errors import FileProblems, Problem, UserError, nearest

MAX_BYTES = 8 * 2**20
MAX_NODES = 200_000
MAX_DEPTH = 200

Location = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_SURROGATES = re.compile(r"\\u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}")
_NULL = {"", "~", "null", "Null", "NULL"}
_BOOL = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
_INT = re.compile(r"[-+]?[0-9]{1,18}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


class Record(BaseModel):
    """Base of our file models: immutable, and unknown keys are problems."""

    model_config = ConfigDict(extra="forbid", frozen=True)


@dataclass
class Marks:
    """Where everything in a file stands.

    Attributes:
        file: Path as the user gave it.
        values: Location, such as ("segments", 0, "target"), to the 1-based (line, column) of the value.
        keys: The same of a mapping's key.
    """

    file: str
    values: dict[Location, tuple[int, int]] = field(default_factory=dict)
    keys: dict[Location, tuple[int, int]] = field(default_factory=dict)

    def at(self, location: Iterable[str | int], key: bool = False) -> tuple[int, int]:
        """(line, column) of the value, or of its key, or else of the nearest thing around it."""
        known = self.known(location)
        if key and known in self.keys:
            return self.keys[known]
        return self.values.get(known, (0, 0))

    def known(self, location: Iterable[str | int]) -> Location:
        """`location` without the parts that are not in the file (missing keys, pydantic's union tags)."""
        found: Location = ()
        for part in location:
            if (*found, part) in self.values:
                found = (*found, part)
        return found

    def problem(self, location: Iterable[str | int], code: str, message: str, key: bool = False) -> Problem:
        """A problem at that location, for checks that a model cannot express."""
        line, column = self.at(location, key)
        return Problem(self.file, line, column, code, message)


def load_marked(path: str | Path) -> tuple[Any, Marks]:
    """Plain data (dict, list, str, int, float, bool, None) of a YAML or JSON file, and the marks of all of it.

    Raises:
        UserError: There is no such file, or it cannot be read.
        FileProblems: It is not valid YAML, has duplicate keys or is too large.
    """
    file = Path(path)
    try:
        if file.is_file() and file.stat().st_size > MAX_BYTES:
            raise FileProblems([Problem(str(path), 0, 0, "too-large", f"larger than {MAX_BYTES >> 20} MiB")])
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileProblems([Problem(str(path), 0, 0, "encoding", f"not UTF-8 text ({error.reason})")]) from None
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from None
    return parse_marked(text, str(path))


def parse_marked(text: str, name: str) -> tuple[Any, Marks]:
    """As `load_marked`, of a text that `name` stands for in problems."""
    if name.endswith(".json"):  # YAML knows no surrogate pairs
        text = _SURROGATES.sub(lambda pair: json.loads(f'"{pair.group()}"'), text)
    return _Reader(text, name).read()


def validate(path: str | Path, model: type[Model]) -> Model:
    """The file as a `model`.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return validate_data(*load_marked(path), model)


def validate_data(data: Any, marks: Marks, model: type[Model]) -> Model:
    """As `validate`, of data that is already loaded.

    Raises:
        FileProblems: Everything that is wrong with it.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise FileProblems(problems_of(error, marks, model)) from None


class _Reader:
    """Builds data and marks straight from the parser's events, so that limits hold before memory is spent."""

    def __init__(self, text: str, name: str) -> None:
        self.marks = Marks(name)
        self.problems: list[Problem] = []
        self.count = 0
        self.anchors: dict[str, list[Any]] = {}
        self.recording: list[list[Any]] = []
        self.text = text

    def read(self) -> tuple[Any, Marks]:
        name = self.marks.file
        try:
            loader = _Loader(self.text)
            try:
                data = self._document(iter(loader.get_event, None))
            finally:
                loader.dispose()
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            # At the end of a text without a last newline libyaml points at a line that is not there.
            line, column = _place(self.text, min(mark.index, len(self.text.rstrip()))) if mark else (0, 0)
            what = " ".join(filter(None, (error.context, error.problem)))
            self.problems.append(Problem(name, line, column, "syntax", f"not valid YAML: {what}"))
        except yaml.reader.ReaderError as error:
            line, column = _place(self.text, error.position)
            self.problems.append(Problem(name, line, column, "syntax", f"not valid YAML: {error.reason}"))
        if self.problems:
            raise FileProblems(self.problems)
        return data, self.marks

    def _document(self, events: Iterator[Any]) -> Any:
        data: Any = None
        seen = False
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                if seen:
                    self._refuse(event, "syntax", "a second document; one file holds one")
                seen = True
                data = self._node(next(events), events, (), 0)
        if not seen:
            self._stop(1, 1, "empty", "the file is empty")
        return data

    def _node(self, event: Any, events: Iterator[Any], location: Location, depth: int) -> Any:
        line, column = event.start_mark.line + 1, event.start_mark.column + 1
        self.count += 1
        if self.count > MAX_NODES:
            self._stop(line, column, "too-large", f"more than {MAX_NODES} values")
        if depth > MAX_DEPTH:
            self._stop(line, column, "too-deep", f"nested more than {MAX_DEPTH} deep")
        self.marks.values[location] = (line, column)
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, location, depth)
        if event.tag is not None and not (event.tag == "!" and isinstance(event, yaml.ScalarEvent)):
            self._refuse(event, "tag", f"tags such as {event.tag!r} are not supported")
        if event.anchor is not None:
            return self._anchored(event, events, location, depth)
        if isinstance(event, yaml.ScalarEvent):
            return plain_scalar(event.value) if not event.style and event.tag is None else event.value
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Any] = []
            while not isinstance(child := next(events), yaml.SequenceEndEvent):
                items.append(self._node(child, events, (*location, len(items)), depth + 1))
            return items
        return self._mapping(events, location, depth)

    def _mapping(self, events: Iterator[Any], location: Location, depth: int) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        while not isinstance(key := next(events), yaml.MappingEndEvent):
            place = (key.start_mark.line + 1, key.start_mark.column + 1)
            if not isinstance(key, yaml.ScalarEvent):
                self._stop(*place, "syntax", "a key must be plain text")
            name = str(key.value)
            if name in mapping:
                first = self.marks.keys[(*location, name)][0]
                self._refuse(key, "duplicate-key", f"key {name!r} is already on line {first}")
                name += " (again)"  # keeps the first one's marks; the file is refused anyway
            here = (*location, name)
            self.marks.keys[here] = place
            mapping[name] = self._node(next(events), events, here, depth + 1)
        return mapping

    def _anchored(self, event: Any, events: Iterator[Any], location: Location, depth: int) -> Any:
        """Remember the events of a node, so that its aliases are read again, each counted against the limit."""
        anchor, event.anchor = event.anchor, None
        record: list[Any] = [event]
        data = self._node(event, _tee(events, record), location, depth)
        self.anchors[anchor] = record
        return data

    def _alias(self, event: Any, location: Location, depth: int) -> Any:
        if event.anchor not in self.anchors:
            self._refuse(event, "alias", f"*{event.anchor} is not defined above, or contains itself")
            return None
        again = iter(self.anchors[event.anchor])
        return self._node(next(again), again, location, depth + 1)

    def _refuse(self, event: Any, code: str, message: str) -> None:
        mark = event.start_mark
        self.problems.append(Problem(self.marks.file, mark.line + 1, mark.column + 1, code, message))

    def _stop(self, line: int, column: int, code: str, message: str) -> typing.NoReturn:
        raise FileProblems([*self.problems, Problem(self.marks.file, line, column, code, message)])


def _tee(events: Iterator[Any], record: list[Any]) -> Iterator[Any]:
    for event in events:
        record.append(event)
        yield event


def plain_scalar(text: str) -> Any:
    """A plain scalar by YAML 1.2's core schema (without octal and hexadecimal numbers)."""
    if text in _NULL:
        return None
    if text in _BOOL:
        return _BOOL[text]
    if _INT.fullmatch(text):
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text


def _place(text: str, position: int) -> tuple[int, int]:
    """1-based (line, column) of a character."""
    before = text[:position]
    return before.count("\n") + 1, position - (before.rfind("\n") + 1) + 1


_CODES = {
    "missing": "missing-key",
    "extra_forbidden": "unknown-key",
    "literal_error": "unknown-value",
    "enum": "unknown-value",
    "union_tag_invalid": "unknown-value",
    "union_tag_not_found": "missing-key",
    "value_error": "invalid-value",
}
_SHAPES = {
    "model_attributes_type": "should be a mapping",
    "model_type": "should be a mapping",
    "dict_type": "should be a mapping",
    "list_type": "should be a list",
    "tuple_type": "should be a list",
    "string_type": "should be text",
    "float_type": "should be a number",
    "float_parsing": "should be a number",
}


def problems_of(
    error: ValidationError,
    marks: Marks,
    model: type[BaseModel],
    at: Location = (),
    keys: Mapping[str, str] | None = None,
) -> list[Problem]:
    """A validation error as problems, each once.

    Args:
        error: What pydantic says.
        marks: Of the file.
        model: What was validated against.
        at: Where in the file the model's data stands.
        keys: Names of fields that the file writes otherwise, to what it writes.
    """
    found = {(p.line, p.column, p.message): p for p in _problems(error, marks, model, at, keys or {})}
    return list(found.values())


def _problems(
    error: ValidationError, marks: Marks, model: type[BaseModel], at: Location, keys: Mapping[str, str]
) -> Iterator[Problem]:
    for item in error.errors(include_url=False):
        kind, context = item["type"], item.get("ctx", {})
        if kind == "too_short" and len(item["input"]) >= context["min_length"]:
            continue  # pydantic counts the valid items of a tuple only; the others have their own problems
        inner = item["loc"]
        location: Location = (*at, *(keys.get(str(part), part) for part in inner[:1]), *inner[1:])
        last = str(location[-1]) if location else ""
        message = item["msg"].removeprefix("Value error, ").removeprefix("Input ")
        if kind == "missing":
            message = f"missing key {last!r}"
        elif kind == "extra_forbidden":
            message = f"unknown key {last!r}." + _hint(last, fields_at(model, inner[:-1]))
        elif kind == "union_tag_not_found":
            message = f"missing key {str(context.get('discriminator', '')).strip(chr(39))!r}"
        elif kind in ("literal_error", "enum", "union_tag_invalid"):
            given = context.get("tag", item["input"])
            choices = re.findall(r"'([^']*)'", str(context.get("expected", context.get("expected_tags", ""))))
            message = f"{given!r} is not valid." + _hint(str(given), choices)
            if kind == "union_tag_invalid":
                location = (*location, str(context["discriminator"]).strip("'"))
        elif kind == "value_error" or marks.known(location) != location:
            pass  # the validator's own words; or a part of a union that the file does not name
        else:
            message = f"{_SHAPES.get(kind, message)}, not {_short(item['input'])}"
        yield marks.problem(location, _CODES.get(kind, kind.replace("_", "-")), message, kind == "extra_forbidden")


def _hint(given: str, known: Iterable[str]) -> str:
    names = sorted(known)
    near = nearest(given, names)
    return (f" Did you mean {near!r}?" if near else "") + (f" Known: {', '.join(names)}." if names else "")


def _short(value: Any) -> str:
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def fields_at(model: type[BaseModel], location: Iterable[str | int]) -> set[str]:
    """Keys that a file of `model` may have at a location (of every union member that fits)."""
    at: set[Any] = {model}
    for part in location:
        inner = {t for hint in at for t in _inside(hint, part)}
        # No such part: pydantic names a union's member by its tag, which is not a key in the file.
        at = inner or {hint for hint in at if _tagged(hint, part)} or at
    return {f.alias or name for m in at if _is_model(m) for name, f in m.model_fields.items()}


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
