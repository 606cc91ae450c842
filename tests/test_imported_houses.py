"""Houses of ProcTHOR become house files that pass the check, and all that is other than there is told."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.apps.cli.check import check
from mpvi_bt.apps.cli.new import new
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.marked_yaml import parse_marked
from mpvi_bt.house.generated.plane import overlap, within
from mpvi_bt.house.imported.fixture_types import TYPES, fixture_type
from mpvi_bt.house.imported.floor_rectangles import floor_rectangles
from mpvi_bt.house.imported.imported_house import imported_house
from mpvi_bt.house.layout.house import House, check_house
from mpvi_bt.house.things.catalogue import load_catalogue
from tests.procthor_houses import house, opening, place, thing, wall, written


def made(folder: Path, told: Any) -> tuple[House, list[str]]:
    """The house of a file, checked as any house's file is, and what is said of it."""
    text, said = imported_house(written(folder, told))
    return check_house(*parse_marked(text, "theirs.yaml")), said


@given(st.lists(st.tuples(st.integers(1, 5), st.integers(1, 5)), min_size=1, max_size=6))
def test_rectangles_cover_a_floor_once(columns: list[tuple[int, int]]) -> None:
    """Rectangles and what is lost have the floor's area together; none overlaps another or is too small."""
    corners, x = [(0.0, 0.0)], 0.0
    for width, height in columns:
        corners += [(x, float(height)), (x + width, float(height))]
        x += width
    corners.append((x, 0.0))
    rects, lost = floor_rectangles(corners, 2.0)
    area = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in rects)
    assert area + lost == pytest.approx(sum(width * height for width, height in columns))
    for k, one in enumerate(rects):
        assert min(one[2] - one[0], one[3] - one[1]) >= 2.0
        assert within(one, (0.0, 0.0, x, 5.0))
        assert not any(overlap(one, other) for other in rects[:k])


def test_a_house_is_rebuilt(tmp_path: Path) -> None:
    """Rooms, doorways and fixtures are where they were; an L is two rectangles, open to one another."""
    built, _ = made(tmp_path, house())
    assert set(built.rooms) == {"bedroom", "living_room", "living_room_2"}
    assert built.rooms["bedroom"].rect == (0.0, 0.0, 4.0, 4.0)
    ways = {frozenset(door.rooms): door for door in built.doorways}
    door = ways[frozenset(("bedroom", "living_room"))]
    assert (door.at, door.width_m) == ((4.0, 1.5), 1.0)
    assert ways[frozenset(("living_room", "living_room_2"))].width_m > 2.5
    where = {fixture.entry.name: fixture for fixture in built.fixtures.values()}
    assert set(where) == {"bed", "chest_of_drawers", "sofa", "picture", "window"}
    drawers, bed = where["chest_of_drawers"], where["bed"]
    assert drawers.T_world_fixture[:2, 0] == pytest.approx([1, 0])  # faces the room, as it did
    assert drawers.extent()[0][0] == pytest.approx(0.05, abs=0.02)  # against its wall
    assert bed.T_world_fixture[:2, 0] == pytest.approx([0, -1], abs=1e-9)
    assert where["sofa"].room in ("living_room", "living_room_2")


def test_what_is_other_than_there_is_told(tmp_path: Path) -> None:
    """Left out, cut, moved or walled up: a line for each."""
    _, said = made(tmp_path, house())
    told = "\n".join(said)
    assert "room|3 is no rectangle: it is living_room, living_room_2" in told
    assert "1 door to the outside: a wall here" in told
    assert "5 fixtures, with the sizes of our catalogue" in told
    assert "left out, since they are no fixtures here: Pillow, Television" in told


def test_the_same_file_gives_the_same_house(tmp_path: Path) -> None:
    """To the letter."""
    file = written(tmp_path, house())
    assert imported_house(file) == imported_house(file)


def test_a_wall_that_is_not_built_is_an_opening(tmp_path: Path) -> None:
    """As wide as the wall is there."""
    told = house()
    told["doors"] = []
    told["walls"] = [wall("2", 4, 0, 4, 4, empty=True), wall("3", 4, 0, 4, 4, empty=True)]
    built, _ = made(tmp_path, told)
    widths = {frozenset(door.rooms): door.width_m for door in built.doorways}
    assert max(width for pair, width in widths.items() if "bedroom" in pair) > 2.5


def test_furniture_that_shuts_a_way_is_left_out(tmp_path: Path) -> None:
    """A robot gets from each doorway to each other; what stood between is told."""
    names = ("Bedroom", "LivingRoom", "Kitchen")
    floors = [[place(0, a), place(0, b), place(3, b), place(3, a)] for a, b in ((0, 3), (3, 9), (9, 12))]
    walls = [wall(str(k + 2), 0, z, 3, z) for k, z in enumerate((3, 9))]
    told = {
        "rooms": [
            {"id": f"room|{k + 2}", "roomType": name, "floorPolygon": floor}
            for k, (name, floor) in enumerate(zip(names, floors, strict=True))
        ],
        "walls": walls,
        "doors": [opening("door", (str(k + 2), str(k + 3)), wall["id"], 1.0, 2.0) for k, wall in enumerate(walls)],
        "objects": [thing("ArmChair", x, 6.0, 0) for x in (0.55, 1.5, 2.45)],  # from wall to wall
    }
    built, said = made(tmp_path, told)
    assert "left out, so that a robot gets through the room: sofa_3 in the living_room" in "\n".join(said)
    assert [fixture.name for fixture in built.fixtures.values()] == ["sofa_1", "sofa_2"]


