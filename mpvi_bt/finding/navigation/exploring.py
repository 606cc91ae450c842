"""Going to what may have to be found first: the paper's order of looking for a target, with frontier exploration."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase, normalize
from mpvi_bt.finding.navigation.camera_mapper import CameraMapper
from mpvi_bt.finding.navigation.driver import DEFAULTS, GaveUp, NavigationParameters, Stow
from mpvi_bt.finding.navigation.goals import Goal, distance_to, near_goals
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator, Trip
from mpvi_bt.finding.navigation.nod import crane, lift_over, nod, tilt_toward
from mpvi_bt.finding.navigation.search import TargetSearch
from mpvi_bt.finding.navigation.traversability import Traversability
from mpvi_bt.finding.navigation.ways import stuck
from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import nearest
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.ground.robot.protocol import CameraImage, Robot
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.words.phrases import OTHER

# Our choice, so that every search ends.
_LOOKS = 4  # at what was gone to: a detector that sees it nine times of ten misses it once in ten thousand such
_OTHER_S = 60.0  # that another one is looked for by who carries one, or has left one: there may be no other
_TRIES = 8  # drives to what was seen: it may be elsewhere, not be there, or no way to it be known yet


class ExploringNavigator(KnownPlaceNavigator):
    """Navigates to targets whose place may be unknown (implements `Navigator`, and `SearchView` for pictures of it).

    Order (Paper, Navigation appendix): done if the base is at the target already; else the knowledge base is asked;
    else the robot drives into the room, or to the thing, that was named with the target, looks there, and explores:
    first the room and what stands on its furniture, then everything that it can reach. All the while the head camera
    looks for everything that the task is about, and what it finds goes into the knowledge base.

    Fails as `KnownPlaceNavigator` does, with `not_found` once all of the floor that can be reached was seen, and with
    `bad_target` if the target says nothing.

    Attributes:
        search: Explores.
        mapper: Maps what the head camera sees on the way.
    """

    def __init__(
        self,
        robot: Robot,
        knowledge: KnowledgeBase,
        mapper: CameraMapper,
        stow: Stow | None = None,
        parameters: NavigationParameters = DEFAULTS,
    ) -> None:
        """Bind the parts; nothing moves before `start`.

        Args:
            robot: The robot to drive.
            knowledge: What is known; `mapper` adds to it.
            mapper: Maps what the head camera sees on the way; paths are planned on its map.
            stow, parameters: As of `KnownPlaceNavigator`.
        """
        super().__init__(robot, lambda: mapper.occupancy.map, knowledge, stow, parameters)
        self.mapper = mapper
        self.search = TargetSearch(robot, mapper, self._driver)

    def feel(self) -> None:
        """Notice what the hands hold and let go; once a control step, whatever the robot does."""
        self.mapper.feel()

    def save(self) -> dict[str, Any]:
        """What was learned so far, as JSON values; a drive begins anew."""
        return {**super().save(), **self.mapper.save()}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on with what was learned. Raises KeyError, TypeError or ValueError if it is not as `save` writes it."""
        super().restore(saved)
        self.mapper.restore(saved)

    def step(self) -> Report:
        """Look if it is time to, and write one step's command; see `Navigator`."""
        if self._work is not None:
            self.mapper.step()
        return super().step()

    # ------------------------------------------------------------------------------------------ for pictures of the run

    @property
    def map(self) -> OccupancyMap:
        """The map for driving."""
        return self.mapper.occupancy.map

    @property
    def known(self) -> NDArray[np.bool_]:
        """(H, W) cells of the map of which it is known whether something stands there."""
        return self.mapper.occupancy.known

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(H, W) floor that the camera has seen, from afar or near."""
        return self.mapper.visibility.seen

    @property
    def frontier(self) -> NDArray[np.bool_]:
        """(H, W) cells between seen and unseen floor, at the last plan."""
        return self.search.frontier

    @property
    def image(self) -> CameraImage | None:
        """The picture that was searched last."""
        return self.mapper.last

    @property
    def detections(self) -> Sequence[Detection]:
        """What was detected in it."""
        return self.mapper.discoveries.detections

    @property
    def entries(self) -> Iterable[Entry]:
        """All that is known."""
        return self._knowledge()

    # ------------------------------------------------------------------------------------------ the drive

    def _drive(self, trip: Trip) -> Iterator[Report]:
        """One report a step until the base has arrived. Raises GaveUp."""
        if not normalize(trip.target):
            raise GaveUp("bad_target", f"{trip.target!r} names nothing to look for")
        discoveries = self.mapper.discoveries
        discoveries.phrases = tuple(dict.fromkeys((*discoveries.phrases, normalize(trip.target))))
        for _ in range(_TRIES):
            entries, room = self._look_up(trip)
            if not entries and room is not None and room == trip.target:
                yield from self._drive_to(trip, [], room)
                return
            if not self._at_hand(trip, entries, room):
                yield from self._find(trip, room)
                entries, room = self._look_up(trip)
                if not entries:
                    raise self._not_found(trip)
            names, slack_m = {entry.name for entry in entries}, 0.0
            try:
                yield from self._drive_to(trip, entries, room, until=partial(self._are_gone, names))
                slack_m = self.parameters.handoff.slack_m  # nowhere nearer was free
            except GaveUp:
                if self.mapper.occupancy.known.all() or not (yield from self._learn_the_way(trip, entries)):
                    raise
                continue
            yield from self._look_again(trip, names)
            entries, room = self._look_up(trip)
            here = [e for e in entries if e.name in names or not e.held]  # what is carried along is there everywhere
            if (here or not entries) and self._is_there(here, room, slack_m):
                return
            if not _seen([e for e in entries if e.name in names]):  # those that the drive was to
                return
        if entries:
            raise GaveUp("not_reached", f"{trip.target} was elsewhere each time that it was gone to")
        raise self._not_found(trip)

    def _find(self, trip: Trip, room: str | None) -> Iterator[Report]:
        """Search at the place named, then everywhere; for a limited time if another such thing is known."""
        feedback = f"looking for {trip.target}"
        passed_over = self._passed_over(trip)
        one = any(entry.held or entry.name in passed_over for entry in self._knowledge().find(trip.target))
        until_s = self.mapper.looked_s + _OTHER_S if one else math.inf

        answers: dict[str | None, tuple[int, bool]] = {}  # asked for each step; only pictures change them

        def found(where: str | None = None) -> bool:
            pictures, answer = answers.get(where, (-1, False))
            if pictures != self.mapper.pictures:
                answer = self._at_hand(trip, self._look_up(trip)[0], where) or self.mapper.looked_s > until_s
                answers[where] = self.mapper.pictures, answer
            return answer

        if room is not None:
            try:
                yield from self._drive_to(trip, [], room, until=lambda: found(room))
            except GaveUp:
                pass  # it may be seen from elsewhere
            else:
                yield from self.search.run(lambda: found(room), f"{feedback} in {room}", room)
                yield from self._look_over(room, lambda: found(room), feedback)
        elif trip.room and (area := self._knowledge().find(trip.room)):
            with suppress(GaveUp):
                yield from self._drive_to(Trip(trip.room, None), area, None, until=found)
        if not found():
            yield from self.search.run(found, feedback)

    def _look_over(self, room: str, found: Callable[[], bool], feedback: str) -> Iterator[Report]:
        """Go up to each piece of the room's furniture, the nearest first, and look down on it.

        Our choice: all floor of a room can be seen, and what lies on a high top, or behind another thing, not.
        """
        left = {e.name: e for e in self._knowledge() if e.kind == "fixture" and e.room == room}
        while left and not found():
            here = self._robot.proprioception().base_pose[:2]
            entry = left.pop(min(left, key=lambda name: distance_to(left[name], here)))
            report = Report(Progress.RUNNING, "", f"{feedback} on {entry.phrases[0]}")
            try:
                yield from self._drive_to(Trip(entry.phrases[0], None), [entry], None, found, self.parameters.look)
            except GaveUp:
                continue
            if found():
                return
            lift, _, _, tilt = map(float, self._posture())
            top = np.array([*entry.center[:2], entry.highest[2]])
            for _ in crane(self._robot, lift_over(self._robot, float(top[2]))):
                yield report
            for _ in nod(self._robot, tilt_toward(self._robot, top)):
                yield report
            self.mapper.look()
            for _ in nod(self._robot, tilt):
                yield report
            for _ in crane(self._robot, lift):
                yield report

    def _posture(self) -> Array:
        """(4,) of the trunk, as felt."""
        felt = self._robot.proprioception()
        return robot_named(felt.robot).trunk.posture(felt.torso)

    def _look_again(self, trip: Trip, names: set[str]) -> Iterator[Report]:
        """Look at what was gone to, until a picture shows it: a detector may have erred, or may miss it now.

        What is near and low is below the picture of a head that looks ahead: it is tilted down, and raised again.
        """
        report = Report(Progress.RUNNING, "", f"looking whether {trip.target} is there")
        before = float(self._posture()[3])
        for _ in range(_LOOKS):
            self.mapper.look()
            entries = self._knowledge().entries
            left = [entries[name] for name in sorted(names & set(entries))]
            if not left or any(entry.seen_s == self.mapper.looked_s or not _seen([entry]) for entry in left):
                break
            for entry in left:
                self.mapper.expect(entry.name)
            here = self._robot.proprioception().base_pose[:2]
            nearest_one = min(left, key=lambda entry: distance_to(entry, here))
            for _ in nod(self._robot, tilt_toward(self._robot, nearest_one.center)):
                yield report
            yield report
        for _ in nod(self._robot, before):
            yield report

    def _learn_the_way(self, trip: Trip, entries: list[Entry]) -> Generator[Report, None, bool]:
        """Without a prior map: come as near to what is seen as known floor leads, and explore until a way is known.

        Returns:
            Whether one is known.
        """
        learned, known = False, self.mapper.pictures

        def can_be_reached() -> bool:
            nonlocal learned, known
            if self.mapper.pictures != known:
                known = self.mapper.pictures
                start = self._robot.proprioception().base_pose[:2]
                grid = self._driver.grid().escaping(start)
                goals = self._before(entries, grid, start)
                learned = any(math.isfinite(g.score) and math.isfinite(grid.cost[grid.map.cell(g.pose)]) for g in goals)
            return learned

        def nearer(grid: Traversability, start: Array) -> list[Goal]:
            return near_goals(entries[0], start, grid)

        feedback = f"looking for a way to {trip.target}"
        with suppress(GaveUp):
            yield from self._driver.to(nearer, feedback, can_be_reached)
        yield from self.search.run(can_be_reached, feedback)
        return learned

    def _at_hand(self, trip: Trip, entries: list[Entry], room: str | None = None) -> bool:
        """Whether there is something to go to: not only what it put into something, such as the cans in the bin.

        Nor what it carries: who is sent to a shoe with a shoe in hand is sent to another one. Nor what it left lying,
        where another is meant. With a room, what was seen in another one does not count.
        """
        known, passed_over = self._knowledge(), self._passed_over(trip)
        some = [e for e in entries if not room or e.source == "prior" or e.room in (None, room)]
        return any(not (entry.held or entry.name in passed_over or known.put_in(entry)) for entry in some)

    def _are_gone(self, names: set[str]) -> bool:
        """Whether none of the entries is believed in any more."""
        known = self._knowledge().entries
        return not any(name in known for name in names)

    def _not_found(self, trip: Trip) -> GaveUp:
        """Reason for a failed search. The base can be stuck in obstacles only if the whole map is known."""
        here, evidence = self._robot.proprioception().base_pose[:2], self._evidence(trip)
        if self.mapper.occupancy.known.all() and stuck(self._driver.grid(), here):
            return GaveUp("start_in_collision", f"the base cannot leave the obstacles that it stands in: {evidence}")
        return GaveUp("not_found", evidence)

    def _evidence(self, trip: Trip) -> str:
        share, area = self.search.coverage()
        near = nearest(normalize(trip.target), self._names())
        hint = f"; something near it is called {near!r}" if near else ""
        name = OTHER.sub("", trip.target).strip()
        said = f"no {name} in {self.mapper.pictures} pictures of {share:.0%} of the {area:.0f} m² within reach"
        discoveries = self.mapper.discoveries
        failed = (
            f"; the detector failed on {discoveries.errors} ({discoveries.last_error})" if discoveries.errors else ""
        )
        return said + hint + failed


def _seen(entries: list[Entry]) -> bool:
    """Whether these entries come from pictures, so that another picture may correct them."""
    return not entries or any(entry.source not in ("prior", "oracle") for entry in entries)
