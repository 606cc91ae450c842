"""Paths of one arm: free where they are checked more finely, level where they promise it, without leaps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from mpvi_bt.finding.shapes.from_above import points
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.ground.robot.arm_motion import glide, plan, plan_level, stay, sweep, swing, touching, trace, trunk_touching
from mpvi_bt.ground.robot.collision import Body, Load, Surroundings
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1

seeds = st.integers(0, 2**32 - 1)
sides = st.sampled_from(SIDES)
TORSO = np.array([0.35, 0.0, 0.2, 0.0])
TABLE = box((0.75, 0.0, 0.70), (0.6, 1.4, 0.04))
POLE = box((0.55, 0.25, 1.0), (0.06, 0.06, 1.0))


def robot(*solids: Solid) -> Body:
    """The robot with folded hands among solids in its own frame."""
    return Body(R1, TORSO, dict(r1.TRAVEL_ARM), {}, Surroundings(solids))


def level(x: float, y: float, z: float, side: Side) -> Array:
    """A hand pose that points ahead, y toward the hand's own side."""
    return kin.transform(kin.hand_rotation((1, 0, 0), (0, 1, 0)), (x, y * SIGN[side], z))


def anywhere(rng: np.random.Generator, side: Side) -> Array:
    """A level hand pose somewhere in front of the body."""
    return level(rng.uniform(0.35, 0.6), rng.uniform(0.05, 0.4), rng.uniform(0.75, 1.1), side)


def finely(path: list[Array], step: float = 0.01) -> Array:
    """The postures of a path, `step` [rad] apart."""
    legs = [a + (b - a) * np.linspace(0, 1, int(np.abs(b - a).max() / step) + 2)[:, None] for a, b in pairwise(path)]
    return np.concatenate(legs)


@pytest.mark.rare
@settings(deadline=None, max_examples=40)
@given(seeds, sides)
def test_planned_paths_are_free_between_their_checks(seed: int, side: Side) -> None:
    """A path begins where the arm is, ends at its goal, stays in the limits, and no posture on it is deeper than 5 mm.

    Edges are checked each 0.07 rad, which is 5 cm of the hand: what is between may graze, not more.
    """
    rng = np.random.default_rng(seed)
    low, high = r1.ARM_LIMITS[side].T
    goal = rng.uniform(low, high)
    body = robot(TABLE, POLE)
    path = plan(body, side, goal, rng, margin=0.02, iterations=60)
    if path is None:
        return
    np.testing.assert_array_equal(path[0], r1.TRAVEL_ARM[side])
    np.testing.assert_allclose(path[-1], goal)
    q = finely(path)
    assert ((q >= low) & (q <= high)).all()
    around, itself = body.clearance(side, q)
    assert around.min() > -0.005 + 0.02
    assert itself.min() > -0.01


@settings(deadline=None, max_examples=20)
@given(seeds, sides)
def test_a_goal_in_a_wall_has_no_path(seed: int, side: Side) -> None:
    """Where the goal is not free there is no path, and that is known at once."""
    rng = np.random.default_rng(seed)
    low, high = r1.ARM_LIMITS[side].T
    goal = rng.uniform(low, high)
    at = R1.tcp(TORSO, goal, side)[:3, 3]
    body = robot(box((float(at[0]), float(at[1]), float(at[2])), (0.1, 0.1, 0.1)))
    assert plan(body, side, goal, rng) is None


def test_planning_finds_a_way_around() -> None:
    """With the straight way barred a path is found all the same, and the same one from the same randomness."""
    side: Side = "left"
    chest = kin.inverse(R1.chest(TORSO))
    start = R1.nearest_posture(chest @ level(0.50, 0.02, 1.05, side), side, r1.TRAVEL_ARM[side])
    goal = R1.nearest_posture(chest @ level(0.50, 0.50, 1.05, side), side, r1.TRAVEL_ARM[side])
    assert start is not None
    assert goal is not None
    body = Body(R1, TORSO, {**r1.TRAVEL_ARM, side: start}, {}, Surroundings([POLE]))
    straight = np.array([start + (goal - start) * u for u in np.linspace(0, 1, 40)])
    assert not body.free(side, straight).all()
    first, second = (plan(body, side, goal, np.random.default_rng(3)) for _ in range(2))
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(np.stack(first), np.stack(second))
    assert body.free(side, finely(first), margin=-0.005).all()


