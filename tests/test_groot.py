"""The client of GR00T's policy servers, over real sockets: what a good server gets, and what a bad one does to us."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from mpvi_bt.executive.remote.connection import KEY
from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
from mpvi_bt.executive.remote.groot import GrootPolicy
from mpvi_bt.ground.errors import PolicyError, UserError
from mpvi_bt.runs.choices.policies import PolicyInputs, make_policy
from mpvi_bt.testing import check_policy
from mpvi_bt.testing.doubles import KinematicRobot
from tests.groot_servers import HORIZON, SIZES, GrootServer, config, modalities, npy, rows
from tests.layouts import ACTION_SIZE, CAMERAS
from tests.numbered_body import numbered_body
from tests.remote_servers import free_port, raw_server

pytest.importorskip("zmq", reason="needs the extra groot")


@pytest.fixture(autouse=True)
def _no_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(KEY, raising=False)


def settings(**changed: Any) -> DialectSettings:
    return load_settings("groot").model_copy(update={"connect_s": 60.0, "answer_s": 60.0, "tries": 1, **changed})


def policy_at(server: GrootServer | str, **changed: Any) -> GrootPolicy:
    return GrootPolicy(server if isinstance(server, str) else server.address, settings(**changed), "groot")


def seen(prompt: str = "pick up the cup") -> dict[str, Any]:
    robot = KinematicRobot()
    return {"prompt": prompt, "proprioception": numbered_body("r1"), "images": {c: robot.look(c) for c in CAMERAS}}


@contextmanager
def fails(reason: str, *words: str) -> Iterator[None]:
    """The block raises a PolicyError of that reason, on one printable line that has the words and the address."""
    with pytest.raises(PolicyError) as caught:
        yield
    assert caught.value.reason == reason, caught.value
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 700
    for word in ("groot:tcp://", *words):
        assert word in str(caught.value)


def test_it_is_a_policy() -> None:
    """The client keeps the contract of policies, on one connection."""
    with GrootServer() as server:
        policy = policy_at(server)
        check_policy(policy)
        assert policy.connections == 1
        assert (policy.name, policy.rate_hz) == (f"groot:{server.address}", 10.0)
        policy.close()


def test_it_is_spoken_to_as_groots_own_client_does() -> None:
    """Modalities first, a reset at a handoff, and an observation as a batch of one moment, with this call's prompt."""
    with GrootServer() as server:
        policy, given = policy_at(server), seen()
        for prompt in ("open the fridge", "close the fridge"):
            policy.reset()
            actions = policy.infer({**given, "prompt": prompt})
        policy.close()
    ends = [endpoint for endpoint, _ in server.asked]
    assert ends == ["get_modality_config", "reset", "get_action", "reset", "get_action"]
    assert server.asked[2][1]["options"] is None
    told = [data["observation"] for endpoint, data in server.asked if endpoint == "get_action"]
    assert [one["language"] for one in told] == [
        {"annotation.human.task_description": [[prompt]]} for prompt in ("open the fridge", "close the fridge")
    ]
    head, state = told[0]["video"]["head"], told[0]["state"]
    assert (head.shape, head.dtype) == ((1, 1, *given["images"]["head"].rgb.shape), np.uint8)
    assert np.array_equal(head[0, 0], given["images"]["head"].rgb)
    assert {key: (part.shape, part.dtype.str) for key, part in state.items()} == {
        key: ((1, 1, size), "<f4") for key, size in SIZES.items()
    }
    np.testing.assert_allclose(state["right_arm"][0, 0], given["proprioception"].arm["right"])
    assert actions.shape == (HORIZON, ACTION_SIZE)


def test_parts_of_an_action_stand_in_the_servers_order() -> None:
    """They are joined in the order of its modality config, whatever their order in an answer is."""

    def turned(observation: dict[str, Any]) -> Any:
        return dict(reversed(rows(observation).items()))

    with GrootServer(turned) as server:
        policy, body = policy_at(server), seen()["proprioception"]
        actions = policy.infer(seen())
        policy.close()
    now = [*body.base_velocity, *body.torso, *body.arm["left"], 0.06, *body.arm["right"], 0.08]
    np.testing.assert_allclose(actions, np.array(now)[None] + np.arange(HORIZON)[:, None], rtol=1e-5)


