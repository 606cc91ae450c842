"""Laws of searches for what nobody knows the place of, on hand-made maps seen through computed depth pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase
from mpvi_bt.finding.navigation.camera_mapper import CameraMapper
from mpvi_bt.finding.navigation.exploring import ExploringNavigator
from mpvi_bt.finding.navigation.goals import HandoffDistances, distance_to
from mpvi_bt.finding.perception.detector import Detection, Detector, GuardedDetector
from mpvi_bt.finding.scene.discovery import Discoveries
from mpvi_bt.finding.scene.occupancy import Occupancy
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.finding.scene.visibility import VisibilityMap
from mpvi_bt.ground.errors import DetectorError
from mpvi_bt.ground.protocols import Progress, Report, StepClock
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Proprioception
from mpvi_bt.hands.robots import r1
from tests.depth_pictures import Box, picture, walls
from tests.layouts import LAYOUT
from tests.navigation_maps import KinematicRobot, put_box, thing, two_rooms

CUP = thing("cup", (7.2, 0.6, 0.06), (0.1, 0.1, 0.12))
KITCHEN = Entry("kitchen", ("kitchen",), "room", np.zeros(3), np.array([4.0, 4.0, 0.0]))
LIVING_ROOM = Entry("living_room", ("living room",), "room", np.array([4.0, 0.0, 0.0]), np.array([8.0, 4.0, 0.0]))


class Seeing(KinematicRobot, StepClock):
    """A base with a head camera in a world of boxes, and the clock, too."""

    def __init__(self, x: float, y: float, yaw: float, boxes: Sequence[Box]) -> None:
        super().__init__(x, y, yaw)
        self.boxes = list(boxes)

    def advance(self) -> None:
        """One control step."""
        super().advance()
        self.steps += 1

    def at(self) -> tuple[float, float, float]:
        """Its pose as plain numbers."""
        x, y, yaw = self.pose.tolist()
        return x, y, yaw

    def look(self, camera: str) -> CameraImage:
        """A small picture."""
        assert camera == "head"
        return picture(self.at(), self.boxes, scale=0.25)


class Rising(Seeing):
    """One whose torso goes where it is told at once, and the camera with it."""

    def __init__(self, x: float, y: float, yaw: float, boxes: Sequence[Box]) -> None:
        super().__init__(x, y, yaw, boxes)
        self.action[LAYOUT.torso] = r1.TRAVEL_TORSO

    def proprioception(self) -> Proprioception:
        """With that torso."""
        return replace(super().proprioception(), torso=self.action[LAYOUT.torso].copy())

    def look(self, camera: str) -> CameraImage:
        """A picture from where the head is."""
        assert camera == "head"
        return picture(self.at(), self.boxes, 0.5, self.action[LAYOUT.torso])


class BoxDetector:
    """Finds the entries that it is given, where the picture shows their boxes."""

    name = "boxes"

    def __init__(self, *entries: Entry) -> None:
        self.entries = entries

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says."""
        points = image.points_world()
        found = []
        for entry in self.entries:
            with np.errstate(invalid="ignore"):
                inside = (points > entry.lowest + [-0.01, -0.01, 0.02]) & (points < entry.highest + 0.01)
            mask: NDArray[np.bool_] = np.all(inside, axis=-1)
            if mask.sum() >= 3 and (asked := [p for p in phrases if p in entry.phrases]):
                rows, columns = np.nonzero(mask.any(1))[0], np.nonzero(mask.any(0))[0]
                box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
                found.append(Detection(asked[0], 0.9, box, mask))
        return found


def box_of(entry: Entry) -> Box:
    return tuple(entry.lowest.tolist()), tuple(entry.highest.tolist())


def exploring(
    robot: Seeing, detector: Detector, grid_map: OccupancyMap | None, *known: Entry, phrases: Sequence[str] = ("cup",)
) -> ExploringNavigator:
    """A navigator with that map, or that builds its own."""
    occupancy = Occupancy.prior(grid_map) if grid_map else Occupancy.unknown(robot.pose[:2], (20.0, 20.0))
    base = KnowledgeBase({entry.name: entry for entry in known})
    discoveries = Discoveries(base, phrases, detector, robot)
    view = VisibilityMap(occupancy.map)
    mapper = CameraMapper(robot, robot, occupancy, view, discoveries, lambda: [(*robot.pose[:2], 0.3)])
    return ExploringNavigator(robot, base, mapper)


