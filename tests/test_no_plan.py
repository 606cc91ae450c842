"""Laws of the symbolic planner where it makes no plan: why there is none, or that there may be one, is told apart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.apps.authoring.skeletons import new_task
from mpvi_bt.executive.plan.planners import NoPlan
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.symbolic import action_search
from mpvi_bt.runs.symbolic.symbolic_planner import SymbolicPlanner

up = pytest.importorskip("unified_planning.shortcuts")
results = pytest.importorskip("unified_planning.engines")
PROBLEM = Path("tasks/problems/tidy.bddl")
GOAL = "(inside can__of__soda.n.01_1 ashcan.n.01_1)"


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of one's own with a new task in it."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    new_task("tidy").write(tmp_path)


def planned(goal: str = GOAL) -> Plan:
    PROBLEM.write_text(PROBLEM.read_text().replace(f"(and {GOAL})", f"(and {goal})"))
    return SymbolicPlanner(load_task("tidy")).ask("tidy").plan


def test_conditions_that_exclude_each_other_have_no_plan() -> None:
    """Each of them can be met alone."""
    with pytest.raises(NoPlan, match="no order of actions reaches all conditions of the goal together"):
        planned(f"{GOAL} (ontop can__of__soda.n.01_1 coffee_table.n.01_1)")


def test_a_condition_that_no_skill_ends_is_named() -> None:
    """What lies there from the start and cannot be taken away."""
    lies = "(ontop coffee_table.n.01_1 floor.n.01_1)"
    PROBLEM.write_text(PROBLEM.read_text().replace("(:init", f"(:init {lies}"))
    with pytest.raises(NoPlan, match=r"no skill ends ontop\(coffee_table.n.01_1, floor.n.01_1\)"):
        planned(f"(not {lies})")


def test_a_search_that_ends_too_early_says_that_there_may_be_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the time that it had."""

    class Hurried:
        """A planner whose time is up before its first plan."""

        def __init__(self, **given: Any) -> None:
            assert given["params"]["fast_downward_search_time_limit"] == "5s"

        def __enter__(self) -> Hurried:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def get_solutions(self, problem: Any) -> Iterator[Any]:
            yield results.PlanGenerationResult(results.PlanGenerationResultStatus.TIMEOUT, None, "hurried")

    monkeypatch.setattr(up, "AnytimePlanner", Hurried)
    with pytest.raises(NoPlan, match="none was found in 5 s; there may be one"):
        planned()


def test_a_task_that_is_too_large_is_told_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    """With how many actions it has, before any search."""
    monkeypatch.setattr(action_search, "MOST_ACTIONS", 2)
    with pytest.raises(NoPlan, match=r"the task is too large: \d+ actions to choose from, of at most 2"):
        planned()


@pytest.mark.slow
def test_the_best_plan_so_far_is_taken_and_told() -> None:
    """When the time is up before the cheapest one is known."""
    told = list[str]()
    assert SymbolicPlanner(load_task("can_meat"), 1, told.append).ask("can_meat").plan.segments
    assert told == ["the cheapest plan was not found in 1 s: this is the best one so far"]
