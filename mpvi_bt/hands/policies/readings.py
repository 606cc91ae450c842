"""Ways to understand what a clause names: as it is said, or without the counts and places that people add."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import product

from mpvi_bt.executive.plan.skills import SkillCall

_COUNTS = {"two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "both": 2}
_COUNTED = re.compile(rf"^(?:the\s+|all\s+)*(?P<count>{'|'.join(_COUNTS)}|[2-9])\s+", re.IGNORECASE)
_PLACE = re.compile(r"\s+(?:from|in|inside|on|at|near|by)\s+(?:the|a|an)\s.*$", re.IGNORECASE)


def count(call: SkillCall) -> int:
    """How many things a clause is about: 3 for "put the three cans in the bin"."""
    found = _COUNTED.match(call.arguments.get("object", ""))
    if not found:
        return 1
    said = found["count"].lower()
    return _COUNTS.get(said) or int(said)


def readings(call: SkillCall) -> Iterator[SkillCall]:
    """The call as it is said, then with fewer words: "three cans of soda from the hall" may be a "can of soda"."""
    slots = list(call.arguments)
    for words in product(*(_forms(call.arguments[slot]) for slot in slots)):
        yield SkillCall(call.skill, dict(zip(slots, words, strict=True)))


def _forms(phrase: str) -> list[str]:
    """A phrase, without the place, and without the count and in the singular."""
    placeless = _PLACE.sub("", phrase)
    single = _COUNTED.sub("", placeless)
    if single != placeless:
        head, of, rest = single.partition(" of ")
        single = re.sub(r"(?<=[^s])s$", "", head) + of + rest
    return list(dict.fromkeys([phrase, placeless, single]))
