"""Episodes with a policy behind a socket that fails in the middle: whose fault it was, and what the robot does."""

from __future__ import annotations

import dataclasses
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.server import ServerConnection

from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.remote.connection import KEY
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.executive.ticking.loop import Outcome, run_episode
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.layouts import ACTION_SIZE, BASE, LAYOUT
from tests.remote_servers import HOST, PolicyServer, broken, packed

SKILLS = load_skills()
SPEC = compile_plan(RecordedPlanner().plan("picking_up_trash"), SKILLS)
PLACES = {"trash can": (1.0, 0.0), "can of soda": (0.0, 0.5)}
GOOD_ANSWERS = 3
MOVING = np.zeros((4, ACTION_SIZE))
MOVING[:, BASE] = [0.2, 0.1, 0.1]
MOVING[:, LAYOUT.arm["left"]] = MOVING[:, LAYOUT.arm["right"]] = 0.1


def reply(**changed: Any) -> bytes:
    return packed({"actions": MOVING, **changed})


def spoiled(value: float) -> np.ndarray[Any, Any]:
    actions = MOVING.copy()
    actions[2, 10] = value
    return actions


def traceback(connection: ServerConnection) -> None:
    connection.send("Traceback (most recent call last):\nRuntimeError: out of memory")
    connection.close(1011)


FAILURES: dict[str, tuple[str, Callable[[ServerConnection], object]]] = {
    "dies": ("server_closed", broken),
    "hangs": ("server_timeout", lambda c: time.sleep(1.5)),
    "says good-bye": ("server_closed", lambda c: c.close(1001)),
    "garbage": ("bad_reply", lambda c: c.send(bytes(range(256)))),
    "nan": ("bad_reply", lambda c: c.send(reply(actions=spoiled(np.nan)))),
    "wrong shape": ("bad_reply", lambda c: c.send(reply(actions=MOVING[:, :22]))),
    "wrong dtype": ("bad_reply", lambda c: c.send(reply(actions=MOVING > 0))),
    "empty chunk": ("bad_reply", lambda c: c.send(reply(actions=MOVING[:0]))),
    "a huge frame": ("bad_reply", lambda c: c.send(bytes(100_000_000))),
    "an error frame": ("server_error", traceback),
}


def episode(server: PolicyServer | str, trace: Path, max_time_s: float = 20.0) -> tuple[Outcome, KinematicWorld]:
    """An episode whose policy is behind an address; by then it is over."""
    address = server if isinstance(server, str) else server.address
    settings = DialectSettings(connect_s=2.0, answer_s=1.0, tries=2, max_mb=1)
    world = KinematicWorld()
    context = scripted_context(world, SKILLS, PLACES, {})
    context = dataclasses.replace(context, policy=OpenpiPolicy(address, settings))
    return run_episode(Tree(SPEC), world, context, [Recorder(trace)], max_time_s=max_time_s), world


def check_failed(outcome: Outcome, world: KinematicWorld, trace: Path, reason: str) -> None:
    """The backend failed and not the policy; the trace says why; the robot stands where it stood."""
    assert outcome.ending == "backend_error"
    assert outcome.failure is not None
    assert outcome.failure.reason == reason, outcome.failure
    assert outcome.log.failures == []
    end = read_trace(trace).end
    assert end is not None
    assert end.error is not None
    assert (end.ending, end.error.reason) == ("backend_error", reason)
    assert not world.robot.action[BASE].any()
    before = world.robot.proprioception()
    for _ in range(30):
        world.step()
    after = world.robot.proprioception()
    assert np.array_equal(before.base_pose, after.base_pose)
    for side in SIDES:
        np.testing.assert_allclose(after.arm[side], before.arm_command[side], atol=1e-6)


@pytest.mark.parametrize("name", FAILURES)
def test_a_server_that_fails_in_the_middle(name: str, tmp_path: Path) -> None:
    """Some chunks are carried out; then it fails, and goes on failing; nor is it held up by what it still sends."""
    reason, fail = FAILURES[name]
    answers = 0

    def talk(connection: ServerConnection, number: int) -> None:
        nonlocal answers
        connection.send(packed({}))
        while True:
            connection.recv()
            answers += 1
            if answers > GOOD_ANSWERS:
                fail(connection)
                return
            connection.send(reply())

    with PolicyServer(talk=talk) as server:
        began = time.monotonic()
        outcome, world = episode(server, tmp_path / "trace.jsonl")
        assert time.monotonic() - began < 8
    assert time.monotonic() - began < 16  # the server has stopped: it waits for its threads
    assert answers > GOOD_ANSWERS
    check_failed(outcome, world, tmp_path / "trace.jsonl", reason)


def test_a_server_that_was_never_there(tmp_path: Path) -> None:
    """The episode ends at the first handoff."""
    with socket.create_server((HOST, 0)) as listener:
        port = listener.getsockname()[1]
    check_failed(*episode(f"{HOST}:{port}", tmp_path / "t.jsonl"), tmp_path / "t.jsonl", "server_absent")


def test_a_server_that_wants_another_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Likewise, and the key is not in the trace."""
    monkeypatch.setenv(KEY, "my-secret")
    with PolicyServer(key="another") as server:
        check_failed(*episode(server, tmp_path / "t.jsonl"), tmp_path / "t.jsonl", "unauthorized")
    assert "my-secret" not in (tmp_path / "t.jsonl").read_text()


def test_tls_that_fails(tmp_path: Path) -> None:
    """Likewise, where TLS is asked for and there is none."""
    with PolicyServer() as server:
        failed = episode(f"wss://{HOST}:{server.port}", tmp_path / "t.jsonl")
    check_failed(*failed, tmp_path / "t.jsonl", "tls")


def test_a_server_that_restarts_costs_no_episode(tmp_path: Path) -> None:
    """Connections that break in between are made anew, and the episode goes on to its end."""

    def talk(connection: ServerConnection, number: int) -> None:
        connection.send(packed({}))
        for _ in range(3):
            connection.recv()
            connection.send(reply())
        connection.recv()
        broken(connection)

    with PolicyServer(talk=talk) as server:
        outcome, _ = episode(server, tmp_path / "t.jsonl", max_time_s=6.0)
        assert server.connections > 2
    assert (outcome.ending, outcome.failure) == ("time_limit", None)


def test_far_out_of_reach_is_clipped_and_counted(tmp_path: Path) -> None:
    """1e30 radians are the policy's doing, not its backend's: the episode goes on within the robot's limits."""
    with PolicyServer(lambda message: {"actions": spoiled(1e30)}) as server:
        outcome, world = episode(server, tmp_path / "t.jsonl", max_time_s=4.0)
    assert outcome.ending == "time_limit"
    assert outcome.log.clipped > 0
    assert np.abs(world.robot.action).max() < 4
