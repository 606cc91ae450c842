"""Whatever is wrong with a target, a detector, a picture or a place: a search in the real loop ends with a reason."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mpvi_bt.executive.behaviors.context import Context, Failure
from mpvi_bt.executive.behaviors.parameters import NavigateTo
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.finding.navigation.exploring import ExploringNavigator
from mpvi_bt.finding.perception.detector import Detection, GuardedDetector
from mpvi_bt.ground.errors import DetectorError
from mpvi_bt.ground.robot.protocol import CameraImage
from tests.depth_pictures import walls
from tests.navigation_maps import put_box, thing, two_rooms
from tests.test_exploring import CUP, BoxDetector, Seeing, box_of, exploring, house

LIMIT_S = 300.0  # simulated; no search in two rooms takes that long


class LoopWorld:
    """What the loop steps: a seeing robot, which is its own clock."""

    def __init__(self, robot: Seeing) -> None:
        self.robot = robot

    @property
    def time_s(self) -> float:
        """Simulated seconds."""
        return self.robot.time_s

    @property
    def steps(self) -> int:
        """Control steps."""
        return self.robot.steps

    def step(self) -> None:
        """One control step."""
        self.robot.advance()


def failure_of(navigator: ExploringNavigator, robot: Seeing, target: str = "cup") -> Failure:
    """How a tree that is one drive to a target fails in the loop; it does so before the time is over."""
    unused: Any = SimpleNamespace()
    context = Context(robot, robot, navigator, unused, unused, unused, sense=navigator.feel)
    tree = Tree(TreeSpec("bad", NodeSpec("navigate", NavigateTo(target=target))))
    outcome = run_episode(tree, cast("Any", LoopWorld(robot)), context, max_time_s=LIMIT_S)
    assert outcome.ending == "failure"
    assert outcome.failure
    return outcome.failure


class Answering:
    """A detector that does with each picture as it is told."""

    name = "answering"

    def __init__(self, answer: Callable[[], Any]) -> None:
        self.answer, self.asked = answer, 0

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """Whatever it is."""
        self.asked += 1
        answer: list[Detection] = self.answer()
        return answer


def raises() -> None:
    """Fail."""
    raise ZeroDivisionError("no")


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (raises, "raised"),
        (lambda: None, "bad_answer"),
        (lambda: [Detection("cup", 0.9, np.array([-5, 0, 3, 3]))], "bad_box"),
        (lambda: [Detection("cup", 0.9, np.array([0, 0, 10**6, 3]))], "bad_box"),
        (lambda: [Detection("cup", float("nan"), np.array([0, 0, 3, 3]))], "bad_score"),
    ],
)
def test_a_detector_that_answers_nonsense_finds_nothing_and_stops_nothing(
    answer: Callable[[], Any], reason: str
) -> None:
    """The whole house is looked at all the same, and the evidence names the detector's last failure."""
    grid_map, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    navigator = exploring(robot, GuardedDetector(Answering(answer)), grid_map)
    failure = failure_of(navigator, robot)
    assert failure.reason == "not_found"
    assert f"the detector failed on {navigator.mapper.pictures}" in failure.evidence
    assert navigator.mapper.discoveries.last_error is not None
    assert navigator.mapper.discoveries.last_error.reason == reason
    assert navigator.search.coverage()[0] > 0.9


