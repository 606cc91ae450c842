"""Laws of `--unit`, `--latency` and `--policy-faults` in a run: what becomes of the tree, of answers and of results."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.executive.behaviors.context import WatchedHandoff
from mpvi_bt.executive.monitors.calibration import Calibration, SkillThresholds
from mpvi_bt.executive.monitors.signals import SIGNALS
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.lateness import LateChecker, latency_of
from mpvi_bt.runs.episode.handoffs import read_handoffs
from mpvi_bt.runs.episode.prepare import check_watched, prepare
from mpvi_bt.runs.episode.result import write_result
from tests.conftest import Shell
from tests.fake_episodes import fake_result

TASK = "picking_up_trash"
RESULT = fake_result(EpisodeConfig(TASK))


def kinds(**settings: Any) -> list[str]:
    """The kinds of node of a task's tree."""
    return [node.spec.kind for node in prepare(EpisodeConfig(TASK, **settings)).spec.nodes]


def test_each_unit_of_manipulation_runs_in_the_tree_that_is_named() -> None:
    """Its nodes stand under the unit's timeout, with prompt, criterion, skill and place filled in; drives stay."""
    plain, watched, all_of_it = kinds(), kinds(unit="monitored"), kinds(unit="intervene")
    units = plain.count("manipulate")
    assert watched.count("monitor") == watched.count("manipulate") == units
    assert all_of_it.count("monitor") == 2 * units
    assert all_of_it.count("back_off") == units
    assert watched.count("navigate") == plain.count("navigate")
    nodes = prepare(EpisodeConfig(TASK, unit="intervene")).spec.nodes
    elsewhere = [node.spec.parameters for node in nodes if getattr(node.spec.parameters, "elsewhere", False)]
    assert elsewhere[0].target == "trash can"  # type: ignore[attr-defined]
    assert not any("$" in str(node.spec.parameters) for node in nodes)


def test_a_unit_whose_place_nobody_knows_is_left_as_it_is(tmp_path: Path) -> None:
    """A plan that begins with manipulation has nowhere to return to; a tree that asks for no place takes it."""
    segment = {"type": "manipulation", "description": "turn on the radio", "completion_criterion": "the radio is on"}
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps({"task_name": "t", "instruction": "Turn on the radio.", "segments": [segment]}))
    for unit, monitors in (("monitored", 1), ("intervene", 0)):
        nodes = prepare(EpisodeConfig("", unit=unit, plan=str(plan))).spec.nodes
        assert [node.spec.kind for node in nodes].count("monitor") == monitors


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"unit": "monitred"}, "monitored"),
        ({"unit": "careful_pick"}, "has no value; a unit has prompt, criterion, skill, place"),
        ({"unit": "monitored", "tree": "hello"}, "--unit is for plans"),
        ({"calibration": "nowhere.json"}, "nowhere.json"),
    ],
)
def test_a_unit_or_calibration_that_cannot_be_is_refused(settings: dict[str, Any], said: str) -> None:
    """Before anything runs."""
    with pytest.raises(UserError, match=said):
        prepare(EpisodeConfig(TASK, **settings))


@pytest.fixture
def wipes(tmp_path: Path) -> str:
    """A file of thresholds of one skill."""
    levels: Any = {name: [1.0] for name in SIGNALS}
    wipe = SkillThresholds(runs=8, thresholds=levels)
    known = Calibration(policy=EpisodeConfig(TASK).policy, robot="r1", alpha=0.2, skills={"wipe": wipe})
    known.write(tmp_path / "wipe.json")
    return str(tmp_path / "wipe.json")


@pytest.mark.parametrize(
    ("unit", "said"),
    [("intervene", "for wipe; skills that this run watches: pick, place_in"), (None, "none; --unit monitored does")],
)
def test_thresholds_of_nothing_that_is_watched_are_refused(unit: str | None, said: str, wipes: str) -> None:
    """Both are told: the skills of the file, and those of the run."""
    config = EpisodeConfig(TASK, unit=unit, calibration=wipes)
    with pytest.raises(UserError, match=said):
        check_watched(config, [prepare(config)])


def test_one_task_whose_skills_have_thresholds_is_enough_for_a_suite(wipes: str, tmp_path: Path, mpvi: Shell) -> None:
    """The monitors of its other tasks only record; without such a task the suite is refused before it starts."""
    trash, trumpet = (EpisodeConfig(task, unit="monitored", calibration=wipes) for task in (TASK, "clean_a_trumpet"))
    check_watched(trash, [prepare(trash), prepare(trumpet)])
    suite = tmp_path / "suite.yaml"
    suite.write_text(f"methods: [expert]\ntasks: [{TASK}]\ninstances: [0]\n")
    asked = ["suite", "run", str(suite), "--unit", "monitored", "--calibration", wipes, "--out", str(tmp_path / "out")]
    result = mpvi(*asked)
    assert result.returncode == 2
    assert "skills that this run watches: pick, place_in" in result.stderr


def test_a_planner_that_takes_its_time_makes_the_robot_wait_first() -> None:
    """A wait before the first unit, as long as the answer takes."""
    first = prepare(EpisodeConfig(TASK, latency="planner=5")).spec.root.children[0]
    assert (first.kind, first.parameters.duration) == ("wait", 5.0)  # type: ignore[attr-defined]
    assert "wait" not in kinds(latency="policy=5")


def test_a_late_checker_says_the_same_later() -> None:
    """Its own latency and the one that it is given; the draws are those of the config's seed."""

    class Sure:
        name, needs_image = "sure", False

        def check(self, criterion: str, image: None) -> Judgement:
            return Judgement(True, "sure", latency_s=1.0)

    config = EpisodeConfig(TASK, latency="checker=1..2", seed=3)
    checker = LateChecker(Sure(), latency_of(config, "checker"))  # type: ignore[arg-type]
    first, second = checker.check("a", None), checker.check("a", None)
    assert first.complete
    assert 2.0 <= first.latency_s <= 3.0
    assert first.latency_s != second.latency_s
    assert first.latency_s - 1.0 == latency_of(config, "checker")(0)


def test_handoffs_are_read_back_from_results_and_only_of_one_policy(tmp_path: Path) -> None:
    """As they were watched; a folder with two policies or none is refused."""
    with pytest.raises(UserError, match="none of 0 results has handoffs"):
        read_handoffs(tmp_path)
    handoff = asdict(WatchedHandoff("pick", "t/monitor", 1.0, 3.0, "success", samples=[[0.0, 0.0, 1.5, 0.0]] * 4))
    result = {**RESULT, "handoffs": [handoff, {**handoff, "ended": "interrupted"}]}
    write_result(tmp_path / "a.json", result)
    found = read_handoffs(tmp_path)
    assert [w.ended for w in found.watched] == ["success", "interrupted"]
    assert [run.samples.tolist() for run in found.went_well] == [[[0.0, 0.0, 1.5, 0.0]] * 4]
    write_result(tmp_path / "b.json", {**result, "config": {**RESULT["config"], "policy": "openpi:ws://a:1"}})
    with pytest.raises(UserError, match="thresholds are of one policy on one robot"):
        read_handoffs(tmp_path)


def test_results_without_them_have_no_keys_for_faults_lateness_and_handoffs(tmp_path: Path) -> None:
    """So that files of runs that used none stay as they were."""
    write_result(tmp_path / "a.json", RESULT)
    assert not {"faults", "lateness", "handoffs"} & set(json.loads((tmp_path / "a.json").read_text()))
