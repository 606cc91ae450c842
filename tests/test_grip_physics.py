"""How soon a hand notices in physics that it holds nothing."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.ground.robot.grip import GripWatch
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, EMPTY_M
from mpvi_bt.house.sim.world import SimWorld
from tests.layouts import LAYOUT
from tests.small_house import placed, small_world

SOON_S = 0.5
CLOSE_S = 0.6  # at the pace of our skills
FAR = pose((2.0, 2.0, 0.001))


def close(world: SimWorld, watch: GripWatch, seconds: float) -> list[tuple[float, str]]:
    """Close the right hand evenly and hold; when [s] after that began what was noticed, and when it was first shut."""
    found: list[tuple[float, str]] = []
    action, shut = world.robot.action, False
    for step in range(1, round(seconds * CONTROL_HZ) + 1):
        action[LAYOUT.gripper["right"]] = max(-1.0, 1.0 - 2.0 * step / (CLOSE_S * CONTROL_HZ))
        world.robot.act(action)
        world.step()
        felt = world.robot.proprioception()
        found += [(step / CONTROL_HZ, kind) for kind, side in watch.update(felt) if side == "right"]
        if not shut and felt.gripper_width["right"] < EMPTY_M:
            shut = True
            found.append((step / CONTROL_HZ, "shut"))
    return found


def test_an_empty_grasp_is_noticed_within_half_a_second() -> None:
    """After the fingers have met, and not before."""
    world = small_world()
    world.settle()
    found = close(world, GripWatch(world.robot.proprioception()), 3.0)
    assert sorted(kind for _, kind in found) == ["empty", "shut"]
    times = {kind: at_s for at_s, kind in found}
    assert 0 <= times["empty"] - times["shut"] < SOON_S
    assert times["empty"] < CLOSE_S + SOON_S


@pytest.mark.parametrize("entry", ["can_of_soda", "coffee_cup"])
def test_a_lost_grasp_is_noticed_within_half_a_second(entry: str) -> None:
    """From the moment at which the thing is gone."""
    world = small_world({"thing": placed(entry, 2.0, 2.0)})
    world.settle()
    T = np.eye(4)
    T[:3, 3] = world.robot.hand_pose_world("right")[:3, 3] - [0, 0, 0.05]
    world.place("thing", T, fixed=True)
    watch = GripWatch(world.robot.proprioception())
    assert close(world, watch, 1.5) == [], "it is held"
    assert world.robot.proprioception().holds("right")
    world.place("thing", FAR)
    action = world.robot.action
    for step in range(1, 60):
        world.robot.act(action)
        world.step()
        if kinds := [kind for kind, side in watch.update(world.robot.proprioception()) if side == "right"]:
            assert kinds == ["lost"]
            assert step / CONTROL_HZ < SOON_S
            return
    pytest.fail("nothing was noticed")
