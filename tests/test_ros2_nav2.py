"""Driving by Nav2: what its error codes mean, who drives when, and what is said where it cannot."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.runs.ros2.nav2_client import REASONS, reason_of
from mpvi_bt.runs.ros2.nav2_navigator import Nav2Navigator, nav2
from tests.test_driving import REASONS as OURS


class Client:
    """Takes goals, and reaches none by itself."""

    def __init__(self) -> None:
        self.goals: list[tuple[float, ...]] = []
        self.canceled = 0
        self.failure: tuple[str, str] | None = None
        self.arrived = False

    def send(self, goal: Any) -> None:
        self.goals.append(tuple(goal))
        self.failure, self.arrived = None, False

    def cancel(self) -> None:
        self.canceled += 1


class Ours:
    """Drives to a goal, or looks around where it has no path."""

    goal, path = np.array([1.0, 2.0, 0.5]), np.zeros((2, 2))
    report = Report(Progress.RUNNING, "", "driving to the table")
    stopped = 0

    def start(self, target: str, room: str | None) -> None: ...

    def leave(self) -> None: ...

    def step(self) -> Report:
        return self.report

    def stop(self) -> None:
        self.stopped += 1


@pytest.fixture
def parts() -> tuple[Nav2Navigator, Ours, Client, Any]:
    """A navigator, and what it is made of."""
    stops: list[Any] = []
    gate = SimpleNamespace(watched=True, base_elsewhere=False, on_halt=stops.append, stops=stops)
    ours, client = Ours(), Client()
    return Nav2Navigator(SimpleNamespace(), ours, client, gate), ours, client, gate  # type: ignore[arg-type]


def test_every_code_has_a_reason_of_ours() -> None:
    """Those of drives by our own navigator, or that Nav2 itself is at fault."""
    assert {reason for reason, _ in REASONS.values()} <= OURS | {"no_pose", "nav2_failed"}
    assert reason_of(208) == ("no_path", "Nav2: no free way (error code 208)")
    assert reason_of(105, "stuck at a chair") == ("blocked", "Nav2: stuck at a chair (error code 105)")
    assert reason_of(31337)[0] == "nav2_failed"


def test_nav2_drives_to_our_goal_and_ours_the_rest(parts: Any) -> None:
    """One goal is sent; meanwhile no velocity of ours goes out; where Nav2 has arrived ours drives."""
    navigator, ours, client, gate = parts
    for _ in range(3):
        assert navigator.step() is ours.report
    assert client.goals == [(1.0, 2.0, 0.5)]
    assert gate.base_elsewhere
    client.arrived = True
    navigator.step()
    assert not gate.base_elsewhere
    ours.report = Report(Progress.SUCCEEDED, "", "arrived")
    assert navigator.step().progress is Progress.SUCCEEDED
    assert client.canceled == 0


def test_turns_for_looking_around_are_ours(parts: Any) -> None:
    """A drive without a path takes the base back."""
    navigator, ours, client, gate = parts
    navigator.step()
    ours.path = None
    navigator.step()
    assert (client.canceled, gate.base_elsewhere) == (1, False)


def test_a_goal_that_fails_ends_the_drive(parts: Any) -> None:
    """With Nav2's reason."""
    navigator, ours, client, gate = parts
    navigator.step()
    client.failure = reason_of(206)
    report = navigator.step()
    assert (report.progress, report.reason) == (Progress.FAILED, "goal_in_obstacle")
    assert (ours.stopped, gate.base_elsewhere) == (1, False)


def test_nothing_is_sent_before_motion_is_allowed(parts: Any) -> None:
    """Nav2 would move the base."""
    navigator, _, client, gate = parts
    gate.watched = False
    navigator.step()
    assert client.goals == []


def test_a_halt_cancels_the_goal(parts: Any) -> None:
    """The watchdog's too."""
    _, _, client, gate = parts
    gate.stops[0]()
    assert client.canceled == 1


def test_another_robot_is_refused() -> None:
    """One that is simulated here."""
    with pytest.raises(UserError, match="--navigator nav2 drives robots over ROS 2 only"):
        nav2(SimpleNamespace(), Ours())
