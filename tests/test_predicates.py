"""Predicates over hand-made states."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.rays import crosses, interval, within
from mpvi_bt.ground.geometry.solids import Solid, box, pose
from mpvi_bt.ground.human import human_stats
from mpvi_bt.house.goals import predicates
from mpvi_bt.house.goals.formula import Literal, literals
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.goals.problem import load_problem
from mpvi_bt.house.states.relations import inside, nextto, ontop, open_, resting_on, touching, under
from mpvi_bt.house.states.temperature import Heat, Thermal


@dataclass
class Table:
    """A state written down by hand."""

    things: dict[str, list[Solid]]
    hollow: dict[str, list[Solid]] = field(default_factory=dict)
    contacts: set[frozenset[str]] = field(default_factory=set)
    joints: dict[str, list[float]] = field(default_factory=dict)
    on: set[str] = field(default_factory=set)
    heats: dict[str, Heat] = field(default_factory=dict)
    marks: set[tuple[str, str]] = field(default_factory=set)
    mounted: set[tuple[str, str]] = field(default_factory=set)

    def exists(self, name: str) -> bool:
        return name in self.things

    def solids(self, name: str) -> Sequence[Solid]:
        return self.things[name]

    def volumes(self, name: str) -> Sequence[Solid]:
        return self.hollow.get(name, [])

    def touching(self, name: str, other: str) -> bool:
        return frozenset({name, other}) in self.contacts

    def joint_fractions(self, name: str) -> Sequence[float]:
        return self.joints.get(name, [])

    def toggled_on(self, name: str) -> bool:
        return name in self.on

    def covered(self, name: str, kind: str) -> bool:
        return (name, kind) in self.marks

    def grains(self, kind: str) -> Sequence[str]:
        return [name for name in self.things if name.startswith(f"{kind}_")]

    def attached(self, name: str, other: str) -> bool:
        return (name, other) in self.mounted

    def heat(self, name: str) -> tuple[Heat, Thermal]:
        return self.heats.get(name, Heat()), Thermal(cooked_c=70.0)


def bin_at(x: float, y: float) -> tuple[list[Solid], Solid]:
    """An open bin of 0.3 x 0.3 x 0.4 m on the floor, and the space in it."""
    walls = [
        box((x + dx, y + dy, 0.2), (0.02, 0.3, 0.4) if dx else (0.3, 0.02, 0.4))
        for dx, dy in ((0.14, 0), (-0.14, 0), (0, 0.14), (0, -0.14))
    ]
    return [*walls, box((x, y, 0.01), (0.3, 0.3, 0.02))], box((x, y, 0.21), (0.26, 0.26, 0.38))


def can(x: float, y: float, z: float) -> list[Solid]:
    """An upright can with its middle there."""
    return [Solid("cylinder", np.array([0.033, 0.033, 0.06]), pose((x, y, z)))]


Kind = typing.Literal["box", "cylinder", "sphere"]
CUBE = (0.1, 0.1, 0.1)
FLOOR = [box((0, 0, -0.05), (6, 6, 0.1))]


def scenes(*rows: tuple[str, tuple[object, ...]]) -> pytest.MarkDecorator:
    """Scenes with a name each: the truth of a predicate is the last of what a scene gives."""
    return pytest.mark.parametrize("given", [pytest.param(given, id=name) for name, given in rows])


def turned(solid: Solid, axis: int, angle: float) -> Solid:
    """A solid turned in place about a world axis [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    T = solid.T.copy()
    R = np.eye(3)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    T[:3, :3] = R @ T[:3, :3]
    return Solid(solid.kind, solid.half_m, T)


def rod(middle: tuple[float, float, float], length: float, tilt: float = 0.0) -> list[Solid]:
    """A thin rod, upright or tilted about y."""
    return [turned(Solid("cylinder", np.array([0.005, 0.005, length / 2]), pose(middle)), 1, tilt)]


BIN, SPACE = bin_at(0, 0)
CRATE = [box((0.5, 0.5, 0.5), (1, 1, 1))]  # from 0 to 1: its faces are exact numbers
RACK = [box((0, 0, z), (0.6, 0.3, 0.02)) for z in (0.01, 0.5, 0.99)]
SHELVES = [box((0, 0, z), (0.6, 0.3, 0.46)) for z in (0.25, 0.74)]  # the spaces above its lower two boards
AWRY, IN_AWRY = [solid.moved(pose(yaw=np.pi / 4)) for solid in BIN], SPACE.moved(pose(yaw=np.pi / 4))


@scenes(
    ("positive: on the bottom", (can(0, 0, 0.08), BIN, [SPACE], True)),
    ("positive: leaning against the wall", (can(0.12, 0, 0.2), BIN, [SPACE], True)),
    ("positive: in the air, without any contact", (can(0, 0, 0.3), BIN, [SPACE], True)),
    ("positive: half out at the top", (can(0, 0, 0.39), BIN, [SPACE], True)),
    ("positive: a long rod, of which most is out", (rod((0, 0, 0.35), 0.66), BIN, [SPACE], True)),
    ("positive: far too large for it", (box((0, 0, 0.2), (1, 1, 1)), BIN, [SPACE], True)),
    ("positive: in the lower of two spaces", (can(0, 0, 0.08), RACK, SHELVES, True)),
    ("positive: in the upper of two spaces", (can(0, 0, 0.57), RACK, SHELVES, True)),
    ("positive: in the corner of a bin that stands awry", (can(0.16, 0, 0.1), AWRY, [IN_AWRY], True)),
    ("negative: beside it", (can(0.2, 0, 0.08), BIN, [SPACE], False)),
    ("negative: under it", (can(0, 0, -0.3), BIN, [SPACE], False)),
    ("negative: over it", (can(0, 0, 0.6), BIN, [SPACE], False)),
    ("negative: a rod whose middle is over the rim", (rod((0, 0, 0.45), 0.9), BIN, [SPACE], False)),
    ("negative: in the wall, which is no space", (can(0.14, 0, 0.2), BIN, [SPACE], False)),
    ("negative: in the board between two spaces", (can(0, 0, 0.5), RACK, SHELVES, False)),
    ("negative: on top of a rack", (can(0, 0, 1.06), RACK, SHELVES, False)),
    ("negative: beside a bin that stands awry, in its bounding box", (can(0.17, 0.17, 0.1), AWRY, [IN_AWRY], False)),
    ("negative: within what has no space", (can(0.5, 0.5, 0.5), CRATE, [], False)),
    ("borderline: its middle on the face of the space", (box((1, 0.5, 0.5), CUBE), CRATE, CRATE, True)),
    ("borderline: its middle just past the face", (box((1 + 1e-9, 0.5, 0.5), CUBE), CRATE, CRATE, False)),
    ("borderline: its middle at the rim", (box((0.5, 0.5, 1), CUBE), CRATE, CRATE, True)),
    (
        "borderline: in a space that reaches over the bounding box",
        (box((0.5, 0.5, 1.1), CUBE), CRATE, [box((0.5, 0.5, 1), (1, 1, 2))], False),
    ),
)
def test_inside_asks_for_the_middle_in_a_container_volume(given: tuple[Any, ...]) -> None:
    """The middle of its bounding box, in that of the container and in one of its spaces; no contact is needed."""
    a, b, spaces, expected = given
    state = Table({"a": as_list(a), "b": b}, {"b": spaces})
    assert inside(state, "a", "b") is expected
    assert not inside(state, "b", "a")


def as_list(solids: Solid | list[Solid]) -> list[Solid]:
    return [solids] if isinstance(solids, Solid) else solids


TABLE = [
    box((0, 0, 0.72), (1.0, 0.8, 0.04)),
    *(box((x, y, 0.35), (0.05, 0.05, 0.7)) for x in (-0.4, 0.4) for y in (-0.3, 0.3)),
]
PLATE = [box((0.5, 0.5, 0.5), (1, 1, 1))]  # its top is at 1
BOARDS = [box((0, 0, z), (1, 0.3, 0.02)) for z in (0.2, 0.6)]
RING = [
    *(box((x, 0, 0.76), (0.04, 0.3, 0.04)) for x in (-0.13, 0.13)),
    *(box((0, y, 0.76), (0.3, 0.04, 0.04)) for y in (-0.13, 0.13)),
]
RAMP = [turned(box((0, 0, 0), (1, 1, 0.04)), 1, 0.3)]
TRESTLES = [box((x, 0, 0.35), (0.4, 0.4, 0.7)) for x in (-0.5, 0.5)]
PEG = [Solid("cylinder", np.array([0.02, 0.02, 0.15]), pose((0, 0, 0.85)))]
COIN = [Solid("cylinder", np.array([0.11, 0.11, 0.005]), pose((0, 0, 0.745)))]
# A low block from which an arm reaches over what lies beside it: its middle is over the block.
CRANE = [
    box((0.25, 0, 0.05), (0.9, 0.4, 0.1)),
    box((1.1, 0, 1.05), (0.6, 0.4, 0.1)),
    box((1.45, 0, 0.55), (0.1, 0.4, 1.1)),
]


@scenes(
    ("positive: standing on it", (can(0, 0, 0.80), TABLE, True, True)),
    ("positive: a millimeter in it, as physics leaves things", (can(0, 0, 0.799), TABLE, True, True)),
    ("positive: a millimeter over it, as physics leaves things", (can(0, 0, 0.801), TABLE, True, True)),
    ("positive: at the edge", (can(0.49, 0, 0.80), TABLE, True, True)),
    ("positive: on a ramp", (box((0, 0, 0.08), CUBE), RAMP, True, True)),
    ("positive: a ring lying flat, its middle over the table", (RING, TABLE, True, True)),
    (
        "positive: far more of it hangs over than lies on it",
        (box((0.49, 0, 0.76), (1.9, 0.1, 0.04)), TABLE, True, True),
    ),
    ("positive: a ring around a coin: where rays miss it, they leave from its middle", (RING, COIN, True, True)),
    ("negative: falling on it", (can(0, 0, 0.85), TABLE, False, False)),
    ("negative: on a book on it", (can(0, 0, 0.83), TABLE, False, False)),
    ("negative: tipping over the edge, its middle past it", (can(0.52, 0, 0.80), TABLE, True, False)),
    ("negative: leaning on its side", (rod((0.53, 0, 0.5), 0.9), TABLE, True, False)),
    ("negative: pressed up against its underside", (can(0.2, 0, 0.64), TABLE, True, False)),
    ("negative: on the lower of two boards, the other above", (can(0, 0, 0.27), BOARDS, True, False)),
    ("negative: a plank over the gap of two trestles", (box((0, 0, 0.71), (1.2, 0.1, 0.02)), TRESTLES, True, False)),
    ("negative: a ring around a peg, which is below and above its middle", (RING, PEG, True, False)),
    ("borderline: its middle over the very edge", (box((1, 0.5, 1.05), CUBE), PLATE, True, True)),
    ("borderline: its middle just past the edge", (box((1 + 1e-9, 0.5, 1.05), CUBE), PLATE, True, False)),
)
def test_ontop_asks_for_contact_and_the_support_straight_below(given: tuple[Any, ...]) -> None:
    """Straight down from its surface, over the middle of its bounding box, and not straight up."""
    a, b, contact, expected = given
    state = Table({"a": as_list(a), "b": b})
    if contact:
        state.contacts.add(frozenset({"a", "b"}))
    assert ontop(state, "a", "b") is expected
    assert not expected or not under(state, "a", "b")
    assert not expected or resting_on(state, "a", "b")


@scenes(
    ("positive: on the lower of two boards, the other above", (can(0, 0, 0.27), BOARDS, True, True)),
    ("positive: a ring around a peg, which is below and above its middle", (RING, PEG, True, True)),
    ("negative: over it", (can(0, 0, 0.85), TABLE, False, False)),
    ("negative: pressed up against its underside", (can(0.2, 0, 0.64), TABLE, True, False)),
    ("negative: leaning on its side", (rod((0.53, 0, 0.5), 0.9), TABLE, True, False)),
)
def test_resting_on_asks_nothing_of_what_is_above(given: tuple[Any, ...]) -> None:
    """What a sentence calls on a rack may lie on any of its boards."""
    a, b, contact, expected = given
    state = Table({"a": as_list(a), "b": b})
    if contact:
        state.contacts.add(frozenset({"a", "b"}))
    assert resting_on(state, "a", "b") is expected


def bridge(height: float) -> list[Solid]:
    """A bridge so high above what is 0.12 m high."""
    return [box((0, 0, 0.12 + height + 0.5), (4, 4, 1.0))]


@scenes(
    ("positive: on the floor below a table", (can(0, 0, 0.06), TABLE, True)),
    ("positive: pressed up against its underside", (can(0.2, 0, 0.64), TABLE, True)),
    ("positive: floating below it", (can(0, 0.2, 0.4), TABLE, True)),
    ("positive: only its middle is below it", (box((0.45, 0, 0.05), (2, 0.1, 0.1)), TABLE, True)),
    ("positive: a ring on the floor below it", ([solid.moved(pose((0, 0, -0.74))) for solid in RING], TABLE, True)),
    ("positive: a short plank below the arm of a crane", (box((1.1, 0, 0.5), (0.5, 0.1, 0.1)), CRANE, True)),
    ("negative: on the floor beside it", (can(0.8, 0, 0.06), TABLE, False)),
    ("negative: on it", (can(0, 0, 0.80), TABLE, False)),
    ("negative: most of it is below, but not its middle", (box((0.6, 0, 0.05), (1.9, 0.1, 0.1)), TABLE, False)),
    ("negative: on the lower of two boards", (can(0, 0, 0.27), BOARDS, False)),
    (
        "negative: a long plank below the arm and over the block of a crane",
        (box((1.1, 0, 0.5), (1, 0.1, 0.1)), CRANE, False),
    ),
    ("borderline: 5 m below a bridge, but a little", (can(0, 0, 0.06), bridge(4.999), True)),
    ("borderline: 5 m below a bridge, and a little", (can(0, 0, 0.06), bridge(5.001), False)),
    ("borderline: its middle below the very edge", (box((1, 0.5, -0.5), CUBE), PLATE, True)),
    ("borderline: its middle just past the edge", (box((1 + 1e-9, 0.5, -0.5), CUBE), PLATE, False)),
)
def test_under_asks_for_the_other_straight_above(given: tuple[Any, ...]) -> None:
    """Within 5 m and not straight below too; and what is above has not the thing above its own middle."""
    a, b, expected = given
    state = Table({"a": as_list(a), "b": b})
    assert under(state, "a", "b") is expected


def cube(x: float, y: float, z: float = 0.05, size: float = 0.1) -> list[Solid]:
    return [box((x, y, z), (size, size, size))]


POST = [Solid("cylinder", np.array([0.005, 0.005, 0.5]), pose((0, 0, 0.5)))]
WARDROBE = [box((0.4, 0, 1.0), (0.6, 1.2, 2.0))]  # its side is 0.1 m from x = 0


def walls(away: float) -> list[Solid]:
    """Two walls of one thing, so far from the origin; from between them, the middle of all is high above."""
    return [box((x, 0, 1), (0.2, 14, 2)) for x in (-away - 0.1, away + 0.1)]


def post(angle: float, away: float) -> list[Solid]:
    """Another post of that kind, in a direction [deg]."""
    return [
        solid.moved(pose((away * np.cos(np.radians(angle)), away * np.sin(np.radians(angle)), 0))) for solid in POST
    ]


@scenes(
    ("positive: 2 cm beside it", (cube(0.12, 0), cube(0, 0), True)),
    ("positive: touching it", (cube(0.1, 0), cube(0, 0), True)),
    ("positive: on the other side", (cube(0, -0.12), cube(0, 0), True)),
    ("positive: corner to corner, where a ray at 45 degrees meets it", (cube(0.11, 0.11), cube(0, 0), True)),
    ("positive: a can before a wardrobe, whose middle is far above", (can(0, 0, 0.06), WARDROBE, True)),
    ("positive: a can on a box, before the same wardrobe", (can(0, 0, 1.5), WARDROBE, True)),
    ("positive: a rod in a bin, beside its walls", (rod((0, 0, 0.2), 0.3), BIN, True)),
    ("positive: rays see through what is between", (cube(0.103, 0), cube(0, 0), True)),
    ("positive: posts in a direction of a ray", (post(22.5, 0.1), POST, True)),
    ("negative: 5 cm beside it", (cube(0.15, 0), cube(0, 0), False)),
    ("negative: above it", (cube(0, 0, 0.16), cube(0, 0), False)),
    ("negative: on it, as a cup on a plate", (can(0, 0, 0.08), [box((0, 0, 0.01), (0.2, 0.2, 0.02))], False)),
    ("negative: near it, but higher up", (cube(0.12, 0, 0.18), cube(0, 0), False)),
    ("negative: near a wardrobe for a wardrobe, but it is a can", (can(-0.25, 0, 1.0), WARDROBE, False)),
    ("negative: posts between the directions of two rays", (post(11.25, 0.1), POST, False)),
    ("borderline: a sixth of both sizes away", (cube(1, 0, 0.375, 0.75), cube(0, 0, 0.375, 0.75), True)),
    ("borderline: just over a sixth away", (cube(1 + 1e-9, 0, 0.375, 0.75), cube(0, 0, 0.375, 0.75), False)),
    ("borderline: between walls of one thing, 5 m away but a little", (can(0, 0, 0.06), walls(4.999), True)),
    ("borderline: between walls of one thing, 5 m away and a little", (can(0, 0, 0.06), walls(5.001), False)),
)
def test_nextto_asks_for_a_small_gap_and_a_ray_that_meets(given: tuple[Any, ...]) -> None:
    """A sixth of both sizes, averaged over the axes; a horizontal ray from either middle; the same from either side."""
    a, b, expected = given
    state = Table({"a": a, "b": b, "between": [box((0.0515, 0, 0.05), (0.003, 0.1, 0.1))]})
    assert nextto(state, "a", "b") is expected
    assert nextto(state, "b", "a") is expected


@given(st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3), st.lists(st.floats(0.01, 0.5), min_size=6, max_size=6))
def test_nextto_is_the_same_from_either_side(shift: list[float], sizes: list[float]) -> None:
    """Whatever the two are."""
    x, y, z = shift
    state = Table(
        {"a": [box((0, 0, 0), (sizes[0], sizes[1], sizes[2]))], "b": [box((x, y, z), (sizes[3], sizes[4], sizes[5]))]}
    )
    assert nextto(state, "a", "b") is nextto(state, "b", "a")