def test_configs_of_older_servers_are_text() -> None:
    """JSON in a string says the same; a server that says nothing is taken at its answers' word."""
    told = {kind: config(about["as_json"]["modality_keys"], as_text=True) for kind, about in modalities().items()}
    for about in (told, {}):
        with GrootServer(about=about) as server:
            policy = policy_at(server)
            assert policy.infer(seen()).shape == (HORIZON, ACTION_SIZE)
            policy.close()


@pytest.mark.parametrize(
    ("about", "said"),
    [
        (modalities(video=config(["head", "ego_view"])), ("wants video 'ego_view'", "send: head, left, right")),
        (modalities(state=config(["waist"])), ("wants state 'waist'",)),
        (modalities(language=config(["annotation.task"])), ("wants language 'annotation.task'",)),
        (modalities(video=config(["head"], (-1, 0))), ("wants video of 2 moments",)),
        (modalities(video={"modality_keys": ["head"]}), ("modality config of 'video'",)),
        (modalities(state=config([3])), ("modality config of 'state'",)),  # type: ignore[list-item]
        ([1], ("a modality config that is",)),
    ],
)
def test_a_checkpoint_that_wants_what_the_settings_lack_is_told_of(about: Any, said: tuple[str, ...]) -> None:
    """Before the first observation goes out, with both sides of it."""
    with GrootServer(about=about) as server:
        with fails("bad_reply", *said):
            policy_at(server).reset()
        assert [endpoint for endpoint, _ in server.asked] == ["get_modality_config"]


def bomb() -> dict[str, Any]:
    """A header of many numbers, and none of them."""
    array = npy(np.zeros((1, 2, 3), np.float32))
    return {**array, "as_npy": array["as_npy"].replace(b"(1, 2, 3)", b"(1,9999999,999999)").replace(b" " * 9, b"", 1)}


def changed(key: str, value: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda observation: {**rows(observation), key: value}


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (lambda seen: b"\xc1", "not a msgpack message"),
        (lambda seen: {}, "an action that is"),
        (lambda seen: 3, "an action that is"),
        (changed("torso", [1.0]), "no part 'torso'"),
        (changed("torso", npy(np.zeros((HORIZON, 4), np.float32))), "not (1, H, n) numbers"),
        (changed("torso", npy(np.zeros((1, HORIZON, 5), np.float32))), "of shape (16, 24)"),
        (changed("torso", npy(np.zeros((1, 3, 4), np.float32))), "rows"),
        (changed("torso", npy(np.full((1, HORIZON, 4), np.nan, np.float32))), "not finite"),
        (changed("torso", npy(np.zeros((1, HORIZON, 4), np.complex64))), "dtype"),
        (changed("torso", npy(np.full((1, HORIZON, 4), None), allow_pickle=True)), "dtype"),
        (changed("torso", {"__ndarray_class__": True, "as_npy": "text"}), "not bytes"),
        (changed("torso", {"__ndarray_class__": True, "as_npy": b"\x80\x04cos\nsystem\n"}), "no .npy file"),
        (changed("torso", bomb()), "an array"),
    ],
)
def test_an_answer_that_is_none_is_a_bad_reply(answer: Callable[[dict[str, Any]], Any], said: str) -> None:
    """Whatever its shape, type and numbers are; pickled objects are never loaded."""
    with GrootServer(answer) as server, fails("bad_reply", said):
        policy_at(server).infer(seen())


def test_an_array_by_columns_is_read_as_it_is() -> None:
    """numpy writes arrays of Fortran's order with their axes turned about."""
    values = np.arange(HORIZON * 4, dtype=np.float32).reshape(1, HORIZON, 4)
    with GrootServer(changed("torso", npy(np.asfortranarray(values)))) as server:
        policy = policy_at(server)
        np.testing.assert_array_equal(policy.infer(seen())[:, 3:7], values[0])
        policy.close()


def test_what_the_server_says_of_its_failure_is_told() -> None:
    """Its message, and that the settings may not fit where it has answered nothing yet."""

    def broken(observation: dict[str, Any]) -> Any:
        raise KeyError("left_hand")

    with GrootServer(broken) as server, fails("server_error", "the server says: 'left_hand'", "--policy-settings"):
        policy_at(server).infer(seen())


