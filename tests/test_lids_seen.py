"""Lids told from points of known things: where they hang, how far they are open, and what they leave open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.finding.shapes.box_lids import lid
from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.moving_parts import lid as is_lid
from mpvi_bt.ground.geometry.solids import Solid, pose
from mpvi_bt.hands.skills.open import behind
from tests.small_house import placed, small_world
from tests.test_fronts import seen
from tests.test_lids import DESK, lidded

EYES = [np.array([0.0, 0.1, 1.37]), np.array([0.1, 0.7, 1.37])]
TABLE = np.array([[x, y, 0.741] for x in np.arange(0.5, 1.1, 0.01) for y in np.arange(-0.3, 0.3, 0.01)])


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("entry", ["toolbox", "hinged_jar"])
def test_a_closed_lid_is_told_by_its_bar(entry: str, eye: np.ndarray) -> None:
    """Bar and hinge are where they are to a centimeter, the hinge across from the bar."""
    world = lidded(entry, 0.0)
    (door,) = world.doors("thing")
    found = lid(seen(world, 0.002, eye), eye)
    assert found is not None
    assert found.bar is not None
    assert door.bar is not None
    assert is_lid(found)
    assert found.position == 0.0
    assert found.axis @ door.axis > 0.98
    assert np.linalg.norm(found.origin - door.origin) < 0.012
    assert np.linalg.norm(found.bar.center - door.bar.center) < 0.01
    assert abs(found.bar.axis @ door.bar.axis) > 0.98


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize(
    ("entry", "fraction"),
    [("toolbox", 0.3), ("toolbox", 0.6), ("toolbox", 0.9), ("hinged_jar", 0.8), ("hinged_jar", 0.95), ("laptop", 0.8)],
)
def test_an_open_lid_is_told_by_the_sheet_that_it_is(entry: str, fraction: float, eye: np.ndarray) -> None:
    """It hangs where it hangs, to one or two centimeters, and is open as far as it is."""
    world = lidded(entry, fraction)
    (door,) = world.doors("thing")
    found = lid(seen(world, 0.002, eye), eye)
    assert found is not None
    assert is_lid(found)
    assert abs(found.position - door.position) < 0.1
    assert found.axis @ door.axis > 0.98
    assert np.linalg.norm(found.origin - door.origin) < 0.02


@pytest.mark.parametrize("fraction", [0.0, 0.6, 0.9])
def test_what_a_lid_leaves_open_takes_things(fraction: float) -> None:
    """The room of an open box is that of the true one, to a few centimeters; a closed one is massive."""
    world, eye = lidded("toolbox", fraction), EYES[0]
    shape = fit(seen(world, 0.002, eye), TABLE, eye)
    assert shape is not None
    assert bool(shape.volumes) == (fraction > 0)
    for room in shape.volumes:
        (true,) = world.volumes("thing")
        assert np.abs(room.aabb() - true.aabb()).max() < 0.03


@pytest.mark.parametrize("entry", ["packing_box", "wicker_basket", "monitor", "drill"])
def test_what_has_no_lid_has_none(entry: str) -> None:
    """Neither an open box nor the hoop of a basket is a lid, nor what stands on a foot."""
    world = small_world({"thing": placed(entry, 0.75, 0.0, 0.741, np.pi)}, desk=DESK)
    assert all(lid(seen(world, 0.002, eye), eye) is None for eye in EYES)


@pytest.mark.parametrize("fraction", [0.0, 0.8])
def test_a_box_is_below_its_lid(fraction: float) -> None:
    """What is taken to be behind a lid is below where it lies, so that a hand may come from above."""
    world = lidded("toolbox", fraction)
    (true,), found = world.doors("thing"), lid(seen(world, 0.002, EYES[0]), EYES[0])
    assert found is not None
    assert behind(found).aabb()[1, 2] < true.origin[2] + 0.02


def test_what_seems_to_be_nothing_but_a_lid_is_a_thing_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plate in a hand, seen on edge, may be taken for a lid that stands open: no points are left of a body then."""
    world = lidded("toolbox", 0.0)
    points = seen(world, 0.004, EYES[0])
    up = lid(points, EYES[0])
    low, high = points.min(0), points.max(0)
    assert up is not None
    everything = Solid("box", (high - low) / 2 + 0.05, pose((low + high) / 2))
    monkeypatch.setattr("mpvi_bt.finding.shapes.fit.raised", lambda points, eye: replace(up, solids=(everything,)))
    assert fit(points, TABLE, EYES[0]) is not None
