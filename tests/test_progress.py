"""What a running suite says of itself, in which order its episodes begin, and how long it takes them to be."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.suite.progress import SuiteProgress, span
from mpvi_bt.runs.suite.schedule import EpisodeTimes, in_rounds
from mpvi_bt.runs.suite.store import Fault
from tests.fake_episodes import fake_result

EPISODES = [EpisodeConfig("picking_up_trash", instance) for instance in range(4)]
RESULTS = {c: Result.model_validate(fake_result(c)) for c in EPISODES[:3]}
FAULT = Fault("the worker process died (exit code -9)")
BUDGET_S = {"picking_up_trash": 100.0, "long": 300.0}


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def tell(stream: io.StringIO) -> str:
    """What is written of a run that finds one result and one broken file, makes two, and breaks once."""
    progress = SuiteProgress(stream, EpisodeTimes(BUDGET_S))
    progress.begin({EPISODES[0]: RESULTS[EPISODES[0]]}, EPISODES[1:], 2)
    progress.corrupt(EPISODES[1], Path("out/quarantine/a.json"))
    for config in EPISODES[1:3]:
        progress.started(config, config.instance)
    progress.tick(2)
    progress.finished(EPISODES[1], RESULTS[EPISODES[1]])
    progress.started(EPISODES[3], 1)
    progress.broke(EPISODES[3], FAULT, again=False)
    progress.tick(2)
    progress.finished(EPISODES[2], RESULTS[EPISODES[2]])
    progress.end()
    return stream.getvalue()


def test_progress_is_plain_lines_when_piped() -> None:
    """No control characters; each line stands alone."""
    text = tell(io.StringIO())
    assert "\x1b" not in text
    assert "\r" not in text
    lines = text.splitlines()
    assert lines[0] == "4 episodes, 1 already there, 3 to run in 2 worker processes, 1 to 5 s"
    assert lines[1] == (
        "picking_up_trash_1_0  its result file is broken; moved to out/quarantine/a.json, and to run again"
    )
    assert lines[2:4] == [f"picking_up_trash_{i}_0  begins, worker {i}" for i in (1, 2)]
    assert "| 2/4 done, 1 to 2 s left, mean q 0.75, 1 reached the goal, 1 running" in lines[4]
    assert lines[6] == "picking_up_trash_3_0  machine fault: the worker process died (exit code -9); given up"
    assert "3/4 done, mean q 0.83, 2 reached the goal, 1 machine fault, 0 running" in lines[7]


def test_progress_redraws_a_line_for_each_worker_on_a_terminal() -> None:
    """Below one of the whole; they are cleared before anything else is written, and gone at the end."""
    text = tell(Terminal())
    drawn, *rest = re.split(r"\r(?:\x1b\[\dA)?\x1b\[J", text)
    assert re.sub(r"\d+( to \d+)? s", "N s", drawn).splitlines()[-3:] == [
        "1/4 done, N s left, mean q 1.00, 1 reached the goal, 2 running",
        "  worker 1: picking_up_trash_1_0, N s of about N s",
        "  worker 2: picking_up_trash_2_0, N s of about N s",
    ]
    assert re.findall(r"\x1b\[(\d)A", text) == ["2", "1"], "up over what was drawn, and no farther"
    assert rest[-1] == "picking_up_trash_2_0  q 1.00  30 s simulated\n"
    assert all(len(line) < 80 for part in rest for line in part.splitlines()[-2:])


def test_methods_are_named() -> None:
    """Episodes of two methods are not the same."""
    stream = io.StringIO()
    progress = SuiteProgress(stream, EpisodeTimes(BUDGET_S))
    progress.broke(EpisodeConfig("picking_up_trash", method="e2e"), FAULT, again=True)
    assert stream.getvalue().startswith("e2e picking_up_trash_0_0  machine fault: ")


def test_nothing_is_said_of_the_time_left_before_an_episode_ran() -> None:
    """No table knows this machine and what else it does."""
    pace = EpisodeTimes(BUDGET_S)
    assert pace.left_s(EPISODES, {EPISODES[0]: 5.0}, 2) is None
    assert pace.expected_s(EPISODES[0]) is None
    stream = io.StringIO()
    progress = SuiteProgress(stream, pace)
    progress.begin({}, EPISODES, 2)
    progress.started(EPISODES[0], 1)
    assert stream.getvalue().splitlines()[0] == "4 episodes, 4 to run in 2 worker processes"
    assert progress.summary() == "0/4 done, 1 running"
    assert re.fullmatch(r"  worker 1: picking_up_trash_0_0, \d+ s", progress.at_work()[0])


def test_the_time_left_is_told_by_episodes_that_ran_and_weighs_tasks() -> None:
    """As the task's own took, or else by budgets at the rate of its method; who works at once shares what waits."""
    pace, short, long = EpisodeTimes(BUDGET_S), EPISODES[0], EpisodeConfig("long")
    pace.learn(short, 8.0)
    pace.learn(short, 12.0)
    assert pace.expected_s(short) == 10
    assert pace.expected_s(long) == pytest.approx(30), "three times the budget"
    assert pace.ends_s([short, long], {}, 1, 1) == pytest.approx(40)
    assert pace.ends_s([long, long, short, short], {}, 2, 1) == pytest.approx(40)
    assert pace.ends_s([short, short, long], {}, 2, 1) == pytest.approx(40), "in their order: the long one last"
    assert pace.ends_s([short], {short: 5.0}, 2, 1) == pytest.approx(10), "no sooner than the one that waits"
    assert pace.ends_s([], {short: 100.0}, 2, 1) == pytest.approx(25), "who is over its time is not done now"
    assert pace.expected_s(long, {short: 20.0}) == pytest.approx(60), "the first to end are the short ones"
    pace.learn(long, 4.0)
    assert pace.expected_s(long) == 4
    other = EpisodeConfig("long", method="e2e")
    assert pace.expected_s(other) == pytest.approx(300 * 24 / 500)
    pace.learn(EpisodeConfig("picking_up_trash", method="e2e"), 50.0)
    assert pace.expected_s(other) == pytest.approx(150), "its own method's episodes tell more"


