"""Another robot's joints as an R1Pro's, and back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.hands.behavior_robot.retargeting import as_r1pro, from_r1pro
from mpvi_bt.hands.robots.fetch import FETCH
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1pro import R1PRO
from tests.layouts import ACTION_SIZE, LAYOUT

REST = [1.025, -1.45, -0.47, 0.0]  # of the trunk, where an episode of BEHAVIOR begins


def body(torso: Any = (0.3, 0.0, 0.0, 0.5), arms: Any = None, robot: str = "r1") -> Proprioception:
    arms = R1.travel_arm if arms is None else arms
    return Proprioception(
        base_pose=np.zeros(3),
        base_velocity=np.zeros(3),
        torso=np.array(torso, float),
        arm=arms,
        arm_velocity={side: np.linspace(-0.5, 0.4, 7) for side in SIDES},
        gripper_width=dict.fromkeys(SIDES, 0.1),
        gripper_command=dict.fromkeys(SIDES, 1.0),
        arm_command=arms,
        torso_velocity=np.array([0.1, 0.2, -0.1, 0.3]),
        robot=robot,
    )


def action(torso: Any, arms: Any) -> Any:
    out = np.zeros((1, ACTION_SIZE))
    out[:, LAYOUT.torso] = torso
    for side in SIDES:
        out[:, LAYOUT.arm[side]] = arms[side]
    return out


def test_an_r1pros_numbers_are_its_own() -> None:
    """What an R1Pro feels and is told is not touched, to the last bit."""
    felt = body(REST, dict.fromkeys(SIDES, np.linspace(0.1, 0.3, 7)), "r1pro")
    assert as_r1pro(felt) is felt
    told = action([0.4, -0.3, 0.2, 0.1], felt.arm)
    assert from_r1pro(told, felt) is told


@given(st.lists(st.floats(0.02, 0.98), min_size=14, max_size=14))
def test_hands_are_turned_alike(where: list[float]) -> None:
    """Wherever the r1's arms are, an R1Pro's with the numbers that are sent turn the hands so, and back again."""
    arms = {
        side: R1.arms[side].limits[:, 0] + np.array(part) * np.ptp(R1.arms[side].limits, axis=1)
        for side, part in zip(SIDES, (where[:7], where[7:]), strict=True)
    }
    felt = body(arms=arms)
    like = as_r1pro(felt)
    back = from_r1pro(action(like.torso, like.arm), felt)[0]
    for side in SIDES:
        hand = R1.arm(arms[side], side)[:3, :3]
        np.testing.assert_allclose(R1PRO.arm(like.arm[side], side)[:3, :3], hand, atol=1e-9)
        np.testing.assert_allclose(R1.arm(back[LAYOUT.arm[side]], side)[:3, :3], hand, atol=1e-6)
        assert np.array_equal(like.arm[side][:4], arms[side][:4])


def test_a_posture_that_is_sent_back_is_held() -> None:
    """A server that answers what it was told leaves lift, waist and arms as they are; the head looks as R1Pro's."""
    felt = body(torso=[0.42, 0.3, 0.2, 0.5])
    like = as_r1pro(felt)
    back = from_r1pro(action(like.torso, like.arm), felt)[0]
    np.testing.assert_allclose(back[LAYOUT.torso], [0.42, 0.3, 0.2, np.deg2rad(20)], atol=1e-4)
    for side in SIDES:
        np.testing.assert_allclose(back[LAYOUT.arm[side]], felt.arm[side], atol=1e-9)


def test_behaviors_rest_posture_stands_the_r1_likewise() -> None:
    """Its chest is as high, as bent and as straight ahead as R1Pro's, and its head looks as far down."""
    told = from_r1pro(action(REST, dict.fromkeys(SIDES, np.zeros(7))), body())[0]
    torso = told[LAYOUT.torso]
    ours, theirs = R1.chest(torso), R1PRO.chest(np.array(REST))
    np.testing.assert_allclose(ours[:3, :3], theirs[:3, :3], atol=1e-9)
    assert ours[2, 3] == pytest.approx(theirs[2, 3], abs=1e-9)
    np.testing.assert_allclose(R1.head_camera(torso)[:3, 2], R1PRO.head_camera(np.array(REST))[:3, 2], atol=1e-3)
    hands = [R1.arm(told[LAYOUT.arm[side]], side)[:3, :3] for side in SIDES]
    np.testing.assert_allclose(hands, [R1PRO.arm(np.zeros(7), side)[:3, :3] for side in SIDES], atol=1e-9)


def test_velocities_are_of_the_joints_that_are_sent() -> None:
    """A hundredth of a second of the velocity that is sent is how far the angles that are sent have gone then."""
    felt = body()
    arms = {side: felt.arm[side] + 0.01 * felt.arm_velocity[side] for side in SIDES}
    later = replace(felt, arm=arms, torso=felt.torso + 0.01 * felt.torso_velocity)
    moved = as_r1pro(later).torso - as_r1pro(felt).torso
    np.testing.assert_allclose(moved, 0.01 * as_r1pro(felt).torso_velocity, atol=1e-4)
    for side in SIDES:
        moved = as_r1pro(later).arm[side] - as_r1pro(felt).arm[side]
        np.testing.assert_allclose(moved, 0.01 * as_r1pro(felt).arm_velocity[side], atol=1e-4)


def test_a_hand_turns_the_nearer_way() -> None:
    """Over a chunk in which the wrist passes through straight, no joint of it jumps."""
    arms = {side: R1.travel_arm[side] for side in SIDES}
    chunk = np.repeat(action(REST, arms), 41, axis=0)
    for side in SIDES:
        chunk[:, LAYOUT.arm[side].start + 5] = np.linspace(-0.8, 0.8, 41)
    told = from_r1pro(chunk, body())
    for side in SIDES:
        assert np.abs(np.diff(told[:, LAYOUT.arm[side]], axis=0)).max() < 0.05


def test_a_robot_with_one_arm_is_refused() -> None:
    """The fetch is no R1Pro with an arm missing: it is told so, and what to choose."""
    arms: dict[Side, Any] = {"right": np.zeros(7)}
    felt = replace(body(robot="fetch"), arm=arms, arm_velocity=arms, arm_command=arms)
    assert FETCH.sides == ("right",)
    for convert in (lambda: as_r1pro(felt), lambda: from_r1pro(np.zeros((1, ACTION_SIZE)), felt)):
        with pytest.raises(UserError, match=r"fetch.*two arms.*--robot r1pro"):
            convert()
