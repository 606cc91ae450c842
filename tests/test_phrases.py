"""The rule by which a query means things by what they are called."""

from __future__ import annotations

import re
import string
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.words import phrases
from mpvi_bt.ground.words.phrases import MOST_CHARACTERS, Vocabulary, asked, kinds, normalize, read, whole
from mpvi_bt.house.things.catalogue import load_catalogue

DATA = yaml.safe_load(Path(phrases.__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
CATALOGUE = {entry.name: entry.phrases for entry in load_catalogue()}
NAMES = sorted({phrase for names in CATALOGUE.values() for phrase in names})
PAGE = (Path(__file__).parent.parent / "docs" / "detectors.md").read_text(encoding="utf-8")
_CALLED = re.findall(r'"([^"]+)"', PAGE.split("\nWith objects called ")[1].split(":\n")[0])
THINGS = Vocabulary({names.split(", ")[0]: names.split(", ") for names in _CALLED})
EXAMPLES = re.findall(r"^\| ([^|]+) \| ([^|]+) \| [^|]+ \|$", PAGE.split("| query |")[1].split("\n\n")[0], re.MULTILINE)
words = st.text(string.ascii_lowercase, min_size=1, max_size=8)
adjectives = st.sampled_from([word for items in DATA["qualities"].values() for item in items for word in item.split()])
leads = st.sampled_from(["", "the ", "a ", "two ", "all of the ", "one of the ", "3 ", "your ", "The other "])
places = st.sampled_from(
    ["", " on the table", " next to the sofa", " from the hall", " in front of the red trash can", " to the left of it"]
    + [" that is open", " lying under a bed", " closest to you", " over there", " with a lid"]
)


@pytest.mark.parametrize(("query", "meant"), EXAMPLES)
def test_what_a_query_means(query: str, meant: str) -> None:
    """The page's examples: when a qualifier is used, when it is dropped, and that the noun is never another one."""
    assert THINGS.named(query) == ([] if meant == "nothing" else meant.split(", "))


@pytest.mark.parametrize(
    ("query", "meant"),
    [
        ("The cans of soda", ["can of soda"]),
        ("one of the cans", ["can of soda"]),
        ("soda can next to the sofa", ["can of soda"]),
        ("can from the hall", ["can of soda"]),
        ("a rubbish bin", ["trash can"]),
        ("refrigerator", ["fridge"]),
        ("big cup", ["red cup", "white cup", "cup"]),
        ("dresser", ["chest of drawers"]),
        ("sink", ["kitchen sink", "bathroom sink"]),
        ("the paper towels", ["paper towel"]),
        ("soda", []),
        ("drawers", []),
        ("cup holder", []),
        ("table", []),
    ],
)
def test_what_else_a_query_means(query: str, meant: list[str]) -> None:
    """Further ways to say it."""
    assert THINGS.named(query) == meant


@pytest.mark.parametrize("query", ["", " ", "?!", "the", "the two", "of", "of the", "on the table", "7", "x" * 301])
def test_a_query_without_a_noun_means_nothing(query: str) -> None:
    """Nor does one that is longer than anybody's."""
    assert read(query) is None
    assert THINGS.named(query) == []
    assert Vocabulary({"it": [query]}).named(query) == []


@given(st.text(max_size=400))
def test_any_text_is_read_or_refused(text: str) -> None:
    """No text raises; what is read has a noun, and reading its words again gives the same noun."""
    reading = read(text)
    THINGS.named(text)
    asked(text, ["cup", text])
    if reading is not None:
        assert len(text) <= MOST_CHARACTERS
        assert all(reading.noun)
        assert reading.noun


@given(leads, st.sampled_from(NAMES), places)
def test_lead_and_place_do_not_matter(lead: str, name: str, place: str) -> None:
    """Articles, counts, owners and what is said of the place leave unchanged what is meant, of every name there is."""
    vocabulary = Vocabulary(CATALOGUE)
    assert vocabulary.named(f"{lead}{name}{place}") == vocabulary.named(name)


@given(st.sampled_from(NAMES))
def test_everything_that_is_called_so_is_meant(name: str) -> None:
    """A name always means at least all things that have it."""
    assert set(Vocabulary(CATALOGUE).named(name)) >= {key for key, names in CATALOGUE.items() if name in names}


@given(st.sampled_from(NAMES))
def test_plurals_are_meant(name: str) -> None:
    """An s at the end of a head noun, where that is how its plural goes, changes nothing."""
    first, of, rest = name.partition(" of ")
    if not first.endswith(("s", "sh", "ch", "x", "z", "y", "f", "fe", "o")):
        vocabulary = Vocabulary(CATALOGUE)
        assert vocabulary.named(f"{first}s{of}{rest}") == vocabulary.named(name)


@given(adjectives, words, words)
def test_another_head_noun_is_never_meant(adjective: str, noun: str, other: str) -> None:
    """Whatever qualifies it: a query means nothing whose noun is another one or has other words before it."""
    called = [f"{adjective} {other}", f"{noun} {other}", f"{other} {noun}", other]
    vocabulary = Vocabulary({name: [name] for name in called if read(name) is not None})
    for query in (noun, f"{adjective} {noun}"):
        asked_for = read(query)
        for found in vocabulary.named(query):
            assert asked_for is not None
            told = read(found)
            assert told is not None
            assert told.noun == asked_for.noun


@given(adjectives, adjectives, words.filter(lambda word: read(word) is not None))
def test_a_quality_is_used_where_somebody_has_it_and_else_dropped(one: str, other: str, noun: str) -> None:
    """Of things of the noun the one that is said to be so; if none is, those that are not said to be otherwise."""
    noun = f"{noun}q"  # no word of the rule's own
    a, b = (read(f"{quality.replace('_', ' ')} {noun}") for quality in (one, other))
    assert a is not None
    assert b is not None
    query = f"the {one.replace('_', ' ')} {noun}"
    assert Vocabulary({"plain": [noun], "so": [query]}).named(query) == ["so"]
    assert Vocabulary({"plain": [noun]}).named(query) == ["plain"]
    assert Vocabulary({"so": [query], "plain": [noun]}).named(noun) == ["so", "plain"]
    if {group for group, _ in a.qualities} == {group for group, _ in b.qualities} and a.qualities != b.qualities:
        otherwise = f"{other.replace('_', ' ')} {noun}"
        assert Vocabulary({"otherwise": [otherwise, noun], "plain": [noun]}).named(query) == ["plain"]
        assert Vocabulary({"otherwise": [otherwise]}).named(query) == []


@pytest.mark.parametrize("group", DATA["synonyms"], ids=lambda group: group[0])
def test_synonyms_name_the_same(group: list[str]) -> None:
    """Each word of a group finds what is called by any other, alone and within a longer noun."""
    for called in group:
        vocabulary = Vocabulary({"it": [called], "its": [f"cover plate of the {called}"]})
        for query in group:
            assert vocabulary.named(f"the {query}") == ["it"]
            assert vocabulary.named(f"cover plate of a {query}") == ["its"]


def test_no_word_is_in_two_groups() -> None:
    """A synonym of two things, or a quality of two kinds, would mean either."""
    synonyms = [read(name) for group in DATA["synonyms"] for name in group]
    assert len({reading.noun for reading in synonyms if reading}) == len(DATA["synonyms"])
    assert len({name for group in DATA["synonyms"] for name in group}) == sum(map(len, DATA["synonyms"]))
    qualities = [word for items in DATA["qualities"].values() for item in items for word in item.split()]
    assert len(set(qualities)) == len(qualities)


@pytest.mark.parametrize(
    ("label", "among", "means"),
    [
        ("can", ["red can"], "red can"),
        ("soda can", ["can of soda", "trash can"], "can of soda"),
        ("trash can", ["can of soda", "trash can"], "trash can"),
        ("can", ["can of soda", "trash can"], None),
        ("red can table", ["red can", "table"], "red can"),
        ("red table", ["red can", "table"], "table"),
        ("table", ["the red can on the table", "the sofa"], None),
        ("red", ["red can"], None),
        ("soda", ["can of soda"], None),
        ("", ["red can"], None),
        ("##dge", ["fridge"], None),
        ("fridge", ["fridges", ""], "fridges"),
    ],
)
def test_which_phrase_a_label_is_of(label: str, among: list[str], means: str | None) -> None:
    """It must have the head noun; more words win; where two fit as well nobody knows."""
    assert asked(label, among) == means


@given(st.lists(st.sampled_from(NAMES), min_size=1, max_size=6, unique=True), st.data())
def test_the_whole_of_a_phrase_is_its_label(names: list[str], data: st.DataObject) -> None:
    """A label that has all words of one phrase, and no other's head noun, is of that phrase."""
    name = data.draw(st.sampled_from(names))
    others = [other for other in names if set(normalize(other).split()).isdisjoint(normalize(name).split())]
    assert asked(name, [*others, name]) == name


def test_a_part_is_read_as_it_always_was() -> None:
    """What stands for its thing where nothing is called like the part."""
    assert whole("the fridge door") == "fridge"
    assert THINGS.named("handle of the fridge") == ["fridge"]
    assert THINGS.named("the front door") == ["front door"]


def test_what_several_phrases_mean_is_looked_for_once() -> None:
    """State, contents, place and count are no kinds of things; colors and parts are."""
    assert kinds(["basket without a candle", "candle", "another basket"]) == ["basket", "candle"]
    assert kinds(["three cans of soda from the hall", "can of soda"]) == ["cans of soda"]
    assert kinds(["empty bowl", "bowl with the leek", "half full bowl", "open cabinet"]) == ["bowl", "cabinet"]
    assert kinds(["red cup", "cup", "glass of water", "left cabinet door"]) == [
        "red cup", "cup", "glass of water", "left cabinet door",
    ]  # fmt: skip
    assert kinds(["the other gizmo", "", "gizmo"]) == ["gizmo", ""]