@given(st.lists(st.floats(5.0, 200.0), min_size=1, max_size=12), st.integers(1, 4), st.floats(0.3, 3.0))
def test_the_time_left_is_that_of_the_schedule(walls: list[float], workers: int, share: float) -> None:
    """Where each task takes what is known of it, the time left at the start is when the last one ends."""
    tasks = [f"t{i}" for i in range(len(walls))]
    pace = EpisodeTimes(dict.fromkeys(tasks, 100.0 * share))
    for task, wall in zip(tasks, walls, strict=True):
        pace.learn(EpisodeConfig(task), wall)
    ends = [0.0] * workers
    for wall in walls:
        ends[ends.index(min(ends))] += wall
    assert pace.ends_s([EpisodeConfig(task) for task in tasks], {}, workers, 1) == pytest.approx(max(ends))


@pytest.mark.parametrize("workers", [1, 2, 8])
@pytest.mark.parametrize("through", [1, 6, 30, 54])
def test_the_range_of_the_time_left_holds_what_it_takes(workers: int, through: int) -> None:
    """Of made-up suites of 60 episodes four of five end in it, however many are through; it narrows meanwhile."""
    rng = np.random.default_rng(0)
    hits, widths = 0, []
    for _ in range(100):
        budget_s = {f"t{i}": float(rng.uniform(100, 1000)) for i in range(12)}
        walls = {
            EpisodeConfig(task, i): budget * rate * math.exp(rng.normal(0, 0.3))
            for task, budget in budget_s.items()
            for rate in [0.1 * math.exp(rng.normal(0, 0.6))]  # some tasks are slow for their budget
            for i in range(5)
        }
        free, begun = [0.0] * workers, {}
        for config in in_rounds(list(walls), budget_s):
            at = free.index(min(free))
            begun[config] = free[at]
            free[at] += walls[config]
        now = sorted(begun[c] + walls[c] for c in walls)[through - 1]
        pace = EpisodeTimes(budget_s)
        for config in sorted(walls, key=lambda c: begun[c] + walls[c])[:through]:
            pace.learn(config, walls[config])
        running = {c: now - begun[c] for c in walls if begun[c] <= now < begun[c] + walls[c]}
        span = pace.left_s([c for c in walls if begun[c] > now], running, workers)
        assert span is not None
        hits += span[0] <= max(free) - now <= span[1]
        widths.append(span[1] / span[0])
    assert hits >= 80
    assert np.median(widths) < {1: 30, 6: 6, 30: 4, 54: 20}[through], "at the end it is a few episodes' time"


def test_a_span_is_told_in_few_words() -> None:
    """The unit once where both have it; one figure where both are the same."""
    assert [span(*of) for of in ((120, 300), (40, 180), (119, 121), (3600, 9000), (0.2, 0.4))] == [
        "2 to 5 min", "40 s to 3 min", "about 2 min", "60 min to 2.5 h", "about 0 s",
    ]  # fmt: skip


def test_every_task_and_method_has_its_turn_before_another_instance_has() -> None:
    """A report of half a suite says something of all of it; in a round, long ones begin first."""
    kinds = [("long", "a"), ("picking_up_trash", "a"), ("long", "b")]
    episodes = [EpisodeConfig(task, i, method=method) for task, method in kinds for i in range(3)]
    order = in_rounds(episodes, BUDGET_S)
    assert sorted(map(str, order)) == sorted(map(str, episodes))
    assert [c.instance for c in order] == [0] * 3 + [1] * 3 + [2] * 3
    assert [c.task for c in order[:3]] == ["long", "long", "picking_up_trash"]
