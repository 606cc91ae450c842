"""Making a little room: back, or obliquely back where something stands in the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mpvi_bt.manipulation.carry import back_off, step_back
from mpvi_bt.manipulation.truth import TrueScene
from mpvi_bt.manipulation.work import Work
from mpvi_bt.robot.motion import Actions, Motion
from mpvi_bt.robot.solids import Array
from tests.small_house import placed, small_world

BEHIND = {side: placed("carton_of_milk", -0.58, y) for side, y in (("left", 0.2), ("right", -0.2))}


def backed_off(*sides: str, by: Callable[[Work], Actions] = back_off) -> Array:
    """Where the base goes (3,) from the origin with cartons behind it on these sides."""
    world = small_world({side: BEHIND[side] for side in sides})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in by(work):
        world.step(action)
        work.motion.felt = world.robot.proprioception()
    return np.asarray(work.motion.felt.base_pose)


@pytest.mark.parametrize(("side", "away"), [("left", -1.0), ("right", 1.0)])
def test_what_stands_behind_on_one_side_is_passed_on_the_other(side: str, away: float) -> None:
    """It goes about as far back as in the open, away from what straight back would be too near to."""
    assert backed_off()[0] == pytest.approx(-0.35, abs=0.02)
    x, y, yaw = backed_off(side)
    assert x < -0.28
    assert y * away > 0.05
    assert yaw == pytest.approx(0.0, abs=0.03)


def test_between_things_it_goes_less_far() -> None:
    """With something on both sides it goes straight, as far as that is clear."""
    x, y, _ = backed_off("left", "right")
    assert -0.25 < x < -0.1
    assert abs(y) < 0.02


def test_close_before_something_it_goes_aside() -> None:
    """What stands right behind it bars every way that is nearly straight: it slips past, still facing ahead."""
    world = small_world({"box": placed("carton_of_milk", -0.4, 0.0)})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in back_off(work):
        world.step(action)
        work.motion.felt = world.robot.proprioception()
    x, y, yaw = work.motion.felt.base_pose
    assert -0.3 < x < -0.1
    assert abs(y) > 0.2
    assert yaw == pytest.approx(0.0, abs=0.03)


def test_a_step_back_ends_before_what_stands_there() -> None:
    """After a failure the robot steps back in the open; with its back to something it stays where it is."""
    assert backed_off(by=step_back)[0] == pytest.approx(-0.15, abs=0.02)
    world = small_world({"box": placed("carton_of_milk", -0.45, 0.0)})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert not list(step_back(work))
