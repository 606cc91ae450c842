"""The tasks as a benchmark of the published vla-eval package, and our policies as its model server."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("vla_eval", reason="needs the extra vla-eval")

import vla_eval
from vla_eval.model_servers.base import SessionContext
from vla_eval.model_servers.behavior1k_baseline import Behavior1KBaselineModelServer
from vla_eval.specs import check_specs

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.remote.dialect_settings import load_settings
from mpvi_bt.executive.remote.observation import write_observation
from mpvi_bt.executive.remote.relay import Relay, Stopped
from mpvi_bt.executive.remote.server import Refused
from mpvi_bt.executive.remote.vla_eval import VlaEvalPolicy
from mpvi_bt.executive.ticking.loop import Last, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_instruction
from mpvi_bt.ground.errors import BackendError, PolicyError, UnknownName, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_rows import command_of
from mpvi_bt.hands.policies.demonstrated import DemonstratedPolicy
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import PolicyInputs, demonstrations, make_policy
from mpvi_bt.runs.serving.vla_eval_benchmark import MpviBenchmark
from mpvi_bt.runs.serving.vla_eval_server import MpviModelServer
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.layouts import ACTION_SIZE, BASE
from tests.serving import observation
from tests.vla_eval_server import Model, model_server

ROOT = Path(__file__).parent.parent
TASK = "picking_up_trash"
SECONDS = 0.5  # of simulated time that episodes have here
WHOLE, MAPPED = load_settings("mpvi"), load_settings("vla_eval")


# --- the relay


def asking(relay: Relay, seen: dict[str, Any], results: list[Any]) -> Thread:
    """A thread that asks once, as an episode's does, and keeps what comes of it."""

    def ask() -> None:
        try:
            results.append(relay.infer(seen))
        except Stopped as stopped:
            results.append(stopped)

    thread = Thread(target=ask)
    thread.start()
    return thread


def test_a_question_waits_for_its_answer() -> None:
    """What the other thread gives is what the episode gets, in our order and units."""
    relay, results = Relay("runner", MAPPED), list[Any]()
    thread = asking(relay, observation("pick up the cup", size=224, robot="r1pro"), results)
    message = relay.asked()
    assert message is not None
    assert message["task_description"] == "pick up the cup"
    actions = np.tile(np.arange(ACTION_SIZE) / 100, (3, 1))
    relay.answer({"actions": actions, "note": "reaching\nfor it", "gave_up": True})
    thread.join(10)
    (chunk,) = results
    np.testing.assert_allclose(chunk[:, 3:], actions[:, 3:])
    np.testing.assert_allclose(chunk[0, BASE], actions[0, :3] * [0.75, 0.75, 1.0])
    assert relay.note == "reaching for it"
    assert relay.gave_up


@pytest.mark.parametrize(("first", "begins"), [(None, ("head", "left", "right")), ([], ()), (["head"], ("head",))])
def test_an_answer_says_which_pictures_come_next(first: list[str] | None, begins: tuple[str, ...]) -> None:
    """Others are not asked for, until the policy begins anew."""
    relay = Relay("runner", WHOLE, first)
    assert relay.cameras == begins
    thread = asking(relay, observation(), [])
    relay.asked()
    relay.answer({"actions": np.zeros((1, ACTION_SIZE)), "cameras": ["left"]})
    thread.join(10)
    assert relay.cameras == ("left",)
    relay.reset()
    assert relay.cameras == begins


def test_a_bad_answer_leaves_the_question_open() -> None:
    """It is refused with its reason, and a good one may follow."""
    relay, results = Relay("runner", WHOLE), list[Any]()
    thread = asking(relay, observation(), results)
    relay.asked()
    for bad in ({}, {"actions": np.zeros((1, 7))}, {"actions": np.full((1, ACTION_SIZE), np.nan)}):
        with pytest.raises(PolicyError) as failed:
            relay.answer(bad)
        assert failed.value.reason == "bad_reply"
    assert not results
    relay.answer({"actions": np.zeros(ACTION_SIZE)})
    thread.join(10)
    assert results[0].shape == (1, ACTION_SIZE)