@scenes(
    ("positive: in contact", (cube(0.1, 0), {frozenset({"a", "b"})}, True)),
    ("negative: far away", (cube(3, 0), set(), False)),
    ("negative: both touch a third", (cube(0.2, 0), {frozenset({"a", "c"}), frozenset({"b", "c"})}, False)),
    ("borderline: their boxes overlap, but physics reports no contact", (cube(0.05, 0), set(), False)),
)
def test_touching_is_what_physics_reports(given: tuple[Any, ...]) -> None:
    """In both directions alike; where things are does not matter."""
    a, contacts, expected = given
    state = Table({"a": a, "b": cube(0, 0), "c": cube(0.1, 0)}, contacts=contacts)
    assert touching(state, "a", "b") is expected
    assert touching(state, "b", "a") is expected


@scenes(
    ("positive: wide open", ([1.0], True)),
    ("positive: one of two doors", ([0.0, 0.9], True)),
    ("positive: beyond its range", ([1.02], True)),
    ("negative: closed", ([0.0], False)),
    ("negative: all of three drawers closed", ([0.0, 0.0, 0.0], False)),
    ("negative: pressed in a little too far", ([-0.01], False)),
    ("negative: without joints", ([], False)),
    ("borderline: at 5 %", ([0.05], False)),
    ("borderline: just past 5 %", ([0.05 + 1e-9], True)),
    ("borderline: both doors at 5 %, which do not add up", ([0.05, 0.05], False)),
)
def test_open_begins_past_a_twentieth_of_a_joint(given: tuple[Any, ...]) -> None:
    """Any joint past 5 % of its range opens a thing."""
    fractions, expected = given
    assert open_(Table({"fridge": FLOOR}, joints={"fridge": fractions}), "fridge") is expected


