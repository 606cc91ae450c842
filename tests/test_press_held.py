"""Pressing what the other hand holds."""

from __future__ import annotations

import numpy as np

from mpvi_bt.manipulation.motion.work import Work
from mpvi_bt.manipulation.skills.press import options
from mpvi_bt.manipulation.skills.press_held import press_held
from mpvi_bt.robot.linear_algebra import norm
from mpvi_bt.robot.motion import Motion
from mpvi_bt.scene.true_scene import TrueScene
from mpvi_bt.testing.full_hands import put_in_hands
from tests.small_house import placed, small_world


def test_a_hand_that_comes_to_hold_something_presses_all_the_same() -> None:
    """Empty at first, it has a can between its fingers from the first step on; it comes to the switch, can and all."""
    things = {"sprayer": placed("insectifuge_atomizer", 2.0, 0.0), "can": placed("can_of_soda", 2.0, 1.0)}
    world = small_world(things)
    put_in_hands(world, {"right": "sprayer", "left": "can"})
    scene, known = TrueScene(world), False
    scene.holding = lambda side: world.holding(side) if known or side == "right" else None
    work = Work(scene, Motion(world.robot.proprioception()), np.random.default_rng(0))

    def away_m() -> float:
        return float(norm((work.hand("left") - world.switches("sprayer")[0])[:3, 3]))

    assert away_m() > 0.2
    for action in press_held(work, "right", [option.waypoints for option in options(work, "sprayer")]):
        known = True
        world.step(action)
        work.motion.felt = world.robot.proprioception()
        if away_m() < 0.1:
            break
    assert away_m() < 0.1
