"""Laws of the map and of the knowledge base."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.plan.knowledge import KnowledgeBase, normalize, whole
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from tests.navigation_maps import thing, two_rooms


@given(st.integers(0, 79), st.integers(0, 159), st.floats(-20, 20), st.floats(-20, 20), st.sampled_from([0.05, 0.1]))
def test_a_cell_holds_its_own_center(row: int, column: int, x: float, y: float, resolution_m: float) -> None:
    """Cell to world and back, wherever the map's origin is."""
    like = two_rooms()
    moved = OccupancyMap(like.occupied, like.rooms, like.room_names, resolution_m, np.array([x, y]))
    assert moved.cell(moved.center(row, column)) == (row, column)
    assert moved.inside(row, column)


def test_rooms_are_found_by_place() -> None:
    """In each room its name; in a wall, in a doorway between and off the map none."""
    grid_map = two_rooms()
    assert grid_map.room_at((1.0, 1.0)) == "kitchen"
    assert grid_map.room_at((7.0, 1.0)) == "living_room"
    assert grid_map.room_at((4.0, 2.0)) is None
    assert grid_map.room_at((-1.0, 2.0)) is None
    assert grid_map.room_at((9.0, 2.0)) is None


@given(st.text(max_size=40))
def test_normalizing_twice_is_normalizing_once(text: str) -> None:
    """Phrases of any origin come to one form."""
    assert normalize(normalize(text)) == normalize(text)


@given(
    st.sampled_from(["a", "the", "another", "one", "The", "AN"]), st.sampled_from(["can of soda", "Trash_Can", "box!"])
)
def test_articles_capitals_and_underscores_do_not_matter(article: str, noun: str) -> None:
    """The Trash_Can is a trash can."""
    assert normalize(f"{article} {noun}") == normalize(noun) == normalize(noun.upper())


def test_what_is_still_to_be_picked_up_comes_first() -> None:
    """Of things called alike: loose ones, then those put away, then those in a hand; each in the order of entry."""
    base = KnowledgeBase()
    cases: list[tuple[str, dict[str, object]]]
    cases = [("held", {"held": True}), ("put_away", {"inside": "bin"}), ("first", {}), ("second", {})]
    for name, more in cases:
        entry = thing(name, (0, 0, 0), (0.1, 0.1, 0.1), **more)
        entry.phrases = ("can of soda",)
        base.put(entry)
    assert [e.name for e in base.find("a can of soda")] == ["first", "second", "put_away", "held"]


@pytest.mark.parametrize(
    ("phrase", "found"),
    [
        ("the fridge door", "fridge"),
        ("the door of the fridge", "fridge"),
        ("lid of the box", "box"),
        ("the top drawer", None),
        ("a door", None),
        ("fridge", None),
        ("switch of the radio", None),
    ],
)
def test_a_part_stands_for_its_thing(phrase: str, found: str | None) -> None:
    """Its door, lid or drawer is named after it; where a thing is itself called so, it is meant."""
    assert whole(phrase) == found
    base = KnowledgeBase()
    for name, phrases in (("fridge", ("fridge",)), ("box", ("box",)), ("gate", ("front door",))):
        entry = thing(name, (0, 0, 0), (0.1, 0.1, 0.1))
        entry.phrases = phrases
        base.put(entry)
    if found:
        assert [e.name for e in base.find(phrase)] == [found]
    assert [e.name for e in base.find("the front door")] == ["gate"]


def test_a_room_narrows_the_search_and_an_entry_is_replaced_by_name() -> None:
    """Room names match however they are spelled; the last word on a thing counts."""
    base = KnowledgeBase()
    base.put(thing("can", (0, 0, 0), (0.1, 0.1, 0.1), room="kitchen"))
    assert base.find("can", "living room") == []
    base.put(thing("can", (5, 0, 0), (0.1, 0.1, 0.1), room="living_room"))
    assert [e.center[0] for e in base.find("can", "Living Room")] == [5.0]
    assert len(list(base)) == 1
