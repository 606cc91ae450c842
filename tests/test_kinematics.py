"""The r1's kinematics: the closed-form inverse undoes the forward, within limits, alike on both sides."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.arms import posture_distance
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.robots import model_named
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from tests.layouts import ACTION_SIZE, BASE, LAYOUT

MIRROR = np.diag([1.0, -1.0, 1.0])  # in the xz plane

sides = st.sampled_from(SIDES)
angles = st.floats(-50.0, 50.0)
seeds = st.integers(0, 2**32 - 1)


def posture(seed: int, side: Side, n: int = 1) -> Array:
    """Random postures (n, 7) within the limits."""
    low, high = r1.ARM_LIMITS[side].T
    return np.random.default_rng(seed).uniform(low, high, (n, 7))


def torso(seed: int) -> Array:
    """A random torso (4,) within the limits."""
    return np.random.default_rng(seed).uniform(r1.TORSO_LIMITS[:, 0], r1.TORSO_LIMITS[:, 1])


@given(angles, angles)
def test_rotations_of_one_axis_add_up(a: float, b: float) -> None:
    """Turning by a and then by b is turning by a + b, about each axis."""
    for rotation in (kin.rot_x, kin.rot_y, kin.rot_z):
        np.testing.assert_allclose(rotation(a) @ rotation(b), rotation(a + b), atol=1e-9)
        np.testing.assert_allclose(rotation(a).T @ rotation(a), np.eye(3), atol=1e-12)


def test_rotations_are_right_handed() -> None:
    """A quarter turn about x takes y to z, about y takes z to x, about z takes x to y."""
    x, y, z = np.eye(3)
    quarter = np.pi / 2
    np.testing.assert_allclose(kin.rot_x(quarter) @ y, z, atol=1e-12)
    np.testing.assert_allclose(kin.rot_y(quarter) @ z, x, atol=1e-12)
    np.testing.assert_allclose(kin.rot_z(quarter) @ x, y, atol=1e-12)


@given(angles)
def test_wrap_keeps_the_direction(a: float) -> None:
    """A wrapped angle is within -pi..pi, points the same way, and is left alone from then on."""
    w = float(kin.wrap(a))
    assert -np.pi <= w <= np.pi
    assert np.cos(w - a) == pytest.approx(1.0, abs=1e-9)
    assert float(kin.wrap(w)) == pytest.approx(w, abs=1e-12)


@given(seeds, sides)
def test_inverse_undoes_a_transform(seed: int, side: Side) -> None:
    """T and its inverse make the identity, for stacks too."""
    T = R1.arm(posture(seed, side, 3), side)
    np.testing.assert_allclose(kin.inverse(T) @ T, np.broadcast_to(np.eye(4), (3, 4, 4)), atol=1e-12)


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_a_hand_points_along_its_approach(v: list[float]) -> None:
    """z is the approach, y lies in the plane of approach and closing on the side of closing, the frame right-handed."""
    approach, closing = np.array(v[:3]), np.array(v[3:])
    if np.linalg.norm(np.cross(approach, closing)) < 1e-3:
        return
    R = kin.hand_rotation(approach, closing)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R[:, 2], approach / np.linalg.norm(approach), atol=1e-9)
    assert R[:, 1] @ closing > 0
    assert R[:, 0] @ closing == pytest.approx(0.0, abs=1e-9)


@pytest.mark.rare
@settings(deadline=None)
@given(seeds, sides)
def test_every_inverse_solution_reaches_the_target(seed: int, side: Side) -> None:
    """Forward of every solution is the target that it is said to be for, and every solution is within the limits."""
    T = R1.arm(posture(seed, side, 4), side)
    at, q = R1.arm_inverse(T, side)
    limits = r1.ARM_LIMITS[side]
    assert ((q >= limits[:, 0]) & (q <= limits[:, 1])).all()
    np.testing.assert_allclose(R1.arm(q, side), T[at], atol=1e-7)


@settings(deadline=None)
@given(seeds, sides)
def test_what_a_posture_reaches_is_found(seed: int, side: Side) -> None:
    """A target that a posture well within the limits reaches has a solution, its elbow next to that posture's."""
    low, high = r1.ARM_LIMITS[side].T
    q = np.random.default_rng(seed).uniform(low + 0.25, high - 0.25)
    T = R1.arm(q, side)
    assert R1.nearest_posture(T, side, q) is not None
    _, found = R1.arm_inverse(T[None], side, swivels=72)
    elbows = R1.arm_frames(found, side)[:, 1, :3, 3]
    # One swivel in 72 is 5 degrees, so the elbow of the nearest is off by half of that.
    assert np.linalg.norm(elbows - R1.arm_frames(q, side)[1][:3, 3], axis=1).min() < r1.UPPER_ARM_M * np.deg2rad(3.0)


