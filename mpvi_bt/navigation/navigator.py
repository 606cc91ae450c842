"""Driving to a place that is known: the knowledge base says where, A* how, pure pursuit does it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mpvi_bt.behaviors.protocols import Progress, Report
from mpvi_bt.errors import nearest
from mpvi_bt.navigation.footprint import Footprint
from mpvi_bt.navigation.goals import Goal, Handoff, at_target, object_goals, room_goals
from mpvi_bt.navigation.grid import shortest_path
from mpvi_bt.navigation.pursuit import CARRYING, Limits, PathFollower, Tolerance
from mpvi_bt.navigation.traversability import ClearanceCost, Traversability, floor_obstacles, traversability
from mpvi_bt.perception.knowledge import Entry, KnowledgeBase, normalize
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


@dataclass
class _Trip:
    """One drive, from `start` to its end."""

    target: str
    room: str | None
    blocks: list[tuple[float, float, float]] = field(default_factory=list)  # x, y, radius of what stopped the base


_GOALS = 40  # looked at of each target: the best where nothing carried would touch


class _GaveUp(Exception):
    """Ends a drive without arrival; the message is for a person."""

    def __init__(self, reason: str, feedback: str) -> None:
        self.reason = reason
        super().__init__(feedback)


class KnownPlaceNavigator:
    """Navigates to rooms, fixtures and objects whose places the knowledge base holds (implements `Navigator`).

    Order (Paper, Navigation appendix): done if the base is at the target already; else the knowledge base is asked; a
    target that it does not hold is looked up once more from inside the room that was named with it.

    Fails with `unknown_target`, `no_path` (nothing free and reachable to stand on) or `blocked` (the base came to a
    halt, backed off, planned around the place and came to a halt again).
    """

    def __init__(
        self,
        robot: Robot,
        grid_map: OccupancyMap,
        knowledge: KnowledgeBase | Callable[[], KnowledgeBase],
        stow: Stow | None = None,
        footprint_radius_m: Callable[[], float] | None = None,
        parameters: NavigationParameters = NavigationParameters(),
    ) -> None:
        """Bind the parts; nothing moves before `start`.

        Args:
            robot: The robot to drive.
            grid_map: The prior map.
            knowledge: What is known now, or a function that says so.
            stow: Tucks the arms before each drive; None leaves them as they are.
            footprint_radius_m: The footprint's radius [m] with all that is held now; None: that of the parameters.
            parameters: Distances and speeds.
        """
        self._robot, self._map, self._stow, self.parameters = robot, grid_map, stow, parameters
        self._knowledge = knowledge if callable(knowledge) else lambda: knowledge
        self._footprint = footprint_radius_m or (lambda: parameters.footprint_m)
        self._work: Iterator[Report] | None = None
        self._last = Report(Progress.FAILED, "not_started")
        self.goal: Array | None = None
        """(3,) the pose [m, m, rad] in the world that is being driven to, or was last; None before the first plan."""

    def start(self, target: str, room: str | None) -> None:
        """Begin driving to `target`; see `Navigator`."""
        self._work = self._drive(_Trip(target, room))

    def step(self) -> Report:
        """Write one step's command; see `Navigator`. After the end it goes on reporting the end."""
        if self._work is None:
            self._robot.hold()
            return self._last
        try:
            self._last = next(self._work)
        except _GaveUp as failure:
            self._last = Report(Progress.FAILED, failure.reason, str(failure))
        except StopIteration:
            self._last = Report(Progress.SUCCEEDED, "", "arrived")
        if self._last.progress is not Progress.RUNNING:
            self.stop()
        return self._last

    def stop(self) -> None:
        """Let the base stand still."""
        self._work = None
        self._robot.hold()

    # ------------------------------------------------------------------------------------------ the drive

    def _drive(self, trip: _Trip) -> Iterator[Report]:
        """One report a step until the base has arrived. Raises _GaveUp."""
        entries, room = self._look_up(trip)
        if not entries and room is None:
            near = nearest(normalize(trip.target), self._names())
            hint = f"; something near it is called {near!r}" if near else ""
            raise _GaveUp("unknown_target", f"nobody knows where {trip.target!r} is{hint}")
        if not entries and room != trip.target:  # look for the target from within its room
            yield from self._drive_to(trip, [], room)
            entries, room = self._look_up(trip)
            if not entries:
                raise _GaveUp("unknown_target", f"{trip.target} is not known in {room}")
        yield from self._drive_to(trip, entries, room)

    def _drive_to(self, trip: _Trip, entries: list[Entry], room: str | None) -> Iterator[Report]:
        """Drive to the best of `entries`, or into `room` if there are none. Raises _GaveUp."""
        place = trip.target if entries else str(room)
        if self._is_there(entries, room):
            return
        if self._stow is not None:
            self._stow.start()
            while not self._step_stow(self._stow):
                yield Report(Progress.RUNNING, "", "tucking the arms")
        for _ in range(2):
            follower = self._plan(trip, entries, room)
            if follower is None:
                raise _GaveUp("no_path", f"no free way to {place}")
            stalled = yield from self._follow(follower, f"driving to {place}")
            if not stalled or self._is_there(entries, room):
                return
            yield from self._back_off(trip, follower)
        raise _GaveUp("blocked", f"something blocks the way to {place}")

    def _names(self) -> list[str]:
        """What targets may be called."""
        phrases = {normalize(phrase) for entry in self._knowledge() for phrase in entry.phrases}
        return sorted(phrases | {normalize(room) for room in self._map.room_names})

    def _look_up(self, trip: _Trip) -> tuple[list[Entry], str | None]:
        """The entries that the target names, the best kind first only, and the map's room that was meant, if any."""
        knowledge = self._knowledge()
        hits = knowledge.find(trip.target, trip.room) or knowledge.find(trip.target)
        rooms = {normalize(name): name for name in self._map.room_names}
        for hit in hits:
            if hit.kind == "room" and normalize(hit.name) in rooms:
                trip.target = rooms[normalize(hit.name)]
                return [], trip.target
        if not hits and normalize(trip.target) in rooms:
            trip.target = rooms[normalize(trip.target)]
            return [], trip.target
        hits = [h for h in hits if h.kind != "room"]
        best = [h for h in hits if (h.held, h.inside is None) == (hits[0].held, hits[0].inside is None)]
        return best, rooms.get(normalize(trip.room)) if trip.room else None

    def _is_there(self, entries: list[Entry], room: str | None) -> bool:
        pose = self._robot.proprioception().base_pose
        if not entries:
            return self._map.room_at(pose[:2]) == room
        grid = self._grid([])
        return any(at_target(entry, pose, grid, self.parameters.handoff) for entry in entries)

    def _grid(self, blocks: list[tuple[float, float, float]]) -> Traversability:
        boxes = floor_obstacles(self._knowledge())
        return traversability(self._map, self._footprint(), boxes, blocks, self.parameters.clearance)

    def _plan(self, trip: _Trip, entries: list[Entry], room: str | None) -> PathFollower | None:
        """The way to the best goal; around what stopped the base before, if there is such a way."""
        body = self._robot.proprioception()
        start = body.base_pose[:2]
        footprint = Footprint.carrying(self._footprint(), body.base_pose, self._knowledge())
        for blocks in ([trip.blocks] if trip.blocks else []) + [[]]:
            grid = self._grid(blocks).escaping(start)
            goals: list[Goal] = []
            for entry in entries:
                goals += object_goals(entry, start, grid, self.parameters.handoff, most=_GOALS)
            if not entries and room is not None:
                goals = room_goals(room, start, grid, most=_GOALS)
            for goal in sorted(goals, key=lambda g: (footprint.slack(grid, g.pose) < 0, g.score)):
                found = shortest_path(grid.cost, self._map.cell(start), self._map.cell(goal.pose[:2]))
                if found is not None:
                    self.goal = goal.pose
                    limits = self.parameters.carrying if _holding(body) else self.parameters.limits
                    tolerance = self.parameters.tolerance
                    return PathFollower(grid.points(found[0]), goal.pose, grid, limits, tolerance, footprint=footprint)
        return None

    # ------------------------------------------------------------------------------------------ motion

    def _step_stow(self, stow: Stow) -> bool:
        self._robot.hold()
        return stow.step()

    def _follow(self, follower: PathFollower, feedback: str) -> Generator[Report, None, bool]:
        """Follow to the end; its value is whether the base came to a halt on the way."""
        window = int(self.parameters.stall_s * CONTROL_HZ)
        poses: list[Array] = []
        while True:
            body = self._robot.proprioception()
            if follower.reached(body.base_pose, body.base_velocity):
                return False
            poses.append(body.base_pose)
            if len(poses) > window and _still(poses[-1 - window], poses[-1]):
                return True
            self._robot.hold()
            self._write_base(follower.command(body.base_pose))
            yield Report(Progress.RUNNING, "", feedback)

    def _back_off(self, trip: _Trip, follower: PathFollower) -> Iterator[Report]:
        """Note where the base was stopped, and drive a little the other way."""
        pose = self._robot.proprioception().base_pose
        ahead = follower.aim - pose[:2]
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-6)
        at = pose[:2] + ahead * (self._footprint() + 0.10)
        trip.blocks.append((float(at[0]), float(at[1]), 0.15))
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
