"""Blades in a world: halves and dice appear where the whole one was, are saved, and cost nothing where nothing cuts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import bounds
from mpvi_bt.house.sim.future import future
from mpvi_bt.house.sim.world import Placement, SimWorld
from tests.layouts import ACTION_SIZE
from tests.small_house import CATALOGUE, placed, run, small_house, small_world

STILL = np.zeros(ACTION_SIZE)
HALVES = ["half__log.n.01_1", "half__log.n.01_2"]


def world_of(objects: dict[str, Placement]) -> SimWorld:
    """A world in which all may come to be that the catalogue has of its objects."""
    later = future(CATALOGUE, {name: placement.entry for name, placement in objects.items()})
    return SimWorld(small_house(), objects, np.array([-1.5, 0.0, 0.0]), render=False, future=later)


def an_ax_over_a_log(height_m: float = 0.079) -> SimWorld:
    """Its blade falls onto the middle of the log."""
    return world_of({"ax": placed("ax", 0.9, 0.0, height_m), "log.n.01_1": placed("log", 1.09, 0.0)})


def test_a_log_falls_into_two_halves_where_it_lay() -> None:
    """The whole one is gone; together they are about as large, and move like it."""
    world = an_ax_over_a_log()
    before = bounds(world.solids("log.n.01_1"))
    assert not any(map(world.exists, HALVES))
    world.robot.act(STILL)
    world.step()
    assert [name for name in world.objects if name != "ax"] == HALVES
    assert not world.exists("log.n.01_1")
    after = bounds([solid for name in HALVES for solid in world.solids(name)])
    np.testing.assert_allclose(after, before, atol=0.01)
    known = {entry.name for entry in world.knowledge()}
    assert (set(HALVES) <= known, "log.n.01_1" in known) == (True, False)


def test_what_lies_beside_a_blade_is_not_cut() -> None:
    """A thing is cut by the blade that presses on it, not by what else there is of the tool."""
    beside = world_of({"ax": placed("ax", 0.9, 0.0), "log": placed("log", 1.09, 0.1)})
    handle = world_of({"ax": placed("ax", 0.9, 0.0, 0.13), "log": placed("log", 0.9, 0.0, yaw=np.pi / 2)})
    for world in (beside, handle):
        run(world, STILL, 1.0)
        assert world.exists("log")


def test_a_blade_dices_halves_once_it_cuts_anew() -> None:
    """It does not in the two seconds after it cut a whole one; halves become as many dice as the catalogue says."""
    world = world_of({"ax": placed("ax", 0.81, 0.0, 0.068), "beet.n.02_1": placed("beet", 1.0, 0.0)})
    run(world, STILL, 0.2)
    halves = [name for name in world.objects if name.startswith("half__beet")]
    assert len(halves) == 2
    for pause_s in (0.5, 2.0):
        world.place("ax", placed("ax", 0.2, 0.8).T_world)
        run(world, STILL, pause_s)
        assert not world.grains("diced__beet.n.01")
        low, high = bounds(world.solids(halves[0]))
        at = (low + high)[:2] / 2
        world.place("ax", placed("ax", float(at[0]) - 0.19, float(at[1]), float(high[2]) + 0.001).T_world)
        run(world, STILL, 0.2)
    dice = world.grains("diced__beet.n.01")
    assert (len(dice), world.exists(halves[0])) == (2, False)
    assert all(np.linalg.norm(bounds(world.solids(die)).mean(0)[:2] - at) < 0.08 for die in dice)


def test_a_thing_that_meets_a_blade_twice_is_cut_once() -> None:
    """Half a beet is of two solids, and both press on it in the same step."""
    half = placed("half_beet", 1.19, 0.0, yaw=np.pi / 2)
    world = world_of({"ax": placed("ax", 0.94, 0.0, 0.09), "half__beet.n.02_1": half})
    run(world, STILL, 0.4)
    assert len(world.grains("diced__beet.n.01")) == 2


def test_a_cut_world_is_saved_and_goes_on_alike() -> None:
    """As JSON, into a world in which nothing was cut yet."""
    first, second = an_ax_over_a_log(), an_ax_over_a_log()
    run(first, STILL, 0.5)
    second.restore(json.loads(json.dumps(first.save())))
    assert second.objects == first.objects
    for world in (first, second):
        run(world, STILL, 0.5)
    for name in first.objects:
        np.testing.assert_allclose(second.pose(name), first.pose(name), atol=2e-3)


def test_the_same_cut_is_the_same_to_the_bit() -> None:
    """Two worlds of one start."""
    worlds = [an_ax_over_a_log(), an_ax_over_a_log()]
    for world in worlds:
        run(world, STILL, 0.5)
    assert worlds[0].save() == worlds[1].save()


def test_a_world_without_blades_saves_nothing_of_them() -> None:
    """Nor of what may come to be."""
    saved = small_world({"can": placed("can_of_soda", 0.4, 0.0)}).save()
    assert (saved["presence"], saved["blades"]) == ({}, {})


@pytest.mark.parametrize(("entry", "cooked"), [("popcorn", "cooked__popcorn.n.01"), ("softball", None)])
def test_grains_in_a_hot_vessel_are_cooked(entry: str, cooked: str | None) -> None:
    """Each by one in its place, as soon as the vessel is 40 degrees warm; what lies beside it is not."""
    stove = "{entry: stove, at: [1.5, 0.0], z_m: 0.4}"
    pan, inner = placed("frying_pan", 1.5, 0.0, 0.45), placed(entry, 1.5, 0.0, 0.47)
    objects = {"pan": pan, "popcorn.n.02_1": inner, "popcorn.n.02_2": placed(entry, 0.5, 0.5)}
    later = future(CATALOGUE, {name: placement.entry for name, placement in objects.items()})
    world = SimWorld(small_house(stove_1=stove), objects, np.array([-1.5, 0.0, 0.0]), render=False, future=later)
    run(world, STILL, 0.5)
    assert world.objects == list(objects)
    world.turn("stove_1", True)
    run(world, STILL, 2.0)
    assert world.exists("popcorn.n.02_1") is (cooked is None)
    assert world.exists("popcorn.n.02_2")
    assert (cooked is not None) == bool(world.grains(cooked or "cooked__popcorn.n.01"))
