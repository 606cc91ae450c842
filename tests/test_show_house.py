"""`mpvi show HOUSE`: rooms and fixtures as a plan in characters, as data and as a picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mpvi_bt.apps.authoring.house_sheet import floor_plan, house_sheet, house_text
from mpvi_bt.house.layout.house import load_house
from tests.conftest import Shell

TWO_ROOMS = """
outside: "#efe6d6"
doorways:
  - {between: [office, workshop], at: [3.0, 2.0], width_m: 1.0}
rooms:
  office: {rect: [0.0, 0.0, 3.0, 4.0], floor: "#b98d5e", walls: "#f6ecd4"}
  workshop: {rect: [3.0, 0.0, 7.0, 4.0], floor: "#b98d5e", walls: "#f6ecd4", fixtures: {
    shelf_1: {entry: shelf, at: [6.5, 3.0], yaw_deg: 180}}}
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """The file of a house of two rooms."""
    file = tmp_path / "small.yaml"
    file.write_text(TWO_ROOMS)
    return file


def test_a_plan_has_walls_doorways_and_names(small: Path) -> None:
    """Four columns and two lines a meter; north is up, and the doorway is a gap in the wall between."""
    assert floor_plan(house_sheet(load_house(small))) == [
        "+-----------+---------------+",
        "|           |               |",
        "|           |               |",
        "|  office       workshop    |",
        "|   12 m2         16 m2     |",
        "|           |               |",
        "|           |               |",
        "|           |               |",
        "+-----------+---------------+",
    ]


@pytest.mark.parametrize("name", ["family_house", "small.yaml"])
def test_data_of_a_house_are_those_of_its_file(name: str, small: Path, mpvi: Shell) -> None:
    """Rooms, doorways and every fixture."""
    done = mpvi("show", name, "--json")
    told = json.loads(done.stdout)
    house = load_house(name if name == "family_house" else small)
    assert told["rooms"].keys() == house.rooms.keys()
    fixtures = {name: fixture for room in told["rooms"].values() for name, fixture in room["fixtures"].items()}
    assert {name: one["entry"] for name, one in fixtures.items()} == {
        fixture.name: fixture.entry.name for fixture in house.fixtures.values()
    }
    assert len(told["doorways"]) == len(house.doorways)


@pytest.mark.render
def test_a_house_is_drawn_beside_what_is_told(small: Path, mpvi: Shell, tmp_path: Path) -> None:
    """By its file; the text has a line for each room."""
    done = mpvi("show", "small.yaml")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "small: 7.0 m by 4.0 m; rooms: 2, fixtures: 1"
    assert "workshop: 4.0 m by 4.0 m; doors to office (1 m)" in lines
    assert lines[-1] == "wrote small.png"
    import cv2

    picture = cv2.imread(str(tmp_path / "small.png"))
    assert picture is not None
    assert picture.std() > 10


def test_lines_fit_a_terminal() -> None:
    """Those of the plan and of the rooms; every fixture is named."""
    house = load_house()
    text = house_text(house_sheet(house))
    assert max(map(len, text.splitlines())) <= 80
    assert all(fixture in text for fixture in house.fixtures)