@given(seeds, st.sampled_from(["r1", "r1pro", "fetch"]))
def test_many_targets_at_once_are_as_one_by_one(seed: int, name: str) -> None:
    """Postures of a batch are those of each target alone; along a line each starts from the one before."""
    robot = model_named(name)
    side = robot.sides[0]
    low, high = robot.arms[side].limits.T
    ends = np.random.default_rng(seed).uniform(low, high, (2, 7))
    T = robot.arm(ends[0] + (ends[1] - ends[0]) * np.linspace(0, 1, 8)[:, None], side)
    T[5] = T[5] @ kin.transform(np.eye(3), (0.0, 0.0, 0.05))  # off the line, and perhaps out of reach
    near = np.broadcast_to(ends[0], (8, 7))
    found, q = robot.nearest_postures(T, side, near)
    for k in range(8):
        alone = robot.nearest_posture(T[k], side, ends[0])
        assert found[k] == (alone is not None)
        if alone is not None:
            np.testing.assert_array_equal(q[k], alone)
    chain = [ends[0]]
    for target in T:
        after = robot.nearest_posture(target, side, chain[-1])
        if after is None or np.abs(after - chain[-1]).max() > 0.5:
            break
        chain.append(after)
    line = robot.postures_along(T, side, ends[0], 0.5)
    assert (line is None) == (len(chain) <= len(T))
    if line is not None:
        np.testing.assert_array_equal(line, chain[1:])


@given(seeds, sides)
def test_nearest_posture_is_the_nearest(seed: int, side: Side) -> None:
    """No solution is nearer than the nearest one, be the swivels sampled ever so finely around it."""
    near, other = posture(seed, side, 2)
    T = R1.arm(other, side)
    found = R1.nearest_posture(T, side, near, swivels=24)
    _, q = R1.arm_inverse(T[None], side, swivels=24)
    assert (found is None) == (len(q) == 0)
    if found is not None:
        np.testing.assert_allclose(R1.arm(found, side), T, atol=1e-7)
        low, high = r1.ARM_LIMITS[side].T
        assert ((found >= low) & (found <= high)).all()
        assert posture_distance(found, near) <= posture_distance(q, near).min() + 1e-9


@given(seeds, sides)
def test_a_hand_that_moves_evenly_takes_the_elbow_along_evenly(seed: int, side: Side) -> None:
    """Hand poses that follow each other closely have postures that do: the elbow does not hop between samples."""
    low, high = r1.ARM_LIMITS[side].T
    rng = np.random.default_rng(seed)
    q = rng.uniform(low + 0.5, high - 0.5)
    T, found = R1.arm(q, side), q
    for _ in range(10):
        T = T @ kin.transform(np.eye(3), (0.0005, 0.0, 0.0005))
        nearer = R1.nearest_posture(T, side, found)
        if nearer is None or abs(np.cos(found[1])) < 0.4 or abs(found[5]) < 0.4 or found[3] > -0.4:
            return  # out of reach, or two axes so nearly in line that small moves take large turns
        assert np.abs(nearer - found).max() < 0.02
        found = nearer


def test_out_of_reach_has_no_solution() -> None:
    """A target farther than the arm is long, or at the shoulder itself, has none; that is no error."""
    for p in ((2.0, 0.0, 0.0), tuple(R1.arms["left"].shoulder + [0, 0, r1.TCP_M])):
        T = kin.transform(np.eye(3), p)
        at, q = R1.arm_inverse(T[None], "left")
        assert at.shape == (0,)
        assert q.shape == (0, 7)
        assert R1.nearest_posture(T, "left", np.zeros(7)) is None


@given(seeds)
def test_arms_mirror(seed: int) -> None:
    """The mirrored posture of the right arm puts elbow and tcp at the mirror image of the left one's."""
    q = posture(seed, "left")[0]
    right = r1.mirrored(q, "right")
    low, high = r1.ARM_LIMITS["right"].T
    assert ((right >= low - 1e-12) & (right <= high + 1e-12)).all()
    for ours, theirs in zip(R1.arm_frames(q, "left"), R1.arm_frames(right, "right"), strict=True):
        np.testing.assert_allclose(MIRROR @ ours[:3, 3], theirs[:3, 3], atol=1e-12)
        np.testing.assert_allclose(MIRROR @ ours[:3, :3] @ MIRROR, theirs[:3, :3], atol=1e-12)


