"""Choice of a goal and of the path to it, or the reason why there is none."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.goals import Goal
from mpvi_bt.finding.navigation.grid import cost_to_reach, shortest_path
from mpvi_bt.finding.navigation.loaded import loaded_path
from mpvi_bt.finding.navigation.traversability import Traversability
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class PathTries:
    """How many goals are tried if the path search is slow."""

    loaded: int = 2  # goals that are tried by a robot with a payload; our choice
    base: int = 4  # goals that are tried by a base that is not round; our choice
    apart_m: float = 0.3  # least distance between these goals [m]; our choice
    tight_m: float = 0.02  # loads that do not fit get this much less clearance, the base half of that [m]; our choice
    halts: int = 2  # halts of the base before one goal after which that is no goal; our choice
    halted_m: float = 0.3  # if the base was driving to a place this close to it [m]; our choice


_TRIES = PathTries()


class GaveUp(Exception):
    """Ends a drive without arrival.

    Attributes:
        reason: Stable code, such as "no_path".
        message: For a person.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason, self.message = reason, message


Goals = Callable[[Traversability, Array], list[Goal]]
"""Where to: ranked poses for a planning grid and the base's place (2,) [m]."""


def find_way(
    free: Traversability, footprint: Footprint, pose: Array, goals: Goals, halts: list[Array], sideways: bool = True
) -> tuple[Array, Array, Traversability]:
    """The way to the best goal that can be reached.

    Args:
        free: The planning grid.
        footprint: What the robot takes up.
        pose: (3,) where it is.
        goals: Where to.
        halts: (2,) each; places of goals before which the base came to a halt: where it did so twice is no goal.
        sideways: Whether the base can go sideways.

    Returns:
        (N, 2) places [m], or (N, 3) poses where a load has to be seen to; the goal (3,); and the grid for a robot that
        may leave where it stands.

    Raises:
        GaveUp: "no_path", "goal_in_obstacle", "start_in_collision", or "blocked" after halts.
    """
    start = pose[:2]
    grid = free.escaping(start)
    ranked = [goal for goal in goals(grid, start) if np.isfinite(goal.pose).all()]
    left = [g for g in ranked if np.isfinite(g.score) and _fits(free, footprint, g) and not _given_up(g, halts)]
    left = sorted(left, key=lambda g: (footprint.slack(grid, g.pose) < 0, g.score))
    for tried in (footprint, footprint.smaller(_TRIES.tight_m)) if footprint.turns else (footprint,):
        for goal in _to_try(left, footprint):
            path = _way(grid, tried, pose, goal.pose, sideways)
            if path is not None:
                return path, goal.pose, grid
    raise _why(free, footprint, start, ranked, halts)


def _to_try(goals: list[Goal], footprint: Footprint) -> Iterator[Goal]:
    """Goals for path planning, in their order: all of them, or only a few if planning is slow.

    Those of a base that is not round are apart: next to one that it cannot get to there is seldom one that it can.
    """
    if not footprint.turns:
        yield from goals
    elif not len(footprint.base):
        yield from goals[: _TRIES.loaded]
    else:
        tried: list[Goal] = []
        for goal in goals:
            if len(tried) < _TRIES.base and all(math.dist(goal.pose[:2], t.pose[:2]) > _TRIES.apart_m for t in tried):
                tried.append(goal)
                yield goal


def stuck(free: Traversability, start: Array) -> bool:
    """Whether a base at `start` (2,) stands in obstacles that it cannot leave."""
    grid = free.escaping(start)
    reach = cost_to_reach(grid.cost, grid.map.cell(start))
    return not (np.isfinite(reach) & np.isfinite(free.cost)).any()


def _fits(grid: Traversability, footprint: Footprint, goal: Goal) -> bool:
    """Whether the base is free at a goal."""
    cell = grid.map.cell(goal.pose)
    free = grid.map.inside(*cell) and bool(np.isfinite(grid.cost[cell]))
    return free and float(footprint.room(grid, goal.pose)) >= 0


def _given_up(goal: Goal, halts: list[Array]) -> bool:
    """Whether the base came to a halt twice before it reached the place of this goal."""
    return sum(math.dist(goal.pose[:2], at) < _TRIES.halted_m for at in halts) >= _TRIES.halts


def _way(grid: Traversability, footprint: Footprint, start: Array, goal: Array, sideways: bool) -> Array | None:
    """(N, 2) places [m] from pose to pose (3,), or (N, 3) poses where a load has to be seen to; None: no way."""
    if footprint.turns:
        return loaded_path(grid, footprint, start, goal, sideways)
    found = shortest_path(grid.cost, grid.map.cell(start), grid.map.cell(goal))
    return None if found is None else grid.points(found[0])


def _why(free: Traversability, footprint: Footprint, start: Array, goals: list[Goal], halts: list[Array]) -> GaveUp:
    """Why there is no plan."""
    if stuck(free, start):
        return GaveUp("start_in_collision", "the base stands in obstacles and cannot leave them: no way")
    if halts:
        return GaveUp("blocked", "something blocks the way, and there is no other way")
    if not any(_fits(free, footprint, goal) for goal in goals):
        return GaveUp("goal_in_obstacle", "there is nowhere free to stand: no way")
    return GaveUp("no_path", "no free way")
