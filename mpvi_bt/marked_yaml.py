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

from mpvi_bt.errors import FileProblems, Problem, UserError, did_you_mean, nearest, shown

MAX_BYTES = 2 * 2**20
MAX_NODES = 60_000
MAX_DEPTH = 200
MAX_PROBLEMS = 200  # of one file; who wants to mend more begins with these

Location = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_SURROGATES = re.compile(r"\\u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}")
_QUOTED = re.compile(r"""(?<=[\s\[{,])(?:"[^"]*"|'[^']*')""")
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

    def problem(
        self, location: Iterable[str | int], code: str, message: str, key: bool = False, **more: Any
    ) -> Problem:
        """A problem at that location, for checks that a model cannot express. `more`: further fields of it."""
        location = tuple(location)
        line, column = self.at(location, key)
        return Problem(self.file, line, column, code, message, pointer=pointer(self.known(location)), **more)

    def unknown(
        self, location: Iterable[str | int], kind: str, given: str, known: Iterable[str], key: bool = False
    ) -> Problem:
        """The problem of a name that is not known, such as a room that the house does not have."""
        names = sorted(known)
        near = nearest(given, names)
        message = f"unknown {kind} {shown(given)}.{did_you_mean(near, names)}"
        code = f"unknown-{kind.replace(' ', '-')}"
        return self.problem(location, code, message, key, nearest=near, known=tuple(names))


def pointer(location: Location) -> str:
    """A location as a JSON pointer (RFC 6901)."""
    return "".join(f"/{str(part).replace('~', '~0').replace('/', '~1')}" for part in location)


def load_marked(path: str | Path) -> tuple[Any, Marks]:
    """Plain data (dict, list, str, int, float, bool, None) of a YAML or JSON file, and the marks of all of it.

    Raises:
        UserError: There is no such file, or it cannot be read.
        FileProblems: It is not valid YAML (or JSON, if that is its name), has duplicate keys or is too large.
    """
    return parse_marked(read_text(path), str(path))


def read_text(path: str | Path) -> str:
    """The text of a file, whatever ends its lines there. Raises as `load_marked`."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: NUL in the name
        reason = getattr(error, "strerror", None) or "cannot be read"
        raise UserError(f"{path}: {reason.lower()}") from None
    if len(content) > MAX_BYTES:
        raise FileProblems([Problem(str(path), 0, 0, "too-large", f"larger than {MAX_BYTES >> 20} MiB")])
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8", "replace")
        message = f"not UTF-8 text ({error.reason}: byte {content[error.start]:#04x})"
        raise FileProblems([Problem(str(path), *_place(before, len(before)), "encoding", message)]) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_marked(text: str, name: str) -> tuple[Any, Marks]:
    """As `load_marked`, of a text that `name` stands for in problems."""
    if name.endswith(".json"):
        _check_json(text, name)
        text = _SURROGATES.sub(lambda pair: json.loads(f'"{pair.group()}"'), text)  # YAML knows no surrogate pairs
    return _Reader(text, name).read()


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


def validate_data(data: Any, marks: Marks, model: type[Model], at: Location = ()) -> Model:
    """As `validate`, of data that is already loaded, or of the part of a file's data that stands `at` a location.

    Raises:
        FileProblems: Everything that is wrong with it.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise FileProblems(problems_of(error, marks, model, at)) from None


