"""Laws of questions whose answers take their time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.executive.behaviors.question import HANDOVER_S, Question
from mpvi_bt.ground.protocols import StepClock
from mpvi_bt.ground.robot.protocol import CONTROL_HZ

STEP_S = 1 / CONTROL_HZ


class Steps(StepClock):
    """A clock that is moved by hand."""

    def __init__(self, steps: int = 0) -> None:
        self.steps = steps


def ticks_until(question: Question[float], clock: Steps, most: int = 300) -> int:
    """At which tick the answer comes, the one that asked being 0; the loop itself takes no time."""
    for tick in range(most):
        if question.answer() is not None:
            return tick
        clock.steps += 1
    raise AssertionError("no answer")


def sleeps(seconds: float) -> Callable[[], float]:
    """Asks something that takes so long, and measures how long."""

    def ask() -> float:
        began = time.monotonic()
        time.sleep(seconds)
        return time.monotonic() - began

    return ask


def itself(latency_s: float) -> float:
    """The answers of these tests are their latencies."""
    return latency_s


def test_what_is_computed_here_is_answered_in_the_tick_that_asks() -> None:
    """However long it takes, and without another thread."""
    threads = []

    def ask() -> float:
        threads.append(threading.current_thread())
        time.sleep(0.1)
        return 0.0

    assert ticks_until(Question(ask, Steps(7), itself, at_once=True), Steps(7)) == 0
    assert threads == [threading.current_thread()]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 5.0), st.booleans())
def test_an_answer_on_file_comes_at_the_first_tick_at_which_its_latency_has_passed(
    start: int, latency_s: float, at_once: bool
) -> None:
    """In simulated time alone: a replay needs no more wall time than reading the file."""
    clock = Steps(start)
    tick = ticks_until(Question(lambda: latency_s, clock, itself, at_once=at_once), clock)
    due_s = latency_s + (0.0 if at_once else HANDOVER_S)
    assert tick * STEP_S >= due_s - 1e-5
    assert tick == 0 or (tick - 1) * STEP_S < due_s


@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.15, 0.4])
def test_a_live_run_and_its_replay_get_the_answer_at_the_same_tick(seconds: float) -> None:
    """The tick follows from the latency that was measured, not from when the loop happened to look."""
    clock, taken = Steps(), []

    def ask() -> float:
        taken.append(sleeps(seconds)())
        return taken[0]

    live = ticks_until(Question(ask, clock, itself), clock)
    again = Steps()
    assert ticks_until(Question(lambda: taken[0], again, itself), again) == live


def test_an_open_question_holds_the_loop_to_real_time_and_no_tick_waits_longer_than_a_step() -> None:
    """As on a robot: simulated time since the question is never ahead of the wall clock."""
    clock, began, waited = Steps(), time.monotonic(), []
    question = Question(sleeps(0.5), clock, itself)
    while True:
        before = time.monotonic()
        answer = question.answer()
        waited.append(time.monotonic() - before)
        if answer is not None:
            break
        assert time.monotonic() - began >= min(clock.time_s, 0.5)  # once it is there, nothing need be waited for
        clock.steps += 1
    assert sorted(waited)[len(waited) // 2] <= STEP_S * 1.2  # of the median: this machine may be busy
    assert sum(waited) <= answer + HANDOVER_S + 3 * STEP_S


def test_a_loop_that_is_slower_than_real_time_waits_for_simulated_time() -> None:
    """An answer that is there is not used before the robot would have had it."""
    clock = Steps()
    question = Question(lambda: 0.1, clock, itself)
    time.sleep(0.15)
    assert question.answer() is None
    clock.steps += round((0.1 + HANDOVER_S) * CONTROL_HZ) - 1
    assert question.answer() is None
    clock.steps += 1
    assert question.answer() == 0.1


@pytest.mark.parametrize("at_once", [True, False])
def test_what_goes_wrong_is_raised_where_the_answer_is_asked_for(at_once: bool) -> None:
    """Not in the thread, where nobody would see it."""

    def ask() -> float:
        raise ValueError("no such model")

    clock = Steps()
    question = Question(ask, clock, itself, at_once=at_once)
    with pytest.raises(ValueError, match="no such model"):
        ticks_until(question, clock)


def test_a_question_that_is_dropped_leaves_nothing_that_keeps_the_process_alive() -> None:
    """Its thread is a daemon, and its answer goes nowhere."""
    gate = threading.Event()
    question = Question(lambda: gate.wait(5.0), Steps(), lambda _: 0.0)
    (thread,) = [t for t in threading.enumerate() if t.name == "question" and t.is_alive()]
    assert thread.daemon
    del question
    gate.set()
    thread.join(5.0)
    assert not thread.is_alive()
