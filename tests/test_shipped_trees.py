"""The trees that ship do what they say, with physics; tests/test_dry.py runs each of them without."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.ground import paths
from tests.conftest import Shell

pytestmark = [pytest.mark.slow, pytest.mark.render]


def ran(mpvi: Shell, tree: str, *more: str) -> dict[str, object]:
    """The result of an episode of the task with that tree."""
    done = mpvi("run", "picking_up_trash", "--tree", tree, "--no-watch", "--json", *more, timeout=400)
    result = json.loads(done.stdout)
    assert isinstance(result, dict)
    return result


def test_there_are_ten_trees_and_more() -> None:
    """From three lines to a long one."""
    lines = {name: len(paths.find("trees", name).read_text().splitlines()) for name in paths.names("trees")}
    assert len(lines) >= 10
    assert min(lines.values()) <= 4
    assert max(lines.values()) >= 60


@pytest.mark.rare
def test_the_task_is_done_by_a_tree_written_by_hand(mpvi: Shell) -> None:
    """With subtrees, parameters and a counter it reaches the same goal as the compiled plan."""
    result = ran(mpvi, "throw_away_cans")
    assert (result["success"], result["q_score"], result["failures"]) == (True, {"final": 1.0}, [])


@pytest.mark.rare
@pytest.mark.parametrize("tree", ["hello", "go_to", "fetch", "patrol", "guard"])
def test_trees_without_a_goal_succeed(tree: str, mpvi: Shell) -> None:
    """They drive, look around, carry a can to the table: the root ends in SUCCESS and nothing was given up."""
    result = ran(mpvi, tree)
    assert (result["ended"], result["failures"]) == ("success", [])


@pytest.mark.rare
def test_a_long_evening_ends_with_its_report(mpvi: Shell, tmp_path: Path) -> None:
    """Chores that fail are given up; the tree goes on to the end and says how many were done."""
    result = ran(mpvi, "evening_round")
    trace = read_trace(tmp_path / "runs" / "picking_up_trash_0_0.trace.jsonl")
    assert result["ended"] == "success"
    assert trace.blackboard(-1)["chores"] == 3