class _Reader:
    """Builds data and marks straight from the parser's events, so that limits hold before memory is spent."""

    def __init__(self, text: str, name: str) -> None:
        self.marks = Marks(name)
        self.problems: list[Problem] = []
        self.count = 0
        self.anchors: dict[str, list[Any]] = {}
        self.text = text
        self.events: Iterator[Any] = iter(())
        self.record: list[Any] = []  # events within an anchored node, so that its aliases can be read again
        self.recording = 0

    def read(self) -> tuple[Any, Marks]:
        data: Any = None
        try:
            loader = _Loader(self.text)
            try:
                self.events = iter(loader.get_event, None)
                data = self._document()
            finally:
                loader.dispose()
        except yaml.MarkedYAMLError as error:
            self._syntax(error)
        except yaml.reader.ReaderError as error:
            self.problems.append(self._problem(*_place(self.text, error.position), "syntax", error.reason))
        if self.problems:
            raise FileProblems(self.problems)
        return data, self.marks

    def _syntax(self, error: yaml.MarkedYAMLError) -> None:
        """The parser's words where it stopped; and where the cause may be, if that is elsewhere."""
        mark, start = error.problem_mark or error.context_mark, error.context_mark
        what = " ".join(filter(None, (error.context, error.problem)))
        # At the end of a text without a last newline libyaml points at a line that is not there.
        end = len(self.text.rstrip())
        place = _place(self.text, min(mark.index, end)) if mark else (1, 1)
        self.problems.append(self._problem(*place, "syntax", f"not valid YAML: {what}"))
        scanning = (error.context or "").startswith("while scanning")
        if start and mark and (scanning or mark.index >= end) and start.line + 1 < place[0]:
            message = f"what begins here is not closed; line {place[0]} no longer fits"
            self.problems.append(self._problem(start.line + 1, start.column + 1, "syntax", message))
        if quote := _long_quote(self.text, mark.index if mark else end):
            message = (
                f"this quoted text goes on to line {_place(self.text, quote[1])[0]}; is its closing quote missing?"
            )
            self.problems.append(self._problem(*_place(self.text, quote[0]), "syntax", message))

    def _problem(self, line: int, column: int, code: str, message: str) -> Problem:
        return Problem(self.marks.file, line, column, code, message)

    def _next(self) -> Any:
        event = next(self.events)
        if self.recording:
            self.record.append(event)
        return event

    def _document(self) -> Any:
        data: Any = None
        seen = False
        for event in self.events:
            if isinstance(event, yaml.DocumentStartEvent):
                if seen:
                    self._refuse(event, "syntax", "a second document; one file holds one")
                    break
                seen = True
                data = self._node(self._next(), (), 0)
        if not seen:
            self._stop(1, 1, "empty", "the file is empty")
        return data

    def _node(self, event: Any, location: Location, depth: int) -> Any:
        mark = event.start_mark
        line, column = mark.line + 1, mark.column + 1
        self.count += 1
        if self.count > MAX_NODES:
            self._stop(line, column, "too-large", f"more than {MAX_NODES} values")
        if depth > MAX_DEPTH:
            self._stop(line, column, "too-deep", f"nested more than {MAX_DEPTH} deep")
        self.marks.values[location] = (line, column)
        kind = type(event)
        if kind is yaml.AliasEvent:
            return self._alias(event, location, depth)
        if event.tag is not None and not (event.tag == "!" and kind is yaml.ScalarEvent):
            self._refuse(event, "tag", f"tags such as {event.tag!r:.60} are not supported")
        if event.anchor is not None:
            return self._anchored(event, location, depth)
        if kind is yaml.ScalarEvent:
            return plain_scalar(event.value) if not event.style and event.tag is None else event.value
        if kind is yaml.SequenceStartEvent:
            items: list[Any] = []
            while type(child := self._next()) is not yaml.SequenceEndEvent:
                items.append(self._node(child, (*location, len(items)), depth + 1))
            return items
        return self._mapping(location, depth)

    def _mapping(self, location: Location, depth: int) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        while type(key := self._next()) is not yaml.MappingEndEvent:
            place = (key.start_mark.line + 1, key.start_mark.column + 1)
            if type(key) is not yaml.ScalarEvent:
                self._stop(*place, "syntax", "a key must be plain text")
            name = str(key.value)
            if name in mapping:
                first = self.marks.keys[(*location, name)][0]
                self._refuse(key, "duplicate-key", f"key {name!r} is already on line {first}")
                name += " (again)"  # keeps the first one's marks; the file is refused anyway
            here = (*location, name)
            self.marks.keys[here] = place
            mapping[name] = self._node(self._next(), here, depth + 1)
        return mapping

    def _anchored(self, event: Any, location: Location, depth: int) -> Any:
        """Remember the events of a node, so that its aliases are read again, each counted against the limit."""
        anchor, event.anchor = event.anchor, None
        if not self.recording:
            self.record = [event]
        begin = len(self.record) - 1
        self.recording += 1
        data = self._node(event, location, depth)
        self.recording -= 1
        self.anchors[anchor] = self.record[begin:]
        return data

    def _alias(self, event: Any, location: Location, depth: int) -> Any:
        if event.anchor not in self.anchors:
            self._refuse(event, "alias", f"*{event.anchor} is not defined above, or contains itself")
            return None
        events, recording = self.events, self.recording
        self.events, self.recording = iter(self.anchors[event.anchor]), 0
        place = self.marks.values[location]
        data = self._node(self._next(), location, depth + 1)
        self.marks.values[location] = place
        self.events, self.recording = events, recording
        return data

    def _refuse(self, event: Any, code: str, message: str) -> None:
        mark = event.start_mark
        self.problems.append(self._problem(mark.line + 1, mark.column + 1, code, message))
        if len(self.problems) >= MAX_PROBLEMS:
            raise FileProblems(self.problems)

    def _stop(self, line: int, column: int, code: str, message: str) -> typing.NoReturn:
        raise FileProblems([*self.problems, self._problem(line, column, code, message)])