def test_an_arm_finds_into_a_narrow_compartment() -> None:
    """A posture deep between boards, walls and a door that stands open is reached, whatever the randomness."""
    side: Side = "left"
    walls = [box((0.74, 0.15 + 0.35 * s, 0.9), (0.55, 0.02, 0.9)) for s in (-1, 1)]
    boards = [box((0.74, 0.15, z), (0.55, 0.70, 0.02)) for z in (0.88, 1.20)]
    door = box((0.115, -0.25, 0.9), (0.70, 0.03, 0.9))
    body = robot(*walls, *boards, box((1.01, 0.15, 0.9), (0.02, 0.70, 0.9)), door)
    goal = R1.nearest_posture(kin.inverse(R1.chest(TORSO)) @ level(0.70, 0.20, 1.03, side), side, r1.TRAVEL_ARM[side])
    assert goal is not None
    assert body.free(side, goal)[0]
    assert all(plan(body, side, goal, np.random.default_rng(seed)) is not None for seed in range(12))


def test_a_start_in_touch_can_be_left() -> None:
    """An arm that stands in slight contact still finds a way out."""
    side: Side = "left"
    at = R1.tcp(TORSO, r1.TRAVEL_ARM[side], side)[:3, 3]
    body = robot(box((float(at[0]), float(at[1]), float(at[2]) - 0.07), (0.1, 0.1, 0.1)))
    assert not body.free(side, r1.TRAVEL_ARM[side])[0]
    goal = R1.nearest_posture(kin.inverse(R1.chest(TORSO)) @ level(0.45, 0.45, 1.1, side), side, r1.TRAVEL_ARM[side])
    assert goal is not None
    assert plan(body, side, goal, np.random.default_rng(0)) is not None


@settings(deadline=None, max_examples=30)
@given(seeds, sides)
def test_a_traced_line_is_straight_and_without_leaps(seed: int, side: Side) -> None:
    """From start to goal in small steps: each hand pose on the segment, no joint leaping."""
    rng = np.random.default_rng(seed)
    a, b = (anywhere(rng, side) for _ in range(2))
    start = R1.nearest_posture(kin.inverse(R1.chest(TORSO)) @ a, side, r1.TRAVEL_ARM[side])
    assume(start is not None)
    assert start is not None
    path = trace(R1, TORSO, side, start, b)
    assume(path is not None)
    assert path is not None
    np.testing.assert_array_equal(path[0], start)
    hands = R1.tcp(TORSO, np.stack(path), side)
    np.testing.assert_allclose(hands[-1], b, atol=1e-6)
    along = (b - a)[:3, 3] / np.linalg.norm((b - a)[:3, 3])
    off = hands[:, :3, 3] - a[:3, 3]
    np.testing.assert_allclose(np.linalg.norm(off - np.outer(off @ along, along), axis=1), 0.0, atol=1e-6)
    assert np.linalg.norm(np.diff(hands[:, :3, 3], axis=0), axis=1).max() < 0.026
    assert np.abs(np.diff(np.stack(path), axis=0)).max() < 0.46
    # between its postures too the hand stays near the line, so that following it does not sweep through things
    between = R1.tcp(TORSO, finely(path, 0.02), side)[:, :3, 3] - a[:3, 3]
    assert np.linalg.norm(between - np.outer(between @ along, along), axis=1).max() < 0.05


def test_a_line_out_of_reach_is_none() -> None:
    """A hand cannot be traced to where the arm does not reach."""
    assert trace(R1, TORSO, "left", r1.TRAVEL_ARM["left"], level(2.0, 0.2, 1.0, "left")) is None


