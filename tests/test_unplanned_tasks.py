"""Laws of tasks without a plan on file: the symbolic planner makes one by the goal."""

from __future__ import annotations

from pathlib import Path

import pytest

import mpvi_bt
from mpvi_bt.apps.authoring.skeletons import new_task
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.planning import plan_of
from mpvi_bt.runs.episode.prepare import prepare_episode
from mpvi_bt.runs.symbolic import action_search

PROBLEM = Path("tasks/problems/tidy.bddl")


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of one's own with a new task in it."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    new_task("tidy").write(tmp_path)
    return tmp_path


def test_a_task_without_a_plan_is_planned_by_its_goal(root: Path) -> None:
    """A run prepares the tree of that plan."""
    pytest.importorskip("unified_planning")
    planned = prepare_episode(EpisodeConfig("tidy")).planned
    assert planned is not None
    assert planned.plan == plan_of("tidy")


def test_without_the_library_a_run_says_what_to_install(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the check only notes it: the task is well."""
    monkeypatch.setattr(action_search, "NEEDED", ("no_such_library",))
    with pytest.raises(mpvi_bt.UserError, match=r"needs pip install .*\[symbolic\]"):
        plan_of("tidy")
    assert [problem.severity for problem in mpvi_bt.check(root)] == ["note"]


def test_the_check_says_that_no_skill_reaches_a_goal(root: Path) -> None:
    """With what is wanted, and the nearest skill."""
    pytest.importorskip("unified_planning")
    goal = "(and (nextto coffee_table.n.01_1 floor.n.01_1))"
    PROBLEM.write_text(PROBLEM.read_text().replace("(and (inside can__of__soda.n.01_1 ashcan.n.01_1))", goal))
    (problem,) = mpvi_bt.check("tasks/tidy.yaml")
    assert "no skill brings nextto(" in problem.message
    assert "the nearest skill is place_next_to" in problem.message
