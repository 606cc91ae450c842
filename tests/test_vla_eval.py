"""The vla-eval dialect, against a model server made with the published package, and against servers that misbehave."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import msgpack
import numpy as np
import pytest
from vla_eval.protocol.messages import Message, MessageType, pack_message, unpack_message
from vla_eval.specs import GRIPPER_CLOSE_POS, POSITION_DELTA, RAW, ROTATION_AA
from websockets.sync.server import ServerConnection

from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
from mpvi_bt.executive.remote.observation import read_observation
from mpvi_bt.executive.remote.vla_eval import VlaEvalPolicy
from mpvi_bt.ground.errors import PolicyError
from mpvi_bt.testing import check_policy
from tests import layouts, serving
from tests.remote_servers import PolicyServer, packed
from tests.vla_eval_server import Model, model_server

LAYOUT = load_settings("vla_eval")
observation = partial(serving.observation, robot="r1pro")  # whose numbers models of BEHAVIOR are sent as they are
QUICK = LAYOUT.model_copy(update={"connect_s": 2.0, "answer_s": 2.0, "tries": 1})


def test_a_model_sees_what_the_robot_sees_and_moves_it() -> None:
    """Pictures come through bit by bit, with the prompt and the state; its chunk comes back in our order and units."""
    seen = observation("pick up the cup", size=224)
    with model_server(model := Model(horizon=4)) as address:
        policy = VlaEvalPolicy(address)
        policy.reset()
        chunk = policy.infer(seen)
        policy.close()
    (got,) = model.seen
    assert got["task_description"] == "pick up the cup"
    for name, camera in (("head", "head"), ("left_wrist", "left"), ("right_wrist", "right")):
        np.testing.assert_array_equal(got["images"][name], seen["images"][camera].rgb)
    body = seen["proprioception"]
    assert got["states"].shape == (256,)
    np.testing.assert_allclose(got["states"][236:240], body.torso, atol=1e-6)
    np.testing.assert_allclose(got["states"][[193, 194]].sum(), body.gripper_width["left"], atol=1e-6)
    assert chunk.shape == (4, 23)
    np.testing.assert_allclose(chunk[:, 1], 0.75 * np.arange(4) / 100, atol=1e-6)
    np.testing.assert_allclose(chunk[:, layouts.LAYOUT.torso], np.tile(got["states"][3:7], (4, 1)), atol=1e-6)


def test_it_keeps_the_contract_of_policies() -> None:
    """As every policy does, for a server that gives out a chunk step by step, too."""
    for model in (Model(), Model(chunk_size=4)):
        with model_server(model) as address:
            policy = VlaEvalPolicy(address)
            check_policy(policy)
            policy.close()


@pytest.mark.rare
@pytest.mark.slow
def test_the_package_serves_its_own_model_for_our_action() -> None:
    """Its baseline for BEHAVIOR's R1Pro, started as its users start it, is waited for and drives the robot."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
    command = [sys.executable, "-m", "vla_eval.model_servers.behavior1k_baseline", "--address", address]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            policy = VlaEvalPolicy(address)
            check_policy(policy)
            assert not policy.infer(observation(size=224)).any()
            policy.close()
        finally:
            process.kill()


def test_a_server_that_keeps_the_chunk_gives_one_action_at_a_time() -> None:
    """It infers once for four observations, and anew after a reset: what is left of the chunk is flushed."""
    with model_server(model := Model(horizon=4, chunk_size=4)) as address:
        policy = VlaEvalPolicy(address)
        policy.reset()
        rows = [policy.infer(observation()) for _ in range(2)]
        policy.reset()
        rows += [policy.infer(observation()) for _ in range(5)]
        policy.close()
    assert all(row.shape == (1, 23) for row in rows)
    assert [round(float(row[0, 1]) / 0.0075) for row in rows] == [0, 1, 0, 1, 2, 3, 0]
    assert len(model.seen) == 3