# Examples hang on which modules are loaded (tests/conftest.py): with some, only 9 of 59 have a path.
@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.filter_too_much])
@given(seeds, sides)
def test_a_level_path_never_tips_what_is_held(seed: int, side: Side) -> None:
    """All along a level path, detours too, the hand keeps its tilt: only its heading turns."""
    rng = np.random.default_rng(seed)
    chest = kin.inverse(R1.chest(TORSO))
    a, b = (anywhere(rng, side) for _ in range(2))
    b[:3, :3] = kin.rot_z(rng.uniform(-0.8, 0.8)) @ b[:3, :3]
    start = R1.nearest_posture(chest @ a, side, r1.TRAVEL_ARM[side])
    assume(start is not None)
    assert start is not None
    body = Body(R1, TORSO, {**r1.TRAVEL_ARM, side: start}, {}, Surroundings([POLE]))
    assume(bool(body.free(side, start)[0]))
    path = plan_level(body, side, b)
    assume(path is not None)
    assert path is not None
    np.testing.assert_array_equal(path[0], start)
    np.testing.assert_allclose(R1.tcp(TORSO, path[-1], side), b, atol=1e-6)
    up_in_hand = R1.tcp(TORSO, np.stack(path), side)[:, 2, :3]
    np.testing.assert_allclose(up_in_hand, np.broadcast_to(a[2, :3], up_in_hand.shape), atol=1e-5)
    between = R1.tcp(TORSO, finely(path, 0.02), side)[:, 2, :3]
    assert np.arccos(np.clip(between @ a[2, :3], -1, 1)).max() < 0.1
    assert (np.stack(body.clearance(side, np.stack(path))) > 0).all()


@pytest.mark.parametrize("side", SIDES)
def test_a_level_path_goes_over_a_post(side: Side) -> None:
    """With a post in the direct line a level way over it is found, with either arm."""
    post = box((0.50, 0.27 * SIGN[side], 0.475), (0.06, 0.06, 0.95))
    goal = level(0.48, 0.12, 0.95, side)
    start = R1.nearest_posture(kin.inverse(R1.chest(TORSO)) @ level(0.48, 0.42, 0.95, side), side, r1.TRAVEL_ARM[side])
    assert start is not None
    body = Body(R1, TORSO, {**r1.TRAVEL_ARM, side: start}, {}, Surroundings([post]))
    direct = trace(R1, TORSO, side, start, goal)
    assert direct is not None
    assert not body.free(side, np.stack(direct)).all()
    path = plan_level(body, side, goal)
    assert path is not None
    assert body.free(side, finely(path), margin=-0.005).all()


