"""Laws of the driver on random maps: it keeps off what it could know of, replans, and arrives or says why."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.navigation.driver import Driver, GaveUp
from mpvi_bt.navigation.goals import Goal
from mpvi_bt.navigation.grid import cost_to_reach
from mpvi_bt.navigation.traversability import Traversability, traversability
from mpvi_bt.perception.knowledge import KnowledgeBase
from mpvi_bt.perception.map import OccupancyMap
from mpvi_bt.robot.kinematics import wrap
from mpvi_bt.robot.protocol import CONTROL_HZ
from mpvi_bt.robot.solids import Array
from tests.navigation_maps import KinematicRobot, put_box

FOOTPRINT_M = 0.33
TOLERANCE_M = 0.05  # one cell
REASONS = {"no_path", "blocked", "goal_in_obstacle", "start_in_collision"}


def hall(width_m: float = 6.0, depth_m: float = 5.0) -> OccupancyMap:
    """One room with walls around it."""
    occupied = np.zeros((round(depth_m / 0.05), round(width_m / 0.05)), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    return OccupancyMap(occupied, np.zeros(occupied.shape, np.int16), ("hall",), 0.05, np.zeros(2))


def furnished(rng: np.random.Generator) -> OccupancyMap:
    """A hall with a handful of boxes in it."""
    grid_map = hall()
    for _ in range(rng.integers(3, 9)):
        low = rng.uniform((0.0, 0.0), (5.5, 4.5))
        high = np.minimum(low + rng.uniform(0.2, 1.4, 2), (6.0, 5.0))
        put_box(grid_map, (low[0], low[1]), (high[0], high[1]))
    return grid_map


def with_disc(grid_map: OccupancyMap, xy: Array, radius_m: float) -> OccupancyMap:
    """Another map with a disc besides."""
    rows, columns = np.indices(grid_map.occupied.shape)
    away = np.hypot((columns + 0.5) * 0.05 - xy[0], (rows + 0.5) * 0.05 - xy[1])
    return replace(grid_map, occupied=grid_map.occupied | (away <= radius_m))


class Eyes:
    """A map that grows by what lies before the robot, within 1.5 m and 60 degrees to each side, seen through walls."""

    def __init__(self, robot: KinematicRobot, known: OccupancyMap, true: OccupancyMap) -> None:
        self.robot, self.map, self.true = robot, known, true

    def look(self) -> None:
        """Add what is seen now; the map stays the same object if that is nothing."""
        pose, shape = self.robot.pose, self.true.occupied.shape
        rows, columns = np.indices(shape)
        dx, dy = (columns + 0.5) * 0.05 - pose[0], (rows + 0.5) * 0.05 - pose[1]
        seen = (np.hypot(dx, dy) < 1.5) & (np.abs(wrap(np.arctan2(dy, dx) - pose[2])) < 1.05)
        new = seen & self.true.occupied & ~self.map.occupied
        if new.any():
            self.map = replace(self.map, occupied=self.map.occupied | new)


def drive(
    robot: KinematicRobot, driver: Driver, goals: list[Array], eyes: Eyes, most_s: float = 120.0
) -> tuple[str, list[Array]]:
    """Drive to one of the goals, looking around; the reason of failure, or "", and the poses."""
    steps = driver.to(lambda grid, start: [Goal(pose, float(k)) for k, pose in enumerate(goals)], "driving")
    poses = [robot.pose.copy()]
    for k in range(round(most_s * CONTROL_HZ)):
        if k % 9 == 0:
            eyes.look()
        try:
            next(steps)
        except StopIteration:
            return "", poses
        except GaveUp as failure:
            return failure.reason, poses
        robot.advance()
        poses.append(robot.pose.copy())
    raise AssertionError(f"still driving after {most_s} s at {robot.pose}")


def free_places(grid: Traversability, rng: np.random.Generator, count: int) -> Array:
    """(count, 2) places [m] where the footprint fits."""
    cells = np.argwhere(~grid.blocked)
    return grid.points(cells[rng.integers(len(cells), size=count)])


def reachable(grid_map: OccupancyMap, footprint_m: float, start: Array, goal: Array) -> bool:
    """Whether there is a way on the true map, by the planner's own grid."""
    grid = traversability(grid_map, footprint_m).escaping(start)
    return bool(np.isfinite(cost_to_reach(grid.cost, grid_map.cell(start))[grid_map.cell(goal)]))


@pytest.mark.parametrize("seed", range(60))
def test_it_arrives_or_says_why_and_keeps_off_what_it_sees_on_the_way(seed: int) -> None:
    """Among furniture, a part of which is in no map: the base's circle stays free, and a way that is there is found."""
    rng = np.random.default_rng(seed)
    known = furnished(rng)
    start, *ends = free_places(traversability(known, FOOTPRINT_M), rng, 4)
    true = known
    for _ in range(rng.integers(0, 4)):
        at, radius = rng.uniform((0.5, 0.5), (5.5, 4.5)), rng.uniform(0.05, 0.35)
        if math.dist(at, start) > radius + 0.8:
            true = with_disc(true, at, radius)
    robot = KinematicRobot(*start, rng.uniform(-math.pi, math.pi))
    eyes = Eyes(robot, known, true)
    driver = Driver(robot, lambda: eyes.map, KnowledgeBase)
    goals = [np.array([*end, rng.uniform(-math.pi, math.pi)]) for end in ends]
    reason, poses = drive(robot, driver, goals, eyes)
    clearance = traversability(true, FOOTPRINT_M).clearance_m
    assert min(clearance[true.cell(pose)] for pose in poses) >= FOOTPRINT_M - TOLERANCE_M
    if reason:
        assert reason in REASONS
        assert not any(reachable(true, FOOTPRINT_M + 0.1, robot.pose[:2], goal[:2]) for goal in goals)
    else:
        assert min(math.dist(robot.pose[:2], goal[:2]) for goal in goals) <= 0.03
