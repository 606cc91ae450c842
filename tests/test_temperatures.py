"""Temperatures in a world: what a fridge, a microwave and a stove do to the things in or on them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.house.goals.predicates import cooked, frozen
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.states.heat import settles_at
from mpvi_bt.house.states.temperature import ROOM_C, Thermal
from tests.layouts import ACTION_SIZE
from tests.small_house import CATALOGUE, placed, small_world

FRIDGE = "{entry: refrigerator, at: [1.5, 0.0], yaw_deg: 180}"
STOVE = "{entry: stove, at: [1.5, 0.0], z_m: 0.4}"


def warm(world: SimWorld, seconds: float) -> None:
    """Let time pass for temperatures only: nothing moves."""
    for _ in range(round(seconds * 30)):
        world._temperatures.step(world, 1 / 30)


def in_fridge(world: SimWorld) -> Placement:
    """A pie on a board of the fridge."""
    volume = max(world.volumes("fridge_1"), key=lambda v: v.T[2, 3])
    return Placement(CATALOGUE["small_apple_pie"], volume.T @ pose((0.0, 0.0, -float(volume.half_m[2]) + 0.03)))


def test_a_shut_fridge_freezes_and_an_open_one_does_not() -> None:
    """In ten seconds, down to where source and room hold the balance; taken out it thaws."""
    empty = small_world(fridge_1=FRIDGE)
    world = small_world({"pie": in_fridge(empty)}, fridge_1=FRIDGE)
    door = next(b.name for b in world.thing("fridge_1").description.bodies if b.joint is not None)
    world.set_opening("fridge_1", door, 1.0)
    warm(world, 20)
    assert world.heat("pie")[0].now_c == pytest.approx(ROOM_C)
    world.set_opening("fridge_1", door, 0.0)
    warm(world, 10)
    assert frozen(world, "pie")
    warm(world, 100)
    assert world.heat("pie")[0].now_c == pytest.approx(-11.2, abs=0.1)
    world.place("pie", pose((-1.0, 0.0, 0.03)))
    warm(world, 30)
    assert not frozen(world, "pie")
    assert not cooked(world, "pie")


def test_a_stove_that_is_on_cooks_what_is_near_its_middle() -> None:
    """On it, not beside it, and not while it is off."""
    at = {"near": placed("hotdog", 1.5, 0.0, 0.46), "far": placed("hotdog", 1.5, 0.9, 0.46)}
    world = small_world(at, stove_1=STOVE)
    warm(world, 5)
    assert not cooked(world, "near")
    world.turn("stove_1", True)
    warm(world, 5)
    assert cooked(world, "near")
    assert not cooked(world, "far")


def test_how_warm_things_are_is_saved() -> None:
    """As JSON; a world that goes on from it goes on alike."""
    at = {"dog": placed("hotdog", 1.5, 0.0, 0.46)}
    first, second = small_world(at, stove_1=STOVE), small_world(at, stove_1=STOVE)
    first.turn("stove_1", True)
    warm(first, 1)
    second.restore(json.loads(json.dumps(first.save())))
    warm(first, 1)
    warm(second, 1)
    assert second.heat("dog") == first.heat("dog")


def test_what_heat_does_nothing_to_costs_nothing_and_stays_as_the_room() -> None:
    """A world without such things follows none, and asks nothing of itself."""
    world = small_world({"can": placed("can_of_soda", 0.9, 0.0)}, fridge_1=FRIDGE)
    world.robot.act(np.zeros(ACTION_SIZE))
    world.step()
    heat, kind = world.heat("can")
    assert (heat.now_c, kind) == (ROOM_C, Thermal())
    assert world.save()["heat"] == {}


def test_every_thing_that_can_be_cooked_is_cooked_by_some_source() -> None:
    """Each entry's threshold is below what one of the catalogue's own sources brings things to."""
    hottest = max(settles_at([entry.source]) for entry in CATALOGUE if entry.source is not None)
    for entry in CATALOGUE:
        if entry.heat is not None and entry.heat.cooked_c is not None:
            assert entry.heat.cooked_c < hottest, entry.name
            assert "cookable" in entry.abilities, entry.name