def test_every_reset_is_an_episode() -> None:
    """Started with the prompt as its task, ended before the next one and when the connection closes."""
    with model_server(model := Model()) as address:
        policy = VlaEvalPolicy(address)
        for prompt in ("pick up the cup", "open the fridge"):
            policy.reset()
            policy.infer(observation(prompt))
        assert [episode["task"]["name"] for episode in model.episodes] == ["pick up the cup", "open the fridge"]
        assert model.ended == 1
        policy.close()
        end = time.monotonic() + 10
        while model.ended < 2 and time.monotonic() < end:
            time.sleep(0.01)
        assert model.ended == 2


def test_an_error_of_the_model_is_told_and_need_not_last() -> None:
    """Its text comes through as "server_error"; the next call is answered, in an episode of its own."""
    with model_server(model := Model(broken=True)) as address:
        policy = VlaEvalPolicy(address)
        policy.reset()
        with pytest.raises(PolicyError, match="RuntimeError: out of memory") as failed:
            policy.infer(observation())
        assert failed.value.reason == "server_error"
        model.broken = False
        assert policy.infer(observation()).shape == (4, 23)
        assert len(model.episodes) == 2
        policy.close()


def test_actions_of_another_robot_are_refused_at_once() -> None:
    """The server says what its actions are before a picture is rendered: seven numbers of a single arm are not ours."""
    arm = {"position": POSITION_DELTA, "rotation": ROTATION_AA, "gripper": GRIPPER_CLOSE_POS}
    with model_server(Model(action_spec=arm)) as address:
        policy = VlaEvalPolicy(address, QUICK)
        with pytest.raises(PolicyError, match=r"actions of 7 numbers \(position 3, rotation 3, gripper 1\)") as failed:
            policy.reset()
        assert failed.value.reason == "bad_reply"


def test_a_server_need_not_say_what_its_actions_are() -> None:
    """Most declare them raw."""
    with model_server(Model(action_spec={"actions": RAW})) as address:
        policy = VlaEvalPolicy(address)
        policy.reset()
        assert policy.infer(observation()).shape == (4, 23)
        policy.close()


def test_a_server_that_restarts_gets_the_episode_again() -> None:
    """Over a new connection there is no episode yet: it is started before the observation is repeated."""
    with model_server(first := Model()) as address:
        policy = VlaEvalPolicy(address, QUICK)
        policy.reset()
        policy.infer(observation())
    port = int(address.rpartition(":")[2])
    with model_server(second := Model(), port):
        assert policy.infer(observation()).shape == (4, 23)
        policy.close()
    assert len(first.episodes) == len(second.episodes) == 1


def test_the_whole_observation_can_be_sent() -> None:
    """With settings that map nothing it comes through bit by bit, as `mpvi serve` takes it; first it begins anew."""
    seen = observation("pick up the cup")
    heard: list[dict[str, Any]] = []
    answer = {"actions": GOOD, "cameras": ["left"], "note": "reaching"}
    with _scripted(lambda n: _message("action", answer, n), heard=heard) as server:
        policy = VlaEvalPolicy(server.address, load_settings("mpvi"), {"cup_1": ["cup"]})
        policy.reset()
        assert set(policy.cameras) == {"head", "left", "right"}
        for _ in range(2):
            policy.infer(seen)
        assert (policy.cameras, policy.note) == (("left",), "reaching")
        policy.reset()
        assert set(policy.cameras) == {"head", "left", "right"}
        policy.close()
    asked = [read_observation(payload) for payload in heard]
    assert [question.reset for question in asked] == [True, False]
    assert asked[0].vocabulary == {"cup_1": ["cup"]}
    for name, image in seen["images"].items():
        np.testing.assert_array_equal(asked[1].observation["images"][name].depth, image.depth)
        assert asked[1].observation["images"][name].names == image.names


