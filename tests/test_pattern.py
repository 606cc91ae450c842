"""Phrases as patterns: what they fit, and that matching grows no faster than the text, whatever the phrase."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.pattern import pattern
from mpvi_bt.executive.plan.skills import load_skill, load_skills
from mpvi_bt.ground.words.phrases import MOST_CHARACTERS, normalize

SKILLS = load_skills()


def steps(work: Callable[..., object], *given: object) -> int:
    """Functions that are called while something is done: what it takes, whatever else the machine does."""
    count = 0

    def called(*event: object) -> None:
        nonlocal count
        count += 1

    sys.setprofile(called)
    try:
        work(*given)
    finally:
        sys.setprofile(None)
    return count


def _group(inner: st.SearchStrategy[tuple[str, str]]) -> st.SearchStrategy[tuple[str, str]]:
    """Of phrases and the regular expressions that say the same: their rows, alternatives and options."""
    row = st.lists(inner, min_size=1, max_size=4).map(lambda p: ("".join(a for a, _ in p), "".join(b for _, b in p)))
    either = st.lists(row, min_size=1, max_size=3)
    return either.map(lambda p: (f"({'|'.join(a for a, _ in p)})", f"(?:{'|'.join(b for _, b in p)})")) | either.map(
        lambda p: (f"[{'|'.join(a for a, _ in p)}]", f"(?:{'|'.join(b for _, b in p)})?")
    )


texts = st.sampled_from(["a", "b", "ab", "ba"]).map(lambda t: (t, t))
groups = st.recursive(texts, _group, max_leaves=12)


@given(groups, st.text("abAB", max_size=8))
def test_brackets_are_those_of_regular_expressions(both: tuple[str, str], text: str) -> None:
    """Alternatives and what may be left out fit as they do there, in whatever case."""
    phrase, regex = both
    assert (pattern(phrase).match(text) is not None) == bool(re.fullmatch(regex, text, re.IGNORECASE))


names = st.lists(st.sampled_from(["cup", "red", "x", "door open door"]), min_size=1, max_size=3).map(" ".join)


@given(st.lists(names, min_size=2, max_size=4), st.sampled_from(["", "the ", "A "]))
def test_a_slot_takes_the_fewest_words(names: list[str], article: str) -> None:
    """Of several ways to read a text the first slot's is the shortest; what may be left out goes before the slot."""
    text = f"put {article}{' in '.join(names)} with left arm"
    found = pattern("put {object} in {container}[ with {hand} arm]").match(text)
    assert found == {"object": article + names[0], "container": " in ".join(names[1:]), "hand": "left"}


@pytest.mark.parametrize("phrase", ["(a]", "[a)", "a)", "a]", "(a", "[a", "(a[b)c]"])
def test_brackets_that_do_not_match_are_refused(phrase: str) -> None:
    """Each closes the bracket of its own kind."""
    with pytest.raises(ValueError, match="brackets that do not match"):
        pattern(phrase)


MANY = {
    "options": "[a ]" * 45 + "b",
    "alternatives": "(a |a |aa )" * 25 + "b",
    "nested": "[a " * 45 + "]" * 45 + "b",
    "around a slot": "[a ]" * 20 + "{object}" + "[ a]" * 20,
    "slots": "{object}[ a] {source}[ a] {target}[ a] {tool}[ a] {surface}[ a] b",
}


@pytest.mark.parametrize("name", MANY)
def test_a_phrase_of_many_options_takes_no_longer_than_its_length(name: str) -> None:
    """45 parts that may be left out would be 2^45 ways; a text twice as long takes about twice the steps."""
    read = pattern(MANY[name])
    text = "a " * 30 + "c"
    assert read.match(text) is None or "around" in name
    once, twice = (steps(read.match, "a " * n + "c") for n in (60, 120))
    assert twice < 2.5 * once
    assert once < 10 * 60 * len(MANY[name])


def test_a_skill_of_many_options_is_read(tmp_path: Path) -> None:
    """A file whose phrase has 45 of them loads."""
    path = tmp_path / "hum.yaml"
    triggers = "triggers: [{event: idle, camera: head}]\ntimeout_s: 1\n"
    path.write_text(f"name: hum\nabout: Hum.\nphrases: ['hum {'[a ]' * 45}song']\n{triggers}")
    skill = load_skill(path)
    assert match("hum " + "a " * 45 + "song", {"hum": skill}) is not None
    assert match("hum " + "a " * 45 + "son", {"hum": skill}) is None


LONG: dict[str, Callable[[int], str]] = {
    "one clause": lambda n: "push " + "to a cup on " * (n // 12),
    "clauses": lambda n: "; ".join(["put " + "a in b by c on d to " * 14] * (n // 290)),
    "verbs": lambda n: "push a cup and " * (n // 15),
    "pronouns": lambda n: "pick up a cup and " + "pick up it it it it it and " * (n // 27),
    "things": lambda n: " and ".join(f"pick up it a{i}" for i in range(n // 20)),
    "joints": lambda n: " and" * (n // 4),
    "then": lambda n: " then" * (n // 5),
    "manners": lambda n: "please " * (n // 7),
    "articles": lambda n: "pick up " + "the " * (n // 4),
}


@pytest.mark.parametrize("name", LONG)
def test_reading_a_prompt_takes_time_in_proportion_to_its_length(name: str) -> None:
    """Of clauses and of one that has no end: four times the letters take about four times the steps."""
    once, more = (steps(clauses, LONG[name](n), SKILLS) for n in (1000, 4000))
    assert more < 6 * once + 1000


def test_pronouns_do_not_grow_into_one_another() -> None:
    """A thing that "it" stands for is bounded, however often it is named so."""
    read = clauses("pick up the cup and " + "pick up it it it it it it it it and " * 100, SKILLS)
    assert len(read) == 101
    assert sum(map(len, read)) < 101 * MOST_CHARACTERS * 10


def test_a_clause_without_an_end_names_nothing() -> None:
    """As a phrase that is as long names nothing."""
    assert match("pick up the cup " + "of a cup " * 27, SKILLS) is not None
    assert match("pick up the cup " + "of a cup " * 40, SKILLS) is None


def test_articles_are_taken_off_at_once() -> None:
    """A thousand of them as one."""
    assert normalize("the " * 1000 + "cup") == "cup"
    assert steps(normalize, "the " * 4000 + "cup") < 50
