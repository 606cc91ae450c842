"""Laws of the symbolic planner where it makes no plan: why there is none, or that there may be one, is told apart."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
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
PATIENT_S = 120.0  # a busy machine must not change what is found


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of one's own with a new task in it."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    new_task("tidy").write(tmp_path)


def planned(goal: str = GOAL, limit_s: float = PATIENT_S, tell: Callable[[str], None] = print) -> Plan:
    PROBLEM.write_text(PROBLEM.read_text().replace(f"(and {GOAL})", f"(and {goal})"))
    return SymbolicPlanner(load_task("tidy"), limit_s, tell).ask("tidy").plan


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


def test_a_search_that_ends_too_early_says_that_there_may_be_a_plan() -> None:
    """With the time that it had."""
    with pytest.raises(NoPlan, match="none was found in 0 s; there may be one"):
        planned(limit_s=0.0)


def test_a_task_that_is_too_large_is_told_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    """With how many actions it has, before any search."""
    monkeypatch.setattr(action_search, "MOST_ACTIONS", 2)
    with pytest.raises(NoPlan, match=r"the task is too large: \d+ actions to choose from, of at most 2"):
        planned()


def test_the_best_plan_so_far_is_taken_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """When the time is up after a first plan and before the cheapest one is known."""

    class Hurried:
        """A planner that stops after its first plan."""

        def __init__(self, **given: Any) -> None:
            self._planner = real(**given)

        def __enter__(self) -> Hurried:
            return self

        def __exit__(self, *_: object) -> None:
            self._planner.destroy()

        def get_solutions(self, problem: Any, timeout: float) -> Iterator[Any]:
            first, *_ = self._planner.get_solutions(problem, timeout=timeout)
            yield replace(first, status=results.PlanGenerationResultStatus.TIMEOUT)

    real, told = up.AnytimePlanner, list[str]()
    best = planned(tell=told.append)
    assert not told
    monkeypatch.setattr(up, "AnytimePlanner", Hurried)
    assert len(planned(tell=told.append).segments) >= len(best.segments)
    assert told == [f"the cheapest plan was not found in {PATIENT_S:g} s: this is the best one so far"]