def test_a_state_that_is_asked_for_must_be_sent() -> None:
    """Else the model would read zeros, and nobody would know."""
    assert LAYOUT.observation is not None
    blind = QUICK.model_copy(update={"observation": LAYOUT.observation.model_copy(update={"state": {}})})

    class Stateful(Model):
        def get_observation_params(self) -> dict[str, Any]:
            return {"send_state": True}

    with model_server(Stateful()) as address, pytest.raises(PolicyError, match="reads a state"):
        VlaEvalPolicy(address, blind).reset()


HELLO = {"protocol_version": 1}


def _message(kind: str, payload: dict[str, Any], number: int) -> bytes:
    return pack_message(Message(MessageType(kind), payload, number))


def _action(actions: Any, number: int) -> bytes:
    return _message("action", {"actions": actions}, number)


def _scripted(
    answer: Callable[[int], Any], hello: Any = HELLO, heard: list[dict[str, Any]] | None = None
) -> PolicyServer:
    """A server that greets and then answers every observation, which `heard` keeps, as it is told, given its number."""

    def talk(connection: ServerConnection, number: int) -> None:
        for frame in connection:
            message = unpack_message(frame)
            if message.type is MessageType.HELLO:
                connection.send(hello if isinstance(hello, bytes | str) else _message("hello", hello, message.seq))
            elif message.type is MessageType.OBSERVATION:
                if heard is not None:
                    heard.append(message.payload)
                replies = answer(message.seq)
                for reply in replies if isinstance(replies, list) else [replies]:
                    connection.send(reply)

    return PolicyServer(talk=talk)


GOOD = np.zeros((2, 23), np.float32)
REPLIES: dict[str, tuple[Callable[[int], Any], str]] = {
    "garbage": (lambda n: b"\xc1\xff", "bad_reply"),
    "text": (lambda n: "Traceback: it broke", "server_error"),
    "list": (lambda n: msgpack.packb([1]), "bad_reply"),
    "no_payload": (lambda n: msgpack.packb({"type": "action", "seq": n}), "bad_reply"),
    "no_number": (lambda n: msgpack.packb({"type": "action", "payload": {}}), "bad_reply"),
    "no_actions": (lambda n: _message("action", {}, n), "bad_reply"),
    "other_type": (lambda n: _message("hello", {}, n), "bad_reply"),
    "number_of_the_future": (lambda n: _action(GOOD, n + 1), "bad_reply"),
    "seven_numbers": (lambda n: _action(np.zeros((2, 7)), n), "bad_reply"),
    "empty_chunk": (lambda n: _action(np.zeros((0, 23)), n), "bad_reply"),
    "nan": (lambda n: _action(np.full((2, 23), np.nan), n), "bad_reply"),
    "text_for_actions": (lambda n: _action("left", n), "bad_reply"),
    "array_of_objects": (
        lambda n: _action({"__ndarray__": True, "data": b"", "dtype": "|O", "shape": [0]}, n),
        "bad_reply",
    ),
    "array_that_lies": (
        lambda n: _action({"__ndarray__": True, "data": b"", "dtype": "<f4", "shape": [1 << 40, 23]}, n),
        "bad_reply",
    ),
    "text_of_no_length": (
        lambda n: _action({"__ndarray__": True, "data": b"", "dtype": "<U999999999", "shape": [0]}, n),
        "bad_reply",
    ),
    "array_for_type": (lambda n: packed({"type": np.array([1, 1]), "payload": {}, "seq": n}), "bad_reply"),
    "very_deep": (
        lambda n: b"\x83\xa4type\xa6action\xa3seq\x01\xa7payload" + b"\x81\xa1a" * 500 + b"\xc0",
        "bad_reply",
    ),
    "error": (lambda n: _message("error", {"error": "observation_failed: no"}, n), "server_error"),
    "too_large": (lambda n: bytes(20 << 20), "bad_reply"),
    "silence": (lambda n: [], "server_timeout"),
    "only_late_answers": (lambda n: [_action(GOOD, n - 1)] * 3, "server_timeout"),
}