def play(
    robot: Seeing, navigator: ExploringNavigator, target: str, room: str | None = None, most_s: float = 300.0
) -> tuple[Report, list[tuple[float, float, float]]]:
    """Run a search to its end; the last report and the trace of poses."""
    navigator.start(target, room)
    trace = [robot.at()]
    for _ in range(round(most_s * CONTROL_HZ)):
        report = navigator.step()
        if report.progress is not Progress.RUNNING:
            return report, trace
        robot.advance()
        trace.append(robot.at())
    raise AssertionError(f"still {report} after {most_s} s at {robot.pose}")


def house(*things: Entry) -> tuple[OccupancyMap, list[Box]]:
    """Two rooms with a cupboard in the living room that hides its far corner, and what stands in them."""
    grid_map = two_rooms()
    put_box(grid_map, (6.0, 0.3), (6.3, 1.7))
    return grid_map, [*walls(grid_map), *map(box_of, things)]


@pytest.mark.parametrize("prior", [True, False])
def test_what_is_hidden_in_another_room_is_found_and_approached(prior: bool) -> None:
    """With a map, and without one: then nothing is entered that is not free."""
    grid_map, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    robot.walls = grid_map
    report, trace = play(robot, exploring(robot, BoxDetector(CUP), grid_map if prior else None), "the cup")
    assert report.progress is Progress.SUCCEEDED, report
    assert distance_to(CUP, robot.pose[:2]) < HandoffDistances().distance_m + HandoffDistances().slack_m
    assert not any(grid_map.occupied[grid_map.cell(pose[:2])] for pose in trace)


def test_the_same_search_is_made_twice() -> None:
    """Nothing in it is left to chance."""
    traces = []
    for _ in range(2):
        grid_map, boxes = house(CUP)
        robot = Seeing(1.0, 2.0, 3.0, boxes)
        traces.append(play(robot, exploring(robot, BoxDetector(CUP), grid_map), "cup")[1])
    assert traces[0] == traces[1]


@pytest.mark.parametrize("prior", [True, False])
def test_what_does_not_exist_is_looked_for_everywhere_and_no_longer(prior: bool) -> None:
    """It fails once all that can be reached was seen, and says so."""
    grid_map, boxes = house()
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    navigator = exploring(robot, BoxDetector(), grid_map if prior else None)
    report, _ = play(robot, navigator, "cup")
    assert report.reason == "not_found"
    assert "no cup in" in report.feedback
    share, area = navigator.search.coverage()
    assert share > 0.97
    assert area > 10.0
    assert robot.time_s > 10.0


def test_what_is_seen_but_cannot_be_reached() -> None:
    """Behind a counter that shuts off the room the way ends, and the reason is that of driving."""
    grid_map = two_rooms(door_m=0.0)
    counter = thing("counter", (4.0, 2.0, 0.3), (0.1, 3.8, 0.6))
    low: list[Box] = [b for b in walls(grid_map) if not (3.8 < b[0][0] < 4.2 and b[1][0] < 4.3)]
    urn = thing("cup", (5.6, 2.0, 0.25), (0.4, 0.4, 0.5))
    robot = Seeing(2.0, 2.0, 0.0, [*low, box_of(counter), box_of(urn)])
    report, _ = play(robot, exploring(robot, BoxDetector(urn), grid_map), "cup")
    assert report.progress is Progress.FAILED
    assert report.reason == "no_path"


@pytest.mark.parametrize("prior", [True, False])
def test_what_lies_in_the_middle_of_a_wide_table_is_come_as_near_to_as_one_can(prior: bool) -> None:
    """A base that stands where nothing nearer is free has arrived."""
    plain = two_rooms()
    table, cup = thing("table", (6.0, 2.0, 0.15), (1.5, 1.5, 0.3)), thing("cup", (6.0, 2.0, 0.36), (0.1, 0.1, 0.12))
    robot = Seeing(1.0, 2.0, 0.0, [*walls(plain), box_of(table), box_of(cup)])
    grid_map = two_rooms()
    put_box(grid_map, (5.25, 1.25), (6.75, 2.75))
    report, _ = play(robot, exploring(robot, BoxDetector(cup), grid_map if prior else None), "cup")
    assert report.progress is Progress.SUCCEEDED, report
    assert (
        HandoffDistances().distance_m
        < distance_to(cup, robot.pose[:2])
        <= HandoffDistances().distance_m + HandoffDistances().slack_m
    )


@pytest.mark.parametrize("target", ["", "  ", "!?"])
def test_a_target_that_says_nothing(target: str) -> None:
    """It is refused at once."""
    grid_map, boxes = house()
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    report, trace = play(robot, exploring(robot, BoxDetector(), grid_map), target)
    assert report.reason == "bad_target"
    assert len(trace) < 3


