"""What phrases name: the rule by which a query finds things by what a vocabulary calls them."""

from __future__ import annotations

import re

_ARTICLES = re.compile(r"^(?:an?|the|one|another|some|any|next|first|second|third|last)\s+")

_WHERE = r"(?:front|top|upper|middle|lower|bottom|left|right)"
_PART = rf"(?:{_WHERE} )?(?:door|lid|drawer|cover|flap|handle)s?"
_OF_THING = re.compile(rf"{_PART} (?:of|on) (?P<a>.+)|(?P<b>(?!{_WHERE} \w+$).+?) {_PART}")


def whole(phrase: str) -> str | None:
    """The thing whose part a phrase names, such as "fridge" of "the fridge door" and of "the door of the fridge"."""
    found = _OF_THING.fullmatch(normalize(phrase))
    return normalize(found["a"] or found["b"]) if found else None


def normalize(phrase: str) -> str:
    """Lower case, words split by single spaces, without leading articles and counting words."""
    text = " ".join(re.sub(r"[_\W]+", " ", phrase.lower()).split())
    while (shorter := _ARTICLES.sub("", text)) != text:
        text = shorter
    return text
