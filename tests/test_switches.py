"""Switches: a fingertip that stays on one for five steps turns the thing on or off, once."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.goals.predicates import toggled_on
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.states.switches import PRESSED_STEPS, SWITCH_M
from mpvi_bt.house.things.catalogue import CatalogueEntry
from tests.small_house import CATALOGUE, placed, small_world

AWAY = np.full((4, 3), 9.0)


def radio_world(render: bool = False) -> SimWorld:
    return small_world({"radio": placed("radio_receiver", 0.8, 0.0, 0.001, yaw=0.7)}, render=render)


def fingers(world: SimWorld, off_m: float, name: str = "radio") -> Array:
    """Fingertips of which one is so far out of the thing's switch."""
    T = world.switches(name)[0]
    tips = AWAY.copy()
    tips[2] = T[:3, 3] + off_m * T[:3, 2]
    return tips


def touch(world: SimWorld, tips: Array) -> None:
    """One control step with fingertips there, and the hands that they are of."""
    world._switches.step(tips, lambda: tips)


def test_a_fingertip_on_it_for_five_steps_turns_it() -> None:
    """Four steps do nothing, the fifth turns it on, and staying on it does nothing more."""
    world = radio_world()
    for _ in range(PRESSED_STEPS - 1):
        touch(world, fingers(world, 0.01))
    assert not world.toggled_on("radio")
    for _ in range(50):
        touch(world, fingers(world, 0.01))
        assert toggled_on(world, "radio")


def test_it_turns_again_only_after_the_finger_left() -> None:
    """Leaving for one step is enough, and then five steps turn it off."""
    world = radio_world()
    for steps, on in ((PRESSED_STEPS, True), (PRESSED_STEPS, False), (PRESSED_STEPS, True)):
        for _ in range(steps):
            touch(world, fingers(world, 0.0))
        assert world.toggled_on("radio") is on
        touch(world, AWAY)


def test_a_brush_or_a_miss_does_nothing() -> None:
    """Steps on it that are interrupted do not add up; 3 cm away is not on it."""
    world = radio_world()
    for k in range(40):
        touch(world, AWAY if k % 4 == 3 else fingers(world, 0.0))
        touch(world, fingers(world, SWITCH_M + 0.001))
    assert not world.toggled_on("radio")


def press(world: SimWorld, name: str) -> None:
    """A fingertip on the thing's switch for long enough, and then off."""
    for _ in range(PRESSED_STEPS):
        touch(world, fingers(world, 0.0, name))
    touch(world, AWAY)


CLOSED_ONLY = {"dishwasher.n.01", "microwave.n.02", "washer.n.03"}  # BEHAVIOR's `requires_closed`
APPLIANCES = [e for e in CATALOGUE if {"openable", "toggleable"} <= set(e.abilities)]


@pytest.mark.parametrize("entry", APPLIANCES, ids=lambda e: e.name)
@pytest.mark.parametrize(("opened", "kept"), [(0.0, True), (0.049, True), (0.051, False), (1.0, False)])
def test_some_appliances_run_only_while_they_are_closed(entry: CatalogueEntry, opened: float, kept: bool) -> None:
    """One that is open past 5 % is not turned on, and one that is on goes off when it is opened, and stays off."""
    world = small_world(it=f"{{entry: {entry.name}, at: [2, 0], yaw_deg: 180}}")
    door = entry.description.bodies[1].name
    runs = kept or entry.synset not in CLOSED_ONLY
    world.set_opening("it", door, opened)
    press(world, "it")
    assert toggled_on(world, "it") is runs
    world.set_opening("it", door, 0.0)
    world.turn("it", True)
    world.set_opening("it", door, opened)
    touch(world, AWAY)
    assert toggled_on(world, "it") is runs
    world.set_opening("it", door, 0.0)
    touch(world, AWAY)
    assert toggled_on(world, "it") is runs


def test_what_is_on_is_saved_and_restored() -> None:
    """A saved world, through JSON, comes back with the same things on; one saved before there were switches, off."""
    world = radio_world()
    world.turn("radio", True)
    saved = json.loads(json.dumps(world.save()))
    world.turn("radio", False)
    world.restore(saved)
    assert world.toggled_on("radio")
    del saved["on"]
    other = radio_world()
    other.restore(saved)
    assert not other.toggled_on("radio")


def test_only_what_has_a_switch_can_be_turned() -> None:
    """A name that has no switch is told, with the nearest that has one; it is never on."""
    world = small_world({"radio": placed("radio_receiver", 0.8, 0.0), "can": placed("can_of_soda", 0.8, 0.5)})
    with pytest.raises(UnknownName, match="radio"):
        world.turn("radyo", True)
    with pytest.raises(UnknownName):
        world.turn("can", True)
    assert not world.toggled_on("can")
    assert not world.switches("can")


@pytest.mark.parametrize("entry", [e for e in CATALOGUE if "toggleable" in e.abilities], ids=lambda e: e.name)
def test_what_can_be_toggled_has_a_switch_in_reach(entry: object) -> None:
    """Every toggleable thing has a switch on its outside, in front or on top; one that works in a hand anywhere."""
    shape = CATALOGUE[entry.name]  # type: ignore[attr-defined]
    held = shape.sprays is not None or (shape.source is not None and shape.mass_kg is not None)
    description = CATALOGUE[entry.name].description  # type: ignore[attr-defined]
    switches = [s for b in description.bodies for s in b.switches]
    assert switches
    boxes = [solid.aabb() for solid in description.solids()]
    for s in switches:
        assert held or s.outward[0] > 0.99 or s.outward[2] > 0.99
        before = s.center + s.outward * 0.01
        assert not any((before > low).all() and (before < high).all() for low, high in boxes)
        behind = s.center - s.outward * 0.02
        assert any((behind > low - 0.005).all() and (behind < high + 0.005).all() for low, high in boxes)


def test_a_switch_moves_with_its_thing() -> None:
    """Where a thing is put, its switch is too."""
    world = radio_world()
    before, T = world.switches("radio")[0], world.pose("radio")
    moved = T.copy()
    moved[:3, 3] += [0.1, -0.2, 0.3]
    world.place("radio", moved)
    np.testing.assert_allclose(world.switches("radio")[0][:3, 3] - before[:3, 3], [0.1, -0.2, 0.3], atol=1e-5)


@pytest.mark.render
def test_cameras_see_whether_it_is_on() -> None:
    """A switch has a label of its own, which a detector finds by its thing's name; off is red, on is green."""
    world = radio_world(render=True)
    world.settle(0.2)
    at = world.switches("radio")[0][:3, 3]
    T = np.eye(4)
    T[:3, :3] = np.array([[0.0, -0.7071, 0.7071], [-1.0, 0, 0], [0, -0.7071, -0.7071]])
    T[:3, 3] = at + [-0.25, 0, 0.25]
    detector = SegmentationDetector({"radio": ["radio"]})
    for on in (False, True):
        world.turn("radio", on)
        image = world.look_from(T, (160, 120), 0.6)
        (found,) = detector.detect(image, ["switch of the radio"])
        red, green, _ = image.rgb[found.mask].mean(0)
        assert (green > red) is np.bool_(on)
        assert np.linalg.norm(np.nanmean(image.points_world()[found.mask], axis=0) - at) < 0.01
        (radio,) = detector.detect(image, ["radio"])
        assert radio.mask is not None
        assert found.mask is not None
        assert not (radio.mask & found.mask).any()
