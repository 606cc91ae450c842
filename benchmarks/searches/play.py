"""Plays one search, and measures it by the simulator's state."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.searches.scenes import FOOTPRINT_M, Scene, draw
from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.navigation.goals import HandoffDistances, distance_to, facing_yaw, object_goals
from mpvi_bt.finding.navigation.grid import cost_to_reach
from mpvi_bt.finding.navigation.traversability import ClearanceCost, floor_obstacles, traversability
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Progress
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import Catalogue, load_catalogue
from mpvi_bt.runs.choices.backends import eyes_of
from mpvi_bt.runs.choices.detectors import make_detector
from mpvi_bt.runs.choices.navigators import explorer

LIMIT_S = 600.0  # simulated: a whole house can be seen in less
BUMP_N = 20.0


@dataclass(frozen=True)
class Job:
    """One search and how it is to be made.

    Attributes:
        seed: Of the scene.
        map: "prior" or "online".
        detector: As on the command line.
        house: Its name.
    """

    seed: int
    map: str = "prior"
    detector: str = "segmentation"
    house: str = "family_house"


@dataclass(frozen=True)
class Row:
    """What came of a search.

    Attributes:
        job: What was played.
        target, room, on, hidden: What was looked for, and where it was.
        found: Whether the navigator says that it is there and the base stands before the target.
        reason: Of the failure.
        evidence: What the navigator said last.
        path_m, shortest_m: Driven, and the shortest way to a pose before the target.
        simulated_s, pictures: Until it ended.
        bump_n: Largest force [N] on walls and furniture.
        bumped: The thing that it was on.
        wall_s: Wall time: "stepping", "rendering", "navigation" without rendering.
    """

    job: Job
    target: str
    room: str
    on: str
    hidden: bool
    found: bool
    reason: str
    evidence: str
    path_m: float
    shortest_m: float
    simulated_s: float
    pictures: int
    bump_n: float
    bumped: str
    wall_s: dict[str, float]

    @property
    def spl(self) -> float:
        """Success weighted by path length, 0 to 1 (Anderson et al., On Evaluation of Embodied Navigation Agents)."""
        return self.shortest_m / max(self.path_m, self.shortest_m, 1e-9) if self.found else 0.0


@cache
def _place(name: str) -> tuple[House, Catalogue, OccupancyMap]:
    house = load_house(name)
    return house, load_catalogue(), prior_map(house)


def play(job: Job) -> Row:
    """Play one search."""
    house, catalogue, grid = _place(job.house)
    scene = draw(job.seed, house, catalogue, grid)
    world = SimWorld(house, scene.objects, scene.base_pose)
    world.settle()
    assert world.cameras is not None
    world.cameras.labels = "labels" in eyes_of({"detector": job.detector}).values()
    vocabulary = {e.name: e.phrases for e in world.knowledge() if e.kind != "room"}
    phrase = scene.objects[scene.target].entry.phrases[0]
    navigator = explorer(world, house, [phrase], make_detector(job.detector, vocabulary, job.seed), job.map, job.seed)
    shortest = _shortest_m(world, scene, grid)
    bumps = world.measure_bumps()
    navigator.start(phrase, None)
    wall = {"stepping": 0.0, "navigation": 0.0}
    drawn = world.cameras.seconds
    path, last = 0.0, scene.base_pose[:2]
    report = navigator.step()
    while report.progress is Progress.RUNNING and world.time_s < LIMIT_S:
        began = time.perf_counter()
        world.step()
        stepped = time.perf_counter()
        report = navigator.step()
        wall["stepping"] += stepped - began
        wall["navigation"] += time.perf_counter() - stepped
        here = world.robot.proprioception().base_pose[:2]
        path, last = path + float(np.linalg.norm(here - last)), here
    wall["rendering"] = world.cameras.seconds - drawn
    wall["navigation"] -= wall["rendering"]
    wall["stepping"] -= bumps.seconds
    target = world.knowledge().entries[scene.target]
    there = _is_before(target, world.robot.proprioception().base_pose)
    said = report.progress is Progress.SUCCEEDED
    reason = "" if said and there else (report.reason or ("not_there" if said else "time_limit"))
    return Row(
        job, scene.objects[scene.target].entry.name, scene.room, scene.on, scene.hidden, said and there, reason,
        report.feedback, round(path, 2), round(shortest, 2), round(world.time_s, 1), navigator.mapper.pictures,
        round(bumps.worst, 1), max(bumps.forces, key=lambda n: bumps.forces[n], default=""),
        {key: round(seconds, 3) for key, seconds in wall.items()},
    )  # fmt: skip


def _is_before(target: Entry, pose: Array) -> bool:
    """Whether a base stands where navigation may hand over, by the true place of the target."""
    handoff = HandoffDistances()
    near = distance_to(target, pose[:2]) <= handoff.distance_m + handoff.slack_m
    return near and abs(float(wrap(facing_yaw(target, pose[:2]) - pose[2]))) <= handoff.facing_rad


def _shortest_m(world: SimWorld, scene: Scene, grid_map: OccupancyMap) -> float:
    """The shortest way [m] for the footprint from the start to a pose before the target."""
    boxes = floor_obstacles(world.knowledge())
    grid = traversability(grid_map, FOOTPRINT_M, boxes, (), ClearanceCost(weight=0.0)).escaping(scene.base_pose[:2])
    ways = cost_to_reach(grid.cost, grid.map.cell(scene.base_pose[:2])) * grid.map.resolution_m
    goals = object_goals(
        world.knowledge().entries[scene.target], scene.base_pose[:2], grid, HandoffDistances(), most=10**6
    )
    return min((float(ways[grid.map.cell(goal.pose[:2])]) for goal in goals), default=float("nan"))
