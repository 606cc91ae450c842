"""Predicates over hand-made states."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.errors import UnknownName, UserError
from mpvi_bt.goals import predicates
from mpvi_bt.goals.formula import Literal
from mpvi_bt.goals.predicates import inside, nextto, ontop, open_, touching, truth_in, under
from mpvi_bt.goals.rays import contains, crosses, interval
from mpvi_bt.robot.solids import Solid, box, pose


@dataclass
class Table:
    """A state written down by hand."""

    things: dict[str, list[Solid]]
    hollow: dict[str, list[Solid]] = field(default_factory=dict)
    contacts: set[frozenset[str]] = field(default_factory=set)
    joints: dict[str, list[float]] = field(default_factory=dict)
    on: set[str] = field(default_factory=set)

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


@pytest.mark.parametrize(
    ("middle", "expected"),
    [
        ((0.0, 0.0, 0.08), True),  # on the bottom
        ((0.12, 0.0, 0.2), True),  # leaning against the wall
        ((0.0, 0.0, 0.39), True),  # half out at the top: only the middle counts
        ((0.0, 0.0, 0.41), False),  # middle over the rim
        ((0.2, 0.0, 0.08), False),  # beside it
        ((0.14, 0.0, 0.2), False),  # in the wall: in the bounding box, not in the space
        ((0.0, 0.0, -0.3), False),  # under the floor
    ],
)
def test_inside_asks_for_the_middle_in_a_container_volume(middle: tuple[float, float, float], expected: bool) -> None:
    """Neither contact nor full containment is needed."""
    walls, space = bin_at(0, 0)
    state = Table({"bin": walls, "can": can(*middle)}, {"bin": [space]})
    assert inside(state, "can", "bin") is expected
    assert not inside(state, "bin", "can")


def test_nothing_is_inside_what_has_no_volume() -> None:
    """A solid crate around a thing holds nothing."""
    state = Table({"crate": [box((0, 0, 0), (1, 1, 1))], "can": can(0, 0, 0)})
    assert not inside(state, "can", "crate")


TABLE = [
    box((0, 0, 0.72), (1.0, 0.8, 0.04)),
    *(box((x, y, 0.35), (0.05, 0.05, 0.7)) for x in (-0.4, 0.4) for y in (-0.3, 0.3)),
]


@pytest.mark.parametrize(
    ("middle", "contact", "on", "below"),
    [
        ((0, 0, 0.80), True, True, False),  # standing on it
        ((0, 0, 0.799), True, True, False),  # 1 mm into it, as physics leaves things
        ((0, 0, 0.85), False, False, False),  # falling on it
        ((0.49, 0, 0.80), True, True, False),  # at the edge
        ((0.52, 0, 0.80), True, False, False),  # tipping over the edge: its middle is past it
        ((0, 0, 0.06), False, False, True),  # on the floor under it
        ((0.2, 0, 0.64), True, False, True),  # pressed up against its underside
        ((0.8, 0, 0.06), False, False, False),  # on the floor beside it
    ],
)
def test_ontop_and_under_follow_vertical_rays(
    middle: tuple[float, float, float], contact: bool, on: bool, below: bool
) -> None:
    """Ontop needs contact and the support straight below; under needs it straight above and not below."""
    state = Table({"table": TABLE, "can": can(*middle), "floor": FLOOR})
    if contact:
        state.contacts.add(frozenset({"can", "table"}))
    assert (ontop(state, "can", "table"), under(state, "can", "table")) == (on, below)
    assert touching(state, "table", "can") is contact


def test_between_two_boards_is_neither_ontop_nor_under() -> None:
    """In a shelf there is board above and below, which OmniGibson calls neither."""
    state = Table({"shelf": [box((0, 0, z), (1, 0.3, 0.02)) for z in (0.2, 0.6)], "can": can(0, 0, 0.27)})
    state.contacts.add(frozenset({"can", "shelf"}))
    assert not ontop(state, "can", "shelf")
    assert not under(state, "can", "shelf")


def test_rays_end_after_five_metres() -> None:
    """A bridge 5.1 m above does not count, one 4.9 m above does."""
    for height, expected in ((4.9, True), (5.1, False)):
        state = Table({"bridge": [box((0, 0, 0.12 + height + 0.5), (4, 4, 1.0))], "can": can(0, 0, 0.06)})
        assert under(state, "can", "bridge") is expected


@pytest.mark.parametrize(
    ("at", "expected"),
    [
        ((0.12, 0.0), True),  # 0.02 m apart
        ((0.15, 0.0), False),  # 0.05 m apart
        ((0.11, 0.11), True),  # corner to corner, 0.014 m apart: one of the five planes is at 45 degrees
        ((0.0, -0.12), True),
    ],
)
def test_nextto_allows_a_gap_in_proportion_to_size(at: tuple[float, float], expected: bool) -> None:
    """Two cubes of 0.1 m may be 0.2 / 6 = 0.033 m apart, and it is the same from either side."""
    state = Table({"a": [box((0, 0, 0.05), CUBE)], "b": [box((*at, 0.05), CUBE)]})
    assert nextto(state, "a", "b") is expected
    assert nextto(state, "b", "a") is expected


@pytest.mark.parametrize(("gap", "expected"), [(0.033, True), (0.034, False)])
def test_nextto_ends_where_the_sixth_does(gap: float, expected: bool) -> None:
    """The borderline is a sixth of the sum of both sizes."""
    state = Table({"a": [box((0, 0, 0.05), CUBE)], "b": [box((0.1 + gap, 0, 0.05), CUBE)]})
    assert nextto(state, "a", "b") is expected


def test_above_is_not_nextto() -> None:
    """Near, but no horizontal ray meets it."""
    state = Table({"a": [box((0, 0, 0.05), CUBE)], "b": [box((0, 0, 0.16), CUBE)]})
    assert not nextto(state, "a", "b")


@pytest.mark.parametrize(
    ("fractions", "expected"), [([], False), ([0.0], False), ([0.05], False), ([0.051], True), ([0.0, 0.9], True)]
)
def test_open_begins_past_a_twentieth_of_a_joint(fractions: list[float], expected: bool) -> None:
    """Any joint past 5 % of its range opens a thing; a thing without joints is never open."""
    assert open_(Table({"fridge": FLOOR}, joints={"fridge": fractions}), "fridge") is expected


def test_toggled_on_is_the_states() -> None:
    """A switch is what the state says."""
    truth = truth_in(Table({"radio": FLOOR, "lamp": FLOOR}, on={"radio"}))
    assert truth(Literal("toggled_on", ("radio",)))
    assert not truth(Literal("toggled_on", ("lamp",)))


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
        within = span is not None and span[0] < t < span[1]
        assert contains(solid, start + t * direction) == within


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
