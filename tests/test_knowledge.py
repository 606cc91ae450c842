"""Laws of what is known: who is told of it, what is forgotten, and that it survives as JSON."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.plan.knowledge import LIKELY, Entry, KnowledgeBase, contents, laid_down
from mpvi_bt.finding.scene.belief import Belief
from mpvi_bt.ground.words.phrases import normalize
from tests.navigation_maps import thing


def base(*entries: Entry) -> KnowledgeBase:
    return KnowledgeBase({entry.name: entry for entry in entries})


def can(name: str = "can", **more: object) -> Entry:
    return thing(name, (1, 2, 0.1), (0.06, 0.06, 0.12), **more)


@given(st.floats(0, 1))
def test_only_what_is_likely_there_is_told(confidence: float) -> None:
    """Below even odds an entry stays known, but nobody is sent to it."""
    known = base(can(confidence=confidence))
    assert bool(known.find("can")) == (confidence >= LIKELY)
    assert [e.name for e in known] == ["can"]


def test_other_words_for_a_thing_find_it_but_do_not_rival_its_name() -> None:
    """A fridge is a refrigerator; where something is called just so, nothing else is meant."""
    known = base(thing("refrigerator", (0, 0, 1), (1, 1, 2)))
    assert [e.name for e in known.find("the fridge")] == ["refrigerator"]
    known.put(thing("fridge", (5, 0, 1), (1, 1, 2)))
    assert [e.name for e in known.find("the fridge")] == ["fridge"]


def test_what_is_put_on_another_level_is_laid_down() -> None:
    """From a counter into the cabinet below it; what fell to the floor, or slipped, is still to be picked up."""
    taken, half = np.array([4.6, 0.4, 0.91]), np.array([0.08, 0.08, 0.01])
    for now, laid in (((4.6, 0.3, 0.13), True), ((4.6, 0.3, 0.01), False), ((4.7, 0.4, 0.91), False),
                      ((5.6, 0.4, 0.01), True)):  # fmt: skip
        assert laid_down(taken, now - half, now + half) is laid
        assert laid_down(taken, now - half, now + half, by_hand=True) is (laid or now[2] < 0.1)


def test_what_was_laid_down_is_not_what_is_to_be_picked_up() -> None:
    """A can means one that the robot has not laid anywhere yet, where there is one; then one that it has."""
    given = {"laid": {"laid": True}, "held": {"held": True}, "new": {}}
    known = base(*(replace(can(n, **more), phrases=("can",)) for n, more in given.items()))
    assert [e.name for e in known.find("a can")] == ["new", "laid", "held"]


@pytest.mark.parametrize(
    ("phrase", "meant"),
    [
        ("empty bin", "b"),
        ("bin with a can", "ac"),
        ("bin without an egg", "ab"),
        ("bin", "abc"),
        ("bin with a cup", "abc"),
    ],
)
def test_what_is_said_to_be_in_a_thing_tells_it_apart(phrase: str, meant: str) -> None:
    """Of bins with a can, with nothing, with a can and an egg; where none is as it is said, all are meant."""
    bins = [replace(can(name), phrases=("bin",)) for name in "abc"]
    cans = [replace(can(f"can_{name}", inside=name), phrases=("can",)) for name in "ac"]
    known = base(*bins, *cans, replace(can("egg", inside="c"), phrases=("egg",)))
    assert "".join(e.name for e in known.filled_so(known.find(phrase), phrase)) == meant
    for entry in known:  # what was put into them may be out of view, or called by its color
        entry.filled = {"a": ("red can",), "c": ("can", "egg")}.get(entry.name, ())
        entry.inside = None
    assert "".join(e.name for e in known.filled_so(known.find(phrase), phrase)) == meant


@pytest.mark.parametrize(
    ("phrase", "inner"),
    [("the bowl with the leeks", "leeks"), ("a bin without an egg", "egg"), ("bin", None), ("can on a table", None)],
)
def test_what_a_thing_is_told_apart_by_is_known_by_its_phrase(phrase: str, inner: str | None) -> None:
    """Who is to see it has to look for that, too."""
    said = contents(phrase)
    assert (None if said is None else normalize(said)) == inner


def test_what_stands_open_and_shows_nothing_is_not_the_one_with_something_in_it() -> None:
    """Of cabinets the one with a jar may be any that is shut, as long as no jar is seen in any."""
    cabinets = [replace(can(name), phrases=("cabinet",)) for name in "abc"]
    known = base(*cabinets)

    def meant(phrase: str, ajar: str) -> str:
        found = known.filled_so(known.find(phrase), phrase, stands_open=lambda name: name in ajar)
        return "".join(e.name for e in found)

    assert meant("cabinet with a jar", "a") == "bc"
    assert meant("cabinet with a jar", "abc") == "abc"
    assert meant("cabinet without a jar", "a") == "abc"
    known.put(replace(can("jar", inside="a"), phrases=("jar",)))
    assert meant("cabinet with a jar", "a") == "a"


def test_what_lies_in_a_basket_is_to_be_picked_up_before_what_the_robot_has_laid_anywhere() -> None:
    """A can found in a basket; one that was laid down; two in a bin that the robot filled, one known anew; one in hand.

    What is in a bin that it carries is put in, too.
    """
    known = base(
        can("binned", inside="bin", laid=True), can("shaken", inside="bin"), can("carried", inside="bag", held=True),
        can("laid", laid=True), can("found", inside="basket"), can("bag", held=True),
    )  # fmt: skip
    order = [e.name for e in sorted(known, key=known.away)]
    assert order == ["found", "laid", "shaken", "binned", "bag", "carried"]
    assert [e.name for e in known if known.put_in(e)] == ["binned", "shaken", "carried"]


def test_what_was_put_into_furniture_is_put_in_and_what_lies_on_it_is_not() -> None:
    """The pumpkin in the cabinet is no more to be gone to; the one on it may be, and the one that was in it always."""

    def at(name: str, z: float, laid: bool) -> Entry:
        return replace(can(name, laid=laid), lowest=np.array([0.4, 0.4, z]), highest=np.array([0.6, 0.6, z + 0.2]))

    cabinet = replace(can("cabinet"), kind="fixture", lowest=np.zeros(3), highest=np.ones(3))
    known = base(cabinet, at("in", 0.3, True), at("on", 1.0, True), at("found", 0.3, False))
    assert [e.name for e in known if known.put_in(e)] == ["in"]
    assert [e.name for e in sorted(known, key=known.away)] == ["cabinet", "found", "on", "in"]


def test_what_was_in_a_forgotten_thing_is_in_nothing_known() -> None:
    """Its contents stay known, loose."""
    known = base(can("bin", held=True), can("inner", inside="bin", held=True), can("other", inside="box"))
    known.drop("bin")
    assert [(e.name, e.inside, e.held) for e in known] == [("inner", None, False), ("other", "box", False)]


number = st.floats(-1e3, 1e3)
place = st.tuples(number, number, number).map(np.array)
entries = st.builds(
    Entry,
    name=st.text(min_size=1, max_size=9),
    phrases=st.lists(st.text(max_size=9)).map(tuple),
    kind=st.sampled_from(["room", "fixture", "object"]),
    lowest=place,
    highest=place,
    room=st.none() | st.text(max_size=9),
    source=st.sampled_from(["prior", "segmentation"]),
    held=st.booleans(),
    inside=st.none() | st.text(max_size=9),
    laid=st.booleans(),
    confidence=st.floats(0, 1),
    seen_s=st.none() | st.floats(0, 1e4),
    view=st.none() | place,
)


@given(st.lists(entries, max_size=4))
def test_what_was_learned_comes_back_from_json(given_entries: list[Entry]) -> None:
    """Saved, and restored into a base that knows just what was known beforehand, everything is as it was."""
    known = base(*given_entries)
    fresh = base(*(e for e in known if e.source == "prior" and e.seen_s is None), can("stale", source="segmentation"))
    fresh.restore(json.loads(json.dumps(known.save())))
    assert {name: repr(e) for name, e in fresh.entries.items()} == {name: repr(e) for name, e in known.entries.items()}


@pytest.mark.parametrize(
    "change",
    [{"confidence": 1.5}, {"lowest": [0, 0]}, {"highest": [0, 0, float("nan")]}, {"kind": "cat"}, {"more": 1}],
    ids=str,
)
def test_what_was_not_saved_so_is_refused(change: dict[str, object]) -> None:
    """A damaged file ends as a ValueError, and changes nothing."""
    known = base(can(source="segmentation"))
    (saved,) = known.save()
    assert isinstance(saved, dict)
    with pytest.raises(ValueError, match=next(iter(change))):
        known.restore([{**saved, **change}])
    assert list(known.entries) == ["can"]


@given(st.floats(0, 1), st.floats(0, 1))
def test_two_detections_are_enough_whatever_their_scores(first: float, second: float) -> None:
    """One is, too, if its score is high."""
    belief = Belief()
    once = belief.first(first)
    assert once >= LIKELY or first < 0.78
    assert once < LIKELY or first > 0.77
    assert belief.seen(once, second) >= LIKELY


@given(st.floats(0, 0.98))
def test_a_few_looks_in_vain_are_enough(confidence: float) -> None:
    """Each makes a thing less likely, and after three at most it is given up, however often it was seen."""
    belief, looks = Belief(), 0
    while confidence >= belief.given_up:
        assert belief.missed(confidence) < confidence
        confidence, looks = belief.missed(confidence), looks + 1
    assert looks <= 3


@given(st.floats(0.02, 0.98), st.floats(0, 1))
def test_evidence_counts_alike_in_any_order(before: float, score: float) -> None:
    """A detection and a look in vain: which came first does not matter, short of certainty."""
    belief = Belief()
    if belief.seen(before, score) < 0.98:
        assert belief.missed(belief.seen(before, score)) == pytest.approx(belief.seen(belief.missed(before), score))
