"""What the robot carries takes up floor in front of it, and is not swung into things."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.loaded import loaded_path
from mpvi_bt.finding.navigation.pursuit import PathFollower
from mpvi_bt.finding.navigation.traversability import Traversability, traversability
from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side
from mpvi_bt.hands.robots import r1
from mpvi_bt.runs.choices.navigators import explorer
from tests.depth_pictures import Box, picture
from tests.navigation_maps import KinematicRobot, put_box, thing, two_rooms

LOAD = Footprint(0.33, np.array([[0.45, 0.0, 0.18]]))


def test_a_held_thing_becomes_a_circle_in_the_base_frame() -> None:
    """What is held turns with the base; what lies in it, or is not held, adds nothing."""
    base = np.array([2.0, 1.0, np.pi / 2])
    bin_ = thing("bin", (2.0, 1.5, 0.6), (0.3, 0.2, 0.3), held=True)
    can = thing("can", (2.0, 1.5, 0.5), (0.06, 0.06, 0.1), held=True, inside="bin")
    table = thing("table", (3.0, 3.0, 0.4), (1.0, 1.0, 0.8))
    footprint = Footprint.carrying(0.33, base, [bin_, can, table])
    np.testing.assert_allclose(footprint.loads, [[0.5, 0.0, 0.17]], atol=1e-9)


def test_slack_falls_as_the_load_turns_toward_furniture() -> None:
    """Facing away from a sofa there is room; facing it there is none; with empty hands it does not matter."""
    floor = two_rooms()
    put_box(floor, (1.0, 0.5), (3.0, 1.2))
    grid = traversability(floor, 0.33)
    away, toward = np.array([2.0, 1.7, np.pi / 2]), np.array([2.0, 1.7, -np.pi / 2])
    assert LOAD.slack(grid, away) > 0 > LOAD.slack(grid, toward)
    assert Footprint(0.33, np.zeros((0, 3))).slack(grid, toward) == 9.0


@pytest.mark.parametrize("yaw", [-0.6, -0.5])
def test_a_load_is_not_swung_into_a_sofa_on_the_way(yaw: float) -> None:
    """Where the short way round would swing the load into a sofa, it is not taken, and the goal is reached."""
    floor = two_rooms()
    put_box(floor, (0.05, 0.5), (3.9, 1.2))
    grid = traversability(floor, 0.33)
    start, goal = np.array([2.6, 1.7, yaw]), np.array([0.9, 2.2, np.pi])

    def worst(path: np.ndarray) -> tuple[float, np.ndarray]:
        follower = PathFollower(path, goal, grid)
        pose, least = start.copy(), 9.0
        for _ in range(900):
            vx, vy, rate = follower.command(pose)
            c, s = np.cos(pose[2]), np.sin(pose[2])
            pose = pose + np.array([c * vx - s * vy, s * vx + c * vy, rate]) / 30
            least = min(least, float(LOAD.slack(grid, pose)))
        return least, pose

    heedless, _ = worst(np.linspace(start[:2], goal[:2], 35))
    path = loaded_path(grid, LOAD, start, goal)
    assert path is not None
    careful, end = worst(path)
    assert heedless < -0.05 < -0.02 < careful
    np.testing.assert_allclose(end[:2], goal[:2], atol=0.05)


@pytest.mark.parametrize("seed", range(20))
def test_a_way_with_a_load_fits_at_every_pose(seed: int) -> None:
    """Between free poses in two rooms: neither base nor load touches, steps are small, and it ends at the goal."""
    rng, floor = np.random.default_rng(seed), two_rooms()
    put_box(floor, (1.2, 0.5), (2.6, 1.0))
    grid = traversability(floor, 0.33)
    start, goal = (free_pose(grid, rng, low) for low in (0.4, 4.4))
    path = loaded_path(grid, LOAD, start, goal)
    assert path is not None
    np.testing.assert_array_equal(path[0, :2], start[:2])
    np.testing.assert_array_equal(path[-1, :2], goal[:2])
    assert np.cos(path[-1, 2] - goal[2]) == pytest.approx(1.0)
    assert np.abs(np.diff(path[:, :2], axis=0)).max() <= 0.075 + 1e-9  # from anywhere in a cell
    assert np.abs(np.diff(path[:, 2])).max() <= 2 * np.pi / 48 + 1e-9
    assert LOAD.slack(grid, path[1:-1]).min() >= -0.01
    assert all(np.isfinite(grid.cost[grid.map.cell(pose)]) for pose in path)


def test_a_load_that_is_too_wide_for_the_doorway_has_no_way() -> None:
    """Nor has any load where the base itself has none."""
    grid, wide = traversability(two_rooms(0.9), 0.33), Footprint(0.33, np.array([[0.4, 0.0, 0.48]]))
    start, goal = np.array([2.0, 2.0, 0.0]), np.array([6.0, 2.0, 0.0])
    assert loaded_path(grid, LOAD, start, goal) is not None
    assert loaded_path(grid, wide, start, goal) is None
    assert loaded_path(traversability(two_rooms(0.0), 0.33), LOAD, start, goal) is None


def test_a_wide_load_turns_back_from_a_long_dead_end() -> None:
    """Its base alone would go by a narrow door at the end of a long hall: the hall beside it is found none the less."""
    occupied = np.zeros((70, 800), bool)  # 3.5 x 40 m
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[34, 40:760] = True
    occupied[:34, 750] = True
    occupied[10:26, 750] = False
    halls = OccupancyMap(occupied, np.zeros(occupied.shape, np.int16), ("hall",), 0.05, np.zeros(2))
    grid, wide = traversability(halls, 0.33), Footprint(0.33, np.array([[0.4, 0.0, 0.48]]))
    path = loaded_path(grid, wide, np.array([1.0, 0.9, 0.0]), np.array([39.0, 0.9, 0.0]))
    assert path is not None
    assert (path[np.abs(path[:, 0] - 20.0) < 15.0][:, 1] > 1.7).all()


def test_a_load_over_a_table_may_leave_it() -> None:
    """What touches where the drive begins, or is to end, may do so there, and nowhere else."""
    floor = two_rooms()
    put_box(floor, (0.05, 0.5), (0.9, 3.5))
    grid = traversability(floor, 0.33)
    at_table, away = np.array([1.35, 2.0, np.pi]), np.array([3.0, 3.0, np.pi / 2])
    for start, goal in ((at_table, away), (away, at_table)):
        assert LOAD.slack(grid, at_table) < 0
        path = loaded_path(grid, LOAD, start, goal)
        assert path is not None
        touching = [pose for pose in path if LOAD.slack(grid, pose) < -0.01]
        assert max(np.linalg.norm(pose[:2] - at_table[:2]) for pose in touching) <= 0.8
        assert min(LOAD.slack(grid, pose) for pose in touching) >= LOAD.slack(grid, at_table) - 0.05


@pytest.mark.parametrize("yaw", [0.0, 1.5, -1.5])
def test_over_a_table_a_load_is_not_swung(yaw: float) -> None:
    """What else stands on it is on no map of the floor: the load is drawn off straight, and set down likewise."""
    floor = two_rooms()
    put_box(floor, (0.05, 0.5), (0.9, 3.5))
    grid = traversability(floor, 0.33)
    at_table, away = np.array([1.35, 2.0, np.pi]), np.array([1.35, 3.0, yaw])
    for start, goal in ((at_table, away), (away, at_table)):
        path = loaded_path(grid, LOAD, start, goal)
        assert path is not None
        over = LOAD.places(path[LOAD.slack(grid, path) < -0.01])[:, 0]
        assert np.abs(over[:, 1] - 2.0).max() < 0.1


def free_pose(grid: Traversability, rng: np.random.Generator, low: float) -> np.ndarray:
    """A pose where base and load are free, with x from `low` on, within 3 m [m, m, rad]."""
    while True:
        pose = np.array([rng.uniform(low, low + 3), rng.uniform(0.4, 3.6), rng.uniform(-np.pi, np.pi)])
        if np.isfinite(grid.cost[grid.map.cell(pose)]) and LOAD.slack(grid, pose) > 0.05:
            return pose


class Reaching(KinematicRobot):
    """A robot that holds one arm out before it, over free floor; its camera sees its hand and its wrist."""

    time_s, steps = 0.0, 0

    def proprioception(self) -> Proprioception:
        """As it feels."""
        arm: dict[Side, Array] = {
            "left": r1.TRAVEL_ARM["left"],
            "right": np.array([-0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        }
        return replace(super().proprioception(), torso=r1.TRAVEL_TORSO, arm=arm)

    def look(self, camera: str) -> CameraImage:
        """A picture of the head."""
        hand = r1.R1.tcp(r1.TRAVEL_TORSO, self.proprioception().arm["right"], "right")
        ends = [hand[:3, 3], hand[:3, 3] - 0.1 * hand[:3, 2]]
        boxes: list[Box] = [((x - 0.03, y - 0.03, z - 0.03), (x + 0.03, y + 0.03, z + 0.03)) for x, y, z in ends]
        return picture((0.0, 0.0, 0.0), boxes)


def test_an_arm_that_is_held_out_is_no_obstacle_on_the_way() -> None:
    """However far beyond the base: nothing of it gets into the map, where it would be in the way wherever it goes."""
    robot = Reaching(0.0, 0.0)
    hand = r1.R1.tcp(r1.TRAVEL_TORSO, robot.proprioception().arm["right"], "right")[:3, 3]
    assert np.linalg.norm(hand[:2]) > 0.55
    world = SimpleNamespace(robot=robot, time_s=0.0, steps=0)
    mapper = explorer(world, None, ("cup",), SegmentationDetector({}), "online").mapper  # type: ignore[arg-type]
    image = robot.look("head")
    assert mapper.occupancy.update(image)
    solid = int(mapper.solid.sum())
    assert solid > 0
    mapper = explorer(world, None, ("cup",), SegmentationDetector({}), "online").mapper  # type: ignore[arg-type]
    mapper.look()
    assert not mapper.solid.any()


def test_the_back_of_what_is_carried_is_no_obstacle_on_the_way() -> None:
    """A box before the body is larger than what was seen of it: its corners do not get into the map either."""
    robot = Reaching(0.0, 0.0)
    crate: Box = ((0.45, -0.24, 0.5), (0.95, 0.24, 0.7))
    robot.look = lambda camera: picture((0.0, 0.0, 0.0), [crate])  # type: ignore[method-assign]
    world = SimpleNamespace(robot=robot, time_s=0.0, steps=0)
    mapper = explorer(world, None, ("cup",), SegmentationDetector({}), "online").mapper  # type: ignore[arg-type]
    seen = thing("crate", (0.66, 0.0, 0.6), (0.42, 0.42, 0.2), held=True)
    mapper.discoveries.knowledge.put(seen)
    mapper.look()
    assert not mapper.solid.any()
    seen.held = False
    mapper.look()
    assert mapper.solid.any()


def test_with_what_is_taken_from_the_floor_its_place_becomes_free() -> None:
    """And where it was taken from a table, the table stays."""
    for floor, free in ((0.0, True), (0.7, False)):
        robot = KinematicRobot(0.0, 0.0)
        crate: Box = ((1.5, -0.2, floor), (1.9, 0.2, floor + 0.3))
        robot.look = lambda camera, crate=crate: picture((0.0, 0.0, 0.0), [crate])  # type: ignore[method-assign, misc]
        world = SimpleNamespace(robot=robot, time_s=0.0, steps=0)
        mapper = explorer(world, None, ("cup",), SegmentationDetector({}), "online").mapper  # type: ignore[arg-type]
        mapper.look()
        assert mapper.solid.any()
        mapper.discoveries.feel = lambda body, crate=crate: [np.array(crate)]  # type: ignore[method-assign, misc]
        mapper.feel()
        assert mapper.solid.any() != free