def test_a_key_is_sent_and_a_wrong_one_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the environment, as for every server; it stands in no message of ours."""
    with GrootServer(key="sesame") as server:
        with fails("unauthorized", "Invalid API token"):
            policy_at(server).reset()
        monkeypatch.setenv(KEY, "sesame")
        policy = policy_at(server)
        policy.reset()
        policy.close()


def test_a_server_that_does_not_answer_is_given_up() -> None:
    """After the time of the settings, and the late answer is nobody's: the next question gets its own."""
    go_on = threading.Event()

    def late(observation: dict[str, Any]) -> Any:
        go_on.wait()
        return rows(observation)

    with GrootServer(late) as server:
        policy = policy_at(server, answer_s=0.5, tries=0)
        policy.reset()
        with fails("server_timeout", "no answer in time"):
            policy.infer(seen())
        go_on.set()
        server.answer = changed("torso", npy(np.full((1, HORIZON, 4), 0.25, np.float32)))
        again = policy_at(server)
        assert (again.infer(seen())[:, 3:7] == 0.25).all()
        again.close()


def test_a_server_that_is_not_there_is_waited_for() -> None:
    """As long as the settings say; one that comes meanwhile is used."""
    port = free_port()
    with fails("server_absent", "connection refused"):
        policy_at(f"tcp://127.0.0.1:{port}", connect_s=0.5).reset()
    started: list[GrootServer] = []
    later = threading.Timer(0.7, lambda: started.append(GrootServer(port=port)))
    later.start()
    policy = policy_at(f"127.0.0.1:{port}")
    policy.reset()
    policy.close()
    started[0].stop()


def test_a_server_that_comes_back_gets_the_question_again() -> None:
    """A connection that breaks in the middle is made anew, and the same observation is sent."""

    def dies(observation: dict[str, Any]) -> Any:
        raise ConnectionAbortedError

    server = GrootServer(dies)
    policy = policy_at(server)
    policy.reset()
    started: list[GrootServer] = []

    def come_back() -> None:
        server._thread.join(20)
        started.append(GrootServer(port=server.port))

    threading.Thread(target=come_back).start()
    assert policy.infer(seen()).shape == (HORIZON, ACTION_SIZE)
    assert policy.connections == 2
    policy.close()
    started[0].stop()


def test_a_message_that_is_too_large_is_not_taken() -> None:
    """It is dropped by the socket before it takes memory, and the reason names the limit."""
    large = msgpack.packb([{"torso": b"x" * (3 << 20)}, {}])
    with GrootServer(lambda observation: large) as server, fails("server_closed", "larger than 1 MiB"):
        policy_at(server, max_mb=1).infer(seen())


def test_a_server_of_something_else_is_told_of_at_once() -> None:
    """Who speaks first and does not speak ZeroMQ, such as SSH, is no policy server."""

    def ssh(client: socket.socket) -> None:
        client.sendall(b"SSH-2.0-OpenSSH_9.2\r\n")
        time.sleep(0.2)

    with raw_server(ssh) as address, fails("bad_reply", "does not speak ZeroMQ"):
        policy_at(f"tcp://{address.rpartition('/')[2]}").reset()


def test_what_waits_to_be_asked_is_no_server_of_zeromq() -> None:
    """Such as a web server: it is waited for as long as for one that is not there."""

    def web(client: socket.socket) -> None:
        client.recv(1)

    with raw_server(web) as address, fails("server_timeout", "as ZeroMQ does"):
        policy_at(f"tcp://{address.rpartition('/')[2]}", connect_s=0.5).reset()


@pytest.mark.parametrize(
    "address", ["ws://h:1", "tcp://h:0", "tcp://h:1/x", "tcp://", "tcp://me:key@h:1", "grpc://h:1"]
)
def test_an_address_that_is_none_is_refused(address: str) -> None:
    """Before anybody is asked, with the form that one has."""
    with pytest.raises(UserError, match="tcp://HOST:PORT"):
        make_policy(f"groot:{address}", PolicyInputs({}))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("about: all", "send the whole observation"),
        ("observation: {images: {front: {camera: head}}}", "begins with 'video.'"),
        ("observation: {prompt: task}", "begins with 'language.'"),
        ("robot: fetch\nobservation: {prompt: null}", "of the robot fetch"),
    ],
)
def test_settings_of_another_protocol_are_refused(tmp_path: Path, text: str, said: str) -> None:
    """As soon as the policy is chosen."""
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UserError, match=said):
        make_policy("groot:tcp://h:1", PolicyInputs({}, robot="r1"), str(tmp_path / "mine.yaml"))
