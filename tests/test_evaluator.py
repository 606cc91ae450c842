"""The stand-in for BEHAVIOR's evaluator: what it sends, in which order, and what it makes of answers."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from click.testing import CliRunner
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from mpvi_bt.apps.cli.evaluate_server import evaluate as command
from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.ground.errors import PolicyError, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.serving.evaluator import Evaluation, evaluate
from mpvi_bt.runs.serving.served import ServedWork, executive_server
from tests.driven import Acts, Ear
from tests.layouts import LAYOUT
from tests.serving import running

TASK = "picking_up_trash"
START = np.concatenate([np.zeros(3), [1.025, -1.45, -0.47, 0.0], np.zeros(7), [1.0], np.zeros(7), [1.0]])


@contextmanager
def scripted(answer: Callable[[dict[str, Any], int], Any]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """A server as plain as those of the challenge; its address, and what it was sent."""
    heard: list[dict[str, Any]] = []

    def talk(connection: ServerConnection) -> None:
        connection.send(pack({}))
        for frame in connection:
            assert isinstance(frame, bytes)
            heard.append(unpack(frame))
            if "reset" not in heard[-1]:
                told = answer(heard[-1], len(heard))
                connection.send(told if isinstance(told, str) else pack(told))

    def healthy(connection: ServerConnection, request: Request) -> Response | None:
        return connection.respond(200, "OK\n") if request.path == "/healthz" else None

    with serve(talk, "127.0.0.1", 0, compression=None, max_size=None, process_request=healthy) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"127.0.0.1:{server.socket.getsockname()[1]}", heard
        server.shutdown()
        thread.join()


def _still(message: dict[str, Any], count: int) -> dict[str, Any]:
    """Stand, in whichever shape is asked for."""
    batched = message["robot_r1::proprio"].ndim == 2
    chunk = np.tile(START.astype(np.float32), (message.get("__action_chunk_size__", 1), 1))
    chunk = chunk[None] if batched else chunk
    more = {"action_chunk": chunk} if "__action_chunk_size__" in message else {}
    return {"action": chunk[..., 0, :], **more}


@pytest.mark.slow
@pytest.mark.render
def test_it_goes_on_as_the_evaluators_do(tmp_path: Path) -> None:
    """Resets, shapes of what is sent, replayed chunks and results, of 2025 and 2026, from the same start."""
    with scripted(_still) as (address, heard):
        (first,) = evaluate(Evaluation(address, "behavior-2025", TASK, max_steps=2, out=tmp_path), Ear())
        resets = [list(message) == ["reset"] for message in heard]
        assert resets == [True, True, True, False, False]
        assert "mpvi::names" not in heard[-1]
        old = heard[-1]
        assert old["robot_r1::proprio"].shape == (256,)
        assert old["robot_r1::robot_r1:zed_link:Camera:0::rgb"].shape == (320, 320, 4)
        heard.clear()
        session = Evaluation(address, "behavior-2026", TASK, batched=True, chunk=4, max_steps=10, out=tmp_path)
        ear = Ear()
        (second,) = evaluate(session, ear)
        assert [list(message) == ["reset"] for message in heard] == [True, False, False, False]
        assert heard[1]["robot_r1::proprio"].shape == (1, 61)
        assert heard[1]["task_id"].tolist() == [[1]]
        np.testing.assert_allclose(heard[1]["robot_r1::cam_rel_poses"][0], old["robot_r1::cam_rel_poses"], atol=1e-3)
        np.testing.assert_allclose(heard[1]["robot_r1::proprio"][0, 53:57], START[LAYOUT.torso], atol=1e-2)
        assert len(ear.actions) == 10
    told = json.loads((tmp_path / "metrics" / f"{TASK}_0_0.json").read_text())
    assert told == first.result
    assert set(told) == {"q_score", "agent_distance", "normalized_agent_distance", "time"}
    told = json.loads((tmp_path / "json" / f"{TASK}_0_0.json").read_text())
    assert told == second.result
    assert (told["steps"], told["success"], told["q_score"]) == (10, False, {"final": 0.0})


@pytest.mark.slow
@pytest.mark.render
def test_the_executive_does_behind_a_socket_what_it_does_here() -> None:
    """Action by action: to the bit in our own keys, to the rounding of float32 in the evaluator's.

    The map is built online in both, and reactive acts. Long episodes in the evaluator's keys part in the end: what is
    rounded goes into searches.
    """
    steps = 150
    config = EpisodeConfig("", policy="reactive", map="online", robot="r1pro")
    here = Acts(steps)
    run(EpisodeConfig(TASK, policy="reactive", map="online", robot="r1pro"), [here])
    assert np.ptp(here.actions, axis=0).any()
    within: dict[Literal["openpi", "behavior-2025"], float] = {"openpi": 0.0, "behavior-2025": 1e-3}
    for dialect, tolerance in within.items():
        ear = Ear()
        with running(executive_server(dialect, ServedWork(config))) as server:
            address = f"127.0.0.1:{server.port}"
            evaluate(
                Evaluation(address, dialect, TASK, labels=True, on_demand=True, max_steps=steps),
                ear,
            )
        np.testing.assert_allclose(ear.actions, here.actions, rtol=0, atol=tolerance)


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize(("task", "robot"), [(TASK, "r1"), ("turning_on_radio", "r1pro")])
def test_a_whole_episode_behind_a_socket_is_that_of_run(task: str, robot: Literal["r1", "r1pro"]) -> None:
    """All of it, in our own keys: every action to the bit, up to where one of them ends, and the score."""
    here, ear = Acts(), Ear()
    result = run(EpisodeConfig(task, policy="reactive", map="online", robot=robot), [here])
    config = EpisodeConfig("", policy="reactive", map="online", robot=robot)
    with running(executive_server("openpi", ServedWork(config))) as server:
        address = f"127.0.0.1:{server.port}"
        (rollout,) = evaluate(Evaluation(address, "openpi", task, robot=robot, labels=True, on_demand=True), ear)
    assert rollout.goal.q == result["q_score"]["final"]
    both = min(len(ear.actions), len(here.actions))  # the evaluator ends once the goal is true, or goes on to its limit
    assert both > 500
    np.testing.assert_array_equal(ear.actions[:both], here.actions[:both])


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"task": "picking_up_trsh"}, "picking_up_trash"),
        ({"instances": (99,)}, "instance 99 is out of range"),
        ({"chunk": 8}, "one action at a time"),
        ({"robot": "r1"}, "choose --robot r1pro"),
    ],
)
def test_what_cannot_be_evaluated_is_told_at_once(given: dict[str, Any], why: str) -> None:
    """Before a server is looked for."""
    with pytest.raises(UserError, match=why):
        evaluate(Evaluation(**{"address": "127.0.0.1:9", "dialect": "behavior-2025", "task": TASK, **given}), Ear())


def test_a_server_that_is_not_there_is_told() -> None:
    """As one line and exit code 3, once it has been waited for."""
    error = CliRunner().invoke(
        command, [TASK, "127.0.0.1:9", "--dialect", "behavior-2026", "--wait", "0"], standalone_mode=False
    )
    assert isinstance(error.exception, PolicyError)
    assert error.exception.exit_code == 3
    assert "/healthz is not answered" in str(error.exception)


# The answer, what is told of it, and how often it is asked for: once a camera and once more where it has no action.
BAD: dict[str, tuple[Callable[[dict[str, Any], int], Any], str, int]] = {
    "text": (lambda message, count: "Traceback\nValueError: no such stage", "ValueError: no such stage", 1),
    "none": (lambda message, count: {"actions": START}, "no action in 4 answers", 4),
    "shape": (lambda message, count: {"action": START[:22]}, r"actions of shape \(22,\)", 1),
    "nan": (lambda message, count: {"action": START * np.nan}, "not finite", 1),
}


@pytest.mark.slow
@pytest.mark.render
def test_bad_answers_are_told() -> None:
    """Each by what is wrong with it; one without an action may ask for a picture of each camera first."""
    for answer, why, asked in BAD.values():
        with scripted(answer) as (address, heard), pytest.raises(PolicyError, match=why):
            evaluate(Evaluation(address, "behavior-2025", TASK, max_steps=2), Ear())
        assert sum("reset" not in message for message in heard) == asked
