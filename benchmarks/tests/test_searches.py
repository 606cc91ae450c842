"""Laws of the scenes that searches are tried on."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.searches.__main__ import table, text
from benchmarks.searches.play import Job, Row
from benchmarks.searches.scenes import draw
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.things.catalogue import load_catalogue

HOUSE, CATALOGUE = load_house(), load_catalogue()
GRID = prior_map(HOUSE)


@pytest.mark.parametrize("seed", range(4))
def test_a_scene_follows_from_its_seed_and_takes_a_search(seed: int) -> None:
    """The target is in another room than the robot, hidden every third time, and nothing else is of its kind."""
    scene, again = (draw(seed, HOUSE, CATALOGUE, GRID) for _ in range(2))
    assert np.array_equal(scene.base_pose, again.base_pose)
    assert all(np.array_equal(thing.T_world, again.objects[name].T_world) for name, thing in scene.objects.items())
    assert GRID.room_at(scene.objects[scene.target].T_world[:2, 3]) == scene.room != GRID.room_at(scene.base_pose[:2])
    assert scene.hidden is (seed % 3 == 0)
    kinds = [thing.entry.name for thing in scene.objects.values()]
    assert len(set(kinds)) == len(kinds)


@pytest.mark.rare
def test_nothing_stands_under_a_worktop() -> None:
    """What is drawn on furniture has room over it: a thing in a closed counter cannot be looked for."""
    boxes = [solid.aabb() for fixture in HOUSE.fixtures.values() for solid in fixture.solids()]
    for seed in range(40):
        for thing in draw(seed, HOUSE, CATALOGUE, GRID).objects.values():
            x, y, z = thing.T_world[:3, 3]
            over = [b for b in boxes if (b[0, :2] < (x, y)).all() and (b[1, :2] > (x, y)).all()]
            assert not any(b[0, 2] < z + 0.15 and b[1, 2] > z + 0.01 for b in over), (seed, thing.entry.name)


def test_the_table_counts_what_was_found() -> None:
    """By map and detector, and apart for what was hidden; a failure has an SPL of 0 and its reason."""
    rows = [
        Row(Job(k), "book", "hall", "floor", k == 0, k < 2, "" if k < 2 else "not_found", "", 10.0, 5.0, 60.0, 100,
            0.0, "", {"stepping": 4.0, "navigation": 1.0, "rendering": 5.0})
        for k in range(3)
    ]  # fmt: skip
    records = {r["targets"]: r for r in table(rows, worst=1)}
    assert (records["all"]["found"], records["all"]["n"], records["all"]["failures"]) == (2, 3, {"not_found": 1})
    assert (records["hidden"]["n"], records["open"]["n"]) == (1, 2)
    assert records["all"]["median_spl"] == 0.5
    assert records["all"]["pictures_a_second"] == pytest.approx(10.0)
    assert "2: book in hall on floor: SPL 0.00" in text(rows, worst=1)


def test_drawn_houses_have_rows_of_their_own() -> None:
    """All of them one, beside the family house."""
    rows = [
        Row(Job(k, house=house), "book", "hall", "floor", False, True, "", "", 10.0, 5.0, 60.0, 100, 0.0, "", {})
        for k, house in enumerate(("family_house", "generated:1", "generated:2"))
    ]
    assert {r["houses"]: r["n"] for r in table(rows, worst=1)} == {"family_house": 1, "drawn": 2}
    assert "1: book in hall of generated:1 on floor" in text(rows, worst=1)
