"""What searches take: counted while it is asked for, and told by kind."""

from __future__ import annotations

import numpy as np

from benchmarks.hands.search_times import compared, table, timed
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1


def test_a_search_is_counted_while_it_is_timed_and_not_afterwards() -> None:
    """Every call adds its kind, seconds and whether something was found; the program is as before then."""
    body, goal = Body(R1, np.zeros(4), dict(r1.TRAVEL_ARM)), r1.TRAVEL_ARM["left"]
    log: list[tuple[str, float, bool]] = []
    plan = arm_motion.plan
    with timed(log):
        path = arm_motion.plan(body, "left", goal, np.random.default_rng(0))
    arm_motion.plan(body, "left", goal, np.random.default_rng(0))
    assert arm_motion.plan is plan
    assert [(kind, found) for kind, _, found in log] == [("a path of the arm", path is not None)]
    assert log[0][1] >= 0


def test_files_of_two_commits_are_compared_by_the_trials_that_both_have() -> None:
    """Successes only here and only there, and processor time as a ratio; a trial of one file alone does not count."""
    here = [
        {"trial": "a", "ok": True, "cpu_s": 1.0, "searches": [["a stance", 0.5, True], ["a stance", 2.0, False]]},
        {"trial": "b", "ok": True, "cpu_s": 1.0, "searches": []},
        {"trial": "c", "ok": True, "cpu_s": 9.0, "searches": []},
    ]
    there = [
        {"trial": "a", "ok": False, "cpu_s": 3.0, "searches": []},
        {"trial": "b", "ok": True, "cpu_s": 1.0, "searches": []},
    ]
    told = " ".join(compared(here, there))
    assert "2 trials in both: 2 succeed, there 1; 1 only here, 0 only there" in told
    assert "0.50 of theirs" in told
    rows = list(table(here))
    assert "| a stance | 2 | 1250.0 | 1925.0 | 2000 | 2.5 |" in rows
    assert "| a | a stance | 2.00 |" in rows
