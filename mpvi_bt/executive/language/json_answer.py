"""Extracts the JSON object from a model's answer: untrusted text of any length and form."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterator
from typing import Any

from mpvi_bt.executive.language.json_item import TOO_DEEP, Item, item_at, told
from mpvi_bt.executive.language.thinking import thinking

MOST_CHARACTERS = 2**20  # of an answer with JSON in it; a plan has some thousand
MOST_TRIED = 5000  # places where an object may begin
MOST_READ = 20 * MOST_CHARACTERS  # characters, those of broken objects once more for what is whole within them


def parse_json(text: str, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The JSON object that an answer has in it, fenced or amid chatter.

    Of several it is the last whole one that fits: drafts and worked examples come before the answer, marked as such or
    not. One that breaks after it and begins with one of its keys is a later try, so that the earlier one is no answer.
    What stands in marked thinking is never the answer. An object that fits may be wrapped in another.

    If none fits it is the longest of the outermost ones. A broken object goes as far as its brackets do, so it outranks
    whole ones inside it: those are parts of an answer and none.

    It is plain JSON: numbers are finite, no key stands twice, and what is cut off is not completed.

    Args:
        text: The answer.
        fits: Whether an object has the form that was asked for.

    Returns:
        One that fits; else the longest, so that whoever checks it can say what is wrong.

    Raises:
        ValueError: There is none, or the one meant is broken; says where by line and column of what `spoken` leaves,
            what is expected there and what is there, for the model to mend it.
    """
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"it has more than {MOST_CHARACTERS} characters")
    read = _objects(text)
    aside = thinking(_masked(text, read))
    said = [item for item in read if not _is_in(aside, item.begin)]
    for item in reversed(said):
        fitting = next((value for value in _unwrapped(item.value) if fits(value)), None)
        if fitting is not None:
            later = (other for other in said if other.begin >= item.end and other.value is None)
            again = next((other for other in later if _first_key(text, other) in fitting), None)
            if again is not None:
                raise ValueError(told(text, again, aside))
            return fitting
    outermost = list(_outermost(text, said))
    if not outermost:
        raise ValueError("no { begins one" + (" after the thinking, which is not the answer" if read else ""))
    best = max(outermost, key=lambda item: item.length)
    _refuse_list(text, outermost[0], best, aside)
    if best.value is None:
        raise ValueError(told(text, best, aside))
    return best.value


def _objects(text: str) -> list[Item]:
    """The outermost whole objects in a text, and the broken ones, within which others may be whole; in order."""
    found: list[Item] = []
    begin, read = text.find("{"), 0
    while begin >= 0:
        if len(found) == MOST_TRIED:
            raise ValueError(f"more than {MOST_TRIED} braces")
        item = item_at(text, begin)
        found.append(item)
        read += item.length
        within = item.value is None and item.why != TOO_DEEP and read < MOST_READ
        begin = text.find("{", begin + 1 if within else item.end)
    return found


_LIKE_AN_OBJECT = re.compile(r"""\{\s*(?:["'\u201c`,/#]|\w+\s*:)""")  # unlike {room} or \\boxed{...}
_FIRST_KEY = re.compile(r"""\{\s*["'\u201c]?(\w+)["'\u201d]?\s*:""")
_BRACKETS = re.compile(r'"(?:[^"\\\n]|\\.)*"?|[{}\[\]]')  # and strings, each on one line: so one quote spoils one line


def _outermost(text: str, items: list[Item]) -> Iterator[Item]:
    """Those of some items, in order, that are in no other; broken ones as far as their brackets go."""
    end = 0
    for item in items:
        if item.begin < end:
            continue
        if item.value is None and _LIKE_AN_OBJECT.match(text, item.begin):
            item = item._replace(end=max(item.end, _closed(text, item.begin)))
        yield item
        end = item.end


def _closed(text: str, begin: int) -> int:
    """Index behind the bracket that closes the one at `begin`, ignoring unmatched ones; else the text's end."""
    opened: list[str] = []
    for found in _BRACKETS.finditer(text, begin):
        bracket = found[0]
        if bracket in "{[":
            opened.append("}" if bracket == "{" else "]")
        elif bracket == opened[-1]:
            opened.pop()
            if not opened:
                return found.end()
    return len(text)


def _first_key(text: str, item: Item) -> str | None:
    found = _FIRST_KEY.match(text, item.begin)
    return found[1] if found else None


def _refuse_list(text: str, first: Item, best: Item, aside: list[tuple[int, int]]) -> None:
    """Refuse the `best` object if it is in a list that begins with `first`. Raises ValueError."""
    begin = len(text[: first.begin].rstrip()) - 1
    if text[begin : begin + 1] == "[" and best.begin < _closed(text, begin):
        found = item_at(text, begin)
        raise ValueError(told(text, found, aside) if found.value is None else "it is a list, where one object is due")


def _masked(text: str, items: list[Item]) -> str:
    """A text of the same length without its whole objects, whose strings may look like marks of thinking."""
    parts, at = [], 0
    for item in items:
        if item.value is not None:
            parts += [text[at : item.begin], " " * item.length]
            at = item.end
    return "".join([*parts, text[at:]])


def _is_in(spans: list[tuple[int, int]], at: int) -> bool:
    i = bisect_right(spans, at, key=lambda span: span[0]) - 1
    return i >= 0 and spans[i][0] <= at < spans[i][1]


def _unwrapped(value: dict[str, Any] | None) -> Iterator[dict[str, Any]]:
    """An object and the objects that it has as values, the last first."""
    if value is not None:
        yield value
        for inner in reversed(value.values()):
            if isinstance(inner, dict):
                yield from _unwrapped(inner)
