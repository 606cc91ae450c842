"""Driving to a known place: the knowledge base gives the place, and the driver gets there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase, normalize
from mpvi_bt.finding.navigation.driver import DEFAULTS, Driver, GaveUp, NavigationParameters, Stow, never
from mpvi_bt.finding.navigation.goals import Goal, HandoffDistances, at_target, object_goals, room_goals
from mpvi_bt.finding.navigation.traversability import Traversability
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import nearest
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.ground.robot.protocol import SIDES, Robot
from mpvi_bt.ground.words.phrases import OTHER


@dataclass
class Trip:
    """One drive, from `start` to its end."""

    target: str
    room: str | None
    left: Array | None = None  # (3,) the pose that is not to be stopped at


# Our choice.
_GOALS = 40  # poses that are looked at of each target
_ELSEWHERE_M = 0.4  # half a base: a place this near to the pose that was left is the same place
_RATHER_M = 2.0  # of driving: what it is worth to stand nearer to the target than to what could be taken for it


class KnownPlaceNavigator:
    """Navigates to rooms, fixtures and objects whose places the knowledge base holds (implements `Navigator`).

    Order (Paper, Navigation appendix): done if the base is at the target already; else the knowledge base is asked; a
    target that it does not hold is looked up once more from inside the room that was named with it. Of several fixtures
    that are called so, it is the one that it was at before: a plan that says "the cabinet" again means the same, and
    one that says "another cabinet" does not. Of objects "another" and "the last" are such as it has not been at and
    left lying: what could not be picked up is not gone to again before the rest of its kind (our choice).

    Fails with `unknown_target`, or as its `Driver` does.
    """

    def __init__(
        self,
        robot: Robot,
        grid_map: OccupancyMap | Callable[[], OccupancyMap],
        knowledge: KnowledgeBase | Callable[[], KnowledgeBase],
        stow: Stow | None = None,
        parameters: NavigationParameters = DEFAULTS,
    ) -> None:
        """Bind the parts; nothing moves before `start`.

        Args:
            robot: The robot to drive.
            grid_map: The map, or a function that gives that of now.
            knowledge: What is known now, or a function that says so.
            stow: Tucks the arms before each drive; None leaves them as they are.
            parameters: Distances and speeds.
        """
        self._robot, self.parameters = robot, parameters
        self._map = grid_map if callable(grid_map) else lambda: grid_map
        self._knowledge = knowledge if callable(knowledge) else lambda: knowledge
        self._driver = Driver(robot, self._map, self._knowledge, stow, parameters)
        self._work: Iterator[Report] | None = None
        self._trip = Trip("", None)
        self._last = Report(Progress.FAILED, "not_started")
        self._leaving: Array | None = None
        self._been: dict[str, str] = {}  # phrases to the fixture so called that it was at last
        self._at, self._held = "", 0  # the object that it has arrived at, and how many hands held something then
        self._left: set[str] = set()  # objects that it came away from with as much in its hands

    def save(self) -> dict[str, Any]:
        """Where it was, as JSON values; a drive begins anew."""
        return {"been": self._been, "at": self._at, "held": self._held, "left": sorted(self._left)}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on with that. Raises KeyError, TypeError or ValueError if it is not as `save` writes it."""
        self._been = {str(phrase): str(name) for phrase, name in dict(saved["been"]).items()}
        self._at, self._held = str(saved["at"]), int(saved["held"])
        self._left = set(map(str, saved["left"]))

    @property
    def goal(self) -> Array | None:
        """(3,) the pose [m, m, rad] in the world that is being driven to, or was last; None before the first plan."""
        return self._driver.goal

    @property
    def path(self) -> Array | None:
        """(N, 2) the path [m] of the current drive; None if the base has no goal."""
        return self._driver.path if self._work is not None else None

    def start(self, target: str, room: str | None) -> None:
        """Begin driving to `target`; see `Navigator`."""
        self._driver.forget()
        if self._at and self._hands() == self._held:
            self._left.add(self._at)
        self._at, self._trip = "", Trip(target, room, self._leaving)
        self._leaving = None
        self._work = self._drive(self._trip)

    def leave(self) -> None:
        """Have the next drive stop elsewhere than where the base stands now; see `Navigator`."""
        self._leaving = self._robot.proprioception().base_pose.copy()

    def feel(self) -> None:
        """Once a control step, whatever the robot does: nothing, as the knowledge base knows what is held."""

    def step(self) -> Report:
        """Write one step's command; see `Navigator`. After the end it goes on reporting the end."""
        if self._work is None:
            self._robot.hold()
            return self._last
        try:
            self._last = next(self._work)
        except GaveUp as failure:
            self._last = Report(Progress.FAILED, failure.reason, str(failure))
        except StopIteration:
            self._last = Report(Progress.SUCCEEDED, "", "arrived")
            self._remember(self._trip)
        if self._last.progress is not Progress.RUNNING:
            self.stop()
        return self._last

    def stop(self) -> None:
        """Let the base stand still."""
        self._work = None
        self._robot.hold()

    # ------------------------------------------------------------------------------------------ the drive

    def _drive(self, trip: Trip) -> Iterator[Report]:
        """One report a step until the base has arrived. Raises GaveUp."""
        entries, room = self._look_up(trip)
        if not entries and room is None:
            near = nearest(normalize(trip.target), self._names())
            hint = f"; something near it is called {near!r}" if near else ""
            raise GaveUp("unknown_target", f"nobody knows where {trip.target!r} is{hint}")
        if not entries and room != trip.target:  # look for the target from within its room
            yield from self._drive_to(trip, [], room)
            entries, room = self._look_up(trip)
            if not entries:
                raise GaveUp("unknown_target", f"{trip.target} is not known in {room}")
        yield from self._drive_to(trip, entries, room)

    def _remember(self, trip: Trip) -> None:
        """Remember the nearest of several matches: skills, too, take the nearest match of a phrase."""
        entries = [e for e in self._look_up(trip)[0] if not e.held]
        if not entries:
            return
        here = self._robot.proprioception().base_pose[:2]
        nearest_one = min(entries, key=lambda e: float(norm(e.center[:2] - here)))
        if nearest_one.kind == "object":
            self._at, self._held = nearest_one.name, self._hands()
        elif len(entries) > 1:
            self._been[_said(trip.target)] = nearest_one.name

    def _hands(self) -> int:
        """How many hands feel something between their fingers."""
        felt = self._robot.proprioception()
        return sum(felt.holds(side) for side in SIDES)

    def _passed_over(self, trip: Trip) -> set[str]:
        """Objects that are not meant as long as there are others."""
        return self._left if OTHER.match(trip.target) else set()

    def _drive_to(
        self,
        trip: Trip,
        entries: list[Entry],
        room: str | None,
        until: Callable[[], bool] = never,
        handoff: HandoffDistances | None = None,
    ) -> Iterator[Report]:
        """Drive to the best of `entries`, or into `room` if there are none; no farther than `until`. Raises GaveUp.

        `handoff` is how far before an entry to stand; None: as for manipulation.
        """
        place = trip.target if entries else str(room)
        others = self._put_away(entries)
        pose = self._robot.proprioception().base_pose
        if self._is_there(entries, room, handoff=handoff) and not _mistakable(entries, others, pose):
            return

        def goals(grid: Traversability, start: Array) -> list[Goal]:
            if not entries:
                return room_goals(place, start, grid, most=_GOALS)
            return self._before(entries, grid, start, handoff)

        def there() -> bool:  # a base that was stopped near enough need not get to its goal
            return until() or (self._driver.halted and self._is_there(entries, room, handoff=handoff))

        try:
            yield from self._driver.to(goals, f"driving to {place}", there)
        except GaveUp as failure:
            raise GaveUp(failure.reason, f"{failure.message} to {place}") from None

    def _before(
        self, entries: list[Entry], grid: Traversability, start: Array, handoff: HandoffDistances | None = None
    ) -> list[Goal]:
        """Poses before any of the entries, rather such as skills will take them for what is meant from."""
        others = self._put_away(entries)
        return [
            replace(g, score=g.score + _RATHER_M * (_mistakable([e], others, g.pose) + self._was_left(g.pose)))
            for e in entries
            for g in object_goals(e, start, grid, handoff or self.parameters.handoff, most=_GOALS)
        ]

    def _was_left(self, pose: Array) -> bool:
        """Whether a pose (3,) is where this drive is to lead away from."""
        left = self._trip.left
        return left is not None and float(norm(pose[:2] - left[:2])) < _ELSEWHERE_M

    def _put_away(self, entries: list[Entry]) -> list[Entry]:
        """Objects named like `entries`, but more put away (see `KnowledgeBase.away`). Pictures cannot tell this."""
        known, names = self._knowledge(), {e.name for e in entries}
        said = {normalize(phrase) for e in entries if e.kind == "object" for phrase in e.phrases}
        alike = [o for o in known if o.name not in names and not o.held and said & set(map(normalize, o.phrases))]
        return [o for o in alike if all(known.away(o) > known.away(e) for e in entries)]

    def _names(self) -> list[str]:
        """Possible names of targets."""
        phrases = {normalize(phrase) for entry in self._knowledge() for phrase in entry.phrases}
        return sorted(phrases | {normalize(room) for room in self._map().room_names})

    def _look_up(self, trip: Trip) -> tuple[list[Entry], str | None]:
        """The entries named by the target, only of the best kind, and the map's room, if one is meant."""
        knowledge = self._knowledge()
        hits = knowledge.find(trip.target, trip.room)
        if not hits and trip.room:
            hits = knowledge.find(trip.target)
        rooms = {normalize(name): name for name in self._map().room_names}
        for hit in hits:
            if hit.kind == "room" and normalize(hit.name) in rooms:
                trip.target = rooms[normalize(hit.name)]
                return [], trip.target
        if not hits and normalize(trip.target) in rooms:
            trip.target = rooms[normalize(trip.target)]
            return [], trip.target
        hits = [h for h in hits if h.kind != "room"]
        hits = knowledge.filled_so(hits, trip.target)
        best = [h for h in hits if knowledge.away(h) == knowledge.away(hits[0])]
        if hits and hits[0].kind == "fixture":
            been, other = self._been.get(_said(trip.target)), bool(OTHER.match(trip.target))
            best = [h for h in best if been and (h.name == been) != other] or knowledge.joined(best)
        best = [h for h in best if h.name not in self._passed_over(trip)] or best
        return best, rooms.get(normalize(trip.room)) if trip.room else None

    def _is_there(
        self, entries: list[Entry], room: str | None, slack_m: float = 0.0, handoff: HandoffDistances | None = None
    ) -> bool:
        pose = self._robot.proprioception().base_pose
        if not np.isfinite(pose).all() or self._was_left(pose):
            return False
        if not entries:
            return room is not None and self._map().room_at(pose[:2]) == room
        grid = self._driver.grid()
        return any(at_target(entry, pose, grid, handoff or self.parameters.handoff, slack_m) for entry in entries)


def _mistakable(entries: list[Entry], others: list[Entry], pose: Array) -> bool:
    """Whether one of some others is nearer to a base at a pose (3,) than any entry: skills take the nearest."""
    nearest_m = min((float(norm(e.center[:2] - pose[:2])) for e in entries), default=np.inf)
    return any(float(norm(o.center[:2] - pose[:2])) < nearest_m for o in others)


def _said(target: str) -> str:
    """What "another cabinet" and "the cabinet" have in common."""
    return normalize(OTHER.sub("", target))