def test_a_detector_that_hangs_costs_a_bounded_time() -> None:
    """It is waited for once; the search goes on without it, over the whole house, and says why it found nothing."""
    free = threading.Event()
    detector = Answering(lambda: free.wait(60) or [])
    grid_map, boxes = house(CUP)
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    guarded = GuardedDetector(detector, limit_s=0.3)
    waited = 0.0
    ask = guarded.detect

    def timed(image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        nonlocal waited
        began = time.monotonic()
        try:
            return ask(image, phrases)
        finally:
            waited += time.monotonic() - began

    guarded.detect = timed  # type: ignore[method-assign]
    navigator = exploring(robot, guarded, grid_map)
    failure = failure_of(navigator, robot)
    free.set()
    assert failure.reason == "not_found"
    assert f"the detector failed on {navigator.mapper.pictures}" in failure.evidence
    assert "has not come back" in failure.evidence
    assert detector.asked == 1
    assert waited < 5.0, "0.3 s and what a busy machine adds, not 0.3 s a picture"


def test_a_detector_that_is_always_late_is_asked_no_more() -> None:
    """One that comes back after each time that it was given up would else cost the limit again and again."""

    def late() -> list[Detection]:
        time.sleep(0.2)
        return []

    detector = Answering(late)
    guarded = GuardedDetector(detector, limit_s=0.02)
    image = Seeing(1.0, 2.0, 0.0, []).look("head")
    more, deadline = 50, time.monotonic() + 60
    while more and time.monotonic() < deadline:
        with pytest.raises(DetectorError) as caught:
            guarded.detect(image, ["cup"])
        assert caught.value.reason == "hangs"
        more -= detector.asked >= 3
        time.sleep(0.01)
    assert detector.asked == 3
    assert "asked no more" in str(caught.value)


@pytest.mark.parametrize("prior", [True, False])
def test_what_does_not_exist_fails_by_evidence(prior: bool) -> None:
    """Once the whole reachable space was seen, long before the time is over."""
    grid_map, boxes = house()
    robot = Seeing(1.0, 2.0, 3.0, boxes)
    robot.walls = grid_map
    navigator = exploring(robot, GuardedDetector(BoxDetector()), grid_map if prior else None)
    failure = failure_of(navigator, robot, "unicorn")
    assert failure.reason == "not_found"
    assert failure.time_s < LIMIT_S / 2
    assert "no unicorn in" in failure.evidence
    assert navigator.search.coverage()[0] > 0.9


@pytest.mark.parametrize("target", ["the", "cup " * 200, "💥', NULL; --", "../../etc/passwd"])
def test_an_absurd_target_is_one_that_does_not_exist(target: str) -> None:
    """It says nothing, or nothing is called so."""
    grid_map = two_rooms(door_m=0.0)  # the smaller the space, the sooner all of it was seen
    robot = Seeing(1.0, 2.0, 0.0, [*walls(grid_map), box_of(CUP)])
    failure = failure_of(exploring(robot, GuardedDetector(BoxDetector(CUP)), grid_map), robot, target)
    assert failure.reason in ("bad_target", "not_found")
    assert len(failure.evidence) < 1000


@pytest.mark.parametrize("depth", [float("nan"), float("inf"), 0.0, -1.0])
@pytest.mark.parametrize("prior", [True, False])
def test_pictures_without_depth_end_a_search(depth: float, prior: bool) -> None:
    """Nothing is ever seen; each frontier is tried once, and the search is over."""

    class Blind(Seeing):
        def look(self, camera: str) -> CameraImage:
            """A picture that measures nothing."""
            image = super().look(camera)
            return replace(image, depth=np.full_like(image.depth, depth))

    grid_map, boxes = house(CUP)
    robot = Blind(1.0, 2.0, 3.0, boxes)
    failure = failure_of(exploring(robot, GuardedDetector(BoxDetector(CUP)), grid_map if prior else None), robot)
    assert failure.reason == "not_found"


def test_a_target_inside_an_obstacle_has_no_place_to_stand() -> None:
    """It is seen where nothing free is within reach of the arms."""
    grid_map = two_rooms()
    put_box(grid_map, (5.0, 0.0), (8.0, 4.0))  # a platform that fills the living room but for its doorway
    urn = thing("cup", (6.8, 2.0, 0.5), (0.3, 0.3, 0.3))
    robot = Seeing(2.0, 2.0, 0.0, [*walls(two_rooms()), ((5.0, 0.0, 0.0), (8.0, 4.0, 0.35)), box_of(urn)])
    failure = failure_of(exploring(robot, GuardedDetector(BoxDetector(urn)), grid_map), robot)
    assert failure.reason == "goal_in_obstacle"


def test_a_start_in_collision_has_a_reason() -> None:
    """A robot deep inside of furniture neither drives nor raises."""
    grid_map, boxes = house(CUP)
    put_box(grid_map, (0.2, 0.2), (2.6, 3.8))
    robot = Seeing(1.4, 2.0, 0.0, boxes)
    failure = failure_of(exploring(robot, GuardedDetector(BoxDetector(CUP)), grid_map), robot)
    assert failure.reason == "start_in_collision"
    assert float(np.linalg.norm(robot.pose[:2] - [1.4, 2.0])) < 0.1
