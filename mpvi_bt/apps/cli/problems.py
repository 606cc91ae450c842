"""Problems of files for people and programs: place, message, line, and a mark under the wrong part."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mpvi_bt.executive.drawing.cells import WIDTH, columns
from mpvi_bt.ground.errors import Problem
from mpvi_bt.ground.marked_yaml import MAX_BYTES

_LINE_ENDS = re.compile("\r\n|[\r\n\x85\u2028\u2029]")  # as YAML counts lines
_QUOTED = re.compile(r"""'(?:[^']|'')*'|"(?:[^"\\]|\\.)*\"""")
_PLAIN = re.compile(r"(?:[^:#]|:(?=\S)|(?<=\S)#)+")
_NONE: Mapping[str, str] = {}
_IN_BDDL = re.compile(r"\(?[^\s()]*")
_IN_FLOW = re.compile(r"[^:#,\[\]{}]+")


class Sources:
    """Lines of files, each read once, when a problem is shown; `texts`: files that can't be read again."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._lines = {file: _LINE_ENDS.split(text) for file, text in texts.items()}

    def line(self, problem: Problem) -> str | None:
        """The line that a problem is about, if it has one and the file can be read again."""
        if problem.file not in self._lines:
            self._lines[problem.file] = _LINE_ENDS.split(_text(problem.file))
        lines = self._lines[problem.file]
        return lines[problem.line - 1] if 0 < problem.line <= len(lines) else None


def _text(file: str) -> str:
    try:
        if not Path(file).is_file():  # a pipe cannot be read twice
            return ""
        with Path(file).open("rb") as stream:
            return stream.read(MAX_BYTES).decode("utf-8", "replace").removeprefix("\ufeff")
    except (OSError, ValueError):
        return ""


def as_text(problems: Iterable[Problem], texts: Mapping[str, str] = _NONE) -> Iterator[str]:
    """Each problem's own line, then the line of the file and what of it is meant.

    Args:
        problems: In any order.
        texts: Of what was not read from a file, by the name that problems have for it.
    """
    sources = Sources(texts)
    for problem in problems:
        yield str(problem)
        line = sources.line(problem)
        if line is not None and line.strip():
            yield from excerpt(line, problem.line, problem.column, problem.file.endswith(".bddl"))


def as_json(problems: Sequence[Problem], files: int, texts: Mapping[str, str] = _NONE) -> str:
    """One object with all that a person, or a model, needs for mending the files. `texts`: as of `as_text`."""
    sources = Sources(texts)
    return json.dumps({"problems": [_plain(p, sources.line(p)) for p in problems], "files": files}, indent=2)


def _plain(problem: Problem, line: str | None) -> dict[str, Any]:
    place = None if line is None else _window(line, problem.column, 200)[0]
    return {**vars(problem), "source": place}


def excerpt(line: str, number: int, column: int, bddl: bool = False) -> list[str]:
    """A line of a file as it is shown, no wider than `WIDTH`, and the marks under the text at a 1-based column."""
    gutter = f"{number:>5} | "
    shown, start = _window(line, column, WIDTH - len(gutter))
    length = _IN_BDDL.match(shown, start).end() - start if bddl else extent(shown, start)  # type: ignore[union-attr]
    marked = max(min(length, len(shown) - start), 1)
    blank = " " * columns(shown[:start])
    return [
        gutter + shown,
        " " * (len(gutter) - 2) + "| " + blank + "^" * max(columns(shown[start : start + marked]), 1),
    ]


def _window(line: str, column: int, width: int) -> tuple[str, int]:
    """What of a line is shown, its end or both ends cut off; and the 0-based column therein."""
    start = min(max(column - 1, 0), len(line.rstrip()))
    first = max(0, start - width // 2) if columns(line[: start + width // 3]) > width - 3 else 0
    before = "..." if first else ""
    text = "".join(c if c.isprintable() else " " for c in line[first : first + width]).rstrip()
    start += len(before) - first
    text = before + text
    cut = first + width < len(line.rstrip())
    while columns(text) > width - 3 * cut:
        text, cut = text[:-1], True
    return text + "..." * cut, start


def extent(line: str, start: int) -> int:
    """How many characters the key, the value or the bracket takes that begins there."""
    if start >= len(line):
        return 1
    if quoted := _QUOTED.match(line, start):
        return len(quoted.group())
    before = _QUOTED.sub("", line[:start])
    flow = sum(before.count(c) for c in "[{") > sum(before.count(c) for c in "]}")
    plain = (_IN_FLOW if flow else _PLAIN).match(line, start)
    return len(plain.group().rstrip()) if plain and line[start] not in "[]{},-" else 1