@given(st.floats(0, 1), st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3))
def test_a_glide_goes_from_pose_to_pose(u: float, detour: list[float]) -> None:
    """It starts and ends at its poses, passes the detour half-way, and each pose on it is rigid."""
    start, goal = np.eye(4), kin.transform(kin.rot_z(1.0), (0.3, 0.2, 0.1))
    shares = np.array([0.0, 1.0, 0.5, u])
    first, last, middle, some = glide(start, goal, np.array(detour))(shares)
    np.testing.assert_allclose(first, start, atol=1e-9)
    np.testing.assert_allclose(last, goal, atol=1e-9)
    np.testing.assert_allclose(middle[:3, 3], goal[:3, 3] / 2 + detour, atol=1e-9)
    np.testing.assert_allclose(kin.inverse(some) @ some, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(glide(start, goal)(shares)[3, :3, 3], u * goal[:3, 3], atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(seeds, sides)
def test_a_sweep_keeps_hands_on_their_paths_and_arms_free(seed: int, side: Side) -> None:
    """While the torso moves evenly each posture has the hand on its path, no arm leaps, and nothing touches."""
    rng = np.random.default_rng(seed)
    start = R1.nearest_posture(kin.inverse(R1.chest(TORSO)) @ anywhere(rng, side), side, r1.TRAVEL_ARM[side])
    if start is None:
        return
    body = Body(R1, TORSO, {**r1.TRAVEL_ARM, side: start}, {}, Surroundings([POLE]))
    torso = np.array([rng.uniform(0.1, 0.5), 0.0, rng.uniform(-0.2, 0.6), 0.0])
    path = glide(R1.tcp(TORSO, start, side), anywhere(rng, side))
    arms = sweep(body, torso, {side: path})
    if arms is None or not body.all_free():
        return
    assert list(arms) == [side]
    np.testing.assert_array_equal(arms[side][0], start)
    for u, q in zip(np.linspace(0, 1, len(arms[side])), arms[side], strict=True):
        now = TORSO[:3] + (torso - TORSO)[:3] * u
        np.testing.assert_allclose(R1.tcp(now, q, side), path(np.array([u]))[0], atol=1e-6)
        moved = Body(R1, now, {**r1.TRAVEL_ARM, side: q}, {}, Surroundings([POLE]))
        assert u == 0 or moved.all_free()


def test_a_sweep_into_something_is_none() -> None:
    """Head, held thing or hand would meet a shelf: there is no sweep; without the shelf there is one."""
    level_hand = {"left": stay(R1.tcp(TORSO, r1.TRAVEL_ARM["left"], "left"))}
    bent = np.array([0.3, 0.0, 0.5, 0.0])
    shelf = box((0.40, 0.0, 1.30), (0.2, 0.6, 0.05))
    free, barred = (Body(R1, TORSO, dict(r1.TRAVEL_ARM), {}, Surroundings(s)) for s in ([], [shelf]))
    assert sweep(free, bent, {}) == {}
    assert sweep(barred, bent, {}) is None
    assert sweep(barred, TORSO, {}) == {}
    assert sweep(free, TORSO, level_hand) is not None  # type: ignore[arg-type]


@pytest.mark.parametrize(("pitch", "leads"), [(0.0, True), (0.5, False), (0.9, False)])
def test_a_trunk_may_leave_what_it_touches_and_not_come_nearer(pitch: float, leads: bool) -> None:
    """A picture may put the edge of a shelf into a bent head: it straightens up, and does not stay or go on into it."""
    bent = np.array([0.3, 0.0, 0.5, 0.0])
    x, _, z, _ = R1.chest(bent) @ np.append(R1.hull.trunk[0, :3], 1.0)  # the middle of the head, 12 cm in radius
    body = Body(R1, bent, dict(r1.TRAVEL_ARM), {}, Surroundings([box((x + 0.2, 0.0, z), (0.2, 0.6, 0.02))]))
    assert not body.trunk_free()
    assert (sweep(body, np.array([0.3, 0.0, pitch, 0.0]), {}) is not None) == leads


@settings(deadline=None, max_examples=30)
@given(seeds, sides)
def test_a_sweep_is_a_swing_that_is_clear(seed: int, side: Side) -> None:
    """What stands around does not change how the body swings, only whether it may: one swing serves all base poses."""
    rng = np.random.default_rng(seed)
    torso = np.array([rng.uniform(0.25, 0.45), 0.0, rng.uniform(0.0, 0.4), 0.0])
    bodies = [robot(), robot(POLE), robot(TABLE)]
    path = glide(R1.tcp(TORSO, r1.TRAVEL_ARM[side], side), anywhere(rng, side))
    free, *others = [swing(body, torso, {side: path}) for body in bodies]
    for arms in others:
        assert (arms is None) == (free is None)
        if arms is not None and free is not None:
            np.testing.assert_array_equal(arms[side], free[side])
    if free is not None:
        assert touching(bodies[0], torso, free) is None
        for body in bodies:
            met = trunk_touching(body, torso) or touching(body, torso, free)
            assert (sweep(body, torso, {side: path}) is None) == (met is not None)


@pytest.mark.parametrize(("rise_m", "barred"), [(-0.03, False), (0.001, True), (0.01, True)])
def test_a_sweep_keeps_the_corners_of_what_is_held_out_of_things(rise_m: float, barred: bool) -> None:
    """The torso goes down over a post: its top may stay well below the lowest corner, and may not meet it."""
    shoe = Solid("box", np.array([0.042, 0.125, 0.014]), kin.transform(kin.rot_z(0.5), (0.0, 0.0, 0.08)))
    down = TORSO - [0.15, 0.0, 0.0, 0.0]
    corners = points([shoe.moved(R1.tcp(down, r1.TRAVEL_ARM["left"], "left"))])
    x, y, z = corners[corners[:, 2].argmin()]
    post = box((x, y, z + rise_m - 0.05), (0.03, 0.03, 0.1))
    body = Body(R1, TORSO, dict(r1.TRAVEL_ARM), {"left": Load([shoe])}, Surroundings([post]))
    assert (sweep(body, down, {}) is None) == barred