def test_where_no_answer_has_come_the_robot_holds() -> None:
    """The base stands; joints stay, or go on to where the last answer told them to. A handoff forgets that answer."""
    relay, results = Relay("runner", WHOLE), list[Any]()
    seen, told = observation(), np.tile(np.arange(1.0, ACTION_SIZE + 1), (2, 1))
    told[1] += 0.5
    for k, reply in enumerate((None, told, None, None)):
        if k == 3:
            relay.reset()
        thread = asking(relay, seen, results)
        relay.asked()
        if reply is None:
            relay.hold()
        else:
            relay.answer({"actions": reply})
        thread.join(10)
    first, _, later, anew = results
    at_rest = command_of(seen["proprioception"])[None]
    np.testing.assert_array_equal(first, at_rest)
    np.testing.assert_array_equal(later, [[0.0, 0.0, 0.0, *told[1, 3:]]])
    np.testing.assert_array_equal(anew, at_rest)


def test_who_waits_for_an_answer_is_told_that_none_will_come() -> None:
    """The episode then ends as by Ctrl-C."""
    relay, results = Relay("runner", WHOLE), list[Any]()
    thread = asking(relay, observation(), results)
    relay.asked()
    relay.stop()
    thread.join(10)
    assert isinstance(results[0], KeyboardInterrupt)


# --- the package's own runner, on episodes without a simulator


class Played:
    """Stands for `episode.episode.run`: half a second of a robot that does what it is told, and what it did."""

    def __init__(self, breaks: Callable[[EpisodeConfig], bool] = lambda config: False) -> None:
        self.breaks = breaks
        self.configs: list[EpisodeConfig] = []
        self.cameras: list[tuple[str, ...]] = []
        self.commands: list[Array] = []

    def __call__(self, config: EpisodeConfig, make: Callable[[PolicyInputs], Any]) -> dict[str, Any]:
        self.configs.append(config)
        if self.breaks(config):
            raise BackendError("the machine broke")
        skills, world, last = load_skills(), KinematicWorld(), Last()
        context = scripted_context(world, skills, {}, {})
        context.policy = make(PolicyInputs(skills, {"cup_1": ("cup",)}))
        self.cameras.append(context.policy.cameras)
        spec = compile_instruction(config.task_name, "Tidy up.")
        with contextlib.suppress(KeyboardInterrupt):
            run_episode(Tree(spec), world, context, [last, Commands(self.commands)], SECONDS)
        done = last.outcome.ending == "time_limit"
        return {
            "success": done,
            "q_score": {"final": float(done)},
            "goal_fraction": float(done),
            "conditions_met": float(done),
            "goal": [{"condition": "tidy", "satisfied": done}],
            "time": {"simulator_time": world.time_s},
            "steps": world.steps,
            "ended": last.outcome.ending,
            "failures": [],
        }


class Commands(Last):
    """Keeps what the robot is told at each step."""

    def __init__(self, kept: list[Array]) -> None:
        self._kept = kept

    def step(self, tree: Tree, world: Any) -> None:
        self._kept.append(world.robot.action)


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Played:
    stub = Played()
    monkeypatch.setattr("mpvi_bt.runs.episode.episode.run", stub)
    return stub


def runs(address: str, params: dict[str, Any] | None = None, **entry: Any) -> dict[str, Any]:
    """What the package's runner makes of an entry of its config."""
    benchmark = {
        "benchmark": "mpvi_bt.runs.serving.vla_eval_benchmark:MpviBenchmark",
        "name": "mpvi",
        "params": {"tasks": [TASK], "seed": 0, **(params or {})},
        **entry,
    }
    (result,) = vla_eval.run(
        {"server": {"url": f"ws://{address}"}, "benchmarks": [benchmark]}, no_save=True, docker=False
    )
    return dict(result)


def test_its_runner_plays_our_episodes(played: Played) -> None:
    """Each of as many as it is told, the task's instances in order; their figures are in its result."""
    with model_server(model := Model(horizon=4)) as address:
        result = runs(address, episodes_per_task=2)
    assert (result["mean_success"], result["mean_q"], result["num_errors"]) == (1.0, 1.0, 0)
    episodes = result["tasks"][0]["episodes"]
    assert [episode["metrics"]["conditions"] for episode in episodes] == [{"tidy": True}] * 2
    assert [episode["metrics"]["simulated_s"] for episode in episodes] == [SECONDS] * 2
    assert [config.instance for config in played.configs] == [0, 1]
    assert [episode["task"]["name"] for episode in model.episodes] == [TASK] * 2
    assert model.seen[0]["task_description"] == "Tidy up."


