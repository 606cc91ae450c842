"""Everyday names for names of BDDL or of a house, such as "can of soda" for `can__of__soda.n.01_1`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

_SYNSET = re.compile(r"\b([a-z][\w-]*?)\.n\.\d+(?:_(\d+))?\b")
_NUMBER = re.compile(r"_(\d+)$")


def spoken(name: str) -> str:
    """The words of a name, without synset and number."""
    found = _SYNSET.fullmatch(name)
    return _words(found[1] if found else _NUMBER.sub("", name)) or name


def spoken_each(names: Iterable[str]) -> dict[str, str]:
    """Each name with its words; where several have the same, with its number, such as "can of soda 2"."""
    names = list(names)
    shared = Counter(map(spoken, names))
    each = {}
    for name in names:
        number = _NUMBER.search(name)
        each[name] = f"{spoken(name)} {number[1]}" if number and shared[spoken(name)] > 1 else spoken(name)
    return each


def spoken_texts(texts: Iterable[str]) -> list[str]:
    """Texts with the words of every synset in them, such as conditions of one goal; as `spoken_each` numbers them."""
    texts = list(texts)
    said = spoken_each(dict.fromkeys(found[0] for text in texts for found in _SYNSET.finditer(text)))
    return [_SYNSET.sub(lambda found: said[found[0]], text) for text in texts]


def spoken_text(text: str) -> str:
    """One text likewise, such as what a checker gives as its reason."""
    return spoken_texts([text])[0] if ".n." in text else text


def _words(name: str) -> str:
    return " ".join(name.replace("_", " ").split())
