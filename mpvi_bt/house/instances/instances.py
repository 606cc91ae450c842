"""Instances of a task: settled worlds with :init true, and no more of the goal than :init states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import ndimage

from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.traversability import floor_obstacles, traversability
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.goals.evaluate import early, unmet
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.goals.problem import BddlProblem, load_problem
from mpvi_bt.house.instances.sampling import Start, sample
from mpvi_bt.house.instances.splits import Split, generator
from mpvi_bt.house.instances.start_cache import StartCache
from mpvi_bt.house.instances.tasks import Task
from mpvi_bt.house.layout.boards import MovableForm
from mpvi_bt.house.layout.ground import PASSAGE_M, REACH_M, TWO_HANDS_REACH_M
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.layout.start_facts import with_all
from mpvi_bt.house.sim.world import ROBOT, SimWorld
from mpvi_bt.house.states.world_state import aabb
from mpvi_bt.house.things.catalogue import Catalogue

# All our choice.
DRAWS = 40  # of a start, until one will do
OVERLAP_M = 0.003  # that things lie in each other by contact's give; more is interpenetration
_TOUCH_M = 0.002  # what is so near to another thing touches it
_LOW_M = 0.3  # what begins lower than this is in the way of a robot's base
_SETTLE_S, _WATCH_S, _MORE = 1.0, 0.25, 12
_ASIDE_M = 0.6  # so far from where the r1 begins, along x and along y, another robot may
_STILL_M = 0.002  # what moves less in that time is at rest


def expanded_problem(task: Task, house: House) -> BddlProblem:
    """The task's problem, with its wildcards written out for the house."""
    return with_all(load_problem(task.problem), house)


def begin(
    task: Task,
    house: House,
    catalogue: Catalogue,
    problem: BddlProblem,
    instance: int,
    split: Split = "public",
    *,
    render: bool = True,
    assisted: bool = False,
    robot: RobotDescription = R1,
) -> tuple[SimWorld, Start]:
    """An instance of a task, settled and checked. The same arguments give the same world.

    A start that did is kept in the user's cache, so that the draws before it are not made again. An instance is the
    same for all robots: what does is found with the r1, and another one stands in its place, or as near to that as it
    has room.

    Args:
        task: What is done.
        house, catalogue: Where, and with what.
        problem: The task's, with wildcards written out.
        instance: Which of its starts.
        split: Of which instances.
        render, assisted, robot: As of `SimWorld`.

    Raises:
        UserError: :init asks for what cannot be sampled, or a hidden instance is meant and its seed is not known.
        BackendError: No draw would do; it says why the last would not. Or another robot does not fit where it begins.
    """
    if robot is not R1:
        world, same = begin(task, house, catalogue, problem, instance, split, render=False)
        same = _with_room(robot, same, house, world)
        world, _ = settled(house, same, render=render, assisted=assisted, robot=robot)
        if (unfit := next(faults(world, same, house, problem), None)) is not None:
            raise BackendError(f"{task.problem}, instance {instance}, will not do for {robot.name}: {unfit}")
        return world, same
    cache = StartCache(task, house, catalogue, problem, instance, split)
    wrong = "no draw"
    for draw in range(-1, DRAWS):  # before the first draw: what is kept
        try:
            start = (
                sample(house, catalogue, problem, task.bindings, generator(split, task.problem, instance, draw))
                if draw >= 0
                else cache.load()
            )
        except BackendError as error:
            wrong = str(error)
            continue
        if start is None:
            continue
        world, restless = settled(house, start, render=render, assisted=assisted)
        reason = next(faults(world, start, house, problem), None) if not restless else f"{restless[0]} does not rest"
        if reason is None:
            if draw >= 0:
                cache.save(start)
            return world, start
        wrong = reason
    raise BackendError(f"{task.problem}: no start of instance {instance} would do in {DRAWS} draws; the last: {wrong}")


