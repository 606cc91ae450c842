"""Phrases for things: the rule that matches a query with the names in a vocabulary.

A phrase is read as qualities, a noun and a place: "the red can of soda on the table" is red, a soda can, on the table.
A query means the things that have a name of the same noun, and of these

1. none with a name that contradicts it (a "white cup" is not meant by "the red cup", a "cup" may be),
2. those with a name of the most qualities asked for: what nobody is said to be is dropped,
3. where there is none, and the query names a part, what its thing is called ("the fridge door" means a fridge).

Of one noun are names that differ by articles, counts, plural, synonyms, and order ("soda can", "can of soda"). A noun
is compared whole: neither "can" means a "trash can" nor the other way round. What a phrase says of the place is never
used: a vocabulary knows no places. The words that this takes are in phrases.yaml.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import yaml

MOST_CHARACTERS = 300  # a longer phrase names nothing

OTHER = re.compile(r"(?:the )?(?:another|other|next|last)\b", re.IGNORECASE)  # said of one that was not meant before

_ARTICLES = re.compile(r"^(?:(?:an?|the|one|another|some|any|next|first|second|third|last)\s+)+")

_WHERE = r"(?:front|top|upper|middle|lower|bottom|left|right)"
_PART = rf"(?:{_WHERE} )?(?:door|lid|drawer|cover|flap|handle)s?"
_OF_THING = re.compile(rf"{_PART} (?:of|on) (?P<a>.+)|(?P<b>(?!{_WHERE} \w+$).+?) {_PART}")

_PASSING = ("filling", "state")  # groups of qualities that a thing has for a while

Noun = tuple[str, ...]
Quality = tuple[str, str]  # its group and itself, such as ("color", "red")


@dataclass(frozen=True)
class PhraseMeaning:
    """What a phrase says.

    Attributes:
        words: Qualities and noun as they are said, such as ("red", "cans", "of", "soda").
        noun: What kind of thing, in the one form of all its names, such as ("soda", "can"). The last is the head noun.
        qualities: What it is like.
        place: Where it is said to be, such as "on the table"; "" if nothing is said.
    """

    words: tuple[str, ...]
    noun: Noun
    qualities: frozenset[Quality]
    place: str


class Vocabulary:
    """Names of things, and the things that a query means."""

    def __init__(self, called: Mapping[str, Iterable[str]]) -> None:
        """Take the names: key of each thing to what people call it."""
        self._literal: dict[str, list[str]] = {}
        self._by_noun: dict[Noun, dict[str, list[frozenset[Quality]]]] = {}
        self._known: dict[str, list[str]] = {}
        for key, phrases in called.items():
            for phrase in phrases:
                self._literal.setdefault(normalize(phrase), []).append(key)
                if (reading := read(phrase)) is not None:
                    self._by_noun.setdefault(reading.noun, {}).setdefault(key, []).append(reading.qualities)
        self._order = {key: i for i, key in enumerate(called)}

    def named(self, query: str) -> list[str]:
        """Keys of the things that a query means, in the order of the vocabulary."""
        if query not in self._known:
            if len(self._known) > 10_000:  # queries may come from anywhere
                self._known.clear()
            self._known[query] = sorted(self._meant(query), key=self._order.__getitem__)
        return list(self._known[query])

    def _meant(self, query: str) -> set[str]:
        reading = read(query)
        if reading is None:
            return set()
        literal = set(self._literal.get(normalize(query), ()))
        best: dict[str, int] = {}
        for key, names in self._by_noun.get(reading.noun, {}).items():
            if not any(_contradict(reading.qualities, qualities) for qualities in names):
                best[key] = max(len(reading.qualities & qualities) for qualities in names)
        most = max(best.values(), default=0)
        found = literal | {key for key, count in best.items() if count == most}
        if not found and (thing := whole(" ".join(reading.words))) is not None:
            return self._meant(thing)
        return found


@lru_cache(maxsize=10_000)
def read(phrase: str) -> PhraseMeaning | None:
    """The meaning of a phrase; None if it is empty, longer than `MOST_CHARACTERS`, or without a noun."""
    if len(phrase) > MOST_CHARACTERS:
        return None
    words = _without_lead([word for word in normalize(phrase).split() if word != "s"])  # of "the fridge's door"
    cut = next((i for i in range(len(words)) if _starts_clause(words, i)), len(words))
    words, place = words[:cut], " ".join(words[cut:])
    noun, qualities = _noun(words)
    return PhraseMeaning(tuple(words), _one_name(noun), frozenset(qualities), place) if noun else None


def kinds(phrases: Iterable[str]) -> list[str]:
    """Search terms for a list of phrases: each kind of thing once, in few words.

    Where a thing is and what is in it, how many are meant, and whether it is empty or open, no picture of it alone
    tells: "the basket without a candle" and "another basket" are looked for as "basket", and are one thing where they
    are: known by either they would be two, the one in the way of a hand that takes the other. Of what is no readable
    phrase only "the other" goes.
    """
    found: dict[tuple[Noun, frozenset[Quality]] | str, str] = {}
    for phrase in phrases:
        reading = read(phrase)
        if reading is None:
            said = OTHER.sub("", phrase).strip() or phrase
            found[said] = said
            continue
        lasting = frozenset(q for q in reading.qualities if q[0] not in _PASSING)
        words, left = [], list(reading.words)
        while left:
            size, quality = _term(left)
            words += left[:size] if quality is None or quality[0] not in _PASSING else []
            left = left[size:]
        found.setdefault((reading.noun, lasting), " ".join(words))
    return list(found.values())


def asked(label: str, phrases: Sequence[str]) -> str | None:
    """The phrase that a detector's label stands for, if the label is a fragment of the prompt.

    Such labels may lack words or have words of several phrases. Of the phrases whose head noun is in the label it is
    the one with the largest part of its words there, then with the most words there; none if there are several such.

    Args:
        label: Such as "can", "soda can" or "red can table".
        phrases: Readable ones.
    """
    there = {singular(word) for word in normalize(label).split()}
    fits = []
    for phrase in phrases:
        reading = read(phrase)
        if reading is None:
            continue
        words = {singular(word) for word in reading.words} - {"of", *_data().lead}
        if _head(reading.words) in there:
            fits.append((len(words & there) / len(words), len(words & there), phrase))
    fits.sort(reverse=True)
    if not fits or (len(fits) > 1 and fits[0][:2] == fits[1][:2]):
        return None
    return fits[0][2]


def whole(phrase: str) -> str | None:
    """The thing whose part a phrase names, such as "fridge" of "the fridge door" and of "the door of the fridge"."""
    found = _OF_THING.fullmatch(normalize(phrase))
    return normalize(found["a"] or found["b"]) if found else None


@lru_cache(maxsize=10_000)  # asked for each entry of a knowledge base, each step
def normalize(phrase: str) -> str:
    """Lower case, words split by single spaces, without leading articles and counting words."""
    return _ARTICLES.sub("", " ".join(re.sub(r"[_\W]+", " ", phrase.lower()).split()))


@dataclass(frozen=True)
class _Data:
    """phrases.yaml, ready for use."""

    lead: frozenset[str]
    clause: frozenset[tuple[str, ...]]
    plurals: Mapping[str, str]
    terms: Mapping[tuple[str, ...], Quality | None]  # of several words or one; None: kept


@cache
def _data() -> _Data:
    given: Mapping[str, Any] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    terms: dict[tuple[str, ...], Quality | None] = {tuple(term.split()): None for term in given["kept"]}
    for group, items in given["qualities"].items():
        for item in items:
            first, *others = item.split()
            terms |= {tuple(word.split("_")): (group, first) for word in (first, *others)}
    clause = frozenset(tuple(word.split("_")) for word in given["clause"].split())
    return _Data(frozenset(given["lead"].split()), clause, given["plurals"], terms)


@cache
def _synonyms() -> Mapping[Noun, Noun]:
    """Each of several nouns of one kind to the first of them."""
    given = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))["synonyms"]
    nouns = [[_noun(phrase.split())[0] for phrase in group] for group in given]
    return {noun: group[0] for group in nouns for noun in group}


def _noun(words: Sequence[str]) -> tuple[Noun, list[Quality]]:
    """The noun of some words, what is said "of" it first, and the qualities between its words."""
    noun: list[str] = []
    qualities: list[Quality] = []
    parts: list[list[str]] = [[]]
    for word in words:
        if word == "of":
            parts.append([])
        else:
            parts[-1].append(word)
    for part in parts:
        own: list[str] = []
        left = _without_lead(part)
        while left:
            size, quality = _term(left)
            if quality is None:
                own += map(singular, left[:size])
            else:
                qualities.append(quality)
            left = left[size:]
        noun = own + noun
    return tuple(noun), qualities


def _term(words: Sequence[str]) -> tuple[int, Quality | None]:
    """How many of the first words belong together, and the quality that they are; the last word of all is none."""
    terms = _data().terms
    for size in range(min(3, len(words)), 0, -1):
        term = tuple(words[:size])
        kept = (*term[:-1], singular(term[-1]))
        if terms.get(kept, ()) is None:
            return size, None
        if size < len(words) and (quality := terms.get(term)) is not None:
            return size, quality
    return 1, None


def _one_name(noun: Noun) -> Noun:
    """A noun with the first of their synonyms for all nouns in it, the longest first."""
    synonyms, i = _synonyms(), 0
    done: list[str] = []
    while i < len(noun):
        size = next((n for n in range(min(4, len(noun) - i), 0, -1) if noun[i : i + n] in synonyms), 0)
        done += synonyms[noun[i : i + size]] if size else noun[i : i + 1]
        i += size or 1
    return tuple(done)


def _contradict(asked: frozenset[Quality], said: frozenset[Quality]) -> bool:
    """Whether two phrases say different things of one group of qualities."""
    groups = {group for group, _ in asked} & {group for group, _ in said}
    return any({q for q in asked if q[0] == g}.isdisjoint(q for q in said if q[0] == g) for g in groups)


def _head(words: Sequence[str]) -> str:
    """The head noun of words as they are said: the last before the first "of"."""
    upto = words.index("of") if "of" in words[1:] else len(words)
    return singular(words[upto - 1])


def _without_lead(words: Sequence[str]) -> list[str]:
    """Words without those at the front that say nothing: articles, counts, "of" after a count."""
    said = (i for i, word in enumerate(words) if not (word in _data().lead or word == "of" or word.isdecimal()))
    return list(words[next(said, len(words)) :])


def _starts_clause(words: Sequence[str], i: int) -> bool:
    return any(tuple(words[i : i + n]) in _data().clause for n in (1, 2))


def singular(word: str) -> str:
    """A noun's singular, by its ending; what is no plural may lose an s, always the same way."""
    if (known := _data().plurals.get(word)) is not None:
        return known
    if len(word) > 3 and word.endswith("ies"):
        return word[:-3] + "y"
    if len(word) > 4 and re.search(r"(?:ch|sh|x|ss|zz|o)es$", word):
        return word[:-2]
    if len(word) > 2 and word.endswith("s") and not word.endswith("ss"):
        return word[:-1]
    return word


def plural(noun: str) -> str:
    """Several of what is called so, such as "cans of soda"; a plural stays as it is."""
    head, of, rest = noun.partition(" of ")
    before, gap, word = head.rpartition(" ")
    if singular(word) != word:
        return noun
    several = next((many for many, one in _data().plurals.items() if one == word != many), "")
    if not several and re.search(r"(?:ch|sh|x|s|z)$", word):
        several = f"{word}es"
    elif not several:
        several = f"{word[:-1]}ies" if re.search(r"[^aeiou]y$", word) else f"{word}s"
    return f"{before}{gap}{several}{of}{rest}"