def test_a_room_that_is_named_is_searched_first() -> None:
    """Of two cups the one in the room that was named is gone to, though the other one is nearer."""
    near = thing("near", (1.0, 3.2, 0.06), (0.1, 0.1, 0.12))
    near.phrases = ("cup",)
    grid_map, boxes = house(CUP, near)
    robot = Seeing(2.0, 1.0, 0.0, boxes)
    known = KITCHEN, LIVING_ROOM
    report, _ = play(robot, exploring(robot, BoxDetector(CUP, near), grid_map, *known), "cup", "living room")
    assert report.progress is Progress.SUCCEEDED
    assert distance_to(CUP, robot.pose[:2]) < 1.3


def test_what_lies_flat_on_a_high_cabinet_is_found_from_above() -> None:
    """All floor of the room is seen and the cup is not: before furniture the robot rises, and is low again after."""
    grid_map, boxes = house()
    cabinet = thing("cabinet", (0.35, 3.0, 0.725), (0.6, 1.0, 1.45), kind="fixture", room="kitchen", source="prior")
    put_box(grid_map, (0.05, 2.5), (0.65, 3.5))
    cup = replace(CUP, lowest=np.array([0.1, 2.95, 1.45]), highest=np.array([0.2, 3.05, 1.475]))
    robot = Rising(3.0, 1.0, 0.0, [*boxes, box_of(cabinet), box_of(cup)])
    report, trace = play(
        robot, exploring(robot, BoxDetector(cup), grid_map, KITCHEN, LIVING_ROOM, cabinet), "cup", "kitchen"
    )
    assert report.progress is Progress.SUCCEEDED
    assert distance_to(cup, robot.pose[:2]) < 1.3
    assert max(x for x, _, _ in trace) < 4.0
    np.testing.assert_allclose(robot.proprioception().torso, r1.TRAVEL_TORSO, atol=0.05)


def test_what_lies_in_a_basin_is_found_from_near() -> None:
    """Its near wall hides it from where a robot stands to work at the sink."""
    grid_map, boxes = house()
    sink = thing("sink", (0.35, 3.0, 0.45), (0.6, 0.7, 0.9), kind="fixture", room="kitchen", source="prior")
    put_box(grid_map, (0.05, 2.65), (0.65, 3.35))
    base = thing("base", (0.35, 3.0, 0.33), (0.6, 0.7, 0.66))
    walls = [thing("wall", (x, 3.0, 0.78), (0.02, 0.7, 0.24)) for x in (0.06, 0.64)]
    cup = replace(CUP, lowest=np.array([0.48, 2.95, 0.66]), highest=np.array([0.56, 3.05, 0.7]))
    robot = Rising(3.0, 1.0, 0.0, [*boxes, *map(box_of, (base, *walls, cup))])
    report, _ = play(robot, exploring(robot, BoxDetector(cup), grid_map, KITCHEN, LIVING_ROOM, sink), "cup", "kitchen")
    assert report.progress is Progress.SUCCEEDED
    assert distance_to(cup, robot.pose[:2]) < 1.3


@pytest.mark.parametrize("laid", [False, True])
def test_what_is_found_in_a_basket_is_gone_to_and_what_was_put_into_one_is_not(laid: bool) -> None:
    """The cup in the basket is what is looked for, unless the robot put it there: then another one may be elsewhere."""
    basket = thing("basket", (3.0, 3.0, 0.2), (0.5, 0.5, 0.4))
    cup = thing("cup", (3.0, 3.0, 0.15), (0.15, 0.15, 0.3))
    basket.source = cup.source = "boxes"
    cup.inside, cup.laid = "basket", laid
    grid_map, boxes = house(cup, CUP)
    robot = Seeing(1.0, 2.0, 0.0, boxes)
    report, _ = play(robot, exploring(robot, BoxDetector(cup, CUP), grid_map, KITCHEN, LIVING_ROOM, basket, cup), "cup")
    assert report.progress is Progress.SUCCEEDED
    assert distance_to(CUP if laid else cup, robot.pose[:2]) < 1.3


def test_what_was_seen_on_the_way_is_gone_to_straight() -> None:
    """A later segment drives to it without a search."""
    grid_map, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    navigator = exploring(robot, BoxDetector(CUP), grid_map, KITCHEN, LIVING_ROOM)
    assert play(robot, navigator, "cup")[0].progress is Progress.SUCCEEDED
    assert play(robot, navigator, "kitchen")[0].progress is Progress.SUCCEEDED
    begun = robot.time_s
    report, _ = play(robot, navigator, "cup")
    assert report.progress is Progress.SUCCEEDED
    assert robot.time_s - begun < 25.0


