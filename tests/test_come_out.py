"""A skill that begins where another one was cut short: an arm that is out is folded first."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Proprioception, Side
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.expert import ExpertPolicy
from tests.small_house import placed, small_world


def told(world: SimWorld, expert: ExpertPolicy, prompt: str) -> Proprioception:
    """What is felt after one step with a prompt."""
    felt = world.robot.proprioception()
    world.robot.act(expert.infer({"prompt": prompt, "proprioception": felt, "images": {}})[0])
    world.step()
    return world.robot.proprioception()


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
def test_an_arm_that_is_out_is_folded_before_the_base_drives(side: Side) -> None:
    """Told of a cup as its fingers close around a can, it draws them off the can, folds, and drives to the cup."""
    things = {"can": placed("can_of_soda", 0.55, 0.0, 0.76), "cup": placed("cup", -0.7, -0.9)}
    world = small_world(things, (-0.2, 0.0, 0.0), table_1="{entry: table, at: [0.9, 0.0]}")
    world.settle()
    expert = ExpertPolicy(world, load_skills())
    for _ in range(30 * CONTROL_HZ):
        felt = told(world, expert, f"pick up the can of soda with the {side} hand")
        if world.time_s > 3.0 and felt.gripper_command[side] < 0.9:
            break
    assert np.abs(felt.arm[side] - R1.travel_arm[side]).max() > 0.5
    stood, lay = felt.base_pose[:2], world.pose("can")[:3, 3]
    while np.linalg.norm(told(world, expert, "pick up the cup").base_pose[:2] - stood) < 0.15:
        assert world.time_s < 60.0
    felt = world.robot.proprioception()
    assert all(np.abs(felt.arm[s] - R1.travel_arm[s]).max() < 0.05 for s in SIDES)
    np.testing.assert_allclose(world.pose("can")[:3, 3], lay, atol=0.015)