def test_what_is_turned_is_told(tmp_path: Path) -> None:
    """Furniture stands along walls here; a few degrees are none to speak of."""
    told = house()
    told["objects"] = [thing("Bed", 1.5, 2.5, 183), thing("Sofa", 5.5, 1.5, 30)]
    _, said = made(tmp_path, told)
    assert "; 1 turned to the nearest right angle" in "\n".join(said)


def test_every_type_is_in_the_catalogue() -> None:
    """Its entry can be put up with its shape, and its name is found with and without RoboTHOR's prefix and model."""
    catalogue = load_catalogue()
    for name, kind in TYPES.items():
        assert catalogue[kind.entry].reshaped(kind.shape).description.extent().shape == (2, 3)
        assert fixture_type(name, "Bedroom") is kind
        assert fixture_type(f"RoboTHOR_{name}_hemnes", "Bedroom") is kind
    assert fixture_type("ToiletPaper", "Bathroom") is None
    assert fixture_type("DeskLamp", "Bedroom") is None
    assert fixture_type("Sink_19", "Kitchen") is not fixture_type("Sink_19", "Bathroom")


def askew(told: Any) -> None:
    told["rooms"][0]["floorPolygon"][0]["x"] = 0.5


def shut(told: Any) -> None:
    told["doors"] = []


def narrow(told: Any) -> None:
    for corner in told["rooms"][0]["floorPolygon"][2:]:
        corner["x"] = 0.5


def nameless(told: Any) -> None:
    told["rooms"][0]["roomType"] = "../x"


def endless(told: Any) -> None:
    told["objects"][0]["position"]["x"] = float("nan")


def roomless(told: Any) -> None:
    del told["rooms"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (askew, r"room 'room\|2' cannot be rebuilt: it has walls that are not at right angles"),
        (shut, "no way leads to living_room"),
        (narrow, r"room 'room\|2' is nowhere 1 m wide"),
        (nameless, r"has the type '\.\./x', which is no name"),
        (endless, r"no house of ProcTHOR's: objects\.0\.position\.x"),
        (roomless, "no house of ProcTHOR's: rooms"),
    ],
)
def test_what_cannot_be_rebuilt_is_refused_in_a_line(tmp_path: Path, change: Callable[[Any], None], said: str) -> None:
    """The file is named, and what is wrong with it."""
    told = house()
    change(told)
    with pytest.raises(UserError, match=said) as refused:
        imported_house(written(tmp_path, told))
    assert "theirs.json" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("text", ["", "[", "[1]", "null", "{}", '{"rooms": []}', "[" * 100_000, "\udc80"])
def test_a_file_of_something_else_is_refused(tmp_path: Path, text: str) -> None:
    """Whatever it is."""
    (tmp_path / "theirs.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(UserError, match=r"theirs\.json"):
        imported_house(tmp_path / "theirs.json")


def test_a_file_of_many_houses_has_one_a_line(tmp_path: Path) -> None:
    """Plain or gzipped, as ProcTHOR-10K comes; a line that is not there is told."""
    second = house()
    second["windows"] = []
    lines = f"{json.dumps(house())}\n{json.dumps(second)}\n".encode()
    (tmp_path / "all.jsonl").write_bytes(lines)
    (tmp_path / "all.jsonl.gz").write_bytes(gzip.compress(lines))
    one, two = (imported_house(tmp_path / name, 2)[0].partition("\n")[2] for name in ("all.jsonl", "all.jsonl.gz"))
    assert one == two
    assert "window" in imported_house(tmp_path / "all.jsonl", 1)[0]
    assert "window" not in one
    with pytest.raises(UserError, match="there is no line 3"):
        imported_house(tmp_path / "all.jsonl.gz", 3)
    (tmp_path / "cut.jsonl.gz").write_bytes(gzip.compress(lines)[:-30])
    with pytest.raises(UserError, match="cannot be read"):
        imported_house(tmp_path / "cut.jsonl.gz", 2)


def test_the_command_writes_a_house_that_passes_its_check(tmp_path: Path) -> None:
    """`mpvi new house NAME --from FILE`, with remarks, for people and for programs."""
    file = written(tmp_path, house())
    done = CliRunner().invoke(new, ["house", "theirs", "--from", str(file), "--root", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert any("left out" in remark for remark in told["remarks"])
    assert CliRunner().invoke(check, [str(tmp_path / "tasks/houses/theirs.yaml")]).exit_code == 0
    for more, said in ((["--seed", "3"], "--seed is of a drawn house"), (["--like", "flat"], "--like is of a drawn")):
        done = CliRunner().invoke(new, ["house", "other", "--from", str(file), *more])
        assert done.exit_code == 2
        assert said in done.output
    done = CliRunner().invoke(new, ["house", "other", "--line", "3"])
    assert "--line is of a file of houses" in done.output


def test_a_door_at_the_end_of_a_wall_is_moved_into_it(tmp_path: Path) -> None:
    """By as much as is told."""
    told = house()
    told["doors"][0] = opening("door", ("2", "3"), told["walls"][0]["id"], 3.4, 4.4)
    built, said = made(tmp_path, told)
    door = next(door for door in built.doorways if "bedroom" in door.rooms)
    assert door.at[1] + door.width_m / 2 <= 4.0 - 0.05 + 1e-9
    assert re.search(r"the door between room\|2 and room\|3 is moved or resized by \d\d cm", "\n".join(said))
