"""Comments of a YAML text: their position, the key that they belong to, and their transfer to a reformatted text.

YAML libraries drop comments. Here each is tied to the key or list item that it is about: a comment on a line of its own
to what comes next, or, if it is indented deeper than that, to what came before; a comment at the end of a line to what
began last. In the other text it stands at the same key or item, or, if that is gone, at the nearest around it.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import yaml

from mpvi_bt.ground.marked_yaml import Location, SourceMarks
from mpvi_bt.ground.yaml_reader import LOADER

Position = tuple[int, int]  # 1-based line and column
_Entries = dict[Location, Position]  # where a key or a list item begins, its dash included

_LINE = re.compile("[^\r\n\x85\u2028\u2029]*(?:\r\n|[\r\n\x85\u2028\u2029]|$)")  # as YAML counts lines


@dataclass(frozen=True)
class Comment:
    """A comment, or an empty line.

    Attributes:
        text: With its "#"; "" is an empty line.
        place: Above what it is about, after all of it, or at the end of its line.
        at: Location of what it is about; () is the head of the file.
    """

    text: str
    place: Literal["above", "after", "beside"]
    at: Location


def texts_of(text: str) -> list[str]:
    """The comments of a YAML text, as they stand there."""
    return [found.text for found in _found(text)[0] if found.text]


def comments_of(text: str, marks: SourceMarks) -> list[Comment]:
    """The comments and empty lines of a YAML text, each with what it is about.

    Args:
        text: Valid YAML.
        marks: Of that text.
    """
    found, dashes = _found(text)
    entries = _entries(marks, dashes)
    order = sorted((place, at) for at, place in entries.items())
    comments: list[Comment] = []
    below = 0  # the line of the one that was tied last, if it stands alone
    for one in reversed(found):  # an empty line goes with what follows it
        i = bisect.bisect_left(order, (one.place, ()))
        line = one.place[0]
        if one.text or line + 1 != below:
            if one.text or i < len(order):
                comments.append(_tied(one, order[i - 1] if i else None, order[i] if i < len(order) else None, entries))
        elif comments[-1].text:
            comments.append(Comment("", comments[-1].place, comments[-1].at))
        below = 0 if one.beside else line
    return comments[::-1]


def _tied(
    one: _Found, before: tuple[Position, Location] | None, after: tuple[Position, Location] | None, entries: _Entries
) -> Comment:
    """A comment with its subject, found from the entries before and after it."""
    if before is None:
        return Comment(one.text, "above", ())
    if one.beside:
        return Comment(one.text, "beside", before[1])
    column = one.place[1]
    around = next((at for at in _outwards(before[1]) if at in entries and entries[at][1] <= column), before[1][:1])
    if after is None or (one.text and column > after[0][1] and after[1][: len(around)] != around):
        return Comment(one.text, "after", around)
    return Comment(one.text, "above", after[1])


def with_comments(text: str, marks: SourceMarks, comments: Iterable[Comment]) -> str:
    """A text with comments put where they belong.

    Args:
        text: YAML without comments, whose keys and list items each begin a line, or stand within one.
        marks: Of that text.
        comments: Of another text of the same data.
    """
    lines = text.splitlines()
    entries = _entries(marks, _found(text)[1])
    ends = _ends(entries, len(lines))
    beside: dict[int, str] = {}
    added: list[tuple[int, str]] = []
    for comment in comments:
        at = next((at for at in _outwards(comment.at) if at in entries), ())
        if not at:
            added.append((0, comment.text))
            continue
        line, column = entries[at]
        indent = len(lines[line - 1]) - len(lines[line - 1].lstrip(" "))
        if comment.place == "beside" and line not in beside:
            beside[line] = comment.text
        elif comment.place == "after":
            added.append((ends[at], " " * (column - 1 if column - 1 <= indent + 2 else indent) + comment.text))
        else:
            added.append((line - 1, " " * indent + comment.text))
    for line, comment_text in beside.items():
        lines[line - 1] += f"  {comment_text}"
    return "\n".join(_merged(lines, sorted(added, key=lambda one: one[0]))) + "\n"


@dataclass(frozen=True)
class _Found:
    place: Position
    text: str
    beside: bool


def _found(text: str) -> tuple[list[_Found], dict[Position, Position]]:
    """Comments and empty lines in order; and where the dash stands of each list item, by the item's own place."""
    hidden = [*text]  # what belongs to a token can't be a comment
    filled: set[int] = set()
    dashes: dict[Position, Position] = {}
    dash: Position | None = None
    for token in yaml.scan(text, Loader=LOADER):
        start, end = token.start_mark, token.end_mark
        place = (start.line + 1, start.column + 1)
        if dash is not None:
            dashes.setdefault(place, dash)
        dash = place if isinstance(token, yaml.BlockEntryToken) else None
        first = start.index
        if isinstance(token, yaml.ScalarToken) and token.style and token.style in "|>":
            first = _LINE.match(text, first).end()  # type: ignore[union-attr]  # it may be empty
        hidden[first : end.index] = ["x" if c.isprintable() else c for c in text[first : end.index]]
        filled.update(range(start.line + 1, end.line + (end.column > 0) + 1))
    found = []
    for number, line in enumerate(_LINE.findall("".join(hidden)), 1):
        if (column := line.find("#")) >= 0:
            found.append(_Found((number, column + 1), line[column:].rstrip(), bool(line[:column].strip())))
        elif line and not line.strip() and number not in filled:
            found.append(_Found((number, 1), "", False))
    return found, dashes


def _entries(marks: SourceMarks, dashes: Mapping[Position, Position]) -> _Entries:
    taken: dict[Position, Location] = {}  # what an alias stands for has the place of its anchor
    for at, place in marks.values.items():
        if at:
            taken.setdefault(dashes.get(place, place) if isinstance(at[-1], int) else marks.keys[at], at)
    return {at: place for place, at in taken.items()}


def _outwards(at: Location) -> Iterator[Location]:
    """The location, and those around it."""
    return (at[:n] for n in range(len(at), 0, -1))


def _ends(entries: _Entries, lines: int) -> dict[Location, int]:
    """The last line of everything, of which the next begins a line."""
    ends = {}
    open_: list[Location] = []
    for at, (line, _) in sorted(entries.items(), key=lambda entry: entry[1]):
        while open_ and at[: len(open_[-1])] != open_[-1]:
            ends[open_.pop()] = line - 1
        open_.append(at)
    return ends | dict.fromkeys(open_, lines)


def _merged(lines: list[str], added: list[tuple[int, str]]) -> Iterator[str]:
    """The lines with each added one after so many of them; no two empty lines together, none at the top."""
    last = ""
    at = 0
    for number, line in enumerate([*lines, None]):
        while at < len(added) and added[at][0] == number:
            if added[at][1].strip() or last:
                last = added[at][1].strip() and added[at][1]
                yield last
            at += 1
        if line is not None:
            yield line
            last = line or "x"  # an empty line of a text is not ours
