"""The checker of houses, and houses that it finds nothing wrong with."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.houses.validity import faults
from mpvi_bt.house.layout.house import load_house

ROOMS = """\
outside: "#efe6d6"
doorways:
  - {between: [kitchen, living_room], at: [4.0, 2.0], width_m: 1.4}
rooms:
  kitchen:
    rect: [0.0, 0.0, 4.0, 4.0]
    floor: "#9fb0ab"
    walls: "#f6ecd4"
    fixtures:
      counter_1: {entry: counter, at: [1.2, 0.4], yaw_deg: 90}
      FIXTURE
  living_room:
    rect: [4.0, 0.0, 9.0, 4.0]
    floor: "#c08e5c"
    walls: "#f5ecdc"
"""
WRONG = {
    "does not get through the doorway": "table_1: {entry: table, at: [3.6, 2.0]}",
    "does not get before cabinet_1": "cabinet_1: {entry: base_cabinet, at: [0.6, 3.0], yaw_deg: 180}",
    "door of chest_1 has no room": "chest_1: {entry: tall_cabinet, at: [3.0, 0.3], yaw_deg: 90}\n"
    "      plant_1: {entry: houseplant, at: [2.65, 0.85]}",
}


@pytest.mark.parametrize("seed", range(5))
def test_generated_houses_are_valid(seed: int) -> None:
    """The generator makes no house that the checker, which knows nothing of it, finds fault with."""
    assert faults(load_house(f"generated:{seed}")) == []


@pytest.mark.parametrize(("fault", "fixture"), WRONG.items())
def test_the_checker_finds_what_is_wrong(fault: str, fixture: str, tmp_path: Path) -> None:
    """One fault each, and none without it."""
    file = tmp_path / "small.yaml"
    file.write_text(ROOMS.replace("FIXTURE", ""), encoding="utf-8")
    assert faults(load_house(file)) == []
    file.write_text(ROOMS.replace("FIXTURE", fixture), encoding="utf-8")
    assert [line for line in faults(load_house(file)) if fault in line]
