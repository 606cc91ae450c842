"""A base that is not round: where it may stand, ways for it, and driving them, against exact geometry."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.navigation.driver import Driver
from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.grid import shortest_path
from mpvi_bt.finding.navigation.loaded import loaded_path
from mpvi_bt.finding.navigation.traversability import traversability
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1pro import R1PRO
from tests.navigation_maps import KinematicRobot, put_box, two_rooms
from tests.test_driving import Eyes, drive, furnished

BASE = R1PRO.base
FOOTPRINT = Footprint(BASE.radius_m, np.zeros((0, 3)), BASE.circles)
WEDGE = MobileBase(0.2, 0.2, 0.3, 0.5, np.array([(-0.3, -0.3), (0.5, -0.2), (0.5, 0.2), (-0.3, 0.3)]))
AROUND_M = float(np.hypot(*BASE.corners.T).max())  # of a disc that it would fit in


class Boxy(KinematicRobot):
    """The r1pro as it begins an episode."""

    def proprioception(self) -> Proprioception:
        """What it feels."""
        return replace(super().proprioception(), torso=R1PRO.travel_torso, arm=R1PRO.travel_arm, robot="r1pro")


def depths(poses: Array, grid_map: OccupancyMap) -> Array:
    """(n,) how deep [m] the base's rectangle at poses (n, 3) is in the squares of occupied cells; 0: it is not.

    By the separating axis theorem, of rectangle and square.
    """
    squares = (np.argwhere(grid_map.occupied)[:, ::-1] + 0.5) * grid_map.resolution_m + grid_map.origin_m
    low, high = BASE.corners.min(0), BASE.corners.max(0)
    half, out = grid_map.resolution_m / 2, np.zeros(len(poses))
    for i, (x, y, yaw) in enumerate(poses):
        near = squares[np.abs(squares - (x, y)).max(1) < 1.0]
        c, s = math.cos(yaw), math.sin(yaw)
        R = np.array([[c, -s], [s, c]])
        own, spread = (near - (x, y)) @ R, half * (abs(c) + abs(s))
        corners = BASE.corners @ R.T + (x, y)
        left, right = near - half, near + half
        inside = [own + spread - low, high - own + spread, right - corners.min(0), corners.max(0) - left]
        out[i] = max(0.0, np.concatenate(inside, 1).min(1).max(initial=0.0))
    return out


def between(path: Array) -> Array:
    """(n, 3) poses on a path, none more than 1 cm or 0.02 rad from the next."""
    steps = [path[:1]]
    for a, b in pairwise(path):
        n = math.ceil(max(math.dist(a[:2], b[:2]) / 0.01, abs(b[2] - a[2]) / 0.02, 1))
        steps.append(a + (b - a) * np.linspace(0, 1, n + 1)[1:, None])
    return np.concatenate(steps)


def free_poses(grid_map: OccupancyMap, rng: np.random.Generator, count: int) -> Array:
    """(n, 3) random poses in a hall that the footprint takes for free."""
    grid = traversability(grid_map, BASE.radius_m)
    rows, columns = grid_map.occupied.shape
    poses = rng.uniform((0, 0, -math.pi), (columns * 0.05, rows * 0.05, math.pi), (count, 3))
    cells = np.floor(grid.cells(poses)).astype(int)
    return poses[np.isfinite(grid.cost[cells[:, 0], cells[:, 1]]) & (FOOTPRINT.room(grid, poses) >= 0)]


@pytest.mark.parametrize("base", [BASE, WEDGE], ids=["r1pro", "wedge"])
def test_circles_cover_the_outline_and_little_besides(base: MobileBase) -> None:
    """Each point of the outline is in one of them, or in that about the origin; none reaches 3 cm beyond an edge."""
    corners = base.corners
    weights = np.random.default_rng(0).dirichlet(np.full(len(corners), 0.3), 20000)
    points = np.concatenate([weights @ corners, corners])
    circles = np.vstack([base.circles, [0.0, 0.0, base.radius_m]])
    assert (np.hypot(*(points[:, None] - circles[:, :2]).transpose(2, 0, 1)) <= circles[:, 2]).any(1).all()
    along = np.roll(corners, -1, 0) - corners
    outward = np.stack([along[:, 1], -along[:, 0]], 1) / np.hypot(*along.T)[:, None]
    reach = (circles[:, :2] @ outward.T + circles[:, 2:]).max(0)
    assert (reach <= (corners * outward).sum(1) + 0.03 + 1e-9).all()


def test_a_round_base_has_no_circles() -> None:
    """Its outline is its radius, however it is turned, and it reaches as far as it is to be kept clear."""
    assert not len(R1.base.circles)
    assert R1.base.reach(1.0) == R1.base.folded_m


@pytest.mark.parametrize("seed", range(6))
def test_where_it_may_stand_it_touches_nothing(seed: int) -> None:
    """Among furniture, poses that are taken for free are."""
    rng = np.random.default_rng(seed)
    grid_map = furnished(rng)
    poses = free_poses(grid_map, rng, 4000)
    assert len(poses) > 200
    assert depths(poses, grid_map).max() == 0.0


def test_between_walls_little_room_is_wasted() -> None:
    """In a passage of 0.85 m it may stand lengthwise, which is 17 cm more than it is wide; across it may not."""
    grid_map = two_rooms(0.85)
    grid = traversability(grid_map, BASE.radius_m)
    assert FOOTPRINT.room(grid, np.array([4.0, 2.0, 0.0])) >= 0
    assert FOOTPRINT.room(grid, np.array([4.0, 2.0, math.pi / 4])) < 0


def test_ways_touch_nothing() -> None:
    """From free pose to free pose, among furniture: neither at the poses of the way nor between them."""
    found = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        grid_map = furnished(rng)
        grid, poses = traversability(grid_map, BASE.radius_m), free_poses(grid_map, rng, 1000)
        for start, goal in zip(poses[:6:2], poses[1:6:2], strict=True):
            if (way := loaded_path(grid, FOOTPRINT, start, goal)) is not None:
                found += 1
                assert depths(between(way), grid_map).max() == 0.0
    assert found >= 12


def arrives(grid_map: OccupancyMap, start: Array, goal: Array) -> tuple[str, Array]:
    """Why a drive failed, or "", and the poses of the robot on its way."""
    robot = Boxy(*start)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    reason, poses = drive(robot, driver, [goal], Eyes(robot, grid_map, grid_map))
    return reason, np.array(poses)


def test_it_drives_through_a_doorway_that_is_too_narrow_for_a_disc() -> None:
    """Of 0.9 m, where a disc about it would need 1.04 m."""
    grid_map, goal = two_rooms(0.9), np.array([7.0, 3.0, -1.0])
    disc = traversability(grid_map, AROUND_M)
    assert shortest_path(disc.cost, grid_map.cell((1.0, 1.0)), grid_map.cell(goal)) is None
    reason, poses = arrives(grid_map, np.array([1.0, 1.0, 2.0]), goal)
    assert reason == ""
    assert depths(poses, grid_map).max() == 0.0
    np.testing.assert_allclose(poses[-1, :2], goal[:2], atol=0.04)


def test_where_it_does_not_fit_it_says_so() -> None:
    """Through 0.7 m there is no way; into a niche that is as deep as the base's middle needs, there is no place."""
    reason, poses = arrives(two_rooms(0.7), np.array([1.0, 1.0, 0.0]), np.array([7.0, 2.0, 0.0]))
    assert reason == "no_path"
    assert len(poses) == 1
    grid_map = two_rooms(0.9)
    reason, _ = arrives(grid_map, np.array([1.0, 1.0, 0.0]), np.array([7.6, 2.0, 0.5]))
    assert reason == "goal_in_obstacle"


