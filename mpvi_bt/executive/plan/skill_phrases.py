"""Phrases: small patterns that name a skill, with slots for its arguments.

A phrase has plain words, `(one|another)` for alternatives, `[...]` for optional parts, and slots such as `{object}`
whose words become the call's arguments; those of `{object:button|switch}` end in one of the listed words. The first
matching alternative wins, so longer ones come first: `(take hold of|take)`.

Slots: `object` is the manipulated object; `container`, `surface` and `target` are its destination, or what a `tool` is
held over; `source` is its origin. Four have fixed words: `hand` and, for a hand-over, `to_hand` are left or right,
`state` is on or off, `direction` a direction to push.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from mpvi_bt.executive.plan.pattern import SLOTS, pattern

_SLOT = re.compile(r"\{(\w*)\}")
_ENDING = re.compile(r"\{\w*:([\w\s-]+)[^{}]*\}")


def example(phrase: str) -> str:
    """An example of a phrase, such as "pick up {object}": first alternatives, no optional parts."""
    text = _ENDING.sub(r"\1", phrase)
    while (shorter := re.sub(r"\[[^\[\]]*\]|\(([^()|\[\]]*)(?:\|[^()\[\]]*)?\)", r"\1", text)) != text:
        text = shorter
    return " ".join(text.split())


def first_words(phrase: str) -> list[str]:
    """What a phrase may begin with: "take" and "grab" of `(take hold of|grab) {object}`."""
    leading = re.match(r"\s*(?:\[[^\[\]]*\]\s*)?(?:\(((?:[^()]|\([^()]*\))*)\)|(\w+))", phrase)
    if leading is None:
        return []
    plain = re.sub(r"\([^()]*\)", "", leading[1] or leading[2])
    return [words.split()[0].lower() for words in plain.split("|") if words.split()]


def slots(template: str) -> list[str]:
    """The slots of a template, in order."""
    return _SLOT.findall(template)


def filled(template: str, arguments: Mapping[str, str]) -> str | None:
    """A template such as "the {object} is held[ in the {hand} hand]" with words for its slots.

    What may be left out is left out where a slot in it has no words. None if another slot has none.
    """

    def kept(part: re.Match[str]) -> str:
        return part[1] if set(slots(part[1])) <= arguments.keys() else ""

    text = re.sub(r"\[([^\[\]]*)\]", kept, template)
    if not set(slots(text)) <= arguments.keys():
        return None
    return _SLOT.sub(lambda slot: arguments[slot[1]], text)


def checked_phrase(phrase: str) -> str:
    """The phrase. Raises ValueError as `pattern` does, and for a phrase without a word of its own."""
    read = pattern(phrase)
    if read.match("") is not None:
        raise ValueError("a phrase must not match an empty text")
    if any(read.match(" ".join(["%"] * count)) is not None for count in range(1, len(SLOTS) + 1)):
        raise ValueError("a phrase needs a word of its own: slots alone catch every sentence")
    return phrase


def checked_template(template: str) -> str:
    """The template. Raises ValueError as `pattern` does; alternatives have no place in what is filled in."""
    pattern(template)
    if set("(|)") & set(template):
        raise ValueError("no alternatives here: what the judge should see is one sentence")
    return template
