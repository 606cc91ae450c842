"""The house file: what it must hold, and that everything wrong with one is told at once."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt, label

from mpvi_bt.ground.errors import FileProblems, UnknownName
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.layout.rooms import PANEL_M, Doorway, Room, walls
from mpvi_bt.house.things.catalogue import load_catalogue

# Fixtures that the 50 challenge tasks name: synset, room, how many at least. An exact count is one that a goal's
# wildcard multiplies with (`cabinet.n.01_*`), so that more would change what the goal asks.
AT_LEAST = [
    ("countertop.n.01", "kitchen", 2), ("shelf.n.01", "kitchen", 1), ("stove.n.01", "kitchen", 1),
    ("oven.n.01", "kitchen", 1), ("microwave.n.02", "kitchen", 1), ("dishwasher.n.01", "kitchen", 1),
    ("breakfast_table.n.01", "kitchen", 1), ("coffee_table.n.01", "living_room", 1),
    ("bookcase.n.01", "living_room", 4), ("wood_fireplace.n.01", "living_room", 1), ("bed.n.01", "bedroom", 1),
    ("desk.n.01", "bedroom", 1), ("swivel_chair.n.01", "bedroom", 1), ("bed.n.01", "childs_room", 1),
    ("desk.n.01", "childs_room", 1), ("chair.n.01", "childs_room", 1), ("table.n.02", "childs_room", 1),
    ("hallstand.n.01", "corridor", 1), ("washer.n.03", "utility_room", 1), ("countertop.n.01", "utility_room", 1),
    ("cabinet.n.01", "utility_room", 1), ("tabletop.n.01", "utility_room", 1), ("car.n.01", "garage", 1),
    ("cabinet.n.01", "bathroom", 1), ("shelf.n.01", "bathroom", 1), ("lawn.n.01", "garden", 1),
    ("driveway.n.01", "garden", 1), ("tree.n.01", "garden", 2),
]  # fmt: skip
EXACTLY = [
    ("cabinet.n.01", "kitchen", 6), ("cabinet.n.01", "living_room", 1), ("electric_refrigerator.n.01", "kitchen", 1),
    ("sink.n.01", "kitchen", 1), ("sink.n.01", "bathroom", 1), ("sofa.n.01", "living_room", 4),
    ("table.n.02", "dining_room", 1), ("table.n.02", "living_room", 1), ("table.n.02", "bedroom", 2),
    ("bookcase.n.01", "childs_room", 2), ("wall_nail.n.01", "kitchen", 1),
]  # fmt: skip
TO_USE = {synset for synset, _, _ in AT_LEAST + EXACTLY} - {"lawn.n.01", "driveway.n.01", "wall_nail.n.01"}
ROBOT_RADIUS_M = 0.33
CATALOGUE = load_catalogue()

SMALL = """\
outside: "#ffffff"
doorways:
  - {between: [hall, den], at: [4.0, 2.0], width_m: 1.0}
rooms:
  hall:
    rect: [0, 0, 4, 4]
    floor: "#aaaaaa"
    walls: "#eeeeee"
    fixtures:
      sofa: {entry: sofa, at: [2, 0.6], yaw_deg: 90}
  den:
    rect: [4, 0, 8, 4]
    floor: "#aaaaaa"
    walls: "#eeeeee"
"""


SOFA = "{entry: sofa, at: [2.5, 0.6], yaw_deg: 90}"
DEN = 'rect: [4, 0, 8, 4]\n    floor: "#aaaaaa"\n    walls: "#eeeeee"\n'


@pytest.fixture(scope="module")
def house() -> House:
    return load_house()


def small(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    text = SMALL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "small.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("synset", "room", "count"), AT_LEAST)
def test_house_has_the_fixtures_that_tasks_name(house: House, synset: str, room: str, count: int) -> None:
    """Every fixture of the 50 tasks stands in its room, as often as one task needs it."""
    assert len(house.fixtures_of(synset, room)) >= count


@pytest.mark.parametrize(("synset", "room", "count"), EXACTLY)
def test_wildcard_fixtures_are_as_many_as_in_the_benchmark(house: House, synset: str, room: str, count: int) -> None:
    """Where a goal ranges over all fixtures of a kind in a room, there are as many as in BEHAVIOR's houses."""
    assert len(house.fixtures_of(synset, room)) == count


def test_doorways_are_wide_enough(house: House) -> None:
    """Every doorway is at least 0.9 m wide and joins two rooms of the house."""
    assert all(doorway.width_m >= 0.9 for doorway in house.doorways)
    assert {name for doorway in house.doorways for name in doorway.rooms} == set(house.rooms)


