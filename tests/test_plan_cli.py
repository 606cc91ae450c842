"""`mpvi plan`, and runs whose plan a language model makes, against servers that speak over HTTP."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.apps.cli.score import score
from mpvi_bt.executive.language.chat import Answer
from mpvi_bt.executive.plan.answer_form import answer_schema, answer_text
from mpvi_bt.executive.plan.finetuning import chats
from mpvi_bt.executive.plan.language_planner import REPAIRS, checked, read_answer
from mpvi_bt.executive.plan.plan_check import plan_problems
from mpvi_bt.executive.plan.planners import Planned, RecordedPlanner
from mpvi_bt.executive.plan.prompt import system_text, user_text
from mpvi_bt.executive.plan.schema import Plan, load_plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.planning import ground
from mpvi_bt.runs.episode.prepare import check_episode
from mpvi_bt.runs.episode.result import Planning
from mpvi_bt.runs.suite.worker import play
from tests.chat_servers import ChatServer, RealServer, completion, failure, free_port
from tests.fake_episodes import fake_result

SKILLS = load_skills()
TASK = load_task("picking_up_trash")
TRASH = load_plan(paths.find("tasks/plans", "picking_up_trash"))
GOOD = answer_text(TRASH)
ACTION = GOOD.replace("a can of soda is in the trash can", "the robot puts the can in the trash can")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder of its own, with no key."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)


def test_a_task_has_its_recorded_plan(capsys: pytest.CaptureFixture[str]) -> None:
    """It is printed as JSON that is a plan's file; for programs with the skills that post-processing finds."""
    assert run(["plan", "picking_up_trash"]) == 0
    assert Plan.model_validate_json(capsys.readouterr().out) == TRASH
    assert run(["plan", "picking_up_trash", "--json", "--out", "p.json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["planner"], told["planning"], told["out"]) == ("recorded", None, "p.json")
    assert told["primitives"][0] == {"segment": 1, "skill": "pick", "terminal": True}
    assert load_plan("p.json") == TRASH


def test_a_task_can_be_planned_by_a_model(scripted_chat_server: ChatServer, capsys: pytest.CaptureFixture[str]) -> None:
    """It is told the house, the skills and other tasks' plans, and the form of its answer; what it took is told."""
    scripted_chat_server.answers([completion(f"```json\n{GOOD}\n```", tokens=(900, 200))])
    planner = f"openai:m@{scripted_chat_server.url}"
    assert run(["plan", "picking_up_trash", "--planner", planner, "--json"]) == 0
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    assert Plan.model_validate(told["plan"]) == TRASH
    assert told["planning"] | {"latency_s": 0} == {
        "answers": 1, "latency_s": 0, "tokens_in": 900, "tokens_out": 200, "kept": 0,
    }  # fmt: skip
    assert printed.err == f"mpvi: asking {planner} for a plan\n"
    (request,) = scripted_chat_server.requests
    wanted = answer_schema(ground(TASK.house, TASK), "picking_up_trash")
    assert request["response_format"]["json_schema"]["schema"] == wanted
    system, *examples, question = [message["content"] for message in request["messages"]]
    assert system == system_text(SKILLS, ground(TASK.house, TASK))
    assert question == user_text(TASK.instruction)
    assert len(examples) == 4  # two examples, each a question and an answer
    assert GOOD not in examples


def test_a_server_without_schemas_is_asked_plainly(scripted_chat_server: ChatServer) -> None:
    """Where it knows neither a schema nor JSON, its chatty answer is read."""

    def answer(request: Any) -> Any:
        return (
            failure(400, "unknown response_format") if "response_format" in request else f"Sure: {GOOD} Anything else?"
        )

    scripted_chat_server.answers(answer)
    assert (
        run(["plan", "picking_up_trash", "--planner", f"openai:m@{scripted_chat_server.url}", "--out", "p.json"]) == 0
    )
    assert load_plan("p.json") == TRASH


def test_an_instruction_is_planned_in_a_house(scripted_chat_server: ChatServer) -> None:
    """Several words are an instruction; the house is told if it is named, and its rooms hold."""
    scripted_chat_server.answers([GOOD.replace("living room", "attic"), GOOD])
    planner = ["--planner", f"openai:m@{scripted_chat_server.url}"]
    assert run(["plan", "throw", "the", "cans", "away", *planner, "--house", "family_house", "--out", "p.json"]) == 0
    assert load_plan("p.json") == TRASH.model_copy(update={"instruction": "throw the cans away"})
    assert "unknown room 'attic'" in scripted_chat_server.requests[1]["messages"][-1]["content"]
    scripted_chat_server.answers([GOOD.replace("living room", "attic")])
    assert run(["plan", "throw the cans away", *planner, "--out", "p.json"]) == 0
    assert "kitchen" not in scripted_chat_server.requests[-1]["messages"][0]["content"]


def test_a_model_without_a_plan_ends_the_command(
    scripted_chat_server: ChatServer, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 3, a line, and a line for each problem; the last answer is in the file that the line names."""
    scripted_chat_server.answers([ACTION])
    planner = f"openai:m@{scripted_chat_server.url}"
    assert run(["plan", "picking_up_trash", "--planner", planner]) == 3
    printed = capsys.readouterr()
    assert printed.out == ""
    *asked, head, one, two, three = printed.err.splitlines()
    assert len(asked) == 4 == len(scripted_chat_server.requests)
    kept = re.fullmatch(r"mpvi: \S+ gave no valid plan in 4 answers; 3 problems in the last, which is in (\S+):", head)
    assert kept is not None
    assert Path(kept[1]).read_text() == ACTION
    assert all("[action-like-criterion]" in line for line in (one, two, three))


def test_a_plan_on_file_costs_nothing(scripted_chat_server: ChatServer, capsys: pytest.CaptureFixture[str]) -> None:
    """What was asked once is answered from its file, without a server, as often as one likes."""
    scripted_chat_server.answers([ACTION, GOOD])
    command = ["plan", "picking_up_trash", "--planner", f"openai:m@{scripted_chat_server.url}", "--exchanges", "kept"]
    assert run([*command, "--json"]) == 0
    live = json.loads(capsys.readouterr().out)
    scripted_chat_server.stop()
    assert run([*command, "--json", "--offline"]) == 0
    replayed = json.loads(capsys.readouterr().out)
    assert replayed["planning"].pop("kept") == 2 == live["planning"].pop("kept") + 2
    assert replayed == live


def test_a_budget_ends_the_asking(scripted_chat_server: ChatServer, capsys: pytest.CaptureFixture[str]) -> None:
    """Repairs count."""
    scripted_chat_server.answers([ACTION])
    assert run(["plan", "picking_up_trash", "--planner", f"openai:m@{scripted_chat_server.url}", "--calls", "2"]) == 3
    assert len(scripted_chat_server.requests) == 2
    assert "budget" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "code", "what"),
    [
        (["plan"], 2, "Missing argument"),
        (["plan", ""], 2, "Missing argument"),
        (["plan", "picking_up_trsh"], 2, "Did you mean 'picking_up_trash'?"),
        (["plan", "tidy up"], 2, "plans are recorded of tasks only"),
        (["plan", "picking_up_trash", "--house", "family_house"], 2, "--house is told to a model"),
        (["plan", "tidy up", "--planner", "openai"], 2, "say where, such as openai:MODEL[@URL]"),
        (["plan", "tidy up", "--planner", "opnai:x"], 2, "Did you mean 'openai'?"),
        (["plan", "tidy up", "--planner", "openai:x"], 3, "set OPENAI_API_KEY"),
        (["plan", "tidy up", "--planner", "openai:x@http://127.0.0.1:{port}/v1"], 3, "is not there"),
        (["plan", "tidy " * 20_000, "--planner", "openai:x@http://127.0.0.1:{port}/v1"], 2, "has 99999 characters"),
        (["plan", "tidy \x07 up", "--planner", "openai:x@http://127.0.0.1:{port}/v1"], 2, "unreadable character"),
        (["plan", "?! 42", "--planner", "openai:x@http://127.0.0.1:{port}/v1"], 2, "has no word in it"),
        (["plan", "tidy up", "--house", "castle", "--planner", "openai:x@http://127.0.0.1:{port}/v1"], 2, "castle"),
        (["plan", "--export", "/nowhere/x.jsonl"], 2, "cannot be written"),
    ],
)
def test_bad_input_is_told_in_a_line(
    words: list[str], code: int, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """With its exit code, before anything is asked."""
    port = free_port()
    assert run([word.replace("{port}", str(port)) for word in words]) == code
    printed = capsys.readouterr()
    *before, last = printed.err.splitlines()
    assert what in last
    assert len(last) < 400
    assert all(line.startswith("mpvi: asking") for line in before)


def test_a_dry_run_carries_a_models_plan_out(
    scripted_chat_server: ChatServer, capsys: pytest.CaptureFixture[str]
) -> None:
    """The plan is made first, and lies beside what the run writes."""
    scripted_chat_server.answers([GOOD])
    planner = f"openai:m@{scripted_chat_server.url}"
    assert run(["run", "picking_up_trash", "--dry", "--no-watch", "--no-trace", "--planner", planner]) in (0, 1)
    assert load_plan("runs/picking_up_trash_0_0.plan.json") == TRASH
    assert f"mpvi: asking {planner} for a plan" in capsys.readouterr().err


def test_a_run_without_a_plan_loads_no_simulator(scripted_chat_server: ChatServer, mpvi: Any) -> None:
    """It ends with 3, and the last answer lies where the run writes its outputs."""
    scripted_chat_server.answers(["No."])
    done = mpvi("run", "picking_up_trash", "--planner", f"openai:m@{scripted_chat_server.url}", "--out", "out")
    assert done.returncode == 3
    assert "setting up" not in done.stderr
    (kept,) = Path("out").iterdir()
    assert (kept.name, kept.read_text()) == ("picking_up_trash_0_0.plan.answer.txt", "No.")
    assert f"which is in {kept}" in done.stderr


def test_a_plan_by_file_is_refused_for_what_is_wrong_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    """Each with its line, before anything runs."""
    plan = json.loads(TRASH.to_json())
    plan["segments"][0]["room"] = "attic"
    plan["segments"][1]["completion_criterion"] = "pick up the trash can"
    Path("plan.json").write_text(json.dumps(plan, indent=1))
    assert run(["run", "picking_up_trash", "--plan", "plan.json"]) == 2
    said = capsys.readouterr().err
    assert re.search(r"plan\.json:\d+:\d+: unknown room 'attic'.*\[unknown-room\]", said)
    assert "[action-like-criterion]" in said


def test_a_suite_asks_nothing_before_its_episodes(scripted_chat_server: ChatServer) -> None:
    """What can be refused is; the model is asked by the episodes."""
    config = EpisodeConfig("picking_up_trash", planner=f"openai:m@{scripted_chat_server.url}")
    check_episode(config)
    assert scripted_chat_server.requests == []
    with pytest.raises(ModelError, match="OPENAI_API_KEY"):
        check_episode(replace(config, planner="openai:m"))


def _fails(config: EpisodeConfig) -> dict[str, Any]:
    raise ModelError(config.planner, "it gave\n  no plan")


def test_an_episode_without_a_plan_is_a_backends_fault() -> None:
    """Not a task failure; where no other episode could have a plan either, the suite ends."""
    for reason, hopeless in (("bad_answer", False), ("rate_limited", False), ("wrong_key", True)):
        fault = play(f"{__name__}:_fails", EpisodeConfig("picking_up_trash", planner=reason)).fault
        assert fault is not None
        assert (fault.message, fault.backend, fault.hopeless) == (f"{reason}: it gave no plan", reason, hopeless)
        assert fault.kind == "backend failure"


def test_a_result_says_what_its_plan_took() -> None:
    """Answers, times and tokens of all of them; nothing where no model was asked."""
    answers = (Answer("x", "m", 1.5, 100, 10, kept=True), Answer("y", "m", 2.0, 200, 20))
    assert Planning.of(Planned(TRASH)) is None
    assert Planning.of(None) is None
    took = Planning(answers=2, latency_s=3.5, tokens_in=300, tokens_out=30, kept=1)
    assert Planning.of(Planned(TRASH, answers)) == took
    told = fake_result(EpisodeConfig("picking_up_trash", planner="openai:m"))
    assert told["planning"] is None
    told["wall"] = {"total_s": 2.0, "setup_s": 1.0, "loop": {}}
    assert "by openai:m" not in score(told)
    text = score({**told, "planning": took.model_dump()})
    assert "\n  plan      by openai:m: 2 answers in 3.5 s, 330 tokens\n" in text


def test_exported_chats_are_the_plans_again(capsys: pytest.CaptureFixture[str]) -> None:
    """Every recorded plan is a line of the form that trainers read, and comes back from it as it was."""
    assert run(["plan", "--export", "all.jsonl"]) == 0
    lines = Path("all.jsonl").read_text(encoding="utf-8").splitlines()
    recorded = RecordedPlanner().all()
    assert len(lines) == len(recorded) == int(capsys.readouterr().err.split()[1])
    for line, plan in zip(lines, recorded, strict=True):
        chat = json.loads(line)
        assert list(chat) == ["messages"]
        assert [message["role"] for message in chat["messages"]] == ["system", "user", "assistant"]
        assert all(list(message) == ["role", "content"] for message in chat["messages"])
        _, question, answer = (message["content"] for message in chat["messages"])
        instruction = json.loads(question.removeprefix("Instruction: "))
        data, problems = read_answer(answer)
        assert problems == []
        assert checked(data, plan.task_name, instruction, SKILLS) == (plan, [])


def test_an_exported_chat_is_what_a_model_is_asked() -> None:
    """Without the examples: the same rules, house and question; a plan without an instruction teaches nothing."""
    place = ground(TASK.house)
    (line,) = chats([(TRASH, place), (TRASH.model_copy(update={"instruction": ""}), None)], SKILLS)
    said = {message["role"]: message["content"] for message in json.loads(line)["messages"]}
    assert said == {"system": system_text(SKILLS, place), "user": user_text(TRASH.instruction), "assistant": GOOD}


def test_the_tasks_named_are_exported(capsys: pytest.CaptureFixture[str]) -> None:
    """And no others; told to programs as JSON."""
    assert run(["plan", "picking_up_trash", "tidying_bedroom", "--export", "two.jsonl", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"out": "two.jsonl", "chats": 2}
    assert run(["plan", "picking_up_trsh", "--export", "two.jsonl"]) == 2


@pytest.mark.rare
@pytest.mark.slow
def test_a_real_server_with_a_random_model_gives_the_clear_failure(
    real_chat_server: RealServer, capsys: pytest.CaptureFixture[str]
) -> None:
    """Random weights say no plan: what they say is kept, and the command ends as it should, or with a sound plan."""
    planner = f"openai:{real_chat_server.talking}@{real_chat_server.url}"
    code = run(["plan", "picking_up_trash", "--planner", planner, "--out", "p.json"])
    said = capsys.readouterr().err
    if code == 0:
        assert [p for p in plan_problems(load_plan("p.json"), SKILLS) if p.severity == "error"] == []
        return
    assert code == 3
    assert "gave no valid plan in 4 answers" in said
    assert Path("p.answer.txt").is_file()


@pytest.mark.rare
@pytest.mark.slow
def test_an_episode_has_its_plan_beside_its_result(
    scripted_chat_server: ChatServer, capsys: pytest.CaptureFixture[str]
) -> None:
    """The model is asked before the simulator loads, again while its plan misses the goal; the result counts that."""
    scripted_chat_server.answers([answer_text(TRASH.model_copy(update={"segments": TRASH.segments[:1]}))])
    choices = ["--planner", f"openai:m@{scripted_chat_server.url}", "--detector", "oracle", "--checker", "oracle"]
    assert run(["run", "picking_up_trash", *choices, "--no-watch", "--no-trace", "--out", "out", "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["ended"] == "success"
    assert result["planning"]["answers"] == 1 + REPAIRS == len(scripted_chat_server.requests)
    assert result["planning"]["tokens_in"] > 0
    assert len(load_plan("out/picking_up_trash_0_0.plan.json").segments) == 1