def _long_quote(text: str, stop: int) -> tuple[int, int] | None:
    """Where the last quoted text of more than one line begins and ends, of those before a syntax error."""
    found = None
    last = 0
    try:
        events: Iterator[Any] = yaml.parse(text, Loader=_Loader)
        for event in events:
            start, last = event.start_mark.index, event.end_mark.index
            if isinstance(event, yaml.ScalarEvent) and event.style in ("'", '"') and "\n" in text[start:last]:
                found = start, last
    except yaml.YAMLError:  # the parser reads ahead: what it stumbled over is no event yet
        for quote in _QUOTED.finditer(text, last, stop):
            found = quote.span() if "\n" in quote.group() else found
    return found


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
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
}


def problems_of(
    error: ValidationError,
    marks: Marks,
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
        known: list[str] = []
        near = None
        if kind == "missing":
            message = f"missing key {last!r}"
        elif kind == "extra_forbidden":
            known = sorted(fields_at(model, inner[:-1]))
            near = nearest(last, known)
            message = f"unknown key {shown(last)}.{did_you_mean(near, known, 99)}"
        elif kind == "union_tag_not_found":
            message = f"missing key {str(context.get('discriminator', '')).strip(chr(39))!r}"
        elif kind in ("literal_error", "enum", "union_tag_invalid"):
            given = context.get("tag", item["input"])
            known = sorted(re.findall(r"'([^']*)'", str(context.get("expected", context.get("expected_tags", "")))))
            near = nearest(str(given), known)
            message = f"{shown(given)} is not valid.{did_you_mean(near, known, 99)}"
            if kind == "union_tag_invalid":
                location = (*location, str(context["discriminator"]).strip("'"))
        elif kind == "value_error" or marks.known(location) != location:
            pass  # the validator's own words; or a part of a union that the file does not name
        else:
            message = f"{_words(kind, context, message)}, not {_given(kind, context, item['input'])}"
        code = "wrong-type" if kind in _SHAPES else _CODES.get(kind, "invalid-value")
        yield marks.problem(location, code, message, kind == "extra_forbidden", nearest=near, known=tuple(known))


def _words(kind: str, context: Mapping[str, Any], message: str) -> str:
    """What a value should be."""
    if kind in _SHAPES:
        return f"should be {_SHAPES[kind]}"
    if kind in ("too_long", "too_short", "string_too_long", "string_too_short"):
        number = context["max_length" if kind.endswith("long") else "min_length"]
        part = ("character" if kind.startswith("string") else "item") + "s" * (number != 1)
        return f"should have {number} {part} {'at most' if kind.endswith('long') else 'or more'}"
    if kind == "string_pattern_mismatch":
        name = context["pattern"] == "^[a-z][a-z0-9_]*$"
        return "should be a name such as my_name" if name else f"should match the pattern {context['pattern']}"
    return message


def _given(kind: str, context: Mapping[str, Any], value: Any) -> str:
    return str(context["actual_length"]) if kind in ("too_long", "too_short") else shown(value)


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
