"""Reads an object of plain JSON somewhere in a text, and says where it breaks."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from typing import Any, NamedTuple

MOST_DEEP = 60  # objects and lists within each other
_QUOTED = 40  # characters of what is found where something else is expected


class Item(NamedTuple):
    """An object in a text, or the readable beginning of a broken one.

    Attributes:
        begin, end: Where.
        value: The object; None: it is broken.
        why: What is wrong then.
        at: Where that is, if at one place.
    """

    begin: int
    end: int
    value: Any
    why: str = ""
    at: int | None = None

    @property
    def length(self) -> int:
        """In characters."""
        return self.end - self.begin


TOO_DEEP = "nested too deep"
_DEEP = re.compile(r'(?:\s*[\[{]\s*(?:"[^"\\]*"\s*:)?)+')


def item_at(text: str, begin: int) -> Item:
    """The object that begins at a brace; of a bracket the list."""
    odd: list[str] = []  # what Python's reader takes and JSON does not

    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        value = dict(pairs)
        if len(value) < len(pairs):
            twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
            odd.append(f"the key {twice[:40]!r} stands twice in one object")
        return value

    def number(digits: str) -> float:
        value = float(digits)
        if not math.isfinite(value):
            odd.append(f"a number too large: {digits[:20]}")
        return value

    def whole_number(digits: str) -> int:
        try:
            return int(digits)
        except ValueError:  # it has thousands
            odd.append(f"a number too large: {digits[:20]}")
            return 0

    decoder = json.JSONDecoder(
        object_pairs_hook=mapping,
        parse_float=number,
        parse_int=whole_number,
        parse_constant=lambda name: odd.append(f"{name} is no number of JSON"),
    )
    try:
        value, end = decoder.raw_decode(text, begin)
    except json.JSONDecodeError as error:
        return Item(begin, max(error.pos, begin + 1), None, error.msg, error.pos)
    except RecursionError:
        deep = _DEEP.match(text, begin)
        return Item(begin, deep.end() if deep else begin + 1, None, TOO_DEEP)
    if _deeper_than(value, MOST_DEEP):
        odd.append(f"nested more than {MOST_DEEP} deep")
    return Item(begin, end, None if odd else value, odd[0] if odd else "")


def told(text: str, item: Item, aside: list[tuple[int, int]]) -> str:
    """What is wrong with a broken item: line and column, the text found there, and what was expected."""
    if item.at is None:
        return item.why
    what = re.sub(r"(?: starting)? at$", "", item.why)
    line, column = _place(text, item.at, aside)
    rest = text[item.at : item.at + _QUOTED]
    if not rest.strip().strip("`"):
        return f"line {line}, column {column}, where it ends: {what}"
    return f"line {line}, column {column}: {what}, before {rest!r}"


def _place(text: str, at: int, aside: list[tuple[int, int]]) -> tuple[int, int]:
    """Line and column, from 1, of a place in a text; parts set aside are not counted."""
    parts, begun = [], 0
    for begin, end in aside:
        if end <= at:
            parts.append(text[begun:begin])
            begun = end
    before = "".join([*parts, text[begun:at]])
    before = before.lstrip()
    return before.count("\n") + 1, len(before) - before.rfind("\n")


def _deeper_than(data: Any, most: int) -> bool:
    level = [data]
    for _ in range(most):
        level = [child for item in level for child in _children(item)]
        if not level:
            return False
    return True


def _children(item: Any) -> Any:
    return item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
