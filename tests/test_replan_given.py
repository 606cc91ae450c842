"""What one may say of failures on the command line and in files, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from mpvi_bt.executive.plan.later import LaterPlanner
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.compile import compile_plan, parse_on_failure
from mpvi_bt.executive.tree.lint import lint
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.prepare import Prepared, prepare, prepare_episode
from tests.conftest import Shell

SKILLS = load_skills()
PLAN = RecordedPlanner().plan("picking_up_trash")


@pytest.mark.parametrize(
    ("given", "attempts", "retries"), [("advance", "advance", 0), ("retry:2", "advance", 2), ("replan", "replan", 0)]
)
def test_a_setting_is_what_the_tree_says(given: str, attempts: str, retries: int) -> None:
    """In every unit, and read back from YAML alike."""
    parameters, again = parse_on_failure(given)
    assert (parameters.on_failure, again) == (attempts, retries)
    tree = compile_plan(PLAN, SKILLS, given)
    for unit in tree.root.children:
        assert unit.parameters == parameters
        assert [unit.children[0].kind, unit.children[0].children[0].kind][: 1 + bool(retries)] == (
            ["retry", "timeout"] if retries else ["timeout"]
        )
    assert not lint(tree, SKILLS)


@pytest.mark.parametrize(
    "given", ["", "retry", "retry:", "retry:0", "retry:-1", "retry:1000", "retry: 2", "replan:2", "Advance"]
)
def test_what_is_no_setting_is_refused(given: str, mpvi: Shell) -> None:
    """In one line that says what would be one."""
    with pytest.raises(UserError, match="'advance', 'retry:N' with N from 1 to 999, or 'replan'"):
        parse_on_failure(given)
    done = mpvi("compile", "picking_up_trash", "--on-failure", given)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_a_compiled_tree_says_it(mpvi: Shell) -> None:
    """`mpvi compile` writes what runs; without the option it writes what it always wrote."""
    plain, again, anew = (
        mpvi("compile", "picking_up_trash", *more).stdout
        for more in ([], ["--on-failure", "retry:2"], ["--on-failure", "replan"])
    )
    assert plain == (paths.shipped() / "trees" / "picking_up_trash.yaml").read_text()
    assert again.count("retry: 3") == anew.count("on_failure: replan") == plain.count("attempt:")
    assert parse_tree(anew) == compile_plan(PLAN, SKILLS, "replan")


def test_the_plan_on_file_is_gone_by_once_more() -> None:
    """Also one that is named; a model is asked itself."""
    for config in (
        EpisodeConfig("picking_up_trash", on_failure="replan"),
        EpisodeConfig("picking_up_trash", plan="picking_up_trash", on_failure="replan"),
    ):
        planner = prepare_episode(config).planner
        assert isinstance(planner, LaterPlanner)
        assert planner.ask("picking_up_trash", "").plan.segments == PLAN.segments


def test_a_tree_of_a_file_says_itself(tmp_path: Path) -> None:
    """The option beside a tree is refused; a tree that asks for new plans needs a planner that makes them."""
    with pytest.raises(UserError, match="--on-failure is for plans"):
        prepare(EpisodeConfig("picking_up_trash", tree="picking_up_trash", on_failure="retry:1"))
    file = tmp_path / "t.yaml"
    file.write_text(
        "tree: t\nroot:\n  sequence: s\n  memory: true\n  children:\n"
        "    - {attempt: a, on_failure: replan, child: {navigate: kitchen}}\n"
    )
    with pytest.raises(UserError, match=r"'s/a' \(.*t.yaml:6:8\) wants a new plan"):
        prepare_episode(EpisodeConfig("picking_up_trash", tree=str(file)))


@pytest.mark.parametrize(
    "root",
    [
        "root: {attempt: a, on_failure: replan, child: {wait: 1}}",
        "root: {sequence: s, memory: false, children: [{attempt: a, on_failure: replan, child: {wait: 1}}]}",
        "root: {selector: s, memory: true, children: [{attempt: a, on_failure: replan, child: {wait: 1}}]}",
        "root: {sequence: s, memory: true, children: [{invert: , child: "
        "{attempt: a, on_failure: replan, child: {wait: 1}}}]}",
    ],
)
def test_where_nothing_follows_nothing_can_be_replaced(root: str) -> None:
    """Such an attempt is a problem of its tree."""
    assert [problem.code for problem in lint(parse_tree(f"tree: t\n{root}\n"), None)] == ["no-rest"]


def test_a_result_tells_of_it_where_it_is_not_the_default() -> None:
    """So results of before are still those of the same configuration."""
    config = EpisodeConfig("picking_up_trash")
    assert "on_failure" not in config.record()
    assert replace(config, on_failure="retry:2").record()["on_failure"] == "retry:2"


def test_a_dry_run_retries(mpvi: Shell, tmp_path: Path) -> None:
    """And puts off what failed; the second time it is given up."""
    (tmp_path / "rules.yaml").write_text("substitute:\n  - {nodes: '*/1 */navigate', fail: no_way}\n")
    words = ["run", "picking_up_trash", "--dry", "--substitute", "rules.yaml", "--no-watch", "--json", "--on-failure"]
    again = json.loads(mpvi(*words, "retry:2").stdout)
    assert [failure["reason"] for failure in again["failures"]] == ["out_of_tries"]
    anew = json.loads(mpvi(*words, "replan").stdout)
    assert [failure["reason"] for failure in anew["failures"]] == ["no_way"]
    assert [(replan["segments"], replan["said"]) for replan in anew["replans"]] == [(12, "")]


def test_a_stopped_dry_run_keeps_it(mpvi: Shell) -> None:
    """It goes on with the tree that it had."""
    stopped = mpvi(
        "run", "picking_up_trash", "--dry", "--on-failure", "retry:2", "--no-watch", "--step", stdin="n\nq\n"
    )
    assert stopped.returncode == 130
    assert mpvi("run", "--resume", "runs/picking_up_trash_dry.saved.json", "--no-watch").returncode == 0


def test_a_prepared_episode_has_no_planner_of_its_own() -> None:
    """With the plan on file nobody is asked for another."""
    ready = prepare_episode(EpisodeConfig("picking_up_trash", on_failure="retry:1"))
    assert isinstance(ready, Prepared)
    assert ready.planner is None