def test_it_turns_where_a_disc_cannot_even_stand() -> None:
    """Beside a wall it drives off a little while it turns around, and back."""
    grid_map = two_rooms(0.9)
    put_box(grid_map, (1.0, 1.0), (3.0, 1.6))
    start = np.array([2.0, 2.04, 0.0])
    assert not np.isfinite(traversability(grid_map, AROUND_M).cost[grid_map.cell(start)])
    robot = Boxy(*start)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    poses = []
    for _ in driver.turn(math.pi, "turning"):
        robot.advance()
        poses.append(robot.pose.copy())
    assert abs(abs(robot.pose[2]) - math.pi) < 0.06
    assert depths(np.array(poses), grid_map).max() == 0.0


@pytest.mark.parametrize("seed", range(12))
def test_driving_it_keeps_off_furniture(seed: int) -> None:
    """Following ways among furniture its corners are never deeper than 1 cm in anything; it arrives where a way is."""
    rng = np.random.default_rng(seed)
    grid_map = furnished(rng)
    start, goal = free_poses(grid_map, rng, 1000)[:2]
    reason, poses = arrives(grid_map, start, goal)
    assert depths(poses, grid_map).max() < 0.01
    way = loaded_path(traversability(grid_map, BASE.radius_m), FOOTPRINT, start, goal)
    assert (reason == "") == (way is not None)
