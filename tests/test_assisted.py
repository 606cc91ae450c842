"""Assisted grasps hold what both fingers of a closing hand touch, until it opens; they are off unless asked for."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.hands.robots import r1
from mpvi_bt.house.sim.world import SimWorld
from tests.layouts import BASE, LAYOUT
from tests.small_house import placed, run, small_house


def gripping(assisted: bool) -> tuple[SimWorld, Array]:
    """A right hand that has closed on a can in midair; the world, and the action that keeps it closed."""
    objects = {"can": placed("can_of_soda", 2.0, 2.0)}
    world = SimWorld(small_house(), objects, np.zeros(3), render=False, assisted=assisted)
    world.robot.stand({"right": r1.mirrored(np.array([0.45, 0.15, 0.0, -2.0, 0.0, 0.0, 0.0]), "right")})
    action = world.robot.action
    run(world, action, 0.5)
    T = world.robot.hand_pose_world("right")
    world.place("can", pose(T[:3, 3] - [0, 0, 0.06]), fixed=True)
    action[LAYOUT.gripper["right"]] = -1.0
    run(world, action, 1.0)
    world.place("can", world.pose("can"))
    run(world, action, 0.3)
    return world, action


def shake(world: SimWorld, action: Array) -> None:
    """Spin the base to and fro."""
    for _ in range(3):
        for rate in (1.5, -1.5):
            action[BASE] = (0.0, 0.0, rate)
            run(world, action, 0.5)
    action[BASE] = 0.0
    run(world, action, 0.3)


def slip(world: SimWorld, before: Array) -> float:
    """How far the can has moved in the hand [m]."""
    now = np.linalg.inv(world.robot.hand_pose_world("right")) @ world.pose("can")
    return float(np.linalg.norm(now[:3, 3] - before[:3, 3]))


def in_hand(world: SimWorld) -> Array:
    return np.asarray(np.linalg.inv(world.robot.hand_pose_world("right")) @ world.pose("can"))


@pytest.mark.parametrize("assisted", [False, True])
def test_a_closing_hand_pinches(assisted: bool) -> None:
    """Both fingers touch the can, it is held, and it stays off the floor, assisted or not."""
    world, _ = gripping(assisted)
    assert world.pinched("right") == ["can"]
    assert world.holding("right") == "can"
    assert world.pinched("left") == []
    assert world.pose("can")[2, 3] > 0.3


def test_what_is_assisted_does_not_slip() -> None:
    """A can of lead falls out of a hand that holds it by friction, not out of one that is assisted."""
    fallen = []
    for assisted in (False, True):
        world, action = gripping(assisted)
        world._objects["can"].rigid_body.mass = 60.0
        before = in_hand(world)
        shake(world, action)
        fallen.append(slip(world, before))
    assert fallen[0] > 0.05
    assert fallen[1] < 0.02


def test_an_opening_hand_lets_go() -> None:
    """Told to open, an assisted hand drops what it held."""
    world, action = gripping(assisted=True)
    action[LAYOUT.gripper["right"]] = 1.0
    run(world, action, 1.5)
    assert world.pose("can")[2, 3] < 0.1
    assert world.holding("right") is None


def test_a_world_that_is_restored_holds_what_it_held() -> None:
    """Saved with a can in an assisted hand, dropped, and restored: the can is in hand again and does not slip."""
    world, action = gripping(assisted=True)
    saved = world.save()
    opened = action.copy()
    opened[LAYOUT.gripper["right"]] = 1.0
    run(world, opened, 1.0)
    assert world.holding("right") is None
    world.restore(saved)
    run(world, action, 0.3)
    world._objects["can"].rigid_body.mass = 60.0
    before = in_hand(world)
    shake(world, action)
    assert slip(world, before) < 0.02


def test_an_open_hand_attaches_nothing() -> None:
    """What an open hand only brushes against stays loose."""
    objects = {"can": placed("can_of_soda", 2.0, 2.0)}
    world = SimWorld(small_house(), objects, np.zeros(3), render=False, assisted=True)
    T = world.robot.hand_pose_world("right")
    world.place("can", pose(T[:3, 3] - [0, 0, 0.06]))
    run(world, world.robot.action, 2.0)
    assert world.pose("can")[2, 3] < 0.2


def test_only_what_moves_can_be_placed() -> None:
    """An unknown thing, a fixture's missing door: the names that would do are told."""
    world = SimWorld(small_house(box_1="{entry: base_cabinet, at: [1.5, 0]}"), {}, np.zeros(3), render=False)
    with pytest.raises(UnknownName, match="movable thing"):
        world.place("box_1", np.eye(4))
    with pytest.raises(UnknownName, match="thing 'chest'"):
        world.set_opening("chest", "door", 0.5)
    with pytest.raises(UnknownName, match="door"):
        world.set_opening("box_1", "dor", 0.5)
    world.set_opening("box_1", "door", 0.5)
    assert world.joint_fractions("box_1") == pytest.approx([0.5])