def test_a_chunk_is_carried_out_whole(played: Played) -> None:
    """One action a step, in order, before the next observation is sent."""
    with model_server(model := Model(horizon=5)) as address:
        runs(address)
    steps = round(SECONDS * 30)
    assert len(model.seen) == -(-(steps + 1) // 5)  # at the end it is asked, too, and what it says is not carried out
    lateral = [command[1] for command in played.commands[:steps]]
    np.testing.assert_allclose(lateral, [0.75 * (k % 5) / 100 for k in range(steps)], atol=1e-6)


def test_its_limit_of_observations_ends_an_episode(played: Played) -> None:
    """It counts as interrupted, and is judged as it stands."""
    with model_server(Model(horizon=4)) as address:
        result = runs(address, max_steps=2)
    (episode,) = result["tasks"][0]["episodes"]
    assert (episode["steps"], episode["metrics"]["ended"]) == (2, "interrupted")
    assert episode["metrics"]["control_steps"] == 8


def test_its_live_mode_goes_on_while_the_model_thinks(played: Played) -> None:
    """The robot stands for the steps between two answers, and is told each answer once."""
    thinking = Model(horizon=1)
    predict = thinking.predict

    def slowly(obs: dict[str, Any], ctx: Any) -> dict[str, Any]:
        time.sleep(0.1)
        return predict(obs, ctx) | {"actions": np.full((1, ACTION_SIZE), 0.1)}

    thinking.predict = slowly  # type: ignore[method-assign]
    with model_server(thinking) as address:
        result = runs(address, mode="live", hz=30)
    (episode,) = result["tasks"][0]["episodes"]
    assert episode["metrics"]["simulated_s"] == SECONDS
    driven = [bool(command[0]) for command in played.commands]
    assert 0 < sum(driven) < len(driven) / 2
    assert not any(here and there for here, there in itertools.pairwise(driven))


def test_an_episode_that_breaks_is_told_and_the_next_is_played(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine's fault is an error in the runner's result, with what broke; it is not the next episode's."""
    monkeypatch.setattr("mpvi_bt.runs.episode.episode.run", Played(lambda config: config.instance == 0))
    with model_server(Model()) as address:
        result = runs(address, episodes_per_task=2)
    broken, fine = result["tasks"][0]["episodes"]
    assert "the machine broke" in broken["failure_detail"]
    assert fine["metrics"]["success"]


def test_a_bad_answer_ends_its_episode_alone(played: Played) -> None:
    """Actions of another robot are an error that says so; the next episode begins with a policy that begins anew."""
    seven = Model(action_spec={})
    seven.predict = lambda obs, ctx: {"actions": np.zeros((1, 7 if len(seven.episodes) == 1 else 23))}  # type: ignore[method-assign]
    with model_server(seven) as address:
        result = runs(address, episodes_per_task=2)
    bad, good = result["tasks"][0]["episodes"]
    assert "actions of shape (1, 7)" in bad["failure_detail"]
    assert good["metrics"]["success"]


def test_instances_can_be_chosen(played: Played) -> None:
    """Episodes go through them in turn."""
    with model_server(Model(horizon=30)) as address:
        runs(address, {"instances": [7, 3]}, episodes_per_task=3)
    assert [config.instance for config in played.configs] == [7, 3, 7]


def test_our_server_chooses_what_it_is_sent(played: Played) -> None:
    """The whole observation, with the pictures that its policy wants: no config has to say it."""
    with model_server(MpviModelServer()) as address:
        result = runs(address)
    assert result["mean_success"] == 1.0
    assert played.configs[0].policy_settings == "mpvi"
    assert played.cameras == [()]


@pytest.mark.parametrize(
    ("params", "error", "said"),
    [
        ({"tasks": ["picking_up_trsh"]}, UnknownName, TASK),
        ({"tasks": TASK}, UserError, "a list"),
        ({"tasks": []}, UserError, "a list"),
        ({"tasks": [TASK], "instances": [10]}, UserError, "instances 0 to 9"),
        ({"instances": 3}, UserError, "a list"),
        ({"instances": ["3"]}, UserError, "a list"),
        ({"method": "e2"}, UnknownName, "e2e"),
        ({"cameras": ["heat"]}, UnknownName, "head"),
        ({"policy_settings": "vla_evil"}, UnknownName, "vla_eval"),
    ],
)
def test_what_does_not_exist_is_refused_before_any_episode(
    params: dict[str, Any], error: type[Exception], said: str
) -> None:
    """With what would be valid."""
    with pytest.raises(error, match=said):
        MpviBenchmark(**params)


def test_all_tasks_are_there() -> None:
    """By name, with as many observations as the longest of them can take."""
    benchmark = MpviBenchmark()
    names = {task["name"] for task in benchmark.get_tasks()}
    assert {path.stem for path in (ROOT / "tasks").glob("*.yaml")} <= names
    assert benchmark.get_metadata()["max_steps"] > 30 * 1000


def test_formats_are_declared_for_its_check() -> None:
    """Its check passes its own servers for BEHAVIOR's robot, and ours; and finds what does not fit."""
    theirs, ours = Behavior1KBaselineModelServer(), MpviModelServer()
    for server, settings in ((theirs, "vla_eval"), (ours, "mpvi")):
        benchmark = MpviBenchmark(tasks=[TASK], policy_settings=settings)
        specs = benchmark.get_action_spec(), server.get_observation_spec(), benchmark.get_observation_spec()
        assert not check_specs(server.get_action_spec(), *specs)
        other = ours if server is theirs else theirs
        assert check_specs(other.get_action_spec(), *specs)
    assert sum(part.dims for part in ours.get_action_spec().values()) == ACTION_SIZE


def test_its_renderer_is_chosen_before_the_simulator_loads() -> None:
    """The class can be looked at without SAPIEN, which takes the first renderer that it finds for good."""
    code = """
import sys
from mpvi_bt.runs.serving.vla_eval_benchmark import MpviBenchmark
MpviBenchmark(tasks=["picking_up_trash"])
assert MpviBenchmark.render_backends == {"cpu", "gpu"}
assert MpviBenchmark.configure_render("gpu") == {}
print("sapien" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]


def test_the_page_tells_every_parameter() -> None:
    """It has the example's config as it is, and a row for each argument of the benchmark."""
    page = (ROOT / "docs" / "vla_eval.md").read_text(encoding="utf-8")
    block = page.partition("```yaml")[2].partition("```")[0]
    assert yaml.safe_load(block) == yaml.safe_load((ROOT / "examples" / "vla_eval.yaml").read_text(encoding="utf-8"))
    table = page.partition("| `params` |")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, flags=re.MULTILINE) == list(signature(MpviBenchmark).parameters)


# --- our model server


def test_our_server_answers_as_the_policy_does() -> None:
    """Over the package's connection every action is what it is in process, bit by bit, for several clients at once."""
    instruction = next(iter(demonstrations()))
    ground = PolicyInputs(load_skills(), {"cup.n.01_1": ["cup"]}, seed=3, demonstrations=demonstrations())
    here = make_policy("reactive", ground)
    assert isinstance(here, DemonstratedPolicy)
    with model_server(MpviModelServer("reactive", seed=3)) as address:
        there = [VlaEvalPolicy(address, "mpvi", ground.vocabulary) for _ in range(2)]
        here.reset()
        for policy in there:
            policy.reset()
        for seed, told in enumerate([instruction] * 5 + ["pick up the cup"] * 3):
            seen = observation(told, seed=seed)
            chunk = here.infer(seen)
            for policy in there:
                assert policy.cameras == here.cameras
                np.testing.assert_array_equal(policy.infer(seen), chunk)
                assert policy.note == here.note
        for policy in there:
            policy.close()


def test_our_server_says_what_is_wrong_with_an_observation() -> None:
    """And goes on serving."""
    with model_server(MpviModelServer()) as address:
        policy = VlaEvalPolicy(address, "vla_eval")  # which is not what this server reads
        policy.reset()
        with pytest.raises(PolicyError, match="bad_message"):
            policy.infer(observation(size=224))
        policy = VlaEvalPolicy(address, "mpvi")
        policy.reset()
        assert policy.infer(observation()).shape[1] == ACTION_SIZE
        policy.close()


@pytest.mark.parametrize("live", [True, False])
def test_our_server_waits_for_pictures_where_observations_do_not_wait_for_it(live: bool) -> None:
    """In live mode one may be under way that was sent before the policy asked for pictures; else that is an error."""
    server, answers = MpviModelServer(), list[dict[str, Any]]()
    wants = SimpleNamespace(name="wants", cameras=("head",), reset=lambda: None)
    wants.infer = lambda seen: np.zeros((1, ACTION_SIZE))
    server._make = lambda vocabulary: wants
    context = SessionContext("session", "episode")

    async def keep(answer: dict[str, Any]) -> None:
        answers.append(answer)

    context._send_action_fn = keep
    blind = write_observation({**observation(), "images": {}})

    async def talk() -> None:
        await server.on_episode_start({"mode": "live"} if live else {}, context)
        with contextlib.nullcontext() if live else pytest.raises(Refused, match="head is missing"):
            await server.on_observation(blind, context)
        assert not answers
        await server.on_observation(write_observation(observation()), context)
        await server.on_episode_end({}, context)

    asyncio.run(talk())
    assert len(answers) == 1


@pytest.mark.rare
@pytest.mark.slow
def test_its_own_command_starts_our_server(tmp_path: Path) -> None:
    """With the example's config; `uv run SCRIPT` stands for what uv does outside of a project."""
    uv = tmp_path / "uv"
    uv.write_text(f'#!/bin/sh\nshift\nexec {sys.executable} "$@"\n')
    uv.chmod(0o755)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    command = [str(Path(sys.executable).with_name("vla-eval")), "serve", "--address", address, "--arg", "seed=3"]
    with subprocess.Popen(
        [*command, "--config", "examples/vla_eval_server.yaml"],
        cwd=ROOT,
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        start_new_session=True,
    ) as process:
        try:
            policy = VlaEvalPolicy(address, "mpvi")
            policy.reset()
            assert policy.infer(observation()).shape[1] == ACTION_SIZE
            policy.close()
        finally:
            os.killpg(process.pid, signal.SIGTERM)


def test_a_policy_that_reads_the_simulator_cannot_be_served() -> None:
    """It is refused when the server is made."""
    with pytest.raises(UserError, match="reads the simulator"):
        MpviModelServer("expert")


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("method", ["e2e", "mpvi"])
def test_its_command_line_gives_what_ours_gives(method: str, tmp_path: Path) -> None:
    """Twenty seconds of `vla-eval run` with our server, and of `mpvi run` in process and with that server.

    Be it the policy that does everything or a tree that asks it for some of it, results agree in all but who was asked
    and how long it took.
    """
    (tmp_path / "tasks").mkdir()
    short = (ROOT / "tasks" / f"{TASK}.yaml").read_text() + "\ntime_budget_s: 20\n"
    (tmp_path / "tasks" / "short_trash.yaml").write_text(short)
    config = yaml.safe_load((ROOT / "examples" / "vla_eval.yaml").read_text())
    config["benchmarks"][0]["params"] |= {"tasks": ["short_trash"], "method": method, "out": "theirs"}
    with model_server(MpviModelServer()) as address:
        config["server"]["url"] = f"ws://{address}"
        (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
        mpvi = [
            sys.executable,
            "-m",
            "mpvi_bt.apps.cli",
            "run",
            "short_trash",
            "--method",
            method,
            "--no-watch",
            "--out",
        ]
        remote = ["--policy", f"vla_eval:{address}", "--policy-settings", "mpvi"]
        for command in (
            [str(Path(sys.executable).with_name("vla-eval")), "run", "--config", "config.yaml"],
            [*mpvi, "ours"],
            [*mpvi, "remote", *remote],
        ):
            environment = {**os.environ, "MPVI_PATH": str(tmp_path)}
            done = subprocess.run(
                command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=600
            )
            assert done.returncode in (0, 1), done.stderr  # 1: the goal is not reached in so short a time
    results = []
    for folder in ("theirs", "ours", "remote"):
        result = json.loads((tmp_path / folder / "short_trash_0_0.json").read_text())
        for entry in ("policy", "policy_settings"):
            result["config"].pop(entry, None)
        result["eyes"].pop("policy", None)
        # The digest is of who was asked, too.
        results.append({key: value for key, value in result.items() if key not in ("wall", "digest")})
    assert results[0] == results[1] == results[2]
    assert results[0]["agent_distance"]["left"] > 1.0  # it turned and reached
    told = json.loads((tmp_path / "results" / "mpvi_aggregate.json").read_text())
    assert told["mean_q"] == results[0]["q_score"]["final"]
    assert told["tasks"][0]["episodes"][0]["metrics"]["control_steps"] == results[0]["steps"]
