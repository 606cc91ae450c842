"""Extracts the JSON object from a model's answer: untrusted text of any length and form."""

from __future__ import annotations

import json
import math
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from mpvi_bt.language.thinking import thinking

MOST_CHARACTERS = 2**20  # of an answer with JSON in it; a plan has some thousand
MOST_DEEP = 60  # objects and lists within each other
MOST_TRIED = 5000  # places where an object may begin
MOST_READ = 20 * MOST_CHARACTERS  # characters, those of broken objects once more for what is whole within them


def parse_json(text: str, fits: Callable[[dict[str, Any]], bool] | None = None) -> dict[str, Any]:
    """The JSON object that an answer has in it, fenced or amid chatter.

    Of several it is the last whole one that fits: drafts and worked examples come before the answer, marked as such or
    not. What stands in marked thinking is never the answer. An object that fits may be wrapped in another.

    It is plain JSON: numbers are finite, no key stands twice, and what is cut off is not completed.

    Args:
        text: The answer.
        fits: Whether an object has the form that was asked for; None: any has, but the last whole one is not taken
            where a broken one is longer, as it may be a part of that.

    Returns:
        One that fits. If none does: the longest, so that whoever checks it can say what is wrong.

    Raises:
        ValueError: There is none, or the longest is broken; says where, for the model to mend it.
    """
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"more than {MOST_CHARACTERS} characters")
    read = _objects(text)
    aside = thinking(_masked(text, read))
    said = [item for item in read if not _is_in(aside, item.begin)]
    whole = [item for item in reversed(said) if item.value is not None]  # the last first
    if fits is not None:
        fitting = (value for item in whole for value in _unwrapped(item.value) if fits(value))
        if (answer := next(fitting, None)) is not None:
            return answer
    broken = max((item for item in said if item.value is None), key=_length, default=None)
    best = max(whole, key=_length, default=None) if fits is not None else next(iter(whole), None)
    if best is not None and best.value is not None and (broken is None or _length(broken) <= _length(best)):
        return best.value
    if broken is not None:
        raise ValueError(broken.why)
    raise ValueError("no { begins one" + (" after the thinking, which is not the answer" if read else ""))


class _Item(NamedTuple):
    """An object in a text, or the readable beginning of a broken one.

    Attributes:
        begin, end: Where.
        value: The object; None: it is broken.
        why: What is wrong then.
    """

    begin: int
    end: int
    value: dict[str, Any] | None
    why: str = ""


def _length(item: _Item) -> int:
    return item.end - item.begin


def _objects(text: str) -> list[_Item]:
    """The outermost whole objects in a text, and the broken ones, within which others may be whole; in order."""
    found: list[_Item] = []
    begin, read = text.find("{"), 0
    while begin >= 0:
        if len(found) == MOST_TRIED:
            raise ValueError(f"more than {MOST_TRIED} braces")
        item = _object_at(text, begin)
        found.append(item)
        read += _length(item)
        within = item.value is None and item.why != _TOO_DEEP and read < MOST_READ
        begin = text.find("{", begin + 1 if within else item.end)
    return found


_TOO_DEEP = "nested too deep"
_DEEP = re.compile(r'(?:\s*[\[{]\s*(?:"[^"\\]*"\s*:)?)+')


def _object_at(text: str, begin: int) -> _Item:
    """The object that begins at a brace."""
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
        return _Item(begin, max(error.pos, begin + 1), None, str(error))
    except RecursionError:
        deep = _DEEP.match(text, begin)
        return _Item(begin, deep.end() if deep else begin + 1, None, _TOO_DEEP)
    if _deeper_than(value, MOST_DEEP):
        odd.append(f"nested more than {MOST_DEEP} deep")
    return _Item(begin, end, None if odd else value, odd[0] if odd else "")


def _masked(text: str, items: list[_Item]) -> str:
    """A text of the same length without its whole objects, whose strings may look like marks of thinking."""
    parts, at = [], 0
    for item in items:
        if item.value is not None:
            parts += [text[at : item.begin], " " * _length(item)]
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


def _deeper_than(data: Any, most: int) -> bool:
    level = [data]
    for _ in range(most):
        level = [child for item in level for child in _children(item)]
        if not level:
            return False
    return True


def _children(item: Any) -> Any:
    return item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
