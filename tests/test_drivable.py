"""Straight drives of a base with corners and a knee: what a search for a stance takes to be free is free."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.ground.robot.collision import Load, Surroundings
from mpvi_bt.ground.robot.mobile_base import placed
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.ground.robot.protocol import Proprioception, Side
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.hands.stance.stance_search import Search
from tests.small_house import small_world

START, AHEAD = np.zeros(3), np.array([0.6, 0.0, 0.0])
BENT = R1PRO.trunk.joints(np.array([0.05, 0.0, 1.1, 0.0]))
FAR_M = 0.08  # Our choice: what is farther off than that is in nobody's way


@cache
def felt() -> Proprioception:
    world = small_world(robot=R1PRO)
    return world.robot.proprioception()


def site(*obstacles: Solid, torso: Array = R1PRO.travel_torso) -> Search:
    """The r1pro, empty-handed at the origin, among these."""
    body = replace(felt(), torso=torso, base_pose=START.copy())
    return Search(Motion(body), "right", {}, Surroundings(obstacles), [], np.random.default_rng(0))


@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(-3.1, 3.1))
def test_a_base_stands_where_its_whole_outline_is_clear(ahead: float, left: float, yaw: float) -> None:
    """A post under any part of it is in the way, the corners' too; one 8 cm beside it is not."""
    base = np.array([0.3, -0.4, yaw])
    x, y = placed(np.array([[ahead, left]]), base)[0]
    post = Solid("cylinder", np.array([0.005, 0.005, 0.1]), kin.transform(np.eye(3), (x, y, 0.1)))
    low, high = R1PRO.base.corners.min(0), R1PRO.base.corners.max(0)
    off = float(np.linalg.norm(np.maximum(np.maximum(low - (ahead, left), (ahead, left) - high), 0.0)))
    stands = bool(site(post).stands(base[None])[0])
    assert stands if off > FAR_M else off > 0.0 or not stands


def test_a_drive_goes_nowhere_where_the_knee_meets_something() -> None:
    """A board at the height of the knee that the base would pass under: the farther the trunk is bent the nearer."""
    for torso in (R1PRO.travel_torso, BENT):
        knee, radii = R1PRO.links(torso)
        reach = float((knee[:, 0] + radii).max())
        height = float(knee[knee[:, 0].argmax(), 2])
        assert reach > R1PRO.base.corners[:, 0].max() + 0.05
        for off, free in ((-0.05, False), (0.02, True)):
            board = box((0.6 + reach + off + 0.2, 0.0, height), (0.4, 0.6, 0.02))
            assert site(board).stands(AHEAD[None])[0]
            assert site(board, torso=torso).drivable(START, AHEAD) is free


def test_a_knee_that_is_over_something_comes_out_and_not_farther_in() -> None:
    """Where the trunk was bent over a board the base drives back, and not ahead."""
    knee, radii = R1PRO.links(BENT)
    front = float((knee[:, 0] + radii).max())
    board = box((front + 0.15, 0.0, float(knee[knee[:, 0].argmax(), 2])), (0.34, 0.6, 0.02))
    there = site(board, torso=BENT)
    assert there.drivable(START, np.array([-0.4, 0.0, 0.0]))
    assert not there.drivable(START, np.array([0.1, 0.0, 0.0]))


def test_corners_that_swing_out_as_a_turn_begins_are_heeded() -> None:
    """Between two walls beside it the base goes ahead; it turns only where both are farther off than its corners."""
    half, corner = 0.34, float(np.linalg.norm(R1PRO.base.corners, axis=1).max())
    turned = np.array([0.0, 0.0, np.pi])
    for wall_m, turns in ((half + 0.05, False), (corner + 0.09, True)):
        walls = [box((0.0, side * (wall_m + 0.05), 0.15), (3.0, 0.1, 0.3)) for side in (-1, 1)]
        assert site(*walls).drivable(START, AHEAD)
        assert site(*walls).drivable(START, turned) is turns
    post = box((-0.30, half + 0.07, 0.15), (0.04, 0.04, 0.3))
    assert site(post).stands(START[None])[0]
    assert not site(post).drivable(START, np.array([0.0, 0.0, -0.6]))


def test_a_base_with_corners_turns_where_there_is_room_for_it() -> None:
    """Out of a passage, or into one, in which it has no room to turn: it drives as it stands, or turns first."""
    walls = [box((0.0, side * 0.45, 0.15), (1.4, 0.1, 0.3)) for side in (-1, 1)]
    outside, there = np.array([1.3, 0.0, np.pi / 2]), site(*walls)
    for start, goal in ((START, outside), (outside, START)):
        assert not there.drivable(start, goal)
        way = there.route(start, goal)
        assert way is not None
        np.testing.assert_allclose(np.stack(way), np.stack([np.array([1.3, 0.0, 0.0]), goal]), atol=1e-9)


def test_what_is_carried_is_not_driven_into_what_is_known_underfoot() -> None:
    """Where hidden space is trusted, a sofa that only the way there has shown keeps off what a hand holds, too."""
    there = site()
    x, y, z = there.motion.hand("left")[:3, 3]
    bag = Load([box((0.0, 0.0, 0.1), (0.2, 0.2, 0.2))])
    held: dict[Side, Held] = {"left": Held("bag", "left", np.eye(4), (), bag)}
    for ahead, free in ((0.35, False), (1.2, True)):
        board = box((x + ahead + 0.2, y + 0.1, z - 0.1), (0.4, 0.1, 0.1))
        carrying = replace(there, held=held, underfoot=Surroundings([board]))
        assert carrying.stands(AHEAD[None])[0]
        assert carrying.drivable(START, AHEAD) is free
        assert replace(carrying, held={}).drivable(START, AHEAD)
