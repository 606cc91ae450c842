"""In physics: through doorways with both hands full, and around what only the camera shows."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import pytest

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.navigation.driver import Driver, GaveUp
from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.goals import Goal
from mpvi_bt.finding.navigation.traversability import Traversability
from mpvi_bt.finding.scene.occupancy import Occupancy
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.marked_yaml import parse_marked
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side
from mpvi_bt.ground.robot.stow import ArmStow
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.layout.house import House, check_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.testing.full_hands import put_in_hands
from tests.small_house import LARGE
from tests.test_expert import play

TOUCH_N = 20.0
HELD: Mapping[Side, str] = {"left": "carton_of_milk", "right": "can_of_soda"}


def two_halls(door_m: float) -> House:
    """Two rooms of 4 x 4 m with a doorway in the middle of the wall between."""
    hall = {"floor": "#9fb0ab", "walls": "#f6ecd4", "fixtures": {}}
    house = {
        "outside": "#efe6d6",
        "rooms": {"west": {"rect": [-4, -2, 0, 2], **hall}, "east": {"rect": [0, -2, 4, 2], **hall}},
        "doorways": [{"between": ["west", "east"], "at": [0.0, 0.0], "width_m": door_m}],
    }
    return check_house(*parse_marked(json.dumps(house), "halls.yaml"), load_catalogue())


def with_full_hands(house: House, name: str) -> SimWorld:
    """A world in which the robot has lifted a large thing with both hands."""
    box = Placement(LARGE[name], pose((-2.2, 0.3, 0.001), 0.3))
    world = SimWorld(house, {"box": box}, np.array([-3.2, 0.3, 0.0]), render=False)
    world.settle()
    played = play(world, f"lift the {LARGE[name].phrases[0]} with both hands", limit_s=90.0)
    assert played.note == "done"
    assert world.between() == "box"
    return world


def drive(world: SimWorld, driver: Driver, goal: Array, most_s: float = 60.0) -> str:
    """Drive to a pose; the reason of failure, or ""."""
    steps = driver.to(lambda grid, start: [Goal(goal, 0.0)], "driving")
    for _ in range(round(most_s * CONTROL_HZ)):
        try:
            next(steps)
        except StopIteration:
            return ""
        except GaveUp as failure:
            return failure.reason
        world.step()
    return "too slow"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["moving_box", "storage_tub"])
def test_a_doorway_of_90_cm_with_both_hands_full(name: str) -> None:
    """There and back six times, from any side and heading: nothing is touched with more than 20 N, nor dropped.

    Across the hands the robot takes up 0.84 m.
    """
    house = two_halls(0.9)
    world, grid_map = with_full_hands(house, name), prior_map(house)
    driver = Driver(world.robot, lambda: grid_map, world.knowledge, ArmStow(world.robot))
    bumps, rng = world.measure_bumps(["box"]), np.random.default_rng(0)
    for leg in range(6):
        goal = free_goal(world, driver, rng, east=leg % 2 == 0)
        assert drive(world, driver, goal) == ""
        assert bumps.worst <= TOUCH_N, (leg, goal, bumps.forces)
        np.testing.assert_allclose(world.robot.proprioception().base_pose[:2], goal[:2], atol=0.03)
        assert world.between() == "box"


@pytest.mark.slow
def test_a_doorway_of_90_cm_with_something_in_each_hand() -> None:
    """The same with a carton of milk in one hand and a can of soda in the other, which friction alone holds."""
    house, catalogue = two_halls(0.9), load_catalogue()
    things = {name: Placement(catalogue[name], pose((-3.0, 1.0 + k, 0.0), 0.0)) for k, name in enumerate(HELD.values())}
    world, grid_map = SimWorld(house, things, np.array([-2.0, -1.0, 0.5]), render=False), prior_map(house)
    put_in_hands(world, HELD)
    driver = Driver(world.robot, lambda: grid_map, world.knowledge, ArmStow(world.robot))
    bumps, rng = world.measure_bumps(list(HELD.values())), np.random.default_rng(1)
    for leg in range(4):
        assert drive(world, driver, free_goal(world, driver, rng, east=leg % 2 == 0)) == ""
        assert bumps.worst <= TOUCH_N, (leg, bumps.forces)
        assert {side: world.holding(side) for side in HELD} == HELD


@pytest.mark.slow
@pytest.mark.render
def test_what_only_depth_shows_is_driven_around() -> None:
    """Boxes before and behind a doorway that no map has: the way is planned anew on sight, and nothing is touched."""
    house = two_halls(1.2)
    boxes = {"near": Placement(LARGE["moving_box"], pose((-0.9, 0.1, 0.001), 0.3))}
    boxes["behind"] = Placement(LARGE["storage_tub"], pose((0.75, 0.55, 0.001), 0.7))
    world = SimWorld(house, boxes, np.array([-1.5, 1.4, -1.57]), render=True)
    world.settle()
    before = {name: world.pose(name) for name in boxes}
    occupancy, plans = Occupancy.prior(prior_map(house)), 0

    def looking() -> OccupancyMap:
        if world.steps % 9 == 0:
            x, y, _ = world.robot.proprioception().base_pose
            occupancy.update(world.robot.look("head"), [(x, y, 0.5)])
        return occupancy.map

    def goals(grid: Traversability, start: Array) -> list[Goal]:
        nonlocal plans
        plans += 1
        return [Goal(np.array([2.0, 0.0, 0.0]), 0.0)]

    bumps = world.measure_bumps()
    driver = Driver(world.robot, looking, KnowledgeBase, ArmStow(world.robot))
    for _ in driver.to(goals, "driving"):
        world.step()
    np.testing.assert_allclose(world.robot.proprioception().base_pose[:2], [2.0, 0.0], atol=0.03)
    assert plans > 1
    assert not driver.blocks
    assert bumps.worst <= TOUCH_N
    for name in boxes:
        np.testing.assert_allclose(world.pose(name), before[name], atol=2e-3)


def free_goal(world: SimWorld, driver: Driver, rng: np.random.Generator, east: bool) -> Array:
    """A pose in one of the halls where base and load are free."""
    footprint = Footprint.of(R1.base.folded_m, world.robot.proprioception(), world.knowledge())
    grid = driver.grid()
    while True:
        x, y, yaw = rng.uniform((0.5, -1.5, -3.1), (3.4, 1.5, 3.1))
        drawn = np.array([x if east else -x, y, yaw])
        if footprint.slack(grid, drawn) > 0.05 and not grid.blocked[grid.map.cell(drawn)]:
            return drawn
