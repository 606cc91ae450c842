"""Houses drawn by a seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mpvi_bt
from mpvi_bt.apps.authoring.skeletons import new_house
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.house.generated.generator import generated_house
from mpvi_bt.house.generated.house_kind import load_kind
from mpvi_bt.house.generated.placement import RoomFloor, hinge_toward
from mpvi_bt.house.generated.plane import Side
from mpvi_bt.house.instances.tasks import in_house, load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.things.catalogue import load_catalogue

KIND = """\
day: [[meeting_room]]
night: [bathroom]
rooms:
  meeting_room: {area_m2: [29.0, 31.0], shorter_m: 4.0}
  bathroom: {area_m2: [9.5, 12.0], shorter_m: 2.35}
corridor_m: [1.7, 2.1]
"""


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
    assert set(named.rooms) == set(load_kind("family").all_rooms)
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


@pytest.mark.parametrize("side", ["south", "east", "north", "west"])
@pytest.mark.parametrize(("blocked", "hinge"), [("", ""), ("high", "low"), ("low", "high"), ("both", "")])
def test_a_door_is_hinged_where_nothing_is_in_its_way(side: Side, blocked: str, hinge: str) -> None:
    """Something that sticks out beside a cabinet has its door turned about the other end; else it stays as it was."""
    room = RoomFloor("hall", (0.0, 0.0, 6.0, 6.0), [], [], load_catalogue(), np.random.default_rng(0))
    frame = room.frame(side)
    cabinet = room.piece("cabinet", "base_cabinet", frame, 3.0)
    beside = {"high": 3.0 + 0.32 + 0.5, "low": 3.0 - 0.32 - 0.5}
    sofas = [room.piece(end, "sofa", frame, u, turn_deg=90) for end, u in beside.items() if blocked in (end, "both")]
    room.add([cabinet, *sofas])
    room.hinge_free(cabinet)
    free = hinge_toward(frame, high=hinge == "high") if hinge else "right"
    assert room.pieces[0].shape.get("hinge", "right") == free
    assert room.pieces[0].area == cabinet.area


@pytest.mark.parametrize("name", ["", "x", "-1", "1.5", "flat:", ":3", "flat:x", "../flat:3"])
def test_a_seed_is_a_whole_number(name: str) -> None:
    """Other names of that beginning are refused with what is right."""
    with pytest.raises(UserError, match="generated:7"):
        load_house(f"generated:{name}")


@pytest.mark.parametrize("kind", ["flat", "office"])
def test_a_kind_says_which_rooms_a_house_has(kind: str, tmp_path: Path) -> None:
    """Of a name and a file alike; what a task needs and the kind lacks is said."""
    (file,) = new_house("drawn", seed=2, like=kind).write(tmp_path)
    assert mpvi_bt.check(file) == []
    written, named = load_house(file), load_house(f"generated:{kind}:2")
    assert set(named.rooms) == set(load_kind(kind).all_rooms)
    assert written.fixtures.keys() == named.fixtures.keys()
    assert bool(named.fixtures_of("bathtub.n.01")) == (kind == "flat"), "an office has none"
    with pytest.raises(UserError, match="garage"):
        in_house(load_task("carrying_in_groceries"), f"generated:{kind}:2")


def test_a_kind_of_ones_own_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its rooms have the sizes that it says, and a folder of kinds makes its name known."""
    folder = tmp_path / "tasks" / "kinds"
    folder.mkdir(parents=True)
    (folder / "hall.yaml").write_text(KIND)
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    house = load_house("generated:hall:1")
    assert set(house.rooms) == {"meeting_room", "corridor", "bathroom"}
    x0, y0, x1, y1 = house.rooms["meeting_room"].rect
    assert 28.0 < (x1 - x0) * (y1 - y0) < 32.0
    with pytest.raises(UnknownName, match="hall"):
        load_house("generated:hell:1")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[bathroom]", "[bathrom]", "yaml:2:9: unknown room 'bathrom'. Did you mean 'bathroom'?"),
        ("bathroom: {", "cellar: {", "unknown room 'cellar'"),
        ("[[meeting_room]]", "[[meeting_room], [bathroom]]", "each room of its row once"),
        ("night: [bathroom]", "night: []", "bathroom is in no row"),
        ("[29.0, 31.0]", "[29.0, 3100.0]", "less than or equal to 100"),
    ],
)
def test_what_is_wrong_with_a_kind_is_placed(old: str, new: str, said: str, tmp_path: Path) -> None:
    """By line and column, with the nearest known name."""
    file = tmp_path / "hall.yaml"
    file.write_text(KIND.replace(old, new))
    assert said in "\n".join(map(str, mpvi_bt.check(file)))


def test_a_task_moves_into_a_house_that_has_what_it_needs(tmp_path: Path) -> None:
    """Into another it does not, and what is missing there is said."""
    task = load_task("carrying_in_groceries")
    assert in_house(task, "generated:3").house == "generated:3"
    (small,) = new_house("small", seed=1, rooms=("kitchen", "living_room")).write(tmp_path)
    with pytest.raises(UserError, match="garage"):
        in_house(task, str(small))