def test_toggled_on_is_the_states() -> None:
    """A switch is what the state says, and off is what has none; pressing is tested with switches."""
    truth = truth_in(Table({"radio": FLOOR, "lamp": FLOOR}, on={"radio"}))
    assert truth(Literal("toggled_on", ("radio",)))
    assert not truth(Literal("toggled_on", ("lamp",)))


def test_what_was_hot_is_cooked_and_what_is_cold_is_frozen() -> None:
    """By how warm a thing is now, how warm it ever was, and whether it burns."""
    heats = {"egg": Heat(20.0, 71.0), "pie": Heat(-1.0, 23.0), "log": Heat(1000.0, 1000.0, on_fire=True)}
    truth = truth_in(Table(dict.fromkeys(heats, FLOOR), heats=heats))
    true = {name: [p for p in ("cooked", "frozen", "hot", "on_fire") if truth(Literal(p, (name,)))] for name in heats}
    assert true == {"egg": ["cooked"], "pie": ["frozen"], "log": ["cooked", "hot", "on_fire"]}


def test_covered_is_about_a_substance_that_is_no_thing() -> None:
    """Any mark of it will do; what is not there is covered by nothing."""
    truth = truth_in(Table({"cup": FLOOR}, marks={("cup", "dust.n.01")}))
    assert truth(Literal("covered", ("cup", "dust.n.01_1")))
    assert not truth(Literal("covered", ("cup", "mud.n.03_1")))
    assert not truth(Literal("covered", ("plate", "dust.n.01_1")))


