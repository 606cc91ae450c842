"""Reads what a model says: untrusted text of any length, in any dress."""

from __future__ import annotations

import json
import math
from typing import Any

MOST_CHARACTERS = 2**20  # of an answer with JSON in it; a plan has some thousand
MOST_DEEP = 60  # objects and lists within each other
MOST_TRIED = 200  # places where an object may begin


def parse_json(text: str) -> dict[str, Any]:
    """The JSON object that an answer has in it, fenced or amid chatter; of several, the longest.

    It is plain JSON: numbers are finite, no key stands twice, and what is cut off is not completed.

    Raises:
        ValueError: There is none, or the longest is broken; says where, for the model to mend it.
    """
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"more than {MOST_CHARACTERS} characters")
    longest, length, broken, reach = None, 0, "no { begins one", 0
    begin = text.find("{")
    for _ in range(MOST_TRIED):
        if begin < 0:
            break
        try:
            found, end = _DECODER.raw_decode(text, begin)
            if end - begin > length:
                longest, length = found, end - begin
        except json.JSONDecodeError as error:
            end = max(error.pos, begin + 1)  # what it has read so far has no object of its own
            if end - begin > reach:
                broken, reach = str(error), end - begin
        except RecursionError:
            raise ValueError("nested too deep") from None
        begin = text.find("{", end)
    else:
        raise ValueError(f"more than {MOST_TRIED} braces that begin nothing")
    if longest is None or reach > length:
        raise ValueError(broken)
    if _deeper_than(longest, MOST_DEEP):
        raise ValueError(f"nested more than {MOST_DEEP} deep")
    return longest


def parse_yes_no(text: str) -> bool | None:
    """Whether an answer is a plain yes, or a plain no; None: neither.

    "Yes.", "**no**" and "YES" are plain; whatever says more than the one word is neither.
    """
    if len(text) > 100:
        return None
    word = text.strip().strip("*_`\"'").rstrip(".!").strip("*_`\"'").lower()
    return {"yes": True, "no": False}.get(word)


def _float(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise ValueError(f"a number too large: {digits[:20]}")
    return number


def _constant(name: str) -> Any:
    raise ValueError(f"{name} is no number of JSON")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for key, _ in pairs if sum(key == other for other, _ in pairs) > 1)
        raise ValueError(f"the key {twice[:40]!r} stands twice in one object")
    return found


_DECODER = json.JSONDecoder(object_pairs_hook=_object, parse_float=_float, parse_constant=_constant)


def _deeper_than(data: Any, most: int) -> bool:
    level = [data]
    for _ in range(most):
        level = [child for item in level for child in _children(item)]
        if not level:
            return False
    return True


def _children(item: Any) -> Any:
    return item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
