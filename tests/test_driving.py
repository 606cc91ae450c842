"""Laws of the driver on random maps: it keeps off what it could know of, replans, and arrives or says why."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.navigation.driver import DEFAULTS, Driver, GaveUp
from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.goals import Goal, distance_to
from mpvi_bt.finding.navigation.grid import cost_to_reach
from mpvi_bt.finding.navigation.traversability import Traversability, traversability
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.hands.robots import r1
from tests.layouts import BASE
from tests.navigation_maps import KinematicRobot, put_box, thing, two_rooms

FOOTPRINT_M = 0.33
TOLERANCE_M = 0.05  # one cell
BOX = np.array([[0.55, 0.0, 0.25], [0.22, 0.31, 0.05], [0.22, -0.31, 0.05], [0.52, 0.37, 0.05], [0.52, -0.37, 0.05]])
"""Loads: x, y, radius [m] of a box of 0.4 m, and of elbows and hands that hold it."""
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


def steady(poses: list[Array], limit_m_s2: float) -> bool:
    """Whether the velocity in the world never changed faster than the limit, with a hundredth for turning."""
    velocity = np.diff(np.array(poses)[:, :2], axis=0) * CONTROL_HZ
    changes = np.diff(np.vstack([np.zeros(2), velocity]), axis=0)
    return bool(np.hypot(*changes.T).max(initial=0.0) <= 1.01 * limit_m_s2 / CONTROL_HZ)


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
    robot = KinematicRobot(start[0], start[1], rng.uniform(-math.pi, math.pi))
    eyes = Eyes(robot, known, true)
    narrow = bool(seed % 2)
    driver = Driver(robot, lambda: eyes.map, KnowledgeBase, parameters=replace(DEFAULTS, narrow=narrow))
    goals = [np.array([*end, rng.uniform(-math.pi, math.pi)]) for end in ends]
    reason, poses = drive(robot, driver, goals, eyes)
    clearance = traversability(true, FOOTPRINT_M).clearance_m
    assert (
        min(clearance[true.cell(pose)] for pose in poses) >= (r1.BASE_RADIUS_M if narrow else FOOTPRINT_M) - TOLERANCE_M
    )
    assert steady(poses, driver.parameters.limits.acceleration_m_s2)
    if reason:
        assert reason in REASONS
        assert not any(reachable(true, FOOTPRINT_M + 0.1, robot.pose[:2], goal[:2]) for goal in goals)
    else:
        assert min(math.dist(robot.pose[:2], goal[:2]) for goal in goals) <= 0.03


@pytest.mark.parametrize("seed", range(24))
def test_a_box_before_the_body_meets_nothing_either(seed: int) -> None:
    """With a large box held in both hands, from a free pose to another: nothing touches, and the way is found."""
    rng = np.random.default_rng(seed)
    known = furnished(rng) if seed % 2 else two_rooms(0.9)
    grid = traversability(known, FOOTPRINT_M)
    footprint = Footprint(FOOTPRINT_M, BOX)

    def pose() -> Array:
        while True:
            drawn = np.array([*free_places(grid, rng, 1)[0], rng.uniform(-math.pi, math.pi)])
            if footprint.slack(grid, drawn) > 0.05:
                return drawn

    robot, goal = Carrier(pose()), pose()
    if not reachable(known, FOOTPRINT_M, robot.pose[:2], goal[:2]):
        return
    eyes = Eyes(robot, known, known)
    driver = Driver(robot, lambda: known, robot.knowledge)
    reason, poses = drive(robot, driver, [goal], eyes)
    assert not reason
    assert min(footprint.slack(grid, pose) for pose in poses) >= -TOLERANCE_M / 2
    assert steady(poses, driver.parameters.carrying.acceleration_m_s2)


def test_a_way_as_wide_as_the_base_is_taken_where_there_is_no_other() -> None:
    """Through 0.6 m, as between an open door and a sofa, straight and slowly; where a wider way is free, through that.

    A robot that may not be narrower finds no way, nor does one in whose hand a thing is too wide for the gap.
    """
    grid_map = two_rooms(0.6)
    goal = np.array([7.0, 2.0, 0.0])
    for narrow, expected in ((False, "no_path"), (True, "")):
        robot = KinematicRobot(1.0, 3.0, 2.0)
        driver = Driver(robot, lambda: grid_map, KnowledgeBase, parameters=replace(DEFAULTS, narrow=narrow))
        reason, poses = drive(robot, driver, [goal], Eyes(robot, grid_map, grid_map))
        assert reason == expected
    clear = driver.grid().clearance_m
    assert min(clear[grid_map.cell(pose)] for pose in poses) > r1.BASE_RADIUS_M - 0.01
    board = thing("board", (1.5, 3.0, 0.8), (0.1, 0.9, 0.02), held=True)
    laden = KinematicRobot(1.0, 3.0)
    driver = Driver(laden, lambda: grid_map, lambda: KnowledgeBase({"board": board}))
    assert drive(laden, driver, [goal], Eyes(laden, grid_map, grid_map))[0] == "no_path"
    wide = two_rooms(0.6)
    wide.occupied[10:30, 75:85] = False  # a second doorway of 1 m, farther off
    robot = KinematicRobot(1.0, 3.0)
    reason, poses = drive(robot, Driver(robot, lambda: wide, KnowledgeBase), [goal], Eyes(robot, wide, wide))
    assert not reason
    assert all(pose[1] < 1.5 for pose in poses if abs(pose[0] - 4.0) < 0.1)


def test_near_obstacles_it_is_slow() -> None:
    """Through a doorway of 0.9 m slower than through the open, and never faster than the room there allows."""
    grid_map, robot = two_rooms(0.9), KinematicRobot(1.0, 2.0)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    _, poses = drive(robot, driver, [np.array([7.0, 2.0, 0.0])], Eyes(robot, grid_map, grid_map))
    limits = driver.parameters.limits
    speeds = np.hypot(*np.diff(np.array(poses)[:, :2], axis=0).T) * CONTROL_HZ
    room = np.array([driver.grid().clearance_m[grid_map.cell(pose)] for pose in poses[:-1]]) - FOOTPRINT_M
    allowed = limits.tight_m_s + (limits.speed_m_s - limits.tight_m_s) * (room / limits.roomy_m).clip(0, 1)
    assert (speeds <= allowed + 0.05).all()  # a cell's change of room is met within a few steps
    assert speeds.max() > 0.99 * limits.speed_m_s
    assert speeds[np.abs(np.array(poses)[:-1, 0] - 4.0) < 0.05].max() < 0.75 * limits.speed_m_s


# ------------------------------------------------------------------------------------------- what changes


def test_a_way_that_closes_ends_the_drive_at_rest() -> None:
    """The doorway is shut while the base drives: it brakes, at no place where it may not be, and says so."""
    grid_map, robot = two_rooms(0.9), KinematicRobot(1.0, 2.0)
    shut = two_rooms(0.0)
    driver = Driver(robot, lambda: grid_map if robot.pose[0] < 2.5 else shut, KnowledgeBase)
    reason, poses = drive(robot, driver, [np.array([7.0, 2.0, 0.0])], Eyes(robot, grid_map, grid_map))
    assert reason == "no_path"
    assert poses[-1][0] < 3.0
    assert not robot.action[BASE].any()
    assert steady(poses, driver.parameters.limits.acceleration_m_s2)


def test_the_next_goal_is_driven_to_once_the_first_is_seen_to_be_taken() -> None:
    """What stands where the base was to go makes it go to the next best goal."""
    grid_map, robot = hall(), KinematicRobot(1.0, 2.5)
    eyes = Eyes(robot, grid_map, with_disc(grid_map, np.array([5.0, 2.5]), 0.2))
    driver = Driver(robot, lambda: eyes.map, KnowledgeBase)
    goals = [np.array([5.0, 2.5, 0.0]), np.array([5.0, 1.0, 0.0])]
    reason, _ = drive(robot, driver, goals, eyes)
    assert not reason
    np.testing.assert_allclose(robot.pose, goals[1], atol=0.05)


def test_the_next_goal_is_driven_to_where_the_base_was_stopped() -> None:
    """What no map shows but stops the base before one goal is noted, and the goal left alone."""
    grid_map, robot = hall(), KinematicRobot(1.0, 2.5)
    robot.walls = with_disc(replace(grid_map, occupied=np.zeros_like(grid_map.occupied)), np.array([5.0, 2.5]), 0.7)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    goals = [np.array([5.0, 2.5, 0.0]), np.array([2.0, 1.0, 0.0])]
    reason, _ = drive(robot, driver, goals, Eyes(robot, grid_map, grid_map))
    assert not reason
    np.testing.assert_allclose(robot.pose, goals[1], atol=0.05)
    assert driver.blocks
    driver.forget()
    assert not driver.blocks


def test_backing_off_keeps_off_what_is_known() -> None:
    """With a wall right behind it, a base that was stopped does not back into the wall."""
    grid_map = hall()
    put_box(grid_map, (0.0, 0.0), (0.6, 5.0))
    robot = KinematicRobot(1.0, 2.5)
    robot.walls = with_disc(replace(grid_map, occupied=np.zeros_like(grid_map.occupied)), np.array([1.45, 2.5]), 0.4)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    _, poses = drive(robot, driver, [np.array([4.0, 2.5, 0.0])], Eyes(robot, grid_map, grid_map))
    assert driver.blocks
    clearance = driver.grid().clearance_m
    assert min(clearance[grid_map.cell(pose)] for pose in poses) >= FOOTPRINT_M - TOLERANCE_M


def test_a_map_that_never_rests_ends_the_drive() -> None:
    """Plans are bounded: obstacles that come up before the base again and again are a blocked way."""
    grid_map, robot = hall(12.0), KinematicRobot(1.0, 2.5)
    drawn = [0]

    def flickering() -> OccupancyMap:
        drawn[0] += 1
        ahead = robot.pose[:2] + 1.0 * np.array([math.cos(robot.pose[2]), math.sin(robot.pose[2])])
        return with_disc(grid_map, ahead, 0.10) if drawn[0] % 4 == 0 else grid_map

    driver = Driver(robot, flickering, KnowledgeBase, parameters=replace(DEFAULTS, replans=5))
    reason, _ = drive(robot, driver, [np.array([11.0, 2.5, 0.0])], Eyes(robot, grid_map, grid_map))
    assert reason == "blocked"


def test_nothing_is_computed_anew_while_nothing_changes() -> None:
    """One plan for a drive, and one planning grid while map and loose things stay as they are."""
    grid_map, robot, base, asked = hall(), KinematicRobot(1.0, 2.5), KnowledgeBase(), []
    base.put(thing("can", (3.0, 2.5, 0.06), (0.07, 0.07, 0.12)))
    driver = Driver(robot, lambda: grid_map, lambda: base)
    grid = driver.grid()
    steps = driver.to(lambda grid, start: asked.append(1) or [Goal(np.array([5.0, 2.5, 0.0]), 0.0)], "driving")  # type: ignore[func-returns-value]
    for _ in steps:
        robot.advance()
        base.put(thing("can", (3.0 + 1e-6, 2.5, 0.06), (0.07, 0.07, 0.12)))
    assert len(asked) == 1
    assert driver.grid() is grid
    base.put(thing("box", (3.0, 4.0, 0.1), (0.4, 0.4, 0.2)))
    assert driver.grid() is not grid


def test_a_loose_thing_that_turns_up_on_the_way_is_driven_around() -> None:
    """What the knowledge base learns of on the way counts as well as what the map does."""
    grid_map, robot, base = hall(), KinematicRobot(1.0, 2.5), KnowledgeBase()
    box = thing("box", (4.0, 2.5, 0.1), (0.4, 0.4, 0.2))

    def knowing() -> KnowledgeBase:
        if robot.pose[0] > 2.0:
            base.put(box)
        return base

    driver = Driver(robot, lambda: grid_map, knowing)
    reason, poses = drive(robot, driver, [np.array([5.5, 2.5, 0.0])], Eyes(robot, grid_map, grid_map))
    assert not reason
    assert min(distance_to(box, pose[:2]) for pose in poses) >= FOOTPRINT_M - TOLERANCE_M


def test_it_brakes_gently_when_it_is_told_to_go_no_farther() -> None:
    """`until` ends the drive with the base at rest, not with a jerk."""
    grid_map, robot = hall(), KinematicRobot(1.0, 2.5)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    poses = [robot.pose.copy()]
    goal = Goal(np.array([5.5, 2.5, 0.0]), 0.0)
    for _ in driver.to(lambda grid, start: [goal], "driving", lambda: bool(robot.pose[0] > 3.0)):
        robot.advance()
        poses.append(robot.pose.copy())
    assert 3.0 < robot.pose[0] < 3.4
    assert not robot.action[BASE].any()
    assert steady(poses, driver.parameters.limits.acceleration_m_s2)


def test_it_turns_on_the_spot() -> None:
    """To any yaw, without leaving its place."""
    for yaw in (-3.0, -1.0, 0.0, 2.0, math.pi):
        robot = KinematicRobot(1.0, 2.5)
        for _ in Driver(robot, hall, KnowledgeBase).turn(yaw, "turning"):
            robot.advance()
        np.testing.assert_allclose(robot.pose[:2], [1.0, 2.5], atol=0.03)
        assert abs(wrap(robot.pose[2] - yaw)) <= 0.05


# -------------------------------------------------------------------------------------------- bad input


def end(driver: Driver, robot: KinematicRobot, *goals: tuple[float, float, float]) -> str:
    """How a drive ends: a reason, or ""."""
    grid_map = driver.grid().map
    return drive(robot, driver, [np.array(goal) for goal in goals], Eyes(robot, grid_map, grid_map))[0]


def test_a_start_beside_an_obstacle_is_left_and_one_deep_inside_is_not() -> None:
    """Within the inflation of a wall, or in an obstacle, as under a lid, it leaves; deep in one it says it cannot."""
    grid_map = hall()
    put_box(grid_map, (2.0, 1.0), (5.5, 4.0))
    for start, reason in (((1.85, 2.5), ""), ((2.1, 2.5), ""), ((2.6, 2.5), ""), ((3.75, 2.5), "start_in_collision")):
        robot = KinematicRobot(*start)
        assert end(Driver(robot, lambda: grid_map, KnowledgeBase), robot, (1.0, 1.0, 0.0)) == reason


@pytest.mark.parametrize("seed", range(20))
def test_a_base_that_stands_too_near_leaves_without_coming_nearer(seed: int) -> None:
    """From anywhere beside furniture: never nearer to it than at first, and once in the open it stays there."""
    rng = np.random.default_rng(seed)
    known = furnished(rng)
    grid = traversability(known, FOOTPRINT_M)
    tight = np.argwhere(~known.occupied & grid.blocked)
    start = grid.points(tight[rng.integers(len(tight), size=1)])[0]
    goal = np.array([*free_places(grid, rng, 1)[0], 0.0])
    robot = KinematicRobot(start[0], start[1], rng.uniform(-3, 3))
    driver = Driver(robot, lambda: known, KnowledgeBase)
    reason, poses = drive(robot, driver, [goal], Eyes(robot, known, known))
    assert reason in {"", "no_path", "start_in_collision"}
    assert not (reason and reachable(known, FOOTPRINT_M + 0.1, start, goal[:2]))
    clear = np.array([grid.clearance_m[known.cell(pose)] for pose in poses])
    assert clear.min() >= clear[0] - TOLERANCE_M
    out = np.flatnonzero(clear >= FOOTPRINT_M)
    assert not len(out) or clear[out[0] :].min() >= r1.BASE_RADIUS_M - TOLERANCE_M


def test_every_end_that_cannot_be_reached_has_its_reason() -> None:
    """A goal in an obstacle, one off the map, one that is no number, none at all, one behind walls."""
    grid_map = two_rooms(0.0)
    put_box(grid_map, (1.0, 1.0), (2.0, 2.0))
    robot = KinematicRobot(3.0, 3.0)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    assert end(driver, robot, (1.5, 1.5, 0.0)) == "goal_in_obstacle"
    assert end(driver, robot, (50.0, -9.0, 0.0)) == "goal_in_obstacle"
    assert end(driver, robot, (math.nan, 1.0, 0.0)) == "goal_in_obstacle"
    assert end(driver, robot) == "goal_in_obstacle"
    assert end(driver, robot, (7.0, 2.0, 0.0)) == "no_path"
    assert end(driver, robot, (7.0, 2.0, 0.0), (1.5, 1.5, 0.0)) == "no_path"
    np.testing.assert_array_equal(robot.pose, [3.0, 3.0, 0.0])


def test_where_the_robot_stands_it_is_there_at_once() -> None:
    """A goal at its very pose takes no step."""
    robot = KinematicRobot(1.0, 2.5, 1.0)
    assert list(Driver(robot, hall, KnowledgeBase).to(lambda *_: [Goal(robot.pose.copy(), 0.0)], "driving")) == []


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 40)])
def test_a_map_without_room_is_no_exception(size: tuple[int, int]) -> None:
    """One cell, a strip, everything blocked: on the map or off it there is a reason."""
    grid_map = OccupancyMap(np.ones(size, bool), np.zeros(size, np.int16), ("hall",), 0.05, np.zeros(2))
    for start in ((0.02, 0.02), (1.0, 1.0), (-5.0, 9.0)):
        robot = KinematicRobot(*start)
        driver = Driver(robot, lambda: grid_map, KnowledgeBase)
        assert end(driver, robot, (0.02, 0.02, 0.0)) == "start_in_collision"


@pytest.mark.parametrize(("lost_s", "reason"), [(1.0, ""), (30.0, "no_pose")])
def test_a_lost_pose_stops_the_base_until_it_is_found(lost_s: float, reason: str) -> None:
    """NaN for a moment only makes it wait; for long it ends the drive; no command is ever NaN."""
    grid_map, robot = hall(), Lost(1.0, 2.5)
    driver = Driver(robot, lambda: grid_map, KnowledgeBase)
    robot.lost = range(60, 60 + round(lost_s * CONTROL_HZ))
    assert end(driver, robot, (5.0, 2.5, 0.0)) == reason
    robot.lost = range(10**9)
    assert end(driver, robot, (5.0, 2.5, 0.0)) == "no_pose"
    with pytest.raises(GaveUp, match="where it is"):
        list(driver.turn(0.0, "turning"))


class Lost(KinematicRobot):
    """Does not know where it is at some of its steps."""

    def __init__(self, x: float, y: float) -> None:
        super().__init__(x, y)
        self.lost, self.steps = range(0), 0

    def proprioception(self) -> Proprioception:
        """What it feels."""
        felt = super().proprioception()
        return replace(felt, base_pose=np.full(3, np.nan)) if self.steps in self.lost else felt

    def advance(self) -> None:
        """One step."""
        super().advance()
        self.steps += 1
        if self.steps in self.lost:
            assert not self.velocity.any() or self.steps == self.lost.start


class Carrier(KinematicRobot):
    """Holds a large box before its body."""

    def __init__(self, pose: Array) -> None:
        super().__init__(pose[0], pose[1], pose[2])
        self.gripper = {"left": (0.1, -1.0), "right": (0.1, -1.0)}

    def knowledge(self) -> KnowledgeBase:
        """Where the box is now, and elbows and hands beside it."""
        base = KnowledgeBase()
        places = Footprint(FOOTPRINT_M, BOX).places(self.pose)
        for k, ((x, y), radius) in enumerate(zip(places, BOX[:, 2], strict=True)):
            base.put(thing(f"part_{k}", (x, y, 0.6), (2 * radius - 0.04, 2 * radius - 0.04, 0.3), held=True))
        return base