DICED = "diced__beet.n.01"
BOWL = box((0, 0, 0.05), (0.1, 0.1, 0.1))  # a liter


@pytest.mark.parametrize(
    ("middles", "contained", "full"),
    [
        ([], False, False),
        ([(0.0, 0.0, 0.02)], True, False),
        ([(0.0, 0.0, 0.02), (0.3, 0.0, 0.02)], True, False),
        ([(x, y, 0.02) for x in (-0.04, 0.0, 0.04) for y in (-0.02, 0.02)], True, True),
    ],
)
def test_a_vessel_contains_one_grain_and_is_filled_by_a_fifth(
    middles: list[tuple[float, float, float]], contained: bool, full: bool
) -> None:
    """Grains of 40 ml in a bowl of a liter, told by their middles; those beside it are not in it."""
    side = 0.04 ** (1 / 3) / 10
    grains = {f"{DICED}_{k}": [box(at, (side, side, side))] for k, at in enumerate(middles, 1)}
    truth = truth_in(Table({"bowl": [BOWL], **grains}, hollow={"bowl": [BOWL]}))
    assert truth(Literal("contains", ("bowl", f"{DICED}_1"))) is contained
    assert truth(Literal("filled", ("bowl", f"{DICED}_1"))) is full
    assert truth(Literal("real", (f"{DICED}_1",))) is bool(middles)
    assert not truth(Literal("contains", ("bowl", "diced__onion.n.01_1")))