def test_what_was_taken_away_is_looked_for_anew() -> None:
    """It is no longer where it was seen: it is found where it is now."""
    grid_map, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    detector = BoxDetector(CUP)
    navigator = exploring(robot, detector, grid_map, KITCHEN, LIVING_ROOM)
    assert play(robot, navigator, "cup")[0].progress is Progress.SUCCEEDED
    assert play(robot, navigator, "kitchen")[0].progress is Progress.SUCCEEDED
    moved = thing("cup", (7.2, 3.4, 0.06), (0.1, 0.1, 0.12))
    detector.entries, robot.boxes = (moved,), house(moved)[1]
    report, _ = play(robot, navigator, "cup")
    assert report.progress is Progress.SUCCEEDED
    assert distance_to(moved, robot.pose[:2]) < 1.3


def test_who_finds_nothing_where_it_was_goes_on_to_what_the_map_has() -> None:
    """A lid that was raised looked like another car; it was gone, and the base had "arrived" 7 m from the car."""
    seen = Entry("cupboard #1", ("cupboard",), "fixture", np.array([0.8, 0.4, 0.0]), np.array([1.2, 0.6, 0.8]),
                 source="boxes")  # fmt: skip
    known = Entry("cupboard_1", ("cupboard",), "fixture", np.array([6.0, 0.3, 0.0]), np.array([6.3, 1.7, 1.0]),
                  source="prior")  # fmt: skip
    grid_map, boxes = house()
    robot = Seeing(1.0, 2.0, -1.6, boxes)
    navigator = exploring(robot, BoxDetector(), grid_map, KITCHEN, LIVING_ROOM, seen, known)
    navigator.restore(navigator.save() | {"been": {"cupboard": "cupboard #1"}})
    assert play(robot, navigator, "cupboard")[0].progress is Progress.SUCCEEDED
    assert distance_to(known, robot.pose[:2]) < 1.3


class Laden(Seeing):
    """A robot that carries a thing before it."""

    carried: Entry

    def advance(self) -> None:
        """One control step, of the thing too."""
        super().advance()
        x, y, yaw = self.pose
        middle = np.array([x + 0.6 * np.cos(yaw), y + 0.6 * np.sin(yaw), 0.7])
        self.carried.lowest, self.carried.highest = middle - 0.05, middle + 0.05


def test_what_is_carried_along_is_no_arrival() -> None:
    """It is taken to where the robot came from; another one, which it carries in a bowl, is not taken for it."""
    grid_map, boxes = house(CUP)
    robot = Laden(1.0, 2.0, 3.0, boxes)
    robot.carried = Entry("cup #9", ("cup",), "object", np.zeros(3), np.ones(3), source="boxes", held=True,
                          inside="bowl")  # fmt: skip
    detector = BoxDetector(CUP)
    navigator = exploring(robot, detector, grid_map, KITCHEN, LIVING_ROOM, robot.carried)
    assert play(robot, navigator, "cup")[0].progress is Progress.SUCCEEDED
    assert play(robot, navigator, "kitchen")[0].progress is Progress.SUCCEEDED
    moved = thing("cup", (0.6, 3.6, 0.06), (0.1, 0.1, 0.12))
    navigator.start("cup", None)
    while (report := navigator.step()).progress is Progress.RUNNING and robot.time_s < 300.0:
        robot.advance()
        if robot.pose[0] > 5.5:
            detector.entries, robot.boxes = (moved,), house(moved)[1]
    assert report.progress is Progress.SUCCEEDED
    assert distance_to(moved, robot.pose[:2]) < 1.3


def test_who_carries_one_looks_for_another() -> None:
    """Told to go to a cup, with a cup in hand and no other known: it finds the one in the other room."""
    grid_map, boxes = house(CUP)
    robot = Laden(1.0, 2.0, 3.0, boxes)
    robot.carried = Entry("cup #9", ("cup",), "object", np.zeros(3), np.ones(3), source="boxes", held=True)
    navigator = exploring(robot, BoxDetector(CUP), grid_map, KITCHEN, LIVING_ROOM, robot.carried)
    assert play(robot, navigator, "cup")[0].progress is Progress.SUCCEEDED
    assert distance_to(CUP, robot.pose[:2]) < 1.3