def test_a_robot_gets_from_any_room_to_any_other_and_before_every_fixture(house: House) -> None:
    """On the prior map, a disk of 0.33 m reaches every room and a place near each fixture, in front of what opens."""
    map_ = prior_map(house)
    free = distance_transform_edt(~map_.occupied) * map_.resolution_m > ROBOT_RADIUS_M
    parts, _ = label(free)
    start = map_.cell((10.0, 3.6))
    reached = parts == parts[start]
    assert parts[start]
    rows, columns = np.nonzero(reached)
    places = map_.origin_m + (np.stack([columns, rows], 1) + 0.5) * map_.resolution_m
    for room in house.rooms:
        assert (map_.rooms[reached] == map_.room_names.index(room)).any(), room
    for fixture in house.fixtures.values():
        if fixture.entry.synset in TO_USE:
            low, high = fixture.extent()[:, :2]
            gap = np.linalg.norm(np.maximum(np.maximum(low - places, places - high), 0), axis=1)
            near = places[gap < 0.75]
            assert any(map_.room_at(place) == fixture.room for place in near), fixture.name
        if fixture.entry.description.jointed or fixture.entry.family in ("shelf", "sink", "fireplace", "hallstand"):
            ahead, aside = ((places - fixture.T_world_fixture[:2, 3]) @ fixture.T_world_fixture[:2, :2]).T
            front = fixture.entry.description.extent()[1, 0]
            assert np.any((ahead > front) & (ahead < front + 0.7) & (np.abs(aside) < 0.3)), fixture.name


@given(
    rect=st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(2, 6), st.floats(2, 6)),
    width=st.floats(0.9, 1.5),
    share=st.floats(0, 1),
)
def test_walls_and_doorway_make_up_the_edges(
    rect: tuple[float, float, float, float], width: float, share: float
) -> None:
    """A room's panels are as long as its edges, less corners and doorways, and none crosses the doorway."""
    x, y, w, h = rect
    middle = y + width / 2 + share * (h - width)
    rooms = [
        Room("a", (x, y, x + w, y + h), ("a",), (0, 0, 0), (0, 0, 0), False),
        Room("b", (x + w, y, x + 2 * w, y + h), ("b",), (0, 0, 0), (0, 0, 0), False),
    ]
    doorway = Doorway(("a", "b"), (x + w, middle), width, "y")
    panels = list(walls(rooms, [doorway], (0, 0, 0), 2.2, 0.9))
    for name in ("a", "b"):
        total = sum(2 * panel.solid.half_m[:2].max() for panel in panels if panel.room == name)
        # slivers under 1 cm beside the doorway are dropped
        assert total == pytest.approx(2 * w + 2 * h - 4 * PANEL_M - width, abs=0.021 + 2 * PANEL_M)
    for panel in panels:
        (lx, ly, _), (hx, hy, _) = panel.solid.aabb()
        across = lx < x + w + 0.04 and hx > x + w - 0.04
        assert not (across and ly < middle + width / 2 - 1e-6 and hy > middle - width / 2 + 1e-6 and hy - ly > 0.06)


DOORWAY = "  - {between: [hall, den], at: [4.0, 2.0], width_m: 1.0}\n"


def test_two_doorways_may_lie_in_one_wall(tmp_path: Path) -> None:
    """As long as there is wall between them."""
    more = f"{DOORWAY}  - {{between: [den, hall], at: [4.0, 3.2], width_m: 0.9}}\n"
    assert len(load_house(small(tmp_path, (DOORWAY, more))).doorways) == 2


def test_small_house_is_valid(tmp_path: Path) -> None:
    """The house that the tests below spoil has nothing wrong with it."""
    assert set(load_house(small(tmp_path)).rooms) == {"hall", "den"}