def test_grains_cover_what_they_touch() -> None:
    """As marks do that sit on a thing."""
    state = Table({"dough": FLOOR, f"{DICED}_2": [BOWL]}, contacts={frozenset({"dough", f"{DICED}_2"})})
    assert truth_in(state)(Literal("covered", ("dough", f"{DICED}_1")))
    assert not truth_in(state)(Literal("covered", ("dough", "grated_cheese.n.01_1")))


def test_each_literal_of_the_fifty_goals_is_judged() -> None:
    """Of things that do not exist each is false, and none is unknown; without wildcards' fixtures there are 386."""
    truth = truth_in(Table({}))
    asked = [literal for task in human_stats() for literal in literals(load_problem(task).goal)]
    assert not any(map(truth, asked))
    assert len(asked) == 386


def test_only_the_child_is_attached() -> None:
    """A camera is attached to its tripod, the tripod not to the camera."""
    truth = truth_in(Table({"camera": FLOOR, "tripod": FLOOR}, mounted={("camera", "tripod")}))
    assert truth(Literal("attached", ("camera", "tripod")))
    assert not truth(Literal("attached", ("tripod", "camera")))


def test_names_are_bound_to_the_scene() -> None:
    """A floor's BDDL name stands for the floor of its room."""
    state = Table({"floor_kitchen": FLOOR, "can.n.01_1": can(0, 0, 0.06)})
    state.contacts.add(frozenset({"floor_kitchen", "can.n.01_1"}))
    truth = truth_in(state, {"floor.n.01_2": "floor_kitchen"})
    assert truth(Literal("ontop", ("can.n.01_1", "floor.n.01_2")))


