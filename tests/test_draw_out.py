"""What stands against a wall: swung out so that a finger fits behind it."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.ground.robot.motion import Motion, MotionFailure
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.draw_out import draw_out, options
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import CATALOGUE, placed, small_world

WALL_X = 2.95
TABLE = "{entry: table, at: [2.69, 0.0], yaw_deg: 180, shape: {size_m: [0.5, 1.0, 0.7]}}"


def box_at(x: float) -> SimWorld:
    """A box on a table at the wall, its back along the wall, and a robot before it."""
    world = small_world({"box": placed("box_of_oatmeal", x, 0.0, 0.701)}, (1.9, 0.0, 0.0), table_1=TABLE)
    world.settle()
    return world


def work(world: SimWorld) -> Work:
    return Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))


def test_only_what_stands_against_something_is_swung_out() -> None:
    """There are ways to swing a box out at a wall, and none where a finger fits behind it."""
    assert options(work(box_at(WALL_X - 0.036)), "box")
    with pytest.raises(MotionFailure, match="no_stance"):
        options(work(box_at(WALL_X - 0.2)), "box")


def test_a_swing_goes_out_from_the_wall() -> None:
    """Every way begins beside an end of the thing, and the hand goes away from the wall."""
    for option in options(work(box_at(WALL_X - 0.036)), "box"):
        first, last = option.waypoints[1][:3, 3], option.waypoints[-2][:3, 3]
        assert abs(first[1]) > 0.07
        assert last[0] < first[0] - 0.05
        assert option.waypoints[:, 0, 3].max() < WALL_X


def test_what_is_too_low_to_fall_over_is_swung_out_too() -> None:
    """A bar along a wall, hardly higher than a finger's pad, is pushed on where the finger does not slip over it."""
    bar = CATALOGUE["box_of_oatmeal"].reshaped({"size_m": [0.034, 0.3, 0.028]})
    world = small_world({"box": Placement(bar, pose((WALL_X - 0.018, 0.0, 0.001)))}, (1.9, 0.0, 0.0))
    world.settle()
    found = options(work(world), "box")
    assert found
    for option in found:
        assert option.waypoints[1][2, 3] - 0.012 < 0.028 - 0.008


@pytest.mark.slow
def test_a_box_at_a_wall_is_swung_out_and_goes_on_standing() -> None:
    """One end comes away from the wall by a third of a right angle at least; it does not fall over."""
    world = box_at(WALL_X - 0.036)
    task = work(world)
    before = world.pose("box")
    for action in draw_out(task, "box", "right"):
        world.robot.act(action)
        world.step()
        task.motion.felt = world.robot.proprioception()
    after = world.pose("box")
    assert np.arccos(np.clip(before[:3, 0] @ after[:3, 0], -1, 1)) > np.pi / 6
    assert after[2, 2] > 0.99
    assert after[2, 3] == pytest.approx(before[2, 3], abs=0.003)
