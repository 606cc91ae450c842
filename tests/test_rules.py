"""Rules of states: each case of the fixtures, and laws that hold for all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.house.states.cutting import Cuttable, Slicer, cut, rearmed
from mpvi_bt.house.states.grains import contains, filled
from mpvi_bt.house.states.heat import BURNS_C, Source, cooked, frozen, heated, ignited, settles_at, spread, warmed
from mpvi_bt.house.states.marks import Marks, covered
from mpvi_bt.house.states.mounts import breaks, fits
from mpvi_bt.house.states.recipes import Recipe, baked
from mpvi_bt.house.states.sprayer import EVERY_STEPS, MARKS_AT_ONCE, Sprayer, sprayed
from mpvi_bt.house.states.temperature import ROOM_C, Heat, Thermal
from mpvi_bt.house.states.washer import begins, washed
from mpvi_bt.house.states.wiping import CAPACITY, Remover, wiped

FOLDER = Path(__file__).parent / "fixtures" / "rules"
DT_S = 1 / 30
SOURCES = {
    "fridge": Source(at_c=-18.0, shut=True),
    "microwave": Source(at_c=100.0, switched=True, shut=True),
    "oven": Source(at_c=250.0, switched=True, shut=True),
    "stove": Source(at_c=1980.0, placing="near", switched=True),
}


def cases(file: str, section: str) -> list[Any]:
    """The rows of a section of a file of fixtures, as test cases named for what they say."""
    rows = yaml.safe_load((FOLDER / f"{file}.yaml").read_text(encoding="utf-8"))[section]
    return [pytest.param(row, id=str(row.get("case", i))) for i, row in enumerate(rows)]


@pytest.mark.parametrize("row", cases("heat", "warmed"))
def test_a_temperature_follows_its_sources(row: dict[str, Any]) -> None:
    """Step by step at the control rate, to what the row says within 0.1 degrees."""
    heat = Heat(row["before"], row["before"])
    for _ in range(round(row["seconds"] / DT_S)):
        heat = warmed(heat, [SOURCES[name] for name in row["sources"]], DT_S)
    assert heat.now_c == pytest.approx(row["after"], abs=0.1)


@pytest.mark.parametrize("row", cases("heat", "acts"))
def test_a_source_acts_where_its_conditions_hold(row: dict[str, Any]) -> None:
    """On, closed, inside or near, as each source asks."""
    assert SOURCES[row["source"]].acts(**row["given"]) is row["acts"]


@pytest.mark.parametrize("row", cases("heat", "cooked"))
def test_what_was_hot_enough_is_cooked(row: dict[str, Any]) -> None:
    """By the highest temperature so far, whatever it is now."""
    assert cooked(Heat(ROOM_C, row["highest"]), Thermal(cooked_c=row["cooked_c"])) is row["cooked"]


@pytest.mark.parametrize("row", cases("heat", "cold_and_hot"))
def test_frozen_and_heated_are_of_now(row: dict[str, Any]) -> None:
    """At the threshold it holds."""
    heat = Heat(row["now"], 300.0)
    assert (frozen(heat, Thermal()), heated(heat, Thermal())) == (row["frozen"], row["heated"])


@given(
    start=st.floats(-50, 500),
    sources=st.lists(st.sampled_from(sorted(SOURCES)), max_size=3),
    steps=st.integers(1, 200),
)
def test_a_temperature_moves_toward_where_it_settles_and_never_past(
    start: float, sources: list[str], steps: int
) -> None:
    """From either side, and what it once came to is kept."""
    acting = [SOURCES[name] for name in sources]
    aim, heat = settles_at(acting), Heat(start, start)
    for _ in range(steps):
        before, heat = heat, warmed(heat, acting, DT_S)
        assert abs(heat.now_c - aim) <= abs(before.now_c - aim) + 1e-9
        assert (heat.now_c - aim) * (before.now_c - aim) >= -1e-9
        assert heat.highest_c >= max(before.highest_c, heat.now_c)


@pytest.mark.parametrize("row", cases("fire", "ignited"))
def test_what_can_burn_and_is_hot_enough_burns(row: dict[str, Any]) -> None:
    """It is at the temperature of fire then."""
    heat = ignited(Heat(row["before"], row["before"]), Thermal(ignites_c=row["ignites_c"]))
    assert (heat.on_fire, heat.now_c) == (row["on_fire"], row["after"])


def test_fire_spreads_to_what_is_near_a_step_later_and_never_goes_out() -> None:
    """Along a row of logs each lights the next, and what does not burn is only warmed."""
    names = ["a", "b", "c", "stone"]
    near = {"a": ["b"], "b": ["a", "c"], "c": ["b", "stone"], "stone": ["c"]}
    kinds = {name: Thermal(ignites_c=None if name == "stone" else 250.0) for name in names}
    heats = {name: Heat() for name in names}
    heats["a"] = Heat(260.0, 260.0)
    lit: dict[str, int] = {}
    for step in range(2000):
        heats = spread(heats, kinds, {}, near, DT_S)
        for name in names:
            if heats[name].on_fire:
                lit.setdefault(name, step)
                assert heats[name].now_c == BURNS_C
    assert list(lit) == ["a", "b", "c"]
    assert lit["a"] == 0 < lit["b"] < lit["c"]
    assert heats["stone"].now_c > 250.0
    assert heats["a"].on_fire


@pytest.mark.parametrize("row", cases("cutting", "slicer"))
def test_a_slicer_rests_for_two_seconds_after_a_touch(row: dict[str, Any]) -> None:
    """In steps of a tenth of a second."""
    slicer = Slicer()
    for k in range(round(row["at_s"] * 10)):
        slicer = rearmed(slicer, any(abs(k / 10 - t) < 1e-6 for t in row["touched_s"]), 0.1)
    assert slicer.active is row["active"]


@pytest.mark.parametrize("row", cases("cutting", "cut"))
def test_a_cut_makes_halves_of_whole_things_and_dice_of_halves(row: dict[str, Any]) -> None:
    """By what the kind can become."""
    assert cut(Slicer(row["active"]), Cuttable(half=row["half"], diced=row["diced"])) == row["cut"]


@pytest.mark.parametrize("row", cases("marks", "covered"))
def test_one_mark_or_grain_covers(row: dict[str, Any]) -> None:
    """Of the kind asked for."""
    marks = Marks({"dust": np.zeros((row["marks"], 3)), "mud": np.zeros((3, 3))})
    assert covered(marks, "dust", row["grains"]) is row["covered"]


@pytest.mark.parametrize("row", cases("marks", "wiped"))
def test_a_remover_takes_what_is_about_it(row: dict[str, Any]) -> None:
    """Within its box grown by 2 cm, if it is wet with what it needs, until it is saturated."""
    marks = Marks({"dust": np.array([[x, 0.0, 0.0] for x in row["at"]])})
    remover = Remover({"dust": row["solvents"]}, (0.05, 0.05, 0.05), {"dust": row["taken"]})
    left, after = wiped(marks, remover, np.eye(4), row["wet_with"])
    assert left.count("dust") == row["left"]
    assert after.taken["dust"] == row["taken"] + len(row["at"]) - row["left"]


@given(st.lists(st.tuples(*[st.floats(-0.3, 0.3)] * 3), max_size=300), st.integers(0, CAPACITY))
def test_marks_are_neither_made_nor_lost_by_wiping(points: list[tuple[float, ...]], taken: int) -> None:
    """What is gone from the thing is on the remover; other kinds stay."""
    marks = Marks({"dust": np.array(points).reshape(-1, 3), "mud": np.zeros((2, 3))})
    left, after = wiped(
        marks, Remover({"dust": []}, (0.1, 0.1, 0.1), {"dust": taken}), kin.transform(np.eye(3), (0.05, 0.0, 0.0))
    )
    assert left.count("dust") + after.taken["dust"] == len(points) + taken
    assert after.taken["dust"] <= CAPACITY
    assert left.count("mud") == 2


def test_a_sprayer_marks_now_and_then_within_its_cone() -> None:
    """Two rays every five steps while it is on, none else, and each makes a mark where it meets something."""
    sprayer, rng = (
        Sprayer(kind="pesticide.n.01", at=(0.0, 0.0, 0.0), length_m=0.3, radius_m=0.1),
        np.random.default_rng(0),
    )
    sent = [sprayer.rays(True, step, rng) for step in range(2 * EVERY_STEPS)]
    assert [len(rays) for rays in sent] == 2 * [MARKS_AT_ONCE, 0, 0, 0, 0]
    rays = np.concatenate(sent)
    np.testing.assert_allclose(rays[:, 0], 0.3)
    assert (np.hypot(rays[:, 1], rays[:, 2]) <= 0.1).all()
    assert not len(sprayer.rays(False, 0, rng))
    marks = sprayed(sprayed(Marks(), "pesticide", rays[:1]), "pesticide", rays[1:])
    assert marks.count("pesticide") == len(rays)
    assert covered(marks, "pesticide")


@pytest.mark.parametrize("row", cases("marks", "washer"))
def test_a_washer_begins_once(row: dict[str, Any]) -> None:
    """As it is on and closed and was not before."""
    assert begins(row["ran"], on=row["on"], closed=row["closed"]) is row["begins"]


@pytest.mark.parametrize("row", cases("marks", "washed"))
def test_a_washer_takes_the_kinds_of_its_list(row: dict[str, Any]) -> None:
    """Those that need no solvent, or one that is there."""
    marks = Marks({"dust": np.zeros((2, 3)), "mud": np.zeros((2, 3))})
    assert sorted(washed(marks, row["solvents"], row["there"]).points) == row["left"]


@pytest.mark.parametrize("row", cases("mounts", "fits"))
def test_a_child_is_fixed_to_a_parent_that_it_fits(row: dict[str, Any]) -> None:
    """In contact, of a pair, close and turned alike."""
    turned = kin.transform(kin.rot_z(np.deg2rad(row["turned_deg"])), (row["apart_m"], 0.0, 0.0))
    child = Mount("nail", True, turned)
    parent = Mount(row.get("kind", "nail"), row.get("parent_male", False), np.eye(4), row.get("free", True))
    assert fits(child, parent, row.get("contact", True)) is row["fits"]
    assert not fits(parent, child, True)


@pytest.mark.parametrize("row", cases("mounts", "breaks"))
def test_a_mount_breaks_under_too_much(row: dict[str, Any]) -> None:
    """Force or torque."""
    assert breaks(row["force_n"], row["torque_nm"]) is row["breaks"]


@pytest.mark.parametrize("row", cases("grains", "contains"))
def test_a_vessel_is_filled_by_a_fifth_of_its_volume(row: dict[str, Any]) -> None:
    """And contains what one grain of is in it."""
    assert contains(row["grains"]) is row["contains"]
    assert filled(row["grains"] * (2 * row["radius_m"]) ** 3, row["volume_m3"]) is row["filled"]


PIZZA = Recipe(
    into="pizza",
    covered_by=("cheese.n.01", "onion.n.01"),
    topped_with={"pepperoni.n.01": 1, "mushrooms.n.01": 1},
    on="sheet.n.01",
)


@pytest.mark.parametrize("row", cases("grains", "baked"))
def test_a_pizza_needs_all_of_its_parts(row: dict[str, Any]) -> None:
    """Each of them alone prevents it by its absence."""
    parts = {"cheese", "onion", "pepperoni", "mushrooms", "sheet"} - {row["without"]}
    there = {f"{part}.n.01" for part in parts}
    assert baked(PIZZA, there, dict.fromkeys(there, 1), there) is row["baked"]
