"""Containers are taken with what is in them."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.hands.motion.approach import approach
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.pick import options
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import placed, small_world


def test_what_is_in_a_container_does_not_keep_hands_off_it() -> None:
    """There is a stance to take a sack by its handle from, with a tall carton in it as without."""
    inside = {"sack": placed("sack", 0.75, 0.0, 0.741), "milk": placed("carton_of_milk", 0.83, 0.05, 0.748)}
    world = small_world(inside, desk="{entry: desk, at: [0.85, 0.0], yaw_deg: 180}")
    world.settle(0.3)
    assert world.within("sack") == ["milk"]
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    try:
        for _ in approach(work, "left", "sack", lambda: options(work, "sack"), []):
            break  # it drives there
    except StopIteration as found:
        assert found.value[0] is not None
