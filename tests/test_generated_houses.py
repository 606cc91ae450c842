"""Houses drawn by a seed."""

from __future__ import annotations

from pathlib import Path

import pytest

import mpvi_bt
from mpvi_bt.apps.authoring.skeletons import new_house
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.house.generated.generator import generated_house
from mpvi_bt.house.generated.program import ROOMS
from mpvi_bt.house.instances.tasks import in_house, load_task
from mpvi_bt.house.layout.house import load_house


def test_a_seed_draws_one_house() -> None:
    """Its text is the same each time, and another seed's is another."""
    first = generated_house(3)
    for other in range(4, 14):  # what was drawn meanwhile does not matter
        assert first != generated_house(other, ("kitchen", "living_room"))
    assert first == generated_house(3)


def test_a_drawn_house_is_a_file_like_ours(tmp_path: Path) -> None:
    """What is written passes the check, and is the house that its seed names."""
    (file,) = new_house("drawn", seed=3).write(tmp_path)
    assert mpvi_bt.check(file) == []
    written, named = load_house(file), load_house("generated:3")
    assert set(named.rooms) == set(ROOMS)
    assert {n: f.entry for n, f in written.fixtures.items()} == {n: f.entry for n, f in named.fixtures.items()}


def test_a_drawn_house_has_the_rooms_that_were_named() -> None:
    """In any order of the names; and a room that nobody can draw is no room."""
    house = generated_house(1, ("living_room", "kitchen"))
    assert house == generated_house(1, ("kitchen", "living_room"))
    assert "bathroom" not in house
    with pytest.raises(UnknownName, match="cellar"):
        generated_house(1, ("kitchen", "cellar"))
    with pytest.raises(UserError, match="needs a corridor"):
        generated_house(1, ("kitchen", "bedroom"))


@pytest.mark.parametrize("name", ["generated:", "generated:x", "generated:-1", "generated:1.5"])
def test_a_seed_is_a_whole_number(name: str) -> None:
    """Other names of that beginning are refused with what is right."""
    with pytest.raises(UserError, match="generated:7"):
        load_house(name)


def test_a_task_moves_into_a_house_that_has_what_it_needs(tmp_path: Path) -> None:
    """Into another it does not, and what is missing there is said."""
    task = load_task("carrying_in_groceries")
    assert in_house(task, "generated:3").house == "generated:3"
    (small,) = new_house("small", seed=1, rooms=("kitchen", "living_room")).write(tmp_path)
    with pytest.raises(UserError, match="garage"):
        in_house(task, str(small))
