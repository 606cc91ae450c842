"""Pressing what the other hand holds."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.press import options
from mpvi_bt.hands.skills.press_held import press_held
from mpvi_bt.house.truth.true_scene import TrueScene
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
    for action in press_held(work, "right", options(work, "sprayer")):
        known = True
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
        if away_m() < 0.1:
            break
    assert away_m() < 0.1


def test_a_switch_is_pressed_straight_on_where_the_hands_can_meet_so() -> None:
    """The fingers come onto the button of a lighter along its normal: a slanting push turns it in the hand."""
    world = small_world({"lighter": placed("cigar_lighter", 2.0, 0.0)})
    put_in_hands(world, {"right": "lighter"})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    scene, turned, on, lean = work.scene, 0, False, 1.0
    for action in press_held(work, "right", options(work, "lighter")):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
        if scene.is_on("lighter") != on:
            turned, on = turned + 1, not on
            ways = [-float(T[:3, 2] @ work.hand("left")[:3, 2]) for T in world.switches("lighter")]
            lean = float(np.arccos(max(ways)))
    assert turned == 1
    assert lean < 0.1


def test_a_switch_that_is_known_to_have_turned_is_left_at_once() -> None:
    """The hand comes hardly nearer then: one that springs back from the thing itself may turn the switch again."""
    world = small_world({"lighter": placed("cigar_lighter", 2.0, 0.0)})
    put_in_hands(world, {"right": "lighter"})
    scene = TrueScene(world)
    work = Work(scene, Motion(world.robot.proprioception()), np.random.default_rng(0))
    away_m = []
    for action in press_held(work, "right", options(work, "lighter")):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
        if scene.is_on("lighter"):
            away_m.append(min(float(norm((work.hand("left") - T)[:3, 3])) for T in world.switches("lighter")))
    assert away_m[0] - min(away_m) < 0.008
