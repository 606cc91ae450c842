"""Driving to one of several poses: A* says how, pure pursuit does it, and what blocks the way is driven around."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Protocol

import numpy as np

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.goals import HandoffDistances
from mpvi_bt.finding.navigation.headway import Headway
from mpvi_bt.finding.navigation.loaded import loaded_path
from mpvi_bt.finding.navigation.pursuit import CARRYING, Limits, PathFollower, Tolerance
from mpvi_bt.finding.navigation.traversability import (
    Box,
    ClearanceCost,
    Disc,
    Traversability,
    floor_obstacles,
    occupied,
    snapped,
    traversability,
)
from mpvi_bt.finding.navigation.ways import GaveUp, Goals, find_way
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.kinematics import rot_z
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Robot
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.robot.squeeze import squeezes

__all__ = ["DEFAULTS", "Driver", "GaveUp", "Goals", "NavigationParameters", "Stow", "never"]


@dataclass(frozen=True)
class BackingOff:
    """How the base backs off from what stopped it."""

    speed_m_s: float = 0.15  # speed of the base [m/s]; no camera sees the way back; our choice
    beyond_m: float = 0.10  # distance from the footprint to the obstacle that is assumed [m]; our choice
    block_m: float = 0.15  # radius of that obstacle [m]; our choice
    # directions off straight back, in order [rad]; our choice
    asides_rad: tuple[float, ...] = (0.0, 0.6, -0.6, 1.2, -1.2)


_BACK = BackingOff()


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
    """How to drive. Our choice; the paper gives no figures."""

    narrow: bool = True  # if no way has room for free turns, fit the base alone and treat the arms as a load
    handoff: HandoffDistances = field(default_factory=HandoffDistances)  # where to stand before a target
    # where to stand to look down on furniture: the near side of a basin hides what lies in it; our choice
    look: HandoffDistances = field(default_factory=lambda: HandoffDistances(distance_m=0.65, preferred_m=0.4))
    limits: Limits = field(default_factory=Limits)  # limits with empty hands
    carrying: Limits = CARRYING  # limits with something in a hand, or between both
    tolerance: Tolerance = field(default_factory=Tolerance)  # when the goal pose counts as reached
    clearance: ClearanceCost = field(default_factory=ClearanceCost)  # cost of passing close to obstacles
    stall_s: float = 3.0  # time without motion after which something blocks the way [s]
    idle_s: float = 12.0  # time without progress to the goal after which something blocks the way [s]
    back_off_m: float = 0.20  # distance to drive back from an obstacle before a new plan [m]
    halts: int = 3  # halts that are answered by another plan; the next one ends the drive
    replans: int = 30  # plans that may be given up because the map showed an obstacle
    look_again_s: float = 1.0  # time between two comparisons of an unchanged map with known loose things [s]


DEFAULTS = NavigationParameters()


def never() -> bool:
    """For drives that end only when they have arrived."""
    return False


class _End(Enum):
    """How following a path ended."""

    ARRIVED = "arrived"
    HALTED = "halted"  # it commands motion, and nothing moves
    OBSTRUCTED = "obstructed"  # the map shows something in the way


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
        parameters: NavigationParameters = DEFAULTS,
    ) -> None:
        """Bind the parts; nothing moves yet.

        Args:
            robot: The robot to drive.
            occupancy_map: What is known now of where the base may go; another object whenever that has changed.
            knowledge: What is known now of the things that stand there and that are carried.
            stow: Tucks the arms before each drive; None leaves them as they are.
            parameters: Distances and speeds.
        """
        self._robot, self._map, self._knowledge, self._stow = robot, occupancy_map, knowledge, stow
        self._model = robot_named(robot.proprioception().robot)
        self._sideways = self._model.sideways
        self.parameters = parameters
        self._traversability = lru_cache(maxsize=4)(self._make_grid)
        self.blocks: list[Disc] = []
        self.halted = False
        self.goal: Array | None = None
        self.path: Array | None = None
        self._checked: tuple[OccupancyMap | None, tuple[Box, ...]] = (None, ())

    def forget(self) -> None:
        """Forget what brought the base to a halt: it may have been taken away since."""
        self.blocks = []

    def grid(self, blocks: bool = False, footprint_m: float | None = None) -> Traversability:
        """The planning grid of now; with or without the places that brought the base to a halt.

        It is made anew only when map or loose things have changed. `footprint_m`: another radius.
        """
        grid_map = self._map()
        boxes = snapped(grid_map, floor_obstacles(self._knowledge()))
        radius_m = self._model.base.folded_m if footprint_m is None else footprint_m
        return self._traversability(grid_map, radius_m, boxes, tuple(self.blocks) if blocks else ())

    def to(self, goals: Goals, feedback: str, until: Callable[[], bool] = never) -> Iterator[Report]:
        """Drive to the best reachable goal, or to the next best one if the way proves blocked.

        Args:
            goals: Ranked poses; asked for anew with each plan.
            feedback: What the reports say.
            until: Ends the drive early, as soon as the base has braked, once it is true; asked each step.

        Raises:
            GaveUp: "no_path": no goal can be reached. "goal_in_obstacle": there is nowhere free to stand.
                "start_in_collision": the base stands in obstacles that it cannot leave. "blocked": something was in the
                way, again and again. "no_pose": the robot does not know where it is.
        """
        self.halted, halts = False, list[Array]()  # goals before which the base came to a halt
        yield from self._tuck()
        follower = self._plan(goals, halts, self._moving())
        replans = 0
        while (end := (yield from self._follow(follower, feedback, until))) is not _End.ARRIVED:
            if end is _End.HALTED:
                self.halted = True
                if until():
                    return
                halts.append(follower.goal[:2])
                if len(halts) > self.parameters.halts:
                    raise GaveUp("blocked", f"the base came to a halt {len(halts)} times: something blocks the way")
                yield from self._back_off(follower)
                self.halted = False
            elif (replans := replans + 1) > self.parameters.replans:
                yield from self._brake(follower)
                raise GaveUp("blocked", f"{replans} plans in a row were overtaken by obstacles on the way")
            try:
                follower = self._plan(goals, halts, follower.velocity)
            except GaveUp:
                yield from self._brake(follower)  # the map may have become clearer meanwhile
                follower = self._plan(goals, halts, np.zeros(3))

    def turn(self, yaw_rad: float, feedback: str, until: Callable[[], bool] = never) -> Iterator[Report]:
        """Turn on the spot to a yaw [rad] in the world.

        Raises:
            GaveUp: "blocked" if the base does not turn, or may not with what it carries; "no_pose" if the robot does
                not know where it is.
        """
        self.halted = False
        yield from self._tuck()
        pose = self._pose()
        goal, grid = np.array([*pose[:2], yaw_rad]), self.grid().escaping(pose[:2])
        footprint = self._takes_up()
        path = loaded_path(grid, footprint, pose, goal, self._sideways) if footprint.turns else goal[None, :2]
        if path is None:
            carrying = " with what is carried" if len(footprint.loads) else ""
            raise GaveUp("blocked", f"there is no room to turn{carrying}")
        follower = self._follower(path, goal, grid, footprint, self._moving())
        if (yield from self._follow(follower, feedback, until, watchful=False)) is _End.HALTED:
            self.halted = True
            raise GaveUp("blocked", "something keeps the base from turning")

    # ------------------------------------------------------------------------------------------ planning

    def _make_grid(
        self, grid_map: OccupancyMap, footprint_m: float, boxes: tuple[Box, ...], discs: tuple[Disc, ...]
    ) -> Traversability:
        return traversability(grid_map, footprint_m, boxes, discs, self.parameters.clearance, self._model.base)

    def _pose(self) -> Array:
        pose = self._robot.proprioception().base_pose
        if not np.isfinite(pose).all():
            raise GaveUp("no_pose", "the robot does not know where it is, hence no way")
        return pose

    def _moving(self) -> Array:
        """(3,) the base's velocity now, in the world."""
        body = self._robot.proprioception()
        velocity = matmul(rot_z(float(body.base_pose[2])), body.base_velocity)  # the third is a rate and stays
        return velocity if np.isfinite(velocity).all() else np.zeros(3)

    def _plan(self, goals: Goals, halts: list[Array], velocity: Array) -> PathFollower:
        """The way to the best goal; around what stopped the base before, if there is such a way.

        Where all ways are too narrow for a robot that may turn anywhere, such as between an open door and a sofa, one
        that is wide enough for its base, on which its arms are turned where they have room.
        """
        pose, footprint = self._pose(), self._takes_up()
        if self.blocks:
            with suppress(GaveUp):
                way = find_way(self.grid(blocks=True), footprint, pose, goals, halts, self._sideways)
                return self._follower(*way, footprint, velocity)
        try:
            way = find_way(self.grid(), footprint, pose, goals, halts, self._sideways)
        except GaveUp as failure:
            if not self.parameters.narrow or self._model.base.radius_m == footprint.base_m:
                raise
            footprint = self._takes_up(self._model.base.radius_m)
            try:
                narrow = self.grid(footprint_m=footprint.base_m)
                way = find_way(narrow, footprint, pose, goals, halts, self._sideways)
            except GaveUp:
                raise failure from None
        return self._follower(*way, footprint, velocity)

    def _follower(
        self, path: Array, goal: Array, grid: Traversability, footprint: Footprint, velocity: Array
    ) -> PathFollower:
        body = self._robot.proprioception()
        carrying = squeezes(body) or any(body.holds(side) for side in SIDES)
        limits = self.parameters.carrying if carrying else self.parameters.limits
        self.goal, self.path = goal, path[:, :2]
        return PathFollower(
            path, goal, grid, limits, self.parameters.tolerance, footprint=footprint, velocity=velocity,
            sideways=self._sideways,
        )  # fmt: skip

    def _takes_up(self, base_m: float | None = None) -> Footprint:
        radius_m = self._model.base.folded_m if base_m is None else base_m
        return Footprint.of(radius_m, self._robot.proprioception(), self._knowledge())

    # ------------------------------------------------------------------------------------------ motion

    def _tuck(self) -> Iterator[Report]:
        if self._stow is None:
            return
        self._stow.start()
        while True:
            self._robot.hold()
            if self._stow.step():
                return
            yield Report(Progress.RUNNING, "", "tucking the arms")

    def _follow(
        self, follower: PathFollower, feedback: str, until: Callable[[], bool], watchful: bool = True
    ) -> Generator[Report, None, _End]:
        """Follow to the end; `watchful`: or until the map shows something in the way."""
        headway = Headway(self.parameters.stall_s, self.parameters.idle_s)
        lost, self._checked = 0, (follower.grid.map, ())
        while True:
            body = self._robot.proprioception()
            self._robot.hold()
            if not np.isfinite(body.base_pose).all():
                if (lost := lost + 1) > self.parameters.stall_s * CONTROL_HZ:
                    self._pose()
                follower.velocity = np.zeros(3)
                yield Report(Progress.RUNNING, "", feedback)
                continue
            lost = 0
            if follower.reached(body.base_pose, body.base_velocity):
                return _End.ARRIVED
            if until():
                yield from self._brake(follower)
                return _End.ARRIVED
            if watchful and self._obstructed(follower, headway.steps):
                return _End.OBSTRUCTED
            if headway.stalled(body.base_pose, follower):
                return _End.HALTED
            self._write_base(follower.command(body.base_pose))
            yield Report(Progress.RUNNING, "", feedback)

    def _obstructed(self, follower: PathFollower, steps: int) -> bool:
        """Whether a new obstacle is on the rest of the path."""
        grid_map = self._map()
        if grid_map is self._checked[0] and steps % round(self.parameters.look_again_s * CONTROL_HZ):
            return False
        now = grid_map, snapped(grid_map, floor_obstacles(self._knowledge()))
        if now == self._checked:
            return False
        self._checked = now
        return follower.meets(grid_map, occupied(*now))

    def _back_off(self, follower: PathFollower) -> Iterator[Report]:
        """Note where the base was stopped, and drive a little the other way, as straight back as there is room."""
        pose, follower.velocity = self._pose(), np.zeros(3)
        ahead = math.atan2(*(follower.aim - pose[:2])[::-1])
        away_m = self._model.base.reach(ahead - float(pose[2])) + _BACK.beyond_m
        at = pose[:2] + away_m * np.array([math.cos(ahead), math.sin(ahead)])
        self.blocks.append((float(at[0]), float(at[1]), _BACK.block_m))
        for aside in _BACK.asides_rad:
            away = np.array([math.cos(ahead + math.pi + aside), math.sin(ahead + math.pi + aside)])
            if follower.may_go(pose, away * self.parameters.back_off_m):
                break
        else:
            return
        forward = matmul(rot_z(float(pose[2]))[:2, :2].T, away)
        steps = round(self.parameters.back_off_m / _BACK.speed_m_s * CONTROL_HZ)
        for i in range(steps):
            ramp = min(1.0, 4.0 * min(i + 1, steps - i) / steps)
            self._robot.hold()
            self._write_base(np.array([*(_BACK.speed_m_s * ramp * forward), 0.0]))
            yield Report(Progress.RUNNING, "", "backing off")

    def _brake(self, follower: PathFollower) -> Iterator[Report]:
        """Come to rest within the limits."""
        while np.abs(follower.velocity).max() > 1e-6:
            pose = self._robot.proprioception().base_pose
            if not np.isfinite(pose).all():
                break
            self._robot.hold()
            self._write_base(follower.brake(pose))
            yield Report(Progress.RUNNING, "", "stopping")
        self._robot.hold()

    def _write_base(self, velocity: Array) -> None:
        action = self._robot.action.copy()
        self._model.layout.set_velocity(action, velocity)
        self._robot.act(action)
