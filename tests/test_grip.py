"""Laws of what a hand notices of its grasp."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.robot.grip import GripWatch
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.hands.robots import r1
from mpvi_bt.testing import KinematicRobot

REST = KinematicRobot().proprioception()


def felt(width_m: float, command: float) -> Proprioception:
    """A right hand of that width and command."""
    return replace(
        REST,
        gripper_width={"left": 0.1, "right": width_m},
        gripper_command={"left": 1.0, "right": command},
    )


def go(watch: GripWatch, *ways: tuple[float, float, float, float]) -> list[tuple[float, str]]:
    """When [s] what was noticed; each way is seconds, command, and widths from and to [m]."""
    found: list[tuple[float, str]] = []
    steps = 0
    for seconds, command, start_m, end_m in ways:
        for width in np.linspace(start_m, end_m, round(seconds * CONTROL_HZ) + 1)[1:]:
            steps += 1
            found += [(steps / CONTROL_HZ, kind) for kind, side in watch.update(felt(float(width), command))]
    return found


CLOSE = (0.4, -1.0, 0.1, 0.0)


def test_a_hand_that_closes_on_nothing_is_empty_at_once() -> None:
    """One notice, when the fingers meet."""
    ((at_s, kind),) = go(GripWatch(felt(0.1, 1.0)), CLOSE, (3.0, -1.0, 0.0, 0.0))
    assert kind == "empty"
    assert at_s <= 0.4


@given(width_m=st.floats(0.006, 0.09), after_s=st.floats(0.2, 3.0))
def test_what_slips_out_is_lost_at_once(width_m: float, after_s: float) -> None:
    """Whenever it goes, one notice comes as the fingers meet, and it is not called empty."""
    held = (0.4, -1.0, 0.1, width_m), (after_s, -1.0, width_m, width_m)
    found = go(GripWatch(felt(0.1, 1.0)), *held, (0.1, -1.0, width_m, 0.0), (2.0, -1.0, 0.0, 0.0))
    assert [kind for _, kind in found] == ["lost"]
    assert found[0][0] <= 0.4 + after_s + 0.2


@given(width_m=st.floats(0.006, 0.09))
def test_a_good_grasp_and_a_release_are_no_news(width_m: float) -> None:
    """Holding, letting go and opening notice nothing."""
    ways = (0.4, -1.0, 0.1, width_m), (2.0, -1.0, width_m, width_m), (0.3, 1.0, width_m, 0.1), (1.0, 1.0, 0.1, 0.1)
    assert go(GripWatch(felt(0.1, 1.0)), *ways) == []


@given(command=st.floats(-1.0, 0.3), over_m=st.floats(0.01, 0.03), after_s=st.floats(0.3, 3.0))
def test_what_slips_out_is_lost_whatever_the_hand_is_told(command: float, over_m: float, after_s: float) -> None:
    """The fingers end where they are told to be, wide apart perhaps; one notice, and none before."""
    end_m = (command + 1) * r1.FINGER_TRAVEL_M
    width_m = end_m + over_m
    held = (0.4, command, 0.1, width_m), (after_s, command, width_m, width_m)
    found = go(GripWatch(felt(0.1, 1.0)), *held, (0.1, command, width_m, end_m), (2.0, command, end_m, end_m))
    assert [kind for _, kind in found] == ["lost"]
    assert 0.4 + after_s - 0.05 <= found[0][0] <= 0.4 + after_s + 0.2


@given(width_m=st.floats(0.01, 0.08), seconds=st.floats(0.2, 3.0))
def test_a_hand_that_is_opened_little_by_little_loses_nothing(width_m: float, seconds: float) -> None:
    """What is let go on purpose is no news, however slowly: the fingers follow once they are told to be wider."""
    watch = GripWatch(felt(width_m, -1.0))
    for command in np.linspace(-1.0, 1.0, round(seconds * CONTROL_HZ)):
        told_m = (float(command) + 1) * r1.FINGER_TRAVEL_M
        assert list(watch.update(felt(max(width_m, told_m), float(command)))) == []


def test_each_try_is_told_of() -> None:
    """Opening and closing on nothing again is news again."""
    tries = [CLOSE, (0.5, -1.0, 0.0, 0.0), (0.4, 1.0, 0.0, 0.1)] * 3
    assert [kind for _, kind in go(GripWatch(felt(0.1, 1.0)), *tries)] == ["empty"] * 3


@pytest.mark.parametrize(("width_m", "expected"), [(0.0, []), (0.03, ["lost"])])
def test_what_a_hand_is_like_at_the_start_is_known(width_m: float, expected: list[str]) -> None:
    """A fist is no news; what another primitive left in the hand may be lost."""
    watch = GripWatch(felt(width_m, -1.0))
    found = go(watch, (1.0, -1.0, width_m, width_m), (0.1, -1.0, width_m, 0.0), (1.0, -1.0, 0.0, 0.0))
    assert [kind for _, kind in found] == expected


def test_a_hand_that_is_told_to_pause_half_way_holds_nothing() -> None:
    """A width as commanded is no grasp, so that closing on from there ends empty, not lost."""
    ways = (0.3, -0.4, 0.1, 0.03), (1.0, -0.4, 0.03, 0.03), (0.2, -1.0, 0.03, 0.0)
    assert [kind for _, kind in go(GripWatch(felt(0.1, 1.0)), *ways)] == ["empty"]


@given(width_m=st.floats(0.006, 0.045))
def test_a_hand_holds_what_keeps_it_wider_than_it_is_told_to_be(width_m: float) -> None:
    """Closed on a thing it holds it; opened by just enough to let go of that, it holds nothing, though half closed."""
    assert felt(width_m, -1.0).holds("right")
    told = 2 * (width_m + 0.004) / r1.FINGER_TRAVEL_M / 2 - 1
    assert not felt(width_m + 0.004, told).holds("right")
    assert not felt(0.1, 1.0).holds("right")
