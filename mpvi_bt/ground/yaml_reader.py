"""Plain data from YAML text, and where everything in it stands; bounded, and with every problem of the text.

Scalars follow YAML 1.2's core schema, not PyYAML's 1.1: `on`, `no` and `12:30` stay text, `1e-3` is a number; so JSON
reads the same. Keys are always text. Tags are refused; files are bounded in size, depth and number of nodes (with
aliases written out), because plans and trees may come from elsewhere.
"""

from __future__ import annotations

import re
import typing
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml

from mpvi_bt.ground.errors import FileProblems, Problem

MAX_BYTES = 2 * 2**20
MAX_NODES = 40_000
MAX_DEPTH = 200
MAX_PROBLEMS = 200  # of one file; who wants to mend more begins with these

Location = tuple[str | int, ...]

LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_QUOTED = re.compile(r"""(?<=[\s\[{,])(?:"[^"]*"|'[^']*')""")
# Spaces that are none to YAML, and what has no width: they come in with text that is copied from a page.
_UNSEEN = "[\u00a0\u00ad\u1680\u2000-\u200f\u202f\u205f\u2060\u3000\ufeff]"
_UNSEEN_IN_KEY = re.compile(_UNSEEN)
_UNSEEN_IN_VALUE = re.compile(rf"(?:^[-?]?|:){_UNSEEN}")  # where a value begins; within one it is text
_NULL = {"", "~", "null", "Null", "NULL"}
_BOOL = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
_INT = re.compile(r"[-+]?[0-9]{1,18}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


@dataclass
class SourceMarks:
    """Where everything in a file stands.

    Attributes:
        file: Path as the user gave it.
        values: Location, such as ("segments", 0, "target"), to the 1-based (line, column) of the value.
        keys: The same of a mapping's key.
    """

    file: str
    values: dict[Location, tuple[int, int]] = field(default_factory=dict)
    keys: dict[Location, tuple[int, int]] = field(default_factory=dict)

    @classmethod
    def unplaced(cls, data: Any, file: str) -> SourceMarks:
        """Marks for data without a file: problems then have JSON pointers, but no lines."""
        marks = cls(file)
        left: list[tuple[Location, Any]] = [((), data)]
        while left:
            at, value = left.pop()
            marks.values[at] = (0, 0)
            if isinstance(value, dict):
                marks.keys.update({(*at, key): (0, 0) for key in value})
                left += [((*at, key), inner) for key, inner in value.items()]
            elif isinstance(value, list):
                left += [((*at, i), inner) for i, inner in enumerate(value)]
        return marks

    def at(self, location: Iterable[str | int], key: bool = False) -> tuple[int, int]:
        """(line, column) of the value, or of its key, or else of the nearest thing around it."""
        known = self.known(location)
        if key and known in self.keys:
            return self.keys[known]
        return self.values.get(known, (0, 0))

    def known(self, location: Iterable[str | int]) -> Location:
        """`location` without the parts that are not in the file (missing keys, pydantic's union tags)."""
        location = tuple(location)
        if location in self.values:
            return location
        found: Location = ()
        for part in location:
            if (*found, part) in self.values:
                found = (*found, part)
        return found

    def problem(
        self, location: Iterable[str | int], code: str, message: str, key: bool = False, **more: Any
    ) -> Problem:
        """A problem at that location, for checks beyond a model's. `more`: further fields of it."""
        location = tuple(location)
        line, column = self.at(location, key)
        return Problem(self.file, line, column, code, message, pointer=pointer(self.known(location)), **more)

    def unknown(
        self,
        location: Iterable[str | int],
        kind: str,
        given: str,
        known: Iterable[str],
        key: bool = False,
        whose: str = "",
    ) -> Problem:
        """The problem of an unknown name, such as a room missing from the house. `whose` is added, as in " of it"."""
        location = tuple(location)
        at = pointer(self.known(location))
        return Problem.unknown(self.file, self.at(location, key), kind, given, known, whose, pointer=at)


def pointer(location: Location) -> str:
    """A location as a JSON pointer (RFC 6901)."""
    return "".join(f"/{str(part).replace('~', '~0').replace('/', '~1')}" for part in location)


def read_yaml(text: str, name: str) -> tuple[Any, SourceMarks]:
    """Plain data (dict, list, str, int, float, bool, None) of a text that `name` stands for in problems, and its marks.

    Raises:
        FileProblems: It is not valid YAML, has duplicate keys or is too large.
    """
    return _YamlReader(text, name).read()


class _YamlReader:
    """Builds data and marks straight from the parser's events, so that limits hold before memory is spent."""

    def __init__(self, text: str, name: str) -> None:
        self.marks = SourceMarks(name)
        self.problems: list[Problem] = []
        self.count = 0
        self.anchors: dict[str, list[Any]] = {}
        self.text = text
        self.events: Iterator[Any] = iter(())
        self.record: list[Any] = []  # events within an anchored node, so that its aliases can be read again
        self.recording = 0

    def read(self) -> tuple[Any, SourceMarks]:
        data: Any = None
        try:
            loader = LOADER(self.text)
            try:
                self.events = iter(loader.get_event, None)
                data = self._document()
            finally:
                loader.dispose()
        except yaml.MarkedYAMLError as error:
            self._syntax(error)
        except yaml.reader.ReaderError as error:
            self.problems.append(self._problem(*place_in(self.text, error.position), "syntax", error.reason))
        if self.problems:
            raise FileProblems(self.problems)
        return data, self.marks

    def _syntax(self, error: yaml.MarkedYAMLError) -> None:
        """Note the parser's message at its place, with the likely cause if that is elsewhere."""
        mark, start = error.problem_mark or error.context_mark, error.context_mark
        what = " ".join(filter(None, (error.context, error.problem)))
        # At the end of a text without a last newline libyaml points at a line that is not there.
        end = len(self.text.rstrip())
        place = place_in(self.text, min(mark.index, end)) if mark else (1, 1)
        if "nesting depth" in what:  # libyaml of PyYAML 6.0.4 has a limit of its own, and reads ahead up to it
            self.problems.append(self._problem(*place, "too-deep", f"nested more than {MAX_DEPTH} deep"))
            return
        at = min(mark.index, end) if mark else 0
        self.problems.append(self._problem(*place, "syntax", f"not valid YAML: {_cause(what, self.text, at)}"))
        around = slice(
            self.text.rfind("\n", 0, max(self.text.rfind("\n", 0, at), 0)) + 1, at + 1
        )  # and the line before
        if unseen := _UNSEEN_IN_KEY.search(self.text[around]):
            place = place_in(self.text, around.start + unseen.start())
            self.problems.append(self._problem(*place, "syntax", _unseen(unseen[0])))
        scanning = (error.context or "").startswith("while scanning")
        if start and mark and (scanning or mark.index >= end) and start.line + 1 < place[0]:
            message = f"what begins here is not closed; line {place[0]} no longer fits"
            self.problems.append(self._problem(start.line + 1, start.column + 1, "syntax", message))
        if quote := _long_quote(self.text, mark.index if mark else end):
            message = (
                f"this quoted text goes on to line {place_in(self.text, quote[1])[0]}; is its closing quote missing?"
            )
            self.problems.append(self._problem(*place_in(self.text, quote[0]), "syntax", message))

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
            self._check_seen(event, _UNSEEN_IN_VALUE)
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
            self._check_seen(key, _UNSEEN_IN_KEY)
            if name in mapping:
                first = self.marks.keys[(*location, name)][0]
                self._refuse(key, "duplicate-key", f"key {name!r} is already on line {first}")
                name += " (again)"  # keeps the first one's marks; the file is refused anyway
            here = (*location, name)
            self.marks.keys[here] = place
            mapping[name] = self._node(self._next(), here, depth + 1)
        return mapping

    def _check_seen(self, scalar: Any, unseen: re.Pattern[str]) -> None:
        """Stop at a character of an unquoted text that nobody sees."""
        if not scalar.style and not scalar.value.isascii() and unseen.search(scalar.value):
            found = _UNSEEN_IN_KEY.search(self.text, scalar.start_mark.index)
            assert found is not None
            self._stop(*place_in(self.text, found.start()), "syntax", _unseen(found[0]))

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


_CAUSES = {  # of libyaml's words, what to do
    "mapping values are not allowed in this context": "a text with ': ' needs quotes, and a key its own "
    "line, below its neighbors; or the line above lacks its ':'",
    "did not find expected '-' indicator": "keys of a list's item stand below its first one, not below its '-'",
    "did not find expected key": "it is indented as no list or mapping above it, or follows a text in quotes",
    "while scanning a directive": "a line that begins with '%' is a directive, and a text that does needs quotes",
    "while scanning an alias": "'*' begins an alias, and a text that begins with it needs quotes",
    "while scanning an anchor": "'&' begins an anchor, and a text that begins with it needs quotes",
    "a tab character that violates indentation": "indent with spaces",
}


def _cause(what: str, text: str, at: int) -> str:
    """The parser's message; for an illegal character its name and the correction."""
    char = text[at : at + 1]
    if "cannot start any token" in what and char:
        if char == "\t":
            return "a tab cannot begin anything; indent with spaces"
        return f"{char!r} cannot begin anything; put a text that begins with it into quotes"
    return "; ".join([what, *(mend for words, mend in _CAUSES.items() if words in what)])


def _unseen(char: str) -> str:
    mend = "type a plain space" if char.isspace() else "remove it"
    name = unicodedata.name(char).lower()
    return f"a{'n' * (name[0] in 'aeiou')} {name} (U+{ord(char):04X}), which YAML takes for a letter; {mend}"


def _long_quote(text: str, stop: int) -> tuple[int, int] | None:
    """Where the last quoted text of more than one line begins and ends, of those before a syntax error."""
    found = None
    last = 0
    try:
        events: Iterator[Any] = yaml.parse(text, Loader=LOADER)
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


def place_in(text: str, position: int) -> tuple[int, int]:
    """1-based (line, column) of a character."""
    before = text[:position]
    return before.count("\n") + 1, position - (before.rfind("\n") + 1) + 1
