"""Folding the arms before a drive."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Side, other
from mpvi_bt.ground.robot.stow import ArmStow
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.testing import KinematicWorld
from tests.layouts import BASE, LAYOUT

REACHING = np.array([-0.9, 0.3, 0.0, -0.9, 0.0, 0.2, 0.0])


def world(**gripper: float) -> KinematicWorld:
    """A robot with both arms stretched out; grippers as given, else open."""
    world = KinematicWorld()
    action = world.robot.action
    action[LAYOUT.torso] = (0.2, 0.0, 0.3, 0.2)
    for s in SIDES:
        action[LAYOUT.arm[s]] = r1.mirrored(REACHING, s)
        action[LAYOUT.gripper[s]] = gripper.get(s, 1.0)
    for _ in range(60):
        world.robot.act(action)
        world.step()
    world.robot.act(action)
    return world


def put_hand(world: KinematicWorld, side: Side, T: Array) -> None:
    """Have a hand stand at `T` (4, 4) in the base's frame in a single step, the torso as it is."""
    action = world.robot.action
    chest = kin.inverse(R1.chest(action[LAYOUT.torso]))
    q = R1.nearest_posture(chest @ T, side, r1.TRAVEL_ARM[side])
    assert q is not None
    action[LAYOUT.arm[side]] = q
    world.robot.act(action)
    world.step()
    world.robot.act(action)


def stow(world: KinematicWorld, seed: int = 0, carries: Callable[[Side], bool] | None = None) -> Array:
    """Stow the arms; the actions (n, 23)."""
    stow, sent = ArmStow(world.robot, seed, carries), []
    stow.start()
    while not stow.step():
        sent.append(world.robot.action)
        world.step()
        assert len(sent) < 30 * CONTROL_HZ
    return np.array(sent).reshape(-1, 23)


def test_empty_hands_are_folded_and_the_torso_straightened() -> None:
    """From stretched arms and a bent torso the robot gets to its travel posture, and stands still there."""
    home = world()
    sent = stow(home)
    felt = home.robot.proprioception()
    np.testing.assert_allclose(felt.torso, r1.TRAVEL_TORSO, atol=1e-6)
    for s in SIDES:
        np.testing.assert_allclose(felt.arm[s], r1.TRAVEL_ARM[s], atol=1e-6)
    assert not sent[-1][BASE].any()


@pytest.mark.parametrize("side", SIDES)
def test_a_hand_that_holds_keeps_its_pose(side: Side) -> None:
    """What is held stays where it is before the body, and stays held; the empty hand is folded."""
    home = world(**{side: -1.0})
    T = kin.transform(kin.hand_rotation((1, 0, 0), (0, 1, 0)), (0.5, 0.2 * SIGN[side], 0.75))
    put_hand(home, side, T)
    before = home.robot.proprioception()
    hand = R1.tcp(before.torso, before.arm[side], side)
    sent = stow(home)
    felt = home.robot.proprioception()
    assert (sent[:, LAYOUT.gripper[side]] == -1.0).all()
    np.testing.assert_allclose(R1.tcp(felt.torso, felt.arm[side], side)[:3, 3], hand[:3, 3], atol=0.01)
    np.testing.assert_allclose(felt.arm[other(side)], r1.TRAVEL_ARM[other(side)], atol=1e-6)


@pytest.mark.parametrize(("at", "draws_back"), [((0.45, 0.85), False), ((0.75, 1.3), True), ((0.55, 0.3), True)])
def test_a_hand_that_holds_far_out_is_drawn_back_first(at: tuple[float, float], draws_back: bool) -> None:
    """It may be in a shelf or a basket still, and turning would tear out what it holds; before the body it is not."""
    home = world(left=-1.0)
    T = kin.transform(kin.hand_rotation((1, 0, -0.5), (0, 1, 0)), (at[0], 0.2, at[1]))
    torsos = np.array([(lift, 0.0, pitch, 0.0) for lift in (0.0, 0.2, 0.4) for pitch in (0.0, 0.5, 1.0)])
    found = [(t, R1.nearest_posture(kin.inverse(R1.chest(t)) @ T, "left", r1.TRAVEL_ARM["left"])) for t in torsos]
    torso, q = next((t, q) for t, q in found if q is not None)
    action = home.robot.action
    action[LAYOUT.torso] = torso
    action[LAYOUT.arm["left"]], action[LAYOUT.arm["right"]] = q, r1.TRAVEL_ARM["right"]
    for _ in range(60):
        home.robot.act(action)
        home.step()
    home.robot.act(action)
    before = home.robot.proprioception().base_pose
    stow(home)
    moved = home.robot.proprioception().base_pose - before
    assert (moved[0] < -0.2) == draws_back
    np.testing.assert_allclose(moved[1:], 0.0, atol=0.02)


