"""Motions as actions: they end where they say, stay within the joints, and say why they cannot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.arm_motion import stay, sweep
from mpvi_bt.ground.robot.collision import Body, Surroundings
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure, smooth
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Proprioception, Side
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1pro import R1PRO
from tests.layouts import ACTION_SIZE, BASE, LAYOUT


def feeling(base: Array | None = None) -> Proprioception:
    """A robot at rest with folded, open hands."""
    return Proprioception(
        base_pose=np.zeros(3) if base is None else base,
        base_velocity=np.zeros(3),
        torso=r1.TRAVEL_TORSO.copy(),
        arm={s: r1.TRAVEL_ARM[s].copy() for s in SIDES},
        arm_velocity={s: np.zeros(7) for s in SIDES},
        gripper_width=dict.fromkeys(SIDES, 0.1),
        gripper_command=dict.fromkeys(SIDES, 1.0),
    )


def obey(felt: Proprioception, action: Array) -> Proprioception:
    """What a robot feels that did exactly as it was told for one step."""
    vx, vy, w = action[BASE]
    x, y, yaw = felt.base_pose
    c, s = np.cos(yaw + w / CONTROL_HZ / 2), np.sin(yaw + w / CONTROL_HZ / 2)
    moved = np.array([x + (c * vx - s * vy) / CONTROL_HZ, y + (s * vx + c * vy) / CONTROL_HZ, yaw + w / CONTROL_HZ])
    moved[2] = kin.wrap(moved[2])
    return replace(
        felt,
        base_pose=moved,
        torso=action[LAYOUT.torso].copy(),
        arm={k: action[i].copy() for k, i in LAYOUT.arm.items()},
        gripper_command={k: float(action[i]) for k, i in LAYOUT.gripper.items()},
    )


Step = Callable[[Proprioception, Array], Proprioception]


def play(motion: Motion, actions: Actions, step: Step = obey, limit: int = 3000) -> Array:
    """Carry out a motion; (n, 23) its actions."""
    done = []
    for action in actions:
        assert action.shape == (ACTION_SIZE,)
        assert np.isfinite(action).all()
        done.append(action)
        motion.felt = step(motion.felt, action)
        assert len(done) < limit
    return np.array(done).reshape(-1, ACTION_SIZE)


@given(st.floats(0, 1), st.floats(0, 1))
def test_smooth_is_a_gentle_climb(a: float, b: float) -> None:
    """From 0 to 1, never back, flat at the ends."""
    assert smooth(0.0) == 0.0
    assert smooth(1.0) == 1.0
    assert (smooth(a) - smooth(b)) * (a - b) >= 0
    assert smooth(1e-3) < 1e-5


def test_a_motion_starts_as_the_robot_stands() -> None:
    """Without any motion the command is what is felt, the base at rest."""
    motion = Motion(feeling())
    (action,) = play(motion, motion.wait(1 / CONTROL_HZ))
    np.testing.assert_array_equal(action[LAYOUT.torso], r1.TRAVEL_TORSO)
    for s in SIDES:
        np.testing.assert_array_equal(action[LAYOUT.arm[s]], r1.TRAVEL_ARM[s])
        assert action[LAYOUT.gripper[s]] == 1.0
    assert not action[BASE].any()


def test_actions_are_not_shared() -> None:
    """An action that was handed out is not changed by the next one."""
    motion = Motion(feeling())
    actions = motion.grip("left", -1.0)
    first = next(actions)
    before = first.copy()
    next(actions)
    np.testing.assert_array_equal(first, before)


@pytest.mark.parametrize("side", SIDES)
def test_a_grip_moves_one_gripper_evenly(side: Side) -> None:
    """The gripper gets to its value in equal steps, and nothing else moves."""
    motion = Motion(feeling())
    done = play(motion, motion.grip(side, -1.0, 0.5))
    i = LAYOUT.gripper[side]
    assert len(done) == round(0.5 * CONTROL_HZ)
    np.testing.assert_allclose(np.diff(np.append(1.0, done[:, i])), -2.0 / len(done))
    np.testing.assert_array_equal(np.delete(done, i, axis=1), np.delete(done[:1], i, axis=1).repeat(len(done), 0))


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.3, 2.0))
def test_following_a_path_passes_its_postures_at_its_speed(seed: int, speed: float) -> None:
    """The arm goes by every posture, ends at the last, and no joint is faster than asked for or than it can be."""
    rng = np.random.default_rng(seed)
    low, high = r1.ARM_LIMITS["left"].T
    path = [r1.TRAVEL_ARM["left"], *rng.uniform(low, high, (3, 7))]
    motion = Motion(feeling())
    done = play(motion, motion.follow("left", path, speed))[:, LAYOUT.arm["left"]]
    np.testing.assert_allclose(done[-1], path[-1])
    assert (np.abs(np.diff(done, axis=0)) * CONTROL_HZ <= np.minimum(r1.ARM_SPEED, speed) * 1.01).all()
    for posture in path:
        assert np.abs(done - posture).max(1).min() <= 0.02 + speed / CONTROL_HZ / 2


def test_what_is_held_is_moved_gently() -> None:
    """A hand that holds something speeds up no more than 2.1 rad/s^2, and the base no more than 0.4 m/s^2."""
    holding = replace(feeling(), gripper_width={"left": 0.06, "right": 0.1}, gripper_command={"left": -1.0, "right": 1})
    goal = [r1.TRAVEL_ARM["left"], r1.TRAVEL_ARM["left"] + 0.5]
    motion = Motion(holding)
    arm = play(motion, motion.follow("left", goal))[:, LAYOUT.arm["left"]]
    assert np.abs(np.diff(arm, n=2, axis=0)).max() * CONTROL_HZ**2 < 2.1 * 1.4
    empty = Motion(feeling())
    assert len(play(empty, empty.follow("left", goal))) < 0.8 * len(arm)
    motion = Motion(holding)
    base = play(motion, motion.drive(np.array([1.0, 0.0, 0.0])))[:, 0]
    assert np.abs(np.diff(base)).max() * CONTROL_HZ < 0.5


def test_following_nothing_moves_nothing() -> None:
    """A path of one posture, the present one, ends at once."""
    motion = Motion(feeling())
    done = play(motion, motion.follow("left", [r1.TRAVEL_ARM["left"]]))
    assert len(done) <= 2


def held_off(by: Array, load: float = 0.0) -> Step:
    """A robot whose left arm does not get past a posture (7,), and gives way to a load by as much everywhere."""

    def step(felt: Proprioception, action: Array) -> Proprioception:
        moved = obey(felt, action)
        return replace(moved, arm={**moved.arm, "left": np.minimum(moved.arm["left"], by) - load})

    return step


def test_a_blocked_arm_stops_and_lets_go() -> None:
    """An arm held off its way fails with its reason code within 0.8 s, having ceased to push."""
    for bar in (0.0, 0.1, 0.25):
        motion, start = Motion(feeling()), r1.TRAVEL_ARM["left"]
        sent: list[Array] = []

        def step(felt: Proprioception, action: Array, bar: float = bar, sent: list[Array] = sent) -> Proprioception:
            sent.append(action[LAYOUT.arm["left"]])
            return held_off(r1.TRAVEL_ARM["left"] + bar)(felt, action)

        with pytest.raises(MotionFailure, match="arm_blocked"):
            play(motion, motion.follow("left", [start, start + 0.4]), step)
        beyond = (np.stack(sent) - start - bar).max(1)
        assert beyond.max() < 0.3
        assert np.sum(beyond > 0) < 0.8 * CONTROL_HZ
        assert np.abs(motion.arm("left") - motion.felt.arm["left"]).max() < 0.01


def test_a_load_is_no_hindrance() -> None:
    """An arm that gives way to what it carries by as much all along is not held off its way."""
    motion = Motion(feeling())
    start, step = r1.TRAVEL_ARM["left"], held_off(np.full(7, 9.0), load=0.05)
    play(motion, motion.wait(0.1), step)
    done = play(motion, motion.follow("left", [start, start + 0.3]), step)
    np.testing.assert_allclose(done[-1, LAYOUT.arm["left"]], start + 0.3)


def reaching(side: Side) -> Motion:
    """A robot with a hand held out, the fingers ahead."""
    T = kin.transform(kin.hand_rotation((1, 0, 0), (0, 1, 0)), (0.5, 0.2 * SIGN[side], 0.95))
    q = R1.nearest_posture(kin.inverse(R1.chest(r1.TRAVEL_TORSO)) @ T, side, r1.TRAVEL_ARM[side])
    assert q is not None
    felt = feeling()
    return Motion(replace(felt, arm={**felt.arm, side: q}))


def over_a_floor(height: float, side: Side) -> Step:
    """A robot whose hand stays above a height [m], the arm giving way as a spring does."""

    def step(felt: Proprioception, action: Array) -> Proprioception:
        moved = obey(felt, action)
        T = R1.tcp(moved.torso, moved.arm[side], side)
        if T[2, 3] >= height:
            return moved
        T[2, 3] = height
        q = R1.nearest_posture(kin.inverse(R1.chest(moved.torso)) @ T, side, moved.arm[side])
        assert q is not None
        return replace(moved, arm={**moved.arm, side: q})

    return step


def returned(motion: Motion, actions: Actions, step: Step) -> object:
    """Carry out a motion; what it returns."""
    while True:
        try:
            motion.felt = step(motion.felt, next(actions))
        except StopIteration as stop:
            return stop.value


@pytest.mark.parametrize("side", SIDES)
def test_a_hand_feels_its_way(side: Side) -> None:
    """Told to stop at contact, the hand stops within 2 cm of where it is held up and says so; with none it goes on."""
    motion = reaching(side)
    top = motion.hand(side)[2, 3] - 0.05
    goal = motion.hand(side)
    goal[2, 3] -= 0.12
    floor = over_a_floor(top, side)
    assert returned(motion, motion.line(side, goal, 0.05, until_contact=True), floor) is True
    assert -0.02 < motion.hand(side)[2, 3] - top < 0.001
    assert returned(motion, motion.wait(0.1), floor) is None
    up = motion.hand(side)
    up[2, 3] += 0.1
    assert returned(motion, motion.line(side, up, 0.05, until_contact=True), floor) is False
    np.testing.assert_allclose(motion.hand(side), up, atol=1e-6)


def test_a_hand_may_be_meant_to_press() -> None:
    """Where it may give any way a line ends at its goal, though the hand does not get there."""
    motion = reaching("left")
    goal = motion.hand("left")
    floor = over_a_floor(goal[2, 3] - 0.02, "left")
    goal[2, 3] -= 0.12
    assert returned(motion, motion.line("left", goal, give_rad=np.inf), floor) is False
    np.testing.assert_allclose(motion.hand("left"), goal, atol=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_a_line_is_straight_and_ends_at_its_goal(side: Side) -> None:
    """The commanded hand runs along the segment at no more than its speed, and ends at the pose."""
    motion = Motion(feeling())
    start = motion.hand(side)
    goal = start.copy()
    goal[:3, 3] += [0.12, 0.05 * SIGN[side], 0.10]
    done = play(motion, motion.line(side, goal, speed=0.2))
    hands = R1.tcp(done[:, LAYOUT.torso], done[:, LAYOUT.arm[side]], side)
    np.testing.assert_allclose(hands[-1], goal, atol=1e-6)
    along = (goal - start)[:3, 3] / np.linalg.norm((goal - start)[:3, 3])
    off = hands[:, :3, 3] - start[:3, 3]
    np.testing.assert_allclose(off - np.outer(off @ along, along), 0.0, atol=1e-6)
    assert np.linalg.norm(np.diff(hands[:, :3, 3], axis=0), axis=1).max() * CONTROL_HZ < 0.2 * 1.6


def test_a_line_out_of_reach_is_said() -> None:
    """A hand that cannot stay on its line fails with its reason code."""
    motion = Motion(feeling())
    goal = motion.hand("left")
    goal[0, 3] += 2.0
    with pytest.raises(MotionFailure, match="no_reach"):
        play(motion, motion.line("left", goal))


@settings(deadline=None, max_examples=20)
@given(st.floats(0.05, 0.5), st.floats(-0.5, 0.5), st.floats(-0.2, 0.5))
def test_a_level_hand_stays_while_the_torso_moves(lift: float, yaw: float, pitch: float) -> None:
    """What a hand holds keeps its pose in the base frame while the robot stands up or bends along a planned sweep."""
    motion = Motion(feeling())
    level = motion.hand("right")
    torso = np.array([lift, yaw, pitch, 0.0])
    arms = sweep(Body(R1, motion.torso, {s: motion.arm(s) for s in SIDES}), torso, {"right": stay(level)})
    if arms is None:
        return
    done = play(motion, motion.stand(torso, arms))
    np.testing.assert_allclose(done[-1, LAYOUT.torso], torso)
    hands = R1.tcp(done[:, LAYOUT.torso], done[:, LAYOUT.arm["right"]], "right")
    assert np.linalg.norm(hands[:, :3, 3] - level[:3, 3], axis=1).max() < 0.02  # between the sweep's postures
    np.testing.assert_allclose(hands[-1], level, atol=1e-6)


def test_standing_as_one_stands_takes_no_time() -> None:
    """A torso that is where it should be is not moved."""
    motion = Motion(feeling())
    assert len(play(motion, motion.stand(r1.TRAVEL_TORSO))) == 0


@settings(deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_a_drive_arrives_and_stands_still(x: float, y: float, yaw: float, start: float) -> None:
    """The base gets to its goal, turning the shorter way, within its speeds, and the last command is to stand."""
    motion = Motion(feeling(np.array([0.3, -0.2, start])))
    goal = np.array([x, y, yaw])
    done = play(motion, motion.drive(goal))
    assert np.linalg.norm(motion.felt.base_pose[:2] - goal[:2]) < 0.01
    assert abs(kin.wrap(motion.felt.base_pose[2] - yaw)) < 0.02
    assert not done[-1, BASE].any()
    assert np.linalg.norm(done[:, :2], axis=1).max() < 0.55
    assert np.abs(done[:, 2]).max() < 1.1
    turned = np.sum(done[:, 2]) / CONTROL_HZ
    assert abs(turned - kin.wrap(yaw - start)) < 0.05


def test_a_blocked_base_is_said_and_stands() -> None:
    """A base that does not get there fails with its reason code, after a command to stand."""
    motion = Motion(feeling())
    sent = []

    def stuck(felt: Proprioception, action: Array) -> Proprioception:
        sent.append(action)
        return felt

    with pytest.raises(MotionFailure, match="base_blocked"):
        play(motion, motion.drive(np.array([1.0, 0.0, 0.0])), stuck)
    assert not sent[-1][BASE].any()
    assert len(sent) < CONTROL_HZ


def test_what_held_the_base_up_is_noted_where_it_would_have_gone() -> None:
    """A post stands right before the base then, on the side that it could not go to; one that arrives meets nothing."""
    motion = Motion(feeling())
    play(motion, motion.drive(np.array([0.0, 0.4, 0.0])), obey)
    assert not motion.bumps

    def barred(felt: Proprioception, action: Array) -> Proprioception:
        moved = obey(felt, action)
        return replace(moved, base_pose=np.array([moved.base_pose[0], min(moved.base_pose[1], 0.5), 0.0]))

    with pytest.raises(MotionFailure, match="base_blocked"):
        play(motion, motion.drive(np.array([0.3, 1.0, 0.0])), barred)
    (post,) = motion.bumps
    low, high = post.aabb() - np.append(motion.felt.base_pose[:2], 0.0)
    assert motion.felt.base_pose[1] == pytest.approx(0.5)
    assert low[1] > R1.hull.standing[:, 3].max()
    assert high[1] < R1.hull.standing[:, 3].max() + 0.15
    assert low[2] == pytest.approx(0.0)


@pytest.mark.parametrize("bearing", [0.0, 0.4, -0.8, 1.57, -2.4])
def test_what_held_a_base_with_corners_up_is_noted_all_along_what_leads(bearing: float) -> None:
    """It may be a corner that something holds up: wherever it stands before the base, it would be met once more."""
    motion = Motion(replace(feeling(), robot="r1pro", torso=R1PRO.travel_torso.copy()))
    goal = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    with pytest.raises(MotionFailure, match="base_blocked"):
        play(motion, motion.drive(goal), lambda felt, action: felt)
    posts, aside = Surroundings(motion.bumps), np.array([-np.sin(bearing), np.cos(bearing)])
    across = R1PRO.base.corners @ aside
    for y in np.linspace(across.min() + 0.06, across.max() - 0.06, 9):
        ray = np.append(y * aside, 0.1) + np.outer(np.linspace(0.0, 0.8, 161), np.append(goal[:2], 0.0))
        clear = posts.distance(ray) > 0.05
        assert clear[0]
        assert not clear.all()
    base = R1PRO.hull.standing
    assert (posts.distance(base[:, :3]) > base[:, 3]).all()


def test_a_base_that_cannot_turn_is_said() -> None:
    """Having arrived is to have turned, too."""
    motion = Motion(feeling())

    def stuck(felt: Proprioception, action: Array) -> Proprioception:
        moved = obey(felt, action)
        return replace(moved, base_pose=np.append(moved.base_pose[:2], felt.base_pose[2]))

    with pytest.raises(MotionFailure, match="base_blocked"):
        play(motion, motion.drive(np.array([0.2, 0.0, 0.09])), stuck)


def test_a_blocked_torso_is_said() -> None:
    """A torso that does not follow fails with its reason code."""
    motion = Motion(feeling())

    def stuck(felt: Proprioception, action: Array) -> Proprioception:
        return replace(obey(felt, action), torso=felt.torso)

    with pytest.raises(MotionFailure, match="torso_blocked"):
        play(motion, motion.stand(np.array([0.1, 0.0, 0.0, 0.5])), stuck)
