"""Frontier exploration: looking for what nobody knows the place of (Paper, Navigation appendix; Yamauchi 1997)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.navigation.camera_mapper import CameraMapper
from mpvi_bt.finding.navigation.driver import Driver, GaveUp, Goals
from mpvi_bt.finding.navigation.frontiers import frontier, nearest_frontier
from mpvi_bt.finding.navigation.goals import Goal
from mpvi_bt.finding.navigation.grid import cost_to_reach
from mpvi_bt.finding.navigation.traversability import about
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Report
from mpvi_bt.ground.robot.protocol import Robot

Mask = NDArray[np.bool_]

_EDGES = np.ones((3, 3), bool)  # eight neighbors
_LITTLE = 0.1  # our choice: a turn that shows less of what it was to show is blocked by something low
_BETTER = 1.05  # our choice: a view is better than another if it shows so many times as much


@dataclass(frozen=True)
class SearchParameters:
    """How thoroughly to search. Our choice; the paper gives no figures."""

    # least unseen floor at a frontier that is driven to, in rounds; smaller frontiers and patches are skipped [m2]
    gains_m2: tuple[float, ...] = (1.0, 0.25, 0.05)
    turn_m2: float = 0.5  # least unseen floor for a turn on the spot [m2]
    near_m: float = 0.5  # distance at which a frontier is reached [m]; the camera looks ahead
    headings: int = 16  # headings that are compared, around the circle
    fov_rad: float = 1.3  # horizontal field of view that is counted on [rad]
    barren_m: float = 0.4  # no frontier is this close to a place that showed nothing new [m]


class TargetSearch:
    """Explores until the target is found, or no reachable floor is left unseen.

    At each turn the robot first turns toward unseen floor that is visible from where it stands, then drives to the
    nearest reachable frontier between seen and unseen floor (Paper, Navigation appendix). Once all was seen from afar,
    it is looked at once more from near by, as small things are found only there.

    Attributes:
        frontier: (H, W) bool; of the last plan, for pictures of the run.
    """

    def __init__(
        self, robot: Robot, mapper: CameraMapper, driver: Driver, parameters: SearchParameters = SearchParameters()
    ) -> None:
        self._robot, self._mapper, self._driver, self.parameters = robot, mapper, driver, parameters
        self._view = mapper.visibility
        self.frontier: Mask = np.zeros_like(self._view.seen)
        self._barren: Mask = self.frontier

    def run(self, found: Callable[[], bool], feedback: str, room: str | None = None) -> Iterator[Report]:
        """One report a step; it ends when `found()`, or when all is seen.

        Args:
            found: Asked each step.
            feedback: What the reports say.
            room: Search only this room of the map; None: everything.
        """
        self._mapper.look()
        for view, how in ((self._mapper.visibility, ""), (self._mapper.closer, ", closer")):
            self._view = view
            self._barren = np.zeros_like(self._view.seen)
            yield from self._explore(found, feedback + how, room)
            if found():
                return

    def coverage(self) -> tuple[float, float]:
        """Seen share of the floor within the robot's reach, and the area of that floor [m2]."""
        grid = self._driver.grid().escaping(self._place())
        reach = np.isfinite(cost_to_reach(grid.cost, grid.map.cell(self._place())))
        area = int(reach.sum())
        seen = self._mapper.visibility.seen & self._mapper.occupancy.known
        return float((reach & seen).sum()) / max(area, 1), area * grid.map.resolution_m**2

    def _explore(self, found: Callable[[], bool], feedback: str, room: str | None) -> Iterator[Report]:
        while not found():
            yield from self._turns(found, feedback, room)
            if found() or (goal := self._goal(room)) is None:
                return
            before = self._seen()
            try:
                yield from self._driver.to(_only(goal), feedback, self._passed(goal, found))
            except GaveUp:
                self._mark(self._barren, goal.pose, True)
                continue
            self._mapper.look()
            if self._seen() - before < self._cells(self.parameters.gains_m2[-1]):
                self._mark(self._barren, goal.pose, True)

    # ------------------------------------------------------------------------------------------ where to look

    def _turns(self, found: Callable[[], bool], feedback: str, room: str | None) -> Iterator[Report]:
        """Turn toward unseen floor in view from here, the largest part first, until little is left."""
        for _ in range(self.parameters.headings):
            gain, yaw = self._best_heading(self._place(), self._unseen(room))
            if gain < self._cells(self.parameters.turn_m2):
                return
            before = self._seen()
            try:
                yield from self._driver.turn(yaw, feedback, found)
            except GaveUp:
                return
            if found():
                return
            self._mapper.look()
            if self._seen() - before < _LITTLE * gain:
                return  # something low hides it: go and look from elsewhere

    def _goal(self, room: str | None) -> Goal | None:
        """The nearest pose with a view of unseen floor, large gains before small ones; None if nothing is left."""
        levels = [self._cells(gain_m2) for gain_m2 in self.parameters.gains_m2]
        shown = []
        for gain, goal in self._goals(room, levels[-1]):
            if gain >= levels[0]:
                return goal
            shown.append((gain, goal))
        return next((goal for least in levels for gain, goal in shown if gain >= least), None)

    def _goals(self, room: str | None, least: float) -> Iterator[tuple[int, Goal]]:
        """The poses at frontiers, the nearest first and none beside another, from which so many unseen cells are seen.

        With each comes how many.
        """
        start = self._place()
        grid = self._driver.grid(blocks=True).escaping(start)
        unseen = self._patches(room)
        open_ = ~grid.map.occupied
        near = max(1, round(self.parameters.near_m / grid.map.resolution_m))
        self.frontier = frontier(~self._mapper.solid, ~unseen) & open_ & ~self._barren
        targets, within = np.zeros_like(open_), about(open_)
        targets[within] = ndimage.binary_dilation(self.frontier[within], _EDGES, near, open_[within])
        targets &= np.isfinite(grid.cost) & ~self._barren
        while (found := nearest_frontier(grid.cost, grid.map.cell(start), targets)) is not None:
            row, column = found[0][-1]
            place = grid.map.center(int(row), int(column))
            gain, yaw = self._best_heading(place, unseen, least)
            if gain >= least:
                yield gain, Goal(np.array([*place, yaw]), found[1])
            self._mark(targets, place, False)

    def _best_heading(self, place: Array, unseen: Mask, least: float = 0.0) -> tuple[int, float]:
        """How many unseen cells a look from a place (2,) shows at best, and at which yaw [rad], the nearest such.

        What is certainly less than `least` is not counted, and said to be nothing.
        """
        here = float(self._robot.proprioception().base_pose[2])
        best, at, most = 0, here, self._view.within_reach(place, unseen)
        if most < least:
            return best, at
        yaws = here + np.arange(self.parameters.headings) * (2 * np.pi / self.parameters.headings)
        solid = self._mapper.solid
        for yaw in sorted(yaws, key=lambda yaw: abs(float(wrap(yaw - here)))):
            if most <= best * _BETTER:
                break
            gain = self._view.would_see(place, float(yaw), self.parameters.fov_rad, solid, unseen)
            if gain > best * _BETTER:
                best, at = gain, float(wrap(yaw))
        return best, at

    def _passed(self, goal: Goal, found: Callable[[], bool]) -> Callable[[], bool]:
        """Whether to drive no farther: found, or what was to be seen from the goal has been seen on the way."""
        last, over = self._mapper.pictures, False

        def passed() -> bool:
            nonlocal last, over
            if self._mapper.pictures != last:
                last = self._mapper.pictures
                place, yaw = goal.pose[:2], float(goal.pose[2])
                gain = self._view.would_see(place, yaw, self.parameters.fov_rad, self._mapper.solid)
                over = gain < self._cells(self.parameters.gains_m2[-1]) / 2
            return over or found()

        return passed

    def _mark(self, mask: Mask, place: Array, value: bool) -> None:
        """Set the cells of a mask (H, W) about a place (2,)."""
        grid_map = self._mapper.occupancy.map
        (row, column), n = grid_map.cell(place), math.ceil(self.parameters.barren_m / grid_map.resolution_m)
        top, left = max(row - n, 0), max(column - n, 0)
        window = mask[top : max(row + n + 1, 0), left : max(column + n + 1, 0)]
        rows, columns = np.ogrid[: window.shape[0], : window.shape[1]]
        away = np.hypot(rows + (top - row), columns + (left - column)) * grid_map.resolution_m
        window[away <= self.parameters.barren_m] = value

    # ------------------------------------------------------------------------------------------ what is known

    def _unseen(self, room: str | None) -> Mask:
        """(H, W) unseen cells without a known obstacle."""
        unseen: Mask = ~self._mapper.solid & ~self._explored()
        if room is not None:
            grid_map = self._mapper.occupancy.map
            unseen &= grid_map.rooms == grid_map.room_names.index(room)
        return unseen

    def _patches(self, room: str | None) -> Mask:
        """(H, W) unseen cells, without patches too small to matter."""
        unseen = self._unseen(room)
        patches, _ = ndimage.label(unseen, _EDGES)
        large = np.bincount(patches.ravel()) >= self._cells(self.parameters.gains_m2[-1])
        return unseen & large[patches]

    def _explored(self) -> Mask:
        explored: Mask = self._view.seen & self._mapper.occupancy.known
        return explored

    def _seen(self) -> int:
        return int(self._explored().sum())

    def _cells(self, area_m2: float) -> float:
        return area_m2 / self._mapper.occupancy.map.resolution_m**2

    def _place(self) -> Array:
        place: Array = self._robot.proprioception().base_pose[:2]
        return place


def _only(goal: Goal) -> Goals:
    """That goal, whatever the map is by then."""
    return lambda grid, start: [goal]