@pytest.mark.parametrize(
    ("code", "line", "change"),
    [
        ("room-overlap", 12, ("rect: [4, 0, 8, 4]", "rect: [3, 0, 8, 4]")),
        ("room-size", 6, ("rect: [0, 0, 4, 4]", "rect: [4, 0, 0, 4]")),
        ("doorway-in-no-wall", 3, ("at: [4.0, 2.0]", "at: [3.0, 2.0]")),
        ("doorway-in-no-wall", 3, ("at: [4.0, 2.0]", "at: [4.0, 3.8]")),
        ("doorway-in-no-wall", 3, ("rect: [4, 0, 8, 4]", "rect: [5, 0, 8, 4]")),
        ("unknown-room", 3, ("[hall, den]", "[hall, dne]")),
        ("doorway-overlap", 4, (DOORWAY, DOORWAY + DOORWAY)),
        ("doorway-overlap", 4, (DOORWAY, f"{DOORWAY}  - {{between: [den, hall], at: [4.0, 2.9], width_m: 0.9}}\n")),
        ("fixture-outside-room", 10, ("at: [2, 0.6]", "at: [2, 0.3]")),
        ("unknown-catalogue-entry", 10, ("entry: sofa", "entry: sofe")),
        ("unknown-key", 10, ("yaw_deg", "yaw_dge")),
        ("unknown-key", 10, ("yaw_deg: 90", "yaw_deg: 90, shape: {seets: 2}")),
        ("out-of-range", 3, ("width_m: 1.0", "width_m: 0.7")),
        (
            "invalid-value",
            7,
            ('    floor: "#aaaaaa"\n    walls: "#eeeeee"\n    fix', "    floor: gray\n    walls: tan\n    fix"),
        ),
        ("fixture-overlap", 11, ("yaw_deg: 90}\n", f"yaw_deg: 90}}\n      other: {SOFA}\n")),
        ("cut-off", 9, ("doorways:\n  - {between: [hall, den], at: [4.0, 2.0], width_m: 1.0}\n", "")),
        ("duplicate-fixture", 16, (DEN, f"{DEN}    fixtures:\n      sofa: {SOFA}\n")),
    ],
)
def test_each_problem_is_told_with_its_line(tmp_path: Path, code: str, line: int, change: tuple[str, str]) -> None:
    """Whatever is wrong with a house is refused with its place in the file."""
    path = small(tmp_path, change)
    with pytest.raises(FileProblems) as caught:
        load_house(path)
    assert (code, line) in [(p.code, p.line) for p in caught.value.problems], str(caught.value)


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    """Problems of rooms, doorways and fixtures come in one error, with the nearest valid names."""
    path = small(
        tmp_path,
        ("rect: [4, 0, 8, 4]", "rect: [3, 0, 8, 4]"),
        ("[hall, den]", "[hal, den]"),
        ("entry: sofa", "entry: sofe"),
    )
    with pytest.raises(FileProblems) as caught:
        load_house(path)
    assert [p.code for p in caught.value.problems] == ["unknown-room", "unknown-catalogue-entry", "room-overlap"]
    assert "Did you mean 'hall'?" in str(caught.value)
    assert "Did you mean 'sofa'?" in str(caught.value)


@given(data=st.data())
def test_no_spoiled_file_ends_in_a_traceback(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Whatever stands in place of one value of the file, it is a house or a list of problems."""
    words = re.findall(r"[^\s:,{}\[\]]+", SMALL)
    tokens = [
        "0",
        "-1",
        "1e9",
        ".inf",
        ".nan",
        "''",
        "hall",
        "den",
        "sofa",
        "[]",
        "{}",
        "[1, 2]",
        "null",
        "'#12345g'",
        "~x",
    ]
    at = data.draw(st.integers(0, len(words) - 1))
    new = data.draw(st.sampled_from(tokens) | st.text("abc01-.:[]{}#'\"", max_size=6))
    places = [m.span() for m in re.finditer(r"[^\s:,{}\[\]]+", SMALL)]
    path = tmp_path_factory.mktemp("house") / "house.yaml"
    path.write_text(SMALL[: places[at][0]] + new + SMALL[places[at][1] :])
    with contextlib.suppress(FileProblems):
        load_house(path, CATALOGUE)


@pytest.mark.parametrize(
    "shape",
    ["{leg_m: 25.0, top_m: 5.0}", "{size_m: [0.001, 1, 1], shelf_z_m: 0.1}"],
)
def test_dimensions_that_do_not_fit_together_are_refused(tmp_path: Path, shape: str) -> None:
    """A shape whose parts would have no size is a problem of the file, not a crash of the simulator."""
    path = small(
        tmp_path, ("{entry: sofa, at: [2, 0.6], yaw_deg: 90}", f"{{entry: table, at: [2, 2], shape: {shape}}}")
    )
    with pytest.raises(FileProblems, match="impossible-shape"):
        load_house(path)


def test_unknown_house_names_the_nearest() -> None:
    """A house that is not there is refused with the nearest that is."""
    with pytest.raises(UnknownName, match="family_house"):
        load_house("familly_house")
