"""A server of BEHAVIOR's that holds still, and the r1pro in the simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.remote.dialect_settings import load_settings
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.house.sim.world import SimWorld
from tests.layouts import ACTION_SIZE, LAYOUT
from tests.remote_servers import PolicyServer
from tests.small_house import placed, small_world

REST = np.zeros(ACTION_SIZE, np.float32)  # BEHAVIOR's start: trunk, hanging arms, open hands
REST[LAYOUT.torso] = [1.025, -1.45, -0.47, 0.0]
REST[[LAYOUT.gripper[side] for side in SIDES]] = 1.0
STEPS, CALLS = 15, 4  # actions of a chunk, and chunks: two seconds


@pytest.fixture(scope="module")
def house() -> SimWorld:
    """A table with a can before an r1pro that stands as an episode begins."""
    things = {"can_1": placed("can_of_soda", 1.6, 0.1, 0.9)}
    world = small_world(things, render=True, robot=R1PRO, table="{entry: breakfast_table, at: [1.6, 0.0]}")
    world.settle()
    return world


@pytest.mark.render
@pytest.mark.parametrize("name", ["openpi_comet", "behavior_2025", "behavior_2026"])
def test_a_server_that_holds_still_leaves_the_robot_in_its_posture(name: str, house: SimWorld) -> None:
    """After two seconds of BEHAVIOR's rest posture the r1pro stands in it, and its head sees what it saw before."""
    settings = load_settings(name)

    def answer(message: Any) -> Any:
        return None if "reset" in message else {settings.action.key: np.tile(REST, (STEPS, 1))}

    with PolicyServer(answer) as server:
        policy = OpenpiPolicy(server.address, settings)
        before, start = house.robot.proprioception(), house.robot.look("head")
        policy.reset()
        for _ in range(CALLS):
            images = {camera: house.robot.look(camera) for camera in policy.cameras}
            felt = house.robot.proprioception()
            for action in policy.infer({"prompt": "wait", "proprioception": felt, "images": images}):
                house.robot.act(action)
                house.step()
        after, end = house.robot.proprioception(), house.robot.look("head")
    np.testing.assert_allclose(after.torso, REST[LAYOUT.torso], atol=1e-3)
    np.testing.assert_allclose(after.base_pose, before.base_pose, atol=1e-4)
    for side in SIDES:
        np.testing.assert_allclose(after.arm[side], 0.0, atol=1e-2)
        assert after.gripper_width[side] == pytest.approx(0.10, abs=1e-3)
    assert start.rgb.std() > 10
    assert (np.abs(start.rgb.astype(int) - end.rgb).max(axis=2) > 2).mean() < 1e-3


@pytest.mark.render
def test_velocities_of_trunk_and_hands_are_felt(house: SimWorld) -> None:
    """They are how far joints and fingers go in a step, by its time, while a trunk rises and hands close."""
    for step in range(8):
        before, rising = house.robot.proprioception(), REST.astype(float)
        rising[LAYOUT.torso] += 0.01 * step * np.array([-1, 1, 1, -1])
        rising[[LAYOUT.gripper[side] for side in SIDES]] -= 0.05 * step
        house.robot.act(rising)
        house.step()
    after = house.robot.proprioception()
    moved = (after.torso - before.torso) * CONTROL_HZ
    assert np.abs(moved).min() > 0.1
    np.testing.assert_allclose((before.torso_velocity + after.torso_velocity) / 2, moved, rtol=0.2)
    for side in SIDES:
        closed = (after.gripper_width[side] - before.gripper_width[side]) * CONTROL_HZ
        assert closed < -0.02
        assert 1.5 * closed < after.gripper_velocity[side] < 0.3 * closed  # fingers go by fits and starts within a step