def test_mirroring_the_left_is_nothing() -> None:
    """The left arm's mirrored posture is the posture itself; limits and travel posture are each other's images."""
    q = np.arange(7.0)
    np.testing.assert_array_equal(r1.mirrored(q, "left"), q)
    np.testing.assert_array_equal(r1.mirrored(r1.TRAVEL_ARM["left"], "right"), r1.TRAVEL_ARM["right"])
    for side in SIDES:
        low, high = r1.ARM_LIMITS[side].T
        assert (low < high).all()
        assert ((r1.TRAVEL_ARM[side] > low) & (r1.TRAVEL_ARM[side] < high)).all()
    low, high = r1.TORSO_LIMITS.T
    assert ((r1.TRAVEL_TORSO >= low) & (r1.TRAVEL_TORSO <= high)).all()


def test_zero_hangs_the_arm_straight_down() -> None:
    """At zero the tcp is straight below the shoulder by the arm's length, the fingers down."""
    length = r1.UPPER_ARM_M + r1.FOREARM_M + r1.TCP_M
    for side in SIDES:
        T = R1.arm(np.zeros(7), side)
        np.testing.assert_allclose(T[:3, 3], R1.arms[side].shoulder - [0, 0, length], atol=1e-12)
        np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=1e-12)


@given(seeds, sides)
def test_stacks_agree_with_single_postures(seed: int, side: Side) -> None:
    """Forward kinematics of many is that of each."""
    q = posture(seed, side, 3)
    np.testing.assert_allclose(R1.arm(q, side), np.stack([R1.arm(one, side) for one in q]), atol=1e-12)
    torsos = np.stack([torso(seed + k) for k in range(3)])
    np.testing.assert_allclose(R1.chest(torsos), np.stack([R1.chest(one) for one in torsos]), atol=1e-12)


@given(seeds)
def test_a_level_head_sees_level(seed: int) -> None:
    """With waist and head straight the head camera looks ahead: z forward, y down; tilting it looks down."""
    t = torso(seed)
    t[1:] = 0.0
    np.testing.assert_allclose(R1.head_camera(t)[:3, :3], kin.LINK_TO_OPTICAL, atol=1e-12)
    t[3] = 0.4
    assert R1.head_camera(t)[2, 2] == pytest.approx(-np.sin(0.4))


@given(seeds, sides)
def test_the_wrist_camera_sees_the_tcp(seed: int, side: Side) -> None:
    """The tcp is in front of the wrist camera and within its view, whatever the posture."""
    t, q = torso(seed), posture(seed, side)[0]
    tcp = kin.inverse(R1.wrist_camera(t, q, side)) @ R1.tcp(t, q, side)[:, 3]
    assert tcp[2] > r1.CAMERAS[side].near_m
    assert np.abs(tcp[:2] / tcp[2]).max() < np.tan(r1.CAMERAS[side].fov_rad / 2)


@given(st.floats(-20, 20), st.floats(-20, 20), angles)
def test_base_is_a_planar_pose(x: float, y: float, yaw: float) -> None:
    """T_world_base turns about z and shifts along the floor."""
    T = kin.base(np.array([x, y, yaw]))
    np.testing.assert_allclose(T, pose((x, y, 0.0), yaw), atol=1e-12)
    np.testing.assert_allclose(T @ [1, 0, 0, 1], [x + np.cos(yaw), y + np.sin(yaw), 0, 1], atol=1e-9)


def test_the_action_is_covered_once() -> None:
    """Base, torso, arms and grippers take each of the 23 numbers, none twice."""
    taken = np.zeros(ACTION_SIZE, int)
    parts: list[slice | int] = [BASE, LAYOUT.torso]
    parts += [*LAYOUT.arm.values(), *LAYOUT.gripper.values()]
    for part in parts:
        taken[part] += 1
    assert (taken == 1).all()
    assert [s.stop - s.start for s in (BASE, LAYOUT.torso, *LAYOUT.arm.values())] == [
        len(r1.BASE_JOINTS), len(r1.TORSO_JOINTS), *(len(r1.ARM_JOINTS[s]) for s in SIDES)
    ]  # fmt: skip
