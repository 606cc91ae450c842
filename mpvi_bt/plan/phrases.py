"""Phrases: small patterns in which a skill is said, and the words in them that fill its slots.

A phrase is a small pattern: plain words, `(one|another)` for alternatives, `[...]` for what may be left out, and slots
such as `{object}` whose words become the call's arguments; those of `{object:button|switch}` end in one of the words
listed. The first alternative that fits wins, so longer ones come first: `(take hold of|take)`.

Slots: `object` is what the hands do something to; `container`, `surface` and `target` are where it goes, or what a
`tool` is held over; `source` is where it comes from. Four have words of their own: `hand` and, of a thing that changes
hands, `to_hand` are left or right, `state` is on or off, `direction` a way to push.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from mpvi_bt.errors import UnknownName

SLOTS = ("object", "container", "surface", "target", "source", "tool", "hand", "to_hand", "state", "direction")
_WORDS = {
    "hand": "left|right",
    "to_hand": "left|right",
    "state": "on|off",
    "direction": "left|right|forward|backward|away|aside",
}
LISTED = set("|".join(_WORDS.values()).split("|"))
_TOKEN = re.compile(r"\{(\w*)(?::([\w\s|-]+))?\}|[\[\]()|]|[^\[\](){}|]+|.")
_SLOT = re.compile(r"\{(\w*)\}")
_ENDING = re.compile(r"\{\w*:([\w\s-]+)[^{}]*\}")
_BRACKETS = {"[": "(?:", "]": ")?", "(": "(?:", ")": ")", "|": "|"}
_ITS_ARTICLE = r"(?>(?:(?:an?|the|its|your|my)\s+)?)"  # no thing alone: "press the button" is no button of "the"

# What names a thing begins with no preposition ("in the chair"), has none of motion in it ("box across the table") and
# ends in no word that belongs to the verb ("door open").
_BEFORE = (
    r"(?!(?:in|into|inside|within|on|onto|upon|off|out|of|from|to|towards?|at|by|with|using|under|underneath|beneath|"
    r"below|over|above|across|along|against|behind|between|beside|near|next|through|up|down|away|and|then)(?:\s|$))"
)
_WITHIN = r"(?:(?!\s(?:into|onto|off|out|towards?|across|through|until)\s).)*?"
_VERBAL = "in|into|on|onto|off|out|up|down|over|away|back|open|shut|closed|upside"
_AFTER = "".join(rf"(?<!\s{word})" for word in _VERBAL.split("|"))
# Where something comes from or goes to is no side of itself, nor a side of nothing.
_NOT_A_SIDE = r"(?!its\s|(?:the\s+)?(?:left|right|side|front)(?:\s+side)?(?:$|\s+(?:of|with|using)\s))"
_PLACES = ("source", "surface", "container")


def pattern(phrase: str) -> re.Pattern[str]:
    """The regular expression of a phrase.

    Raises:
        ValueError: An unknown slot, one slot twice, or brackets or braces that do not close.
    """
    source = ""
    seen: set[str] = set()
    for token in _TOKEN.finditer(" ".join(phrase.split())):
        text, slot = token.group(), token.group(1)
        if slot is not None:
            if slot not in SLOTS:
                raise ValueError(str(UnknownName("slot", slot, SLOTS)))
            if slot in seen:
                raise ValueError(f"slot {slot!r} twice in one phrase")
            seen.add(slot)
            source += f"(?P<{slot}>{_named(slot, token.group(2))})"
        elif text in "{}":
            raise ValueError(f"a {text!r} without its other half; a slot is written {{object}}")
        else:
            source += _BRACKETS.get(text) or re.escape(text)
    try:
        return re.compile(source, re.IGNORECASE)
    except re.error:
        raise ValueError("brackets that do not match; known: (a|b), [may be left out], {slot}") from None


def _named(slot: str, ending: str | None) -> str:
    """What the words of a slot may be, as a regular expression."""
    if slot in _WORDS:
        return _WORDS[slot]
    before = _BEFORE + (_NOT_A_SIDE if slot in _PLACES else "")
    if ending is not None:
        words = "|".join(re.escape(word.strip()) for word in ending.split("|"))
        return rf"{before}{_ITS_ARTICLE}(?:\S{_WITHIN}\s)?(?:{words})"
    return rf"{before}{_ITS_ARTICLE}\S(?:{_WITHIN}\S)?{_AFTER}"


def example(phrase: str) -> str:
    """What a phrase reads like, such as "pick up {object}": first alternatives, and nothing that may be left out."""
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
    """The phrase. Raises ValueError as `pattern` does, and for one that fits a text without a word of its own."""
    regex = pattern(phrase)
    if regex.fullmatch(""):
        raise ValueError("a phrase must not match an empty text")
    if any(regex.fullmatch(" ".join(["%"] * count)) for count in range(1, len(SLOTS) + 1)):
        raise ValueError("a phrase needs a word of its own: slots alone catch every sentence")
    return phrase


def checked_template(template: str) -> str:
    """The template. Raises ValueError as `pattern` does; alternatives have no place in what is filled in."""
    pattern(template)
    if set("(|)") & set(template):
        raise ValueError("no alternatives here: what the judge should see is one sentence")
    return template
