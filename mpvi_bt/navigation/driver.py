"""Driving to one of several poses: A* says how, pure pursuit does it, and what blocks the way is driven around."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mpvi_bt.behaviors.protocols import Progress, Report
from mpvi_bt.navigation.footprint import Footprint
from mpvi_bt.navigation.goals import Goal, Handoff
from mpvi_bt.navigation.grid import shortest_path
from mpvi_bt.navigation.pursuit import CARRYING, Limits, PathFollower, Tolerance
from mpvi_bt.navigation.traversability import ClearanceCost, Traversability, floor_obstacles, traversability
from mpvi_bt.perception.knowledge import KnowledgeBase
from mpvi_bt.perception.map import OccupancyMap
from mpvi_bt.robot.kinematics import wrap
from mpvi_bt.robot.protocol import CONTROL_HZ, SIDES, ActionLayout, Proprioception, Robot
from mpvi_bt.robot.solids import Array


class Stow(Protocol):
    """Brings the arms into their travel posture (Paper, Navigation appendix: fixed arms while driving)."""

    def start(self) -> None:
        """Begin from the present posture."""
        ...

    def step(self) -> bool:
        """Write the arms' part of the robot's action for one step; True once they are in posture."""
        ...


@dataclass(frozen=True)
class NavigationParameters:
    """How to drive. Every figure is our choice; the paper gives none.

    Attributes:
        footprint_m: Radius of the robot's footprint with its arms tucked.
        handoff: Where to stand before a target.
        limits: With empty hands.
        carrying: With something in a hand.
        tolerance: When the goal pose counts as reached.
        clearance: What passing close to obstacles costs.
        stall_s: No motion for so long while driving means that something blocks the way.
        back_off_m: How far to drive back from what blocks it, before planning anew.
    """

    footprint_m: float = 0.33
    handoff: Handoff = field(default_factory=Handoff)
    limits: Limits = field(default_factory=Limits)
    carrying: Limits = CARRYING
    tolerance: Tolerance = field(default_factory=Tolerance)
    clearance: ClearanceCost = field(default_factory=ClearanceCost)
    stall_s: float = 3.0
    back_off_m: float = 0.20


DEFAULTS = NavigationParameters()


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


def never() -> bool:
    """For drives that end only when they have arrived."""
    return False


class Driver:
    """Drives the base; one report a step, for which the robot's command has been written.

    Attributes:
        parameters: Distances and speeds.
        blocks: x, y, radius [m] of what brought the base to a halt since the last `forget`.
        halted: Whether the base has come to a halt on the way; asked for by `until` before it backs off.
        goal: (3,) the pose [m, m, rad] in the world that is being driven to, or was last; None before the first plan.
        path: (N, 2) x, y [m] of the way there.
    """

    def __init__(
        self,
        robot: Robot,
        occupancy_map: Callable[[], OccupancyMap],
        knowledge: Callable[[], KnowledgeBase],
        stow: Stow | None = None,
        footprint_radius_m: Callable[[], float] | None = None,
        parameters: NavigationParameters = DEFAULTS,
    ) -> None:
        """Bind the parts; nothing moves yet.

        Args:
            robot: The robot to drive.
            occupancy_map: What is known now of where the base may go.
            knowledge: What is known now of the things that stand there and that are carried.
            stow: Tucks the arms before each drive; None leaves them as they are.
            footprint_radius_m: The footprint's radius [m] with all that is held now; None: that of the parameters.
            parameters: Distances and speeds.
        """
        self._robot, self._map, self._knowledge, self._stow = robot, occupancy_map, knowledge, stow
        self.parameters = parameters
        self._footprint = footprint_radius_m or (lambda: parameters.footprint_m)
        self.blocks: list[tuple[float, float, float]] = []
        self.halted = False
        self.goal: Array | None = None
        self.path: Array | None = None

    def forget(self) -> None:
        """Forget what brought the base to a halt: it may have been taken away since."""
        self.blocks = []

    def grid(self, blocks: bool = False) -> Traversability:
        """The planning grid of now; with or without the places that brought the base to a halt."""
        boxes = floor_obstacles(self._knowledge())
        discs = self.blocks if blocks else []
        return traversability(self._map(), self._footprint(), boxes, discs, self.parameters.clearance)

    def to(self, goals: Goals, feedback: str, until: Callable[[], bool] = never) -> Iterator[Report]:
        """Drive to the best of the goals that can be reached.

        Args:
            goals: Ranked poses; asked for anew with each plan.
            feedback: What the reports say.
            until: Ends the drive early, where the base is then, once it is true; asked each step.

        Raises:
            GaveUp: "no_path", or "blocked" if the base came to a halt, backed off, planned around the place and came
                to a halt again.
        """
        self.halted = False
        yield from self._tuck()
        for _ in range(2):
            follower = self._plan(goals)
            if follower is None:
                raise GaveUp("no_path", "no free way")
            if not (yield from self._follow(follower, feedback, until)):
                return
            self.halted = True
            if until():
                return
            yield from self._back_off(follower)
            self.halted = False
        raise GaveUp("blocked", "something blocks the way")

    def turn(self, yaw_rad: float, feedback: str, until: Callable[[], bool] = never) -> Iterator[Report]:
        """Turn on the spot to a yaw [rad] in the world.

        Raises:
            GaveUp: "blocked" if the base does not turn.
        """
        self.halted = False
        yield from self._tuck()
        place = self._robot.proprioception().base_pose[:2]
        self.goal, self.path = np.array([*place, yaw_rad]), place[None]
        follower = PathFollower(self.path, self.goal, self.grid(), self._limits(), self.parameters.tolerance)
        if (yield from self._follow(follower, feedback, until)):
            raise GaveUp("blocked", "something keeps the base from turning")

    def _tuck(self) -> Iterator[Report]:
        if self._stow is None:
            return
        self._stow.start()
        while True:
            self._robot.hold()
            if self._stow.step():
                return
            yield Report(Progress.RUNNING, "", "tucking the arms")

    def _limits(self) -> Limits:
        holding = _holding(self._robot.proprioception())
        return self.parameters.carrying if holding else self.parameters.limits

    def _plan(self, goals: Goals) -> PathFollower | None:
        """The way to the best goal; around what stopped the base before, if there is such a way."""
        body = self._robot.proprioception()
        start = body.base_pose[:2]
        footprint = Footprint.carrying(self._footprint(), body.base_pose, self._knowledge())
        for blocks in [True, False] if self.blocks else [False]:
            grid = self.grid(blocks).escaping(start)
            ranked = sorted(goals(grid, start), key=lambda g: (footprint.slack(grid, g.pose) < 0, g.score))
            for goal in ranked:
                found = shortest_path(grid.cost, grid.map.cell(start), grid.map.cell(goal.pose[:2]))
                if found is not None:
                    self.goal, self.path = goal.pose, grid.points(found[0])
                    limits, tolerance = self._limits(), self.parameters.tolerance
                    return PathFollower(self.path, goal.pose, grid, limits, tolerance, footprint=footprint)
        return None

    def _follow(
        self, follower: PathFollower, feedback: str, until: Callable[[], bool]
    ) -> Generator[Report, None, bool]:
        """Follow to the end; its value is whether the base came to a halt on the way."""
        window = int(self.parameters.stall_s * CONTROL_HZ)
        poses: list[Array] = []
        while True:
            body = self._robot.proprioception()
            if follower.reached(body.base_pose, body.base_velocity) or until():
                return False
            poses.append(body.base_pose)
            if len(poses) > window and _still(poses[-1 - window], poses[-1]):
                return True
            self._robot.hold()
            self._write_base(follower.command(body.base_pose))
            yield Report(Progress.RUNNING, "", feedback)

    def _back_off(self, follower: PathFollower) -> Iterator[Report]:
        """Note where the base was stopped, and drive a little the other way."""
        pose = self._robot.proprioception().base_pose
        ahead = follower.aim - pose[:2]
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-6)
        at = pose[:2] + ahead * (self._footprint() + 0.10)
        self.blocks.append((float(at[0]), float(at[1]), 0.15))
        c, s = np.cos(pose[2]), np.sin(pose[2])
        away = -np.array([c * ahead[0] + s * ahead[1], -s * ahead[0] + c * ahead[1]])
        steps = round(self.parameters.back_off_m / 0.15 * CONTROL_HZ)
        for i in range(steps):
            ramp = min(1.0, 4.0 * min(i + 1, steps - i) / steps)
            self._robot.hold()
            self._write_base(np.array([*(0.15 * ramp * away), 0.0]))
            yield Report(Progress.RUNNING, "", "backing off")

    def _write_base(self, velocity: Array) -> None:
        action = self._robot.action.copy()
        action[ActionLayout.BASE] = velocity
        self._robot.act(action)


def _holding(body: Proprioception) -> bool:
    """Whether a hand seems to hold something: commanded closed and not closed."""
    return any(body.holds(side) for side in SIDES)


def _still(before: Array, now: Array) -> bool:
    return float(np.linalg.norm(now[:2] - before[:2])) < 0.05 and abs(float(wrap(now[2] - before[2]))) < 0.1