@pytest.mark.parametrize(("down", "raised"), [((0.0, 0.0, -1.0), True), ((1.0, 0.0, -0.5), False)])
def test_what_was_taken_from_above_is_raised_before_the_base_draws_back(
    down: tuple[float, float, float], raised: bool
) -> None:
    """An onion was struck out of the hand by the rim of the sink; what was taken from a shelf has a board over it."""
    home = world(left=-1.0)
    put_hand(home, "left", kin.transform(kin.hand_rotation(down, (0, 1, 0)), (0.62, 0.2, 0.75)))
    before, stow = home.robot.proprioception(), ArmStow(home.robot)
    stow.start()
    while not stow.step():
        home.step()
        felt = home.robot.proprioception()
        if felt.base_pose[0] < before.base_pose[0] - 0.02:
            break
    gain = R1.tcp(felt.torso, felt.arm["left"], "left")[2, 3] - R1.tcp(before.torso, before.arm["left"], "left")[2, 3]
    assert (gain > 0.1) == raised


@pytest.mark.parametrize("side", SIDES)
def test_a_torso_straightens_up_though_what_is_held_cannot_stay_where_it_is(side: Side) -> None:
    """A bottle just taken from a low board: the robot drove on bent down, dragged it along a door, and saw nothing."""
    home = world(**{side: -1.0})
    action = home.robot.action
    action[LAYOUT.torso] = torso = np.array([0.2, 0.0, 0.9, 0.0])
    T = kin.transform(kin.hand_rotation((1, 0, 0), (0, 1, 0)), (0.53, 0.2 * SIGN[side], 0.55))
    q = R1.nearest_posture(kin.inverse(R1.chest(torso)) @ T, side, r1.TRAVEL_ARM[side])
    assert q is not None
    action[LAYOUT.arm[side]], action[LAYOUT.arm[other(side)]] = q, r1.TRAVEL_ARM[other(side)]
    for _ in range(60):
        home.robot.act(action)
        home.step()
    home.robot.act(action)
    stow(home)
    felt = home.robot.proprioception()
    np.testing.assert_allclose(felt.torso, r1.TRAVEL_TORSO, atol=1e-6)
    np.testing.assert_allclose(R1.tcp(felt.torso, felt.arm[side], side)[:3, :3], T[:3, :3], atol=0.02)


def test_a_stowed_robot_does_not_move() -> None:
    """Once folded, stowing again is done soon and leaves arms and base in place."""
    home = world()
    stow(home)
    before = home.robot.proprioception()
    sent = stow(home)
    assert len(sent) < CONTROL_HZ
    assert not sent[:, BASE].any()
    np.testing.assert_allclose(home.robot.proprioception().base_pose, before.base_pose)


def test_the_same_seed_folds_in_the_same_way() -> None:
    """Two robots that stand alike are folded by the same actions."""
    np.testing.assert_array_equal(stow(world(), 5), stow(world(), 5))


def test_stepping_before_a_start_is_harmless() -> None:
    """A stow that was never started has nothing to do."""
    assert ArmStow(world().robot).step()


@pytest.mark.parametrize("side", SIDES)
def test_what_is_held_far_out_is_drawn_back_and_brought_in(side: Side) -> None:
    """A hand that was cut short in a fridge closes, the base draws back, and the hand comes in without tipping."""
    home = world(**{side: -0.4})
    home.robot.between_m[side] = 0.06
    T = kin.transform(kin.hand_rotation((1, 0, 0), (0, 1, 0)), (0.80, 0.25 * SIGN[side], 0.95))
    put_hand(home, side, T)
    before = home.robot.proprioception()
    sent = stow(home)
    felt = home.robot.proprioception()
    assert sent[-1][LAYOUT.gripper[side]] == -1.0
    ahead = np.array([np.cos(before.base_pose[2]), np.sin(before.base_pose[2])])
    assert (before.base_pose - felt.base_pose)[:2] @ ahead > 0.4
    hand = R1.tcp(felt.torso, felt.arm[side], side)
    assert hand[0, 3] < 0.55
    np.testing.assert_allclose(hand[:3, :3], T[:3, :3], atol=0.02)


