"""Marks in a world: where they sit, who sees them, and what a washer does to them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.house.sim.world import Placement, SimWorld
from tests.small_house import CATALOGUE, placed, small_world

WASHER = "{entry: washer, at: [1.5, 0.0], yaw_deg: 180}"
DUST, RUST = "dust.n.01", "rust.n.01"


def a_ball_in_a_washer() -> SimWorld:
    """Both kinds of marks are on the ball and on the can beside the washer."""
    drum = small_world(washer_1=WASHER).volumes("washer_1")[0]
    inner = Placement(CATALOGUE["tennis_ball"], pose(drum.T[:3, 3]))
    world = small_world({"ball": inner, "can": placed("can_of_soda", 0.4, 0.0)}, washer_1=WASHER)
    for name in ("ball", "can"):
        for kind in (DUST, RUST):
            world.mark(name, kind)
    return world


def test_a_washer_takes_its_kinds_off_what_is_in_it_as_it_begins() -> None:
    """Not before it is on, not what is beside it, and no kind that is not on its list."""
    world = a_ball_in_a_washer()
    world._marking.step(world)
    assert world.covered("ball", DUST)
    world.turn("washer_1", True)
    world._marking.step(world)
    assert (world.covered("ball", DUST), world.covered("ball", RUST)) == (False, True)
    assert world.covered("can", DUST)
    world.mark("ball", DUST)
    world._marking.step(world)
    assert world.covered("ball", DUST)  # it runs already


def test_marks_lie_on_the_thing_and_are_the_same_at_each_call() -> None:
    """Within the box about it, at its surface."""
    world = small_world({"teddy": placed("teddy", 0.4, 0.0)})
    solids = list(CATALOGUE["teddy"].description.solids())
    first, again = (world._marking.put("teddy", DUST, world.solids("teddy")) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    low, high = (f(np.stack([s.aabb() for s in solids])[:, k], axis=0) for f, k in ((np.min, 0), (np.max, 1)))
    assert ((first >= low - 1e-9) & (first <= high + 1e-9)).all()


def test_marks_are_saved_and_a_clean_world_saves_none() -> None:
    """As JSON; what was washed stays clean in a world that goes on from it."""
    world, other = a_ball_in_a_washer(), a_ball_in_a_washer()
    world.turn("washer_1", True)
    world._marking.step(world)
    other.restore(json.loads(json.dumps(world.save())))
    assert [other.covered("ball", kind) for kind in (DUST, RUST)] == [False, True]
    clean = small_world({"can": placed("can_of_soda", 0.4, 0.0)})
    clean.step()
    assert clean.save()["marks"] == {}
    assert not clean.covered("can", DUST)


def test_what_is_not_there_cannot_be_marked() -> None:
    """The error names the nearest."""
    with pytest.raises(UnknownName, match="unknown thing 'cann'"):
        small_world({"can": placed("can_of_soda", 0.4, 0.0)}).mark("cann", DUST)


@pytest.mark.render
def test_marks_are_seen_until_they_are_washed_off() -> None:
    """A picture of a dusty ball has dots, labeled as the ball; once it is clean the picture is as it was."""
    world = small_world({"ball": placed("tennis_ball", 1.0, 0.0)}, render=True)
    before = world.robot.look("head")
    world.mark("ball", DUST)
    dusty = world.robot.look("head")
    assert before.rgb is not None
    assert dusty.rgb is not None
    changed = (before.rgb != dusty.rgb).any(-1)
    assert changed.any()
    assert dusty.labels is not None
    assert {dusty.names.get(int(label)) for label in np.unique(dusty.labels[changed])} == {"ball"}
    world._marking.restore({})
    np.testing.assert_array_equal(world.robot.look("head").rgb, before.rgb)