def test_what_does_not_exist_makes_every_predicate_false() -> None:
    """A thing that was consumed is nowhere."""
    truth = truth_in(Table({"bin": bin_at(0, 0)[0]}))
    assert not truth(Literal("inside", ("apple", "bin")))
    assert not truth(Literal("open", ("apple",)))


def test_unknown_predicates_name_the_known_ones() -> None:
    """An error lists what could be asked."""
    truth = truth_in(Table({"a": FLOOR, "b": FLOOR}))
    with pytest.raises(UnknownName, match=r"unknown predicate 'insde'\. Did you mean 'inside'") as caught:
        truth(Literal("insde", ("a", "b")))
    assert set(caught.value.known) == {*predicates.UNARY, *predicates.BINARY}
    with pytest.raises(UserError, match="inside takes 2 arguments"):
        truth(Literal("inside", ("a",)))


@st.composite
def solids(draw: st.DrawFn) -> Solid:
    """A solid of any kind, size and pose."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    kind: Kind = draw(st.sampled_from(["box", "cylinder", "sphere"]))
    half = rng.uniform(0.05, 1.0, 3)
    if kind != "box":
        half[1] = half[0]
    if kind == "sphere":
        half[2] = half[0]
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation * np.linalg.det(rotation), rng.uniform(-1, 1, 3)
    return Solid(kind, half, T)


@given(solids(), st.integers(0, 2**32))
def test_a_ray_is_in_a_solid_exactly_between_its_ends(solid: Solid, seed: int) -> None:
    """Points of the line are in the solid between the two ends of the interval, and nowhere else."""
    rng = np.random.default_rng(seed)
    start, direction = rng.uniform(-2, 2, 3), rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    span = interval(solid, start, direction)
    for t in rng.uniform(-6, 6, 20):
        if span is not None and min(abs(t - span[0]), abs(t - span[1])) < 1e-9:
            continue
        between = span is not None and span[0] < t < span[1]
        assert within(solid, start + t * direction) == between


@given(solids(), st.integers(0, 2**32))
def test_rays_do_not_depend_on_where_the_world_begins(solid: Solid, seed: int) -> None:
    """Moving ray and solid together changes nothing."""
    rng = np.random.default_rng(seed)
    start, direction, T = (
        rng.uniform(-2, 2, 3),
        np.array([0.6, 0.0, 0.8]),
        pose(rng.uniform(-5, 5, 3), rng.uniform(0, 6)),
    )
    here = interval(solid, start, direction)
    there = interval(solid.moved(T), T[:3, :3] @ start + T[:3, 3], T[:3, :3] @ direction)
    assert (here is None) == (there is None)
    if here is not None and there is not None:
        assert there == pytest.approx(here, abs=1e-9)


def test_a_ray_that_begins_inside_meets_the_solid() -> None:
    """As PhysX has it, and as things that rest a little deep need it."""
    assert crosses([box((0, 0, 0), (1, 1, 1))], np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.1)
    assert not crosses([box((0, 0, 0), (1, 1, 1))], np.array([0, 0, 0.6]), np.array([0.0, 0.0, 1.0]), 5.0)
