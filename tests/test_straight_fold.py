"""Arms that no model plans go straight to their travel posture: slowly, and not with something in the hand."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.straight_fold import StraightFold
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.testing import KinematicWorld


def folded(world: KinematicWorld) -> Array:
    """(n, A) the commands of a fold, carried out."""
    fold, told = StraightFold(world.robot), [world.robot.action]
    fold.start()
    while not fold.step():
        told.append(world.robot.action)
        world.step()
        assert len(told) < 60 * CONTROL_HZ
    return np.array(told)


def test_joints_go_straight_and_slowly_to_the_travel_posture() -> None:
    """No joint goes faster than a third of what it can, the base stands, and all arrive at once."""
    world = KinematicWorld(R1)
    told = folded(world)
    body = world.robot.proprioception()
    assert np.allclose(body.torso, R1.travel_torso)
    assert all(np.allclose(body.arm[side], R1.travel_arm[side]) for side in R1.sides)
    speed = np.abs(np.diff(told[:, R1.layout.joints], axis=0)) * CONTROL_HZ
    assert (speed <= np.concatenate([R1.torso_top_speed, *R1.arm_top_speed.values()]) / 3).all()
    assert not R1.layout.velocity(told).any()
    assert len(folded(world)) == 1  # it is there already


def test_an_arm_that_holds_something_stays() -> None:
    """Its joints keep their targets while the other arm folds."""
    world = KinematicWorld(R1)
    world.robot.between_m = {"left": 0.0, "right": 0.06}
    action = world.robot.action
    action[R1.layout.gripper["right"]] = -1.0
    for _ in range(CONTROL_HZ):
        world.robot.act(action)
        world.step()
    assert world.robot.proprioception().holds("right")
    folded(world)
    body = world.robot.proprioception()
    assert not body.arm["right"].any()
    assert np.allclose(body.arm["left"], R1.travel_arm["left"])
    assert body.gripper_command["right"] == -1.0