def _with_room(robot: RobotDescription, start: Start, house: House, world: SimWorld) -> Start:
    """The start, with a base that is not round moved to the nearest free pose; unchanged if there is none.

    `world` is that of the start, with another robot.
    """
    base = robot.base
    if not len(base.corners):
        return start
    grid = traversability(prior_map(house), base.radius_m, floor_obstacles(world.knowledge()))
    offsets = np.stack(np.meshgrid(*[np.arange(-_ASIDE_M, _ASIDE_M + 1e-9, 0.05)] * 2), -1).reshape(-1, 2)
    poses = np.array([start.base_pose + [x, y, turn] for x, y in offsets for turn in np.arange(8) * np.pi / 4])
    cells = np.floor(grid.cells(poses)).astype(int).clip(0, np.array(grid.occupied.shape) - 1)
    free = np.isfinite(grid.cost[cells[:, 0], cells[:, 1]])
    free &= Footprint(base.radius_m, np.zeros((0, 3)), base.circles).room(grid, poses) >= 0
    if not free.any():
        return start
    change = poses[free] - start.base_pose
    return replace(start, base_pose=poses[free][np.argmin(norm(change[:, :2], axis=1) + np.abs(wrap(change[:, 2])))])


def settled(
    house: House, start: Start, *, render: bool = True, assisted: bool = False, robot: RobotDescription = R1
) -> tuple[SimWorld, list[str]]:
    """The world of a start once everything has come to rest, and the names of what has not within 4 s."""
    world = SimWorld(
        house, start.objects, start.base_pose, render=render, assisted=assisted, robot=robot, future=start.future
    )
    return world, come_to_rest(world, start)


def come_to_rest(world: SimWorld, start: Start) -> list[str]:
    """Open and switch on as the start says, let everything settle, and name the things still moving after 4 s."""
    for name, openings in start.openings.items():
        for body, fraction in openings.items():
            world.set_opening(name, body, fraction)
    for name in start.on:
        world.turn(name, True)
    for name, kind in start.marks:
        world.mark(name, kind)
    world.settle(_SETTLE_S)
    for _ in range(_MORE):
        before = {name: world.pose(name)[:3, 3] for name in world.objects}
        world.settle(_WATCH_S)
        # Speeds would not do: contacts tremble, and go nowhere.
        moved = [name for name, p in before.items() if norm(world.pose(name)[:3, 3] - p) > _STILL_M]
        if not moved:
            break
    return moved


def faults(world: SimWorld, start: Start, house: House, problem: BddlProblem) -> Iterator[str]:
    """Why a settled world will not do as the start of an episode, one line each."""
    truth = truth_in(world, start.scene_names)
    for fact in unmet(problem, truth):
        yield f"{'' if fact.positive else 'not '}{fact.literal} does not hold"
    for literal in early(problem, truth):
        yield f"{literal} holds from the start"
    for name, other, depth in world.contacts():
        if depth > OVERLAP_M:
            yield f"{name} lies {depth * 1000:.0f} mm deep in {other}"
        if ROBOT in (name, other) and depth > -_TOUCH_M and not f"{name} {other}".count("floor_"):
            yield f"{name} touches {other}"
    yield from (f"{name} is out of the robot's reach" for name in _out_of_reach(world, start, house, problem))


def _out_of_reach(world: SimWorld, start: Start, house: House, problem: BddlProblem) -> Iterator[str]:
    """Things too far from every place that the robot can drive to, past obstacles on floors.

    What is on or in another movable thing has that carried, so that is what must be near.
    """
    grid = prior_map(house)
    occupied = grid.occupied.copy()
    boxes = {name: aabb(world, name) for name in world.objects}
    windows = {}
    for name, (low, high) in boxes.items():
        (r0, c0), (r1, c1) = grid.cell(low), grid.cell(high)
        windows[name] = (slice(r0, r1 + 1), slice(c0, c1 + 1))
        if low[2] < _LOW_M:
            occupied[windows[name]] = True
    free = ndimage.distance_transform_edt(~occupied) * grid.resolution_m > PASSAGE_M - grid.resolution_m
    regions, _ = ndimage.label(free)
    here = regions[grid.cell(start.base_pose)]
    if not here:
        yield from boxes
        return
    away = ndimage.distance_transform_edt(regions != here) * grid.resolution_m
    carried = {f.literal.args[0] for f in problem.init if len(f.literal.args) == 2 and f.literal.args[1] in boxes}
    for name, window in windows.items():
        two_hands = name not in carried and MovableForm(start.objects[name].entry).two_hands
        if not (away[window] < (TWO_HANDS_REACH_M if two_hands else REACH_M)).any():
            yield name
