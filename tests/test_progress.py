"""What a running suite says of itself, in which order its episodes begin, and how long it takes them to be."""

from __future__ import annotations

import io
import math
from pathlib import Path

import pytest

from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.progress import Progress
from mpvi_bt.suite.result import Result
from mpvi_bt.suite.schedule import Pace, in_rounds
from mpvi_bt.suite.store import Fault
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
    progress = Progress(stream, Pace(BUDGET_S))
    progress.begin({EPISODES[0]: RESULTS[EPISODES[0]]}, EPISODES[1:], 2)
    progress.corrupt(EPISODES[1], Path("out/quarantine/a.json"))
    for config in EPISODES[1:3]:
        progress.started(config)
    progress.tick(2)
    progress.finished(EPISODES[1], RESULTS[EPISODES[1]])
    progress.started(EPISODES[3])
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
    assert lines[0] == "4 episodes, 1 already there, 3 to run in 2 worker processes"
    assert lines[1] == (
        "picking_up_trash_1_0  its result file is broken; moved to out/quarantine/a.json, and to run again"
    )
    assert "2/4 done, mean q 0.75, 1 reached the goal, 1 running, " in lines[2]
    assert lines[3] == "picking_up_trash_3_0  machine fault: the worker process died (exit code -9); given up"
    assert "3/4 done, mean q 0.83, 2 reached the goal, 1 machine fault, 0 running" in lines[4]


def test_progress_redraws_one_line_on_a_terminal() -> None:
    """The line is cleared before anything else is written, and gone at the end."""
    text = tell(Terminal())
    shown = [part for part in text.split("\r\x1b[2K") if "\n" not in part and part]
    assert len(shown) == 2
    assert all(len(line) < 80 for line in shown)
    assert text.rsplit("\r\x1b[2K", 1)[-1].endswith("\n") or text.endswith("\r\x1b[2K")


def test_methods_are_named() -> None:
    """Episodes of two methods are not the same."""
    stream = io.StringIO()
    progress = Progress(stream, Pace(BUDGET_S))
    progress.broke(EpisodeConfig("picking_up_trash", method="e2e"), FAULT, again=True)
    assert stream.getvalue().startswith("e2e picking_up_trash_0_0  machine fault: ")


def test_the_time_left_weighs_tasks() -> None:
    """By what their episodes took, by the budgets of those that none is through of, and by who works at once."""
    pace, short, long = Pace(BUDGET_S), EPISODES[0], EpisodeConfig("long")
    assert math.isnan(pace.left_s([short], {}, 1)), "nobody knows before one is through"
    pace.learn(short, 8.0)
    pace.learn(short, 12.0)
    assert pace.expected_s(short) == 10
    assert pace.expected_s(long) == pytest.approx(30), "three times the budget"
    assert pace.left_s([short, long], {}, 1) == pytest.approx(40)
    assert pace.left_s([short, short, long, long], {}, 2) == pytest.approx(40)
    assert pace.left_s([short], {long: 10.0}, 2) == pytest.approx(20), "no sooner than the one that is running"
    assert pace.left_s([], {short: 99.0}, 2) == 0, "over its time"
    pace.learn(long, 4.0)
    assert pace.expected_s(long) == 4
    other = EpisodeConfig("long", method="e2e")
    assert pace.expected_s(other) == pytest.approx(300 * 24 / 500)
    pace.learn(EpisodeConfig("picking_up_trash", method="e2e"), 50.0)
    assert pace.expected_s(other) == pytest.approx(150), "its own method's episodes tell more"


def test_every_task_and_method_has_its_turn_before_another_instance_has() -> None:
    """A report of half a suite says something of all of it; in a round, long ones begin first."""
    kinds = [("long", "a"), ("picking_up_trash", "a"), ("long", "b")]
    episodes = [EpisodeConfig(task, i, method=method) for task, method in kinds for i in range(3)]
    order = in_rounds(episodes, BUDGET_S)
    assert sorted(map(str, order)) == sorted(map(str, episodes))
    assert [c.instance for c in order] == [0] * 3 + [1] * 3 + [2] * 3
    assert [c.task for c in order[:3]] == ["long", "long", "picking_up_trash"]
    assert [c.instance for c in in_rounds(order[5:], BUDGET_S)] == [2, 2, 1, 2], "what is left has rounds of its own"