def test_who_carries_the_only_one_does_not_look_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may have the other one in hand already."""
    monkeypatch.setattr("mpvi_bt.finding.navigation.exploring._OTHER_S", 5.0)
    grid_map, boxes = house()
    robot = Laden(1.0, 2.0, 3.0, boxes)
    robot.carried = Entry("cup #9", ("cup",), "object", np.zeros(3), np.ones(3), source="boxes", held=True)
    navigator = exploring(robot, BoxDetector(), grid_map, KITCHEN, LIVING_ROOM, robot.carried)
    assert play(robot, navigator, "cup", most_s=20.0)[0].progress is Progress.SUCCEEDED


def test_who_left_one_lying_looks_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """It finds the one in the other room; where there is none it goes back to the one that it left, after a while."""
    monkeypatch.setattr("mpvi_bt.finding.navigation.exploring._OTHER_S", 30.0)
    left = thing("cup #9", (1.0, 0.5, 0.06), (0.1, 0.1, 0.12))
    left.phrases = ("cup",)
    for others, another in (((CUP,), CUP), ((), left)):
        grid_map, boxes = house(left, *others)
        robot = Seeing(1.0, 2.0, -1.6, boxes)
        navigator = exploring(robot, BoxDetector(left, *others), grid_map, KITCHEN, LIVING_ROOM)
        for said, expected in (("cup", left), ("another cup", another)):
            assert play(robot, navigator, said, most_s=200.0)[0].progress is Progress.SUCCEEDED
            assert distance_to(expected, robot.pose[:2]) < 1.3


class Erring(BoxDetector):
    """Sees a cup in some pixels of the first picture, where none is."""

    def __init__(self, box: tuple[int, int, int, int], *entries: Entry) -> None:
        super().__init__(*entries)
        self.box, self.pictures = box, 0

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says, after the first picture."""
        self.pictures += 1
        if self.pictures > 1:
            return super().detect(image, phrases)
        mask = np.zeros(image.depth.shape, bool)
        left, top, right, bottom = self.box
        mask[top:bottom, left:right] = True
        return [Detection("cup", 1.0, np.array(self.box), mask)]


@pytest.mark.parametrize("prior", [True, False])
@pytest.mark.parametrize("box", [(35, 30, 45, 40), (10, 15, 75, 35)])
def test_a_mistake_of_the_detector_is_looked_at_and_passed_over(box: tuple[int, int, int, int], prior: bool) -> None:
    """What is gone to and not seen there is forgotten, a wide patch of floor too; the thing itself is found."""
    grid_map, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 0.0, boxes)
    report, _ = play(robot, exploring(robot, Erring(box, CUP), grid_map if prior else None), "cup")
    assert report.progress is Progress.SUCCEEDED
    assert distance_to(CUP, robot.pose[:2]) < 1.3


class Failing:
    """A detector that raises."""

    name = "failing"

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """Raise."""
        raise ZeroDivisionError("no")


def test_a_detector_that_fails_finds_nothing_and_stops_nothing() -> None:
    """Each failure is counted, and the search ends as any that finds nothing."""
    grid_map, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    navigator = exploring(robot, GuardedDetector(Failing()), grid_map)
    report, _ = play(robot, navigator, "cup")
    assert report.reason == "not_found"
    discoveries = navigator.mapper.discoveries
    assert discoveries.errors == navigator.mapper.pictures
    assert isinstance(discoveries.last_error, DetectorError)
    assert "ZeroDivisionError" in report.feedback


def test_what_was_learned_survives_a_stop() -> None:
    """Another navigator that is told it drives straight to what this one found, and knows the same map."""
    _, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    navigator = exploring(robot, BoxDetector(CUP), None)
    assert play(robot, navigator, "cup")[0].progress is Progress.SUCCEEDED
    saved = json.loads(json.dumps(navigator.save()))
    later = Seeing(1.0, 2.0, 3.0, boxes)
    other = exploring(later, BoxDetector(CUP), None)
    other.restore(saved)
    assert np.array_equal(other.mapper.occupancy.map.occupied, navigator.mapper.occupancy.map.occupied)
    assert np.array_equal(other.mapper.visibility.seen, navigator.mapper.visibility.seen)
    assert play(later, other, "cup")[0].progress is Progress.SUCCEEDED
    assert later.time_s < 25.0
    for spoilt in ({**saved, "seen": "AAAA"}, {**saved, "known": 3}, {}):
        with pytest.raises((KeyError, TypeError, ValueError)):
            other.restore(spoilt)
