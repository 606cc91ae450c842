"""Who rehearses plans: `mpvi check`, `mpvi plan`, agents, and models that are told what is impossible."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from mpvi_bt import check
from mpvi_bt.apps.cli.check import check as check_command
from mpvi_bt.apps.cli.plan import plan as plan_command
from mpvi_bt.apps.cli.run import run as run_command
from mpvi_bt.apps.mcp_server.run_processes import RunProcesses
from mpvi_bt.apps.mcp_server.tools import Tools
from mpvi_bt.executive.language.chat import ChatModel
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
from mpvi_bt.executive.plan.answer_form import answer_text
from mpvi_bt.executive.plan.history import History, SeenObject, Unit
from mpvi_bt.executive.plan.language_planner import REPAIRS, LanguagePlanner
from mpvi_bt.executive.plan.planners import NoPlan
from mpvi_bt.executive.plan.schema import Plan, load_plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground import paths
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.language_models import Models
from mpvi_bt.runs.choices.planning import make_planner
from mpvi_bt.runs.choices.rehearsing import make_rehearsal

SKILLS = load_skills()
GOOD = load_plan(paths.find("tasks/plans", "bringing_water"))
REHEARSE = make_rehearsal(SKILLS, load_task("bringing_water")).problems


def without(*gone: int) -> Plan:
    """The plan of bringing_water without some segments."""
    return GOOD.model_copy(update={"segments": tuple(s for i, s in enumerate(GOOD.segments) if i not in gone)})


SHUT = without(1)  # nobody opens the fridge
LEFT_OPEN = without(7, 8)  # nobody closes it, which the goal wants


def test_check_fails_a_plan_that_is_impossible(tmp_path: Path) -> None:
    """With the facts of the task that the plan is of, in the line of its segment; the exit code is 1."""
    path = tmp_path / "p.json"
    path.write_text(SHUT.to_json())
    (problem,) = check(path)
    assert (problem.code, problem.pointer) == ("impossible", "/segments/1/description")
    line = path.read_text().splitlines()[problem.line - 1]
    assert line[problem.column - 1 :].startswith('"pick up a bottle from the fridge with the left hand"')
    result = CliRunner().invoke(check_command, [str(path)], standalone_mode=False)
    assert (result.return_value, "fridge is closed" in result.stdout) == (1, True)


def test_check_tells_what_of_the_goal_is_missing(tmp_path: Path) -> None:
    """A task that is named replaces the one that the plan's own name means."""
    path = tmp_path / "p.json"
    path.write_text(LEFT_OPEN.model_copy(update={"task_name": "mine"}).to_json())
    assert check(path) == []
    (problem,) = check(path, task="bringing_water")
    assert problem.code == "goal-unmet"
    assert problem.message.endswith("at its end the fridge is open"), "in the words of the plan"


def test_a_plan_of_another_instruction_is_not_held_to_the_goal(tmp_path: Path) -> None:
    """A name alone does not say what a plan is for."""
    path = tmp_path / "p.json"
    path.write_text(LEFT_OPEN.model_copy(update={"instruction": "Bring me two bottles."}).to_json())
    assert check(path) == []


def test_mpvi_plan_tells_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A recorded plan is written, and what its rehearsal finds goes to stderr."""
    folder = tmp_path / "tasks" / "plans"
    folder.mkdir(parents=True)
    (folder / "bringing_water.json").write_text(SHUT.to_json())
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    result = CliRunner().invoke(plan_command, ["bringing_water"], standalone_mode=False)
    assert json.loads(result.stdout)["task_name"] == "bringing_water"
    assert "fridge is closed" in result.stderr


def test_a_run_tells_it_and_goes_on(tmp_path: Path) -> None:
    """Of a plan that is given, once, before the run begins; the plan on file gives no such line."""
    path = tmp_path / "p.json"
    for plan, told in ((SHUT, 1), (GOOD, 0)):
        path.write_text(plan.to_json())
        result = CliRunner().invoke(run_command, ["--dry", "--plan", str(path), "--out", str(tmp_path)])
        assert result.stderr.count("the fridge is closed, and the bottle is in it") == told
        assert result.exit_code == 0


def test_agents_are_told(tmp_path: Path) -> None:
    """A plan that is impossible is not ok; one that only leaves the goal unmet is."""
    tools = Tools(RunProcesses(tmp_path))
    checked = tools.check(plan=SHUT.to_json())
    assert (checked.ok, [p.code for p in checked.problems]) == (False, ["impossible"])
    checked = tools.check(plan=LEFT_OPEN.to_json())
    assert (checked.ok, [p.code for p in checked.problems]) == (True, ["goal-unmet"])


def asked(*plans: Plan) -> tuple[LanguagePlanner, ScriptedChatModel]:
    model = ScriptedChatModel([answer_text(plan) for plan in plans])
    return LanguagePlanner(model, SKILLS, rehearse=REHEARSE), model


def test_a_model_gets_these_messages() -> None:
    """It is told what is impossible and then what is missing, each time, until its plan reaches the goal."""
    planner, model = asked(SHUT, LEFT_OPEN, GOOD)
    planned = planner.ask("bringing_water", GOOD.instruction)
    assert (planned.plan, planned.doubts, len(planned.answers)) == (GOOD, (), 3)
    (first,) = REHEARSE(SHUT)
    assert first.message in model.asked[1][0][-1].text
    (second,) = REHEARSE(LEFT_OPEN)
    assert second.message in model.asked[2][0][-1].text


def test_a_plan_that_stays_impossible_is_used_with_a_doubt() -> None:
    """The attempts are counted; what can be done of it is done."""
    planner, _ = asked(*[SHUT] * (REPAIRS + 1))
    planned = planner.ask("bringing_water", GOOD.instruction)
    assert (len(planned.answers), [p.code for p in planned.doubts]) == (REPAIRS + 1, ["impossible"])


def test_amid_an_episode_it_is_refused_with_the_reason() -> None:
    """With `--on-failure replan` the old plan goes on then, and the run's log says why: by what the hands hold now."""
    history = History((Unit("x", "timeout"),), (), (SeenObject("cup", held=True), SeenObject("can", held=True)))
    model = ScriptedChatModel([answer_text(GOOD)] * (REPAIRS + 1))

    class Scripted(Models):
        def make(self, given: str, tell: Callable[[str], None] = lambda line: None) -> ChatModel:
            return model

    config = EpisodeConfig(task="bringing_water", planner="openai:any", on_failure="replan")
    planner = make_planner(config, load_task("bringing_water"), Scripted(config))
    with pytest.raises(NoPlan, match="a hand has to be free") as refused:
        planner.ask("bringing_water", GOOD.instruction, history)
    assert (refused.value.reason, len(refused.value.answers)) == ("bad_answer", REPAIRS + 1)