@pytest.mark.parametrize("name", REPLIES)
def test_bad_replies_have_a_reason(name: str) -> None:
    """Whatever a server sends, the wait ends, and the reason is told."""
    answer, reason = REPLIES[name]
    with _scripted(answer) as server:
        policy = VlaEvalPolicy(server.address, QUICK.model_copy(update={"answer_s": 0.5}))
        policy.reset()
        began = time.monotonic()
        with pytest.raises(PolicyError) as failed:
            policy.infer(observation())
        assert failed.value.reason == reason
        assert time.monotonic() - began < 5


def test_a_server_that_announces_other_actions_than_the_robots_is_refused() -> None:
    """Before it is asked for any, where no settings say how many numbers they have."""
    hello = {"protocol_version": 1, "action_spec": {"arm": {"dims": 7}}}
    heard: list[dict[str, Any]] = []
    with _scripted(lambda n: _action(GOOD, n), hello, heard) as server:
        policy = VlaEvalPolicy(server.address, DialectSettings(connect_s=2.0, answer_s=2.0, tries=1))
        policy.reset()
        with pytest.raises(PolicyError, match=r"actions of 7 numbers \(arm 7\); the r1pro has 23") as failed:
            policy.infer(observation())
    assert failed.value.reason == "bad_reply"
    assert heard == []


def test_late_answers_are_passed_over() -> None:
    """An answer to an earlier observation is not taken for one to this."""
    with _scripted(lambda n: [_action(GOOD + 1, n - 1), _action(GOOD, n)]) as server:
        policy = VlaEvalPolicy(server.address, QUICK)
        policy.reset()
        assert not policy.infer(observation())[:, layouts.LAYOUT.torso].any()


@pytest.mark.parametrize(
    ("hello", "said"),
    [
        ({"protocol_version": 2}, "version 2"),
        ({}, "version nothing"),
        (packed({"type": "hello", "payload": {"protocol_version": np.array([1, 1])}, "seq": 1}), "version array"),
        (_message("action", {}, 1), "in answer to hello"),
        (b"\xc1", "msgpack"),
    ],
    ids=["newer", "no version", "version of no kind", "not hello", "not msgpack"],
)
def test_servers_that_speak_otherwise_are_refused(hello: Any, said: str) -> None:
    """Before any observation is sent; the settings of openpi belong to openpi."""
    with _scripted(lambda n: [], hello) as server:
        policy = VlaEvalPolicy(server.address, QUICK)
        with pytest.raises(PolicyError, match=said) as failed:
            policy.reset()
        assert failed.value.reason == "bad_reply"


def test_whether_a_state_is_read_is_true_or_false() -> None:
    """What is neither, such as an array, is not taken for either, and fails nothing."""
    wants = {**HELLO, "observation_params": {"send_state": np.array([1, 1])}}
    with _scripted(lambda n: _action(GOOD, n), packed({"type": "hello", "payload": wants, "seq": 1})) as server:
        policy = VlaEvalPolicy(server.address, QUICK)
        policy.reset()
        assert policy.infer(observation()).shape == (2, 23)


def test_an_openpi_server_is_no_model_server() -> None:
    """It speaks first, and not this protocol."""
    with PolicyServer() as server:
        policy = VlaEvalPolicy(server.address, QUICK)
        with pytest.raises(PolicyError, match="without a type, a payload") as failed:
            policy.reset()
        assert failed.value.reason == "bad_reply"


def test_nothing_else_is_sent() -> None:
    """What the state holds is where the settings say, and nothing else is sent."""
    seen = observation()
    seen["proprioception"] = replace(seen["proprioception"], torso=np.array([0.1, 0.2, 0.3, 0.4]))
    with model_server(model := Model()) as address:
        policy = VlaEvalPolicy(address)
        policy.reset()
        policy.infer(seen)
        policy.close()
    assert set(model.seen[0]) == {"images", "task_description", "states"}
    np.testing.assert_allclose(model.seen[0]["states"][236:240], [0.1, 0.2, 0.3, 0.4], atol=1e-6)