@pytest.mark.parametrize("side", SIDES)
def test_a_hand_around_what_does_not_come_along_lets_go_and_is_drawn_back_along_its_fingers(side: Side) -> None:
    """Cut off on a door's bar it feels something as if it carried it; yet it ends open and folded like an empty one."""
    home = world(**{side: -1.0})
    home.robot.between_m[side] = 0.02
    T = kin.transform(kin.hand_rotation((1, 1, 0), (0, 0, 1)), (0.60, 0.25 * SIGN[side], 0.95))
    put_hand(home, side, T)
    assert home.robot.proprioception().holds(side)
    sent = stow(home, carries=lambda _: False)
    first = next(a for a in sent if np.abs(a[BASE]).max() > 0)
    assert first[LAYOUT.gripper[side]] == 1.0
    np.testing.assert_allclose(np.arctan2(*first[BASE][1::-1]), np.arctan2(-1, -1), atol=0.05)
    felt = home.robot.proprioception()
    assert felt.gripper_command[side] == 1.0
    np.testing.assert_allclose(felt.arm[side], r1.TRAVEL_ARM[side], atol=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_an_empty_hand_is_drawn_off_along_its_fingers_before_the_base_moves(side: Side) -> None:
    """Cut short as it let go, it may have the wall of a box between its fingers, which the base would drag along."""
    home = world()
    T = kin.transform(kin.hand_rotation((0.5, 0, -1), (0, 1, 0)), (0.62, 0.2 * SIGN[side], 0.75))
    torso = np.array([0.2, 0.0, 0.3, 0.2])
    q = R1.nearest_posture(kin.inverse(R1.chest(torso)) @ T, side, r1.TRAVEL_ARM[side])
    assert q is not None
    action = home.robot.action
    action[LAYOUT.torso], action[LAYOUT.arm[side]] = torso, q
    action[LAYOUT.arm[other(side)]] = r1.TRAVEL_ARM[other(side)]
    for _ in range(60):
        home.robot.act(action)
        home.step()
    home.robot.act(action)
    stow = ArmStow(home.robot)
    stow.start()
    while not home.robot.action[BASE].any():
        assert not stow.step()
        home.robot.act(home.robot.action)
        home.step()
    felt = home.robot.proprioception()
    off = kin.inverse(T) @ R1.tcp(felt.torso, felt.arm[side], side)
    np.testing.assert_allclose(off[:3, 3], [0.0, 0.0, -0.12], atol=0.01)


def test_a_hand_caught_behind_a_rim_is_raised_and_the_arms_are_folded_all_the_same() -> None:
    """While both hands are low the base cannot go back; the robot ends in its travel posture, a little farther back."""
    home = world()
    before = home.robot.proprioception()

    def height() -> float:
        felt = home.robot.proprioception()
        return min(float(R1.tcp(felt.torso, felt.arm[s], s)[2, 3]) for s in SIDES)

    rim, stow = height() + 0.08, ArmStow(home.robot)
    stow.start()
    for _ in range(40 * CONTROL_HZ):
        if stow.step():
            break
        action = home.robot.action.copy()
        if height() < rim:
            action[BASE] = 0.0
        home.robot.act(action)
        home.step()
    felt = home.robot.proprioception()
    for s in SIDES:
        np.testing.assert_allclose(felt.arm[s], r1.TRAVEL_ARM[s], atol=1e-6)
    assert felt.base_pose[0] < before.base_pose[0] - 0.2


def test_an_arm_that_is_blocked_is_folded_from_farther_back() -> None:
    """As in a trunk no joint of it gets anywhere until the base has drawn back twice as far as usual."""
    home = world()
    before, stow = home.robot.proprioception(), ArmStow(home.robot)
    stow.start()
    for _ in range(40 * CONTROL_HZ):
        if stow.step():
            break
        action, felt = home.robot.action.copy(), home.robot.proprioception()
        if felt.base_pose[0] > before.base_pose[0] - 0.4:
            for s in SIDES:
                action[LAYOUT.arm[s]] = felt.arm[s]
        home.robot.act(action)
        home.step()
    felt = home.robot.proprioception()
    for s in SIDES:
        np.testing.assert_allclose(felt.arm[s], r1.TRAVEL_ARM[s], atol=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_against_a_wall_the_base_draws_back_along_it(side: Side) -> None:
    """A robot that has opened a fridge stands with its back obliquely to the wall: its arms are folded all the same."""
    home = world()
    start = home.robot.proprioception().base_pose
    toward, stow = np.array([-0.6, 0.8 * SIGN[side]]), ArmStow(home.robot)
    stow.start()
    for _ in range(40 * CONTROL_HZ):
        if stow.step():
            break
        action = home.robot.action.copy()
        if action[BASE][:2] @ toward > 0:
            action[BASE] = 0.0
        home.robot.act(action)
        home.step()
    felt = home.robot.proprioception()
    for s in SIDES:
        np.testing.assert_allclose(felt.arm[s], r1.TRAVEL_ARM[s], atol=1e-6)
    assert felt.base_pose[0] < start[0] - 0.1


@pytest.mark.parametrize("fixed", [(), SIDES])
def test_where_the_base_cannot_go_back_what_can_be_brought_home_is(fixed: tuple[Side, ...]) -> None:
    """Between a sofa and an open cabinet: arms that are free are folded, the torso is straightened in any case."""
    home = world()
    stow = ArmStow(home.robot)
    stow.start()
    for _ in range(60 * CONTROL_HZ):
        if stow.step():
            break
        action, felt = home.robot.action.copy(), home.robot.proprioception()
        action[BASE] = 0.0
        for s in fixed:
            action[LAYOUT.arm[s]] = felt.arm[s]
        home.robot.act(action)
        home.step()
    felt = home.robot.proprioception()
    np.testing.assert_allclose(felt.torso, r1.TRAVEL_TORSO, atol=1e-6)
    for s in set(SIDES) - set(fixed):
        np.testing.assert_allclose(felt.arm[s], r1.TRAVEL_ARM[s], atol=1e-6)
