"""Pressing switches: from where a finger comes, and that things are really turned on and off."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.seen import Seen
from mpvi_bt.ground.robot.motion import Motion, MotionFailure
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.press import options, press
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.layouts import LAYOUT
from tests.small_house import placed, run, small_world
from tests.test_open import play

TABLE = "{entry: table, at: [0.9, 0.0], yaw_deg: 180}"
COUNTER = "{entry: counter, at: [1.05, 0.0], yaw_deg: 180}"
FIXTURES: dict[str, Any] = {
    "floor lamp": {"thing": "{entry: floor_lamp, at: [0.9, 0.0], yaw_deg: 180}"},
    "microwave": {"c": COUNTER, "thing": "{entry: microwave, at: [1.0, 0.0], yaw_deg: 180, z_m: 0.901}"},
    "stove": {"c": COUNTER, "thing": "{entry: stove, at: [1.05, 0.0], yaw_deg: 180, z_m: 0.901}"},
    "kitchen sink": {"thing": "{entry: kitchen_sink, at: [1.0, 0.0], yaw_deg: 180}"},
    "television": {"t": TABLE, "thing": "{entry: television, at: [0.9, 0.0], yaw_deg: 180, z_m: 0.721}"},
}


def radio(yaw: float = 0.5) -> SimWorld:
    return small_world({"radio": placed("radio_receiver", 0.8, 0.1, 0.721, yaw)}, base=(-0.2, 0.1, 0.1), t=TABLE)


def test_a_finger_comes_from_outside_and_ends_in_the_switch() -> None:
    """Every way begins well off the thing, points against the switch, and ends with the fingertips in it."""
    world = radio()
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    T = world.switches("radio")[0]
    for option in options(work, "radio"):
        short, touch = option.waypoints
        assert (short[:3, 3] - T[:3, 3]) @ T[:3, 2] > 0.05
        assert touch[:3, 2] @ T[:3, 2] < -0.7
        assert np.linalg.norm(touch[:3, 3] + 0.012 * touch[:3, 2] - T[:3, 3]) < 0.02


def test_what_has_no_switch_says_so() -> None:
    """A table cannot be pressed."""
    world = radio()
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    with pytest.raises(MotionFailure, match="no_switch"):
        options(work, "t")


@pytest.mark.parametrize("words", [{}, {"object": ""}, {"object": "button"}], ids=str)
def test_a_call_that_names_nothing_known_fails_and_does_not_break(words: dict[str, str]) -> None:
    """Whatever the phrases of a skill's file leave out."""
    world = radio()
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    with pytest.raises(MotionFailure, match="unknown_object"):
        next(iter(press(work, words, [])))


@pytest.mark.parametrize(("on", "prompt"), [(True, "turn on the radio"), (False, "turn the radio off")])
def test_what_is_so_already_is_left(on: bool, prompt: str) -> None:
    """Asked to turn on what is on, the robot does not move."""
    world = radio()
    world.turn("radio", on)
    before = world.robot.proprioception()
    assert play(world, prompt, limit_s=3.0)[-1] == "done"
    assert world.toggled_on("radio") is on
    np.testing.assert_allclose(world.robot.proprioception().base_pose, before.base_pose, atol=0.01)


@pytest.mark.render
@pytest.mark.parametrize("name", ["television", "floor lamp"])
def test_a_seen_switch_is_known_and_may_be_touched(name: str) -> None:
    """Of a screen only the foot may be known as a solid, of a lamp the shade: the switch is theirs all the same.

    A hand that comes straight from outside is clear of everything up to the touch.
    """
    world = small_world(base=(-0.2, 0.1, 0.0), render=True, **FIXTURES[name])
    seen = Seen(SegmentationDetector({"thing": (name,)}, least_px=1))
    seen.forget((name,))
    work = Work(seen, Motion(world.robot.proprioception()), np.random.default_rng(0))
    action = world.robot.action
    for tilt in (0.3, 0.6):
        action[LAYOUT.torso] = [0.42, 0.0, 0.0, tilt]
        run(world, action, 1.0)
        seen.feel(world.robot.proprioception())
        seen.see({"head": world.robot.look("head")}, world.robot.proprioception())
    work.motion.felt = world.robot.proprioception()
    thing = work.nearest(name)  # what is seen of a lamp may fall apart into two things
    (T,) = seen.switches(thing)
    (true,) = world.switches("thing")
    assert np.linalg.norm((T - true)[:3, 3]) < 0.02
    assert T[:3, 2] @ true[:3, 2] > 0.9
    search = work.search("right", {thing})
    assert any(search.fits(option) for option in options(work, thing))


@pytest.mark.slow
@pytest.mark.parametrize("prompt", ["turn on the radio", "press the power button of the radio"])
def test_a_loose_radio_is_turned_on_where_it_stands(prompt: str) -> None:
    """The radio is on in the end, and has hardly moved."""
    world = radio()
    world.settle(0.3)
    before = world.pose("radio")
    assert play(world, prompt)[-1] == "done"
    assert world.toggled_on("radio")
    assert np.linalg.norm((world.pose("radio") - before)[:3, 3]) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("name", FIXTURES)
def test_fixtures_are_turned_on_and_off(name: str) -> None:
    """One press turns it on, the next one off."""
    world = small_world(base=(-0.2, 0.2, 0.0), **FIXTURES[name])
    world.settle(0.3)
    assert play(world, f"turn on the {name}")[-1] == "done"
    assert world.toggled_on("thing")
    assert play(world, f"turn the {name} off")[-1] == "done"
    assert not world.toggled_on("thing")
