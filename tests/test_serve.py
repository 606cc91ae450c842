"""A policy behind a websocket: what clients get, right and wrong, over real sockets."""

from __future__ import annotations

import contextlib
import copy
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from mpvi_bt.executive.remote.codec import MAX_BYTES, pack, unpack
from mpvi_bt.executive.remote.observation import Vocabulary, read_observation, write_observation
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.executive.remote.policy_server import PolicyServer
from mpvi_bt.executive.remote.server import MOST_CLIENTS
from mpvi_bt.ground.errors import BadMessage
from mpvi_bt.ground.geometry.solids import Array
from tests.serving import ask, client, grip, observation, received, serving


class Probe:
    """A policy that tells in its actions what has been done to it.

    Args:
        cameras: That it wants.
        work: What it does before it answers.
    """

    name = "probe"

    def __init__(self, cameras: tuple[str, ...] = (), work: Callable[[], object] = lambda: None) -> None:
        self.cameras, self.closed = cameras, False
        self._work = work
        self._calls = self._resets = 0
        self.note = "at rest"

    def reset(self) -> None:
        self._calls = 0
        self._resets += 1

    def close(self) -> None:
        self.closed = True

    def infer(self, observation: Mapping[str, Any]) -> Array:
        self._work()
        self._calls += 1
        self.note = f"call {self._calls}"
        return np.full((2, 23), self._calls + self._resets / 100)


def test_a_robot_with_one_arm_comes_through() -> None:
    """The fetch has a right arm and no left one, on the wire as well."""
    two = observation()["proprioception"]
    right = {name: {"right": getattr(two, name)["right"]} for name in ("arm", "arm_velocity", "gripper_width")}
    told = ("gripper_command", "arm_command", "gripper_velocity")
    more = {name: {"right": getattr(two, name)["right"]} for name in told}
    sent = {"prompt": "", "images": {}, "proprioception": replace(two, robot="fetch", **right, **more)}
    read = read_observation(unpack(pack(write_observation(sent)))).observation["proprioception"]
    assert (read.robot, read.sides) == ("fetch", ("right",))
    np.testing.assert_array_equal(read.arm_command["right"], two.arm_command["right"])


@pytest.mark.parametrize("bare", [False, True])
def test_an_observation_comes_through_whole(bare: bool) -> None:
    """What is read is what was written, bit by bit, labels and what was told to the arms or not."""
    sent = observation(size=5, robot="r1pro")
    if bare:
        sent["proprioception"] = replace(sent["proprioception"], arm_command={})
        sent["images"] = {name: replace(image, labels=None, names={}) for name, image in sent["images"].items()}
    called = None if bare else {"cup.n.01_1": ["cup", "mug"]}
    question = read_observation(unpack(pack(write_observation(sent, not bare, called))))
    assert question.reset is not bare
    assert question.vocabulary == called
    read = question.observation
    assert read["prompt"] == sent["prompt"]
    for name, value in vars(sent["proprioception"]).items():
        np.testing.assert_equal(getattr(read["proprioception"], name), value)
    for camera, image in sent["images"].items():
        for name, value in vars(image).items():
            got = getattr(read["images"][camera], name)
            np.testing.assert_equal(got, value)
            assert not isinstance(value, np.ndarray) or got.dtype == value.dtype


def test_a_client_gets_what_the_policy_gives_in_process() -> None:
    """Metadata come first, then actions that equal those in process; the policy keeps its state from call to call."""
    alone = grip()
    with serving() as server, client(server) as connection:
        metadata = received(connection)
        assert metadata["policy"] == "grip"
        assert metadata["cameras"] == list(alone.cameras)
        alone.reset()
        for prompt in ["pick up the cup, then put it on the table"] * 5 + ["put the cup on the table"] * 2:
            seen = observation(prompt)
            if prompt.startswith("put"):
                alone.reset()
            answer = ask(connection, write_observation(seen))
            assert np.array_equal(answer["actions"], alone.infer(seen))
            assert answer["policy_timing"]["infer_ms"] >= 0
            assert answer["server_timing"]["infer_ms"] >= 0
        assert answer["server_timing"]["prev_total_ms"] > 0


def test_a_policy_begins_anew_when_told_and_when_the_prompt_changes() -> None:
    """The handoff is a flag of the observation; the same prompt again is none."""
    with serving(lambda _: Probe()) as server, client(server) as connection:
        connection.recv(timeout=10)

        def calls(prompt: str, reset: bool = False) -> int:
            answer = ask(connection, write_observation(observation(prompt), reset))
            assert answer["note"] == f"call {int(answer['actions'][0, 0])}"
            return int(answer["actions"][0, 0])

        assert [calls("a"), calls("a"), calls("b"), calls("b"), calls("b", reset=True)] == [1, 2, 1, 2, 1]


def test_a_client_says_what_its_labels_are_called() -> None:
    """The policy is made with it, and made anew when it changes; saying the same again changes nothing."""
    made = []
    policies: list[Probe] = []

    def make(vocabulary: Vocabulary) -> Probe:
        made.append(dict(vocabulary))
        policies.append(Probe())
        return policies[-1]

    with serving(make) as server, client(server) as connection:
        received(connection)
        calls = [
            ask(connection, write_observation(observation(), vocabulary=called))["note"]
            for called in (None, {"a": ["cup"]}, {"a": ["cup"]}, None, {"a": ["cup", "mug"]})
        ]
        assert [policy.closed for policy in policies] == [True, True, False]  # the old one is of no more use
        assert policies[-1]._resets == 1
    assert calls == ["call 1", "call 1", "call 2", "call 3", "call 1"]
    assert made == [{}, {"a": ["cup"]}, {"a": ["cup", "mug"]}]


def test_answers_say_which_cameras_come_next() -> None:
    """A client sends the pictures that are asked for; without them it is told which is missing."""
    with serving(lambda _: Probe(cameras=("head",))) as server, client(server) as connection:
        assert received(connection)["cameras"] == ["head"]
        assert ask(connection, write_observation(observation()))["cameras"] == ["head"]
        told = ask(connection, write_observation({**observation(), "images": {}}))
        assert told.startswith("bad_message: images: head is missing")


def test_clients_do_not_share_a_policy_nor_wait_for_each_other() -> None:
    """While one client's policy thinks, others are answered; each counts its own calls."""
    go, thinking = threading.Event(), threading.Event()
    made: list[Probe] = []

    def make(vocabulary: Vocabulary) -> Probe:
        def think() -> None:
            thinking.set()
            go.wait(10)

        made.append(Probe() if made else Probe(work=think))
        return made[-1]

    with serving(make) as server, client(server) as slow:
        slow.recv(timeout=10)
        slow.send(pack(write_observation(observation())))
        assert thinking.wait(10)
        with client(server) as quick:
            quick.recv(timeout=10)
            counts = [int(ask(quick, write_observation(observation()))["actions"][0, 0]) for _ in range(3)]
        go.set()
        assert counts == [1, 2, 3]
        assert int(received(slow)["actions"][0, 0]) == 1


def _without(message: dict[str, Any], *path: str) -> dict[str, Any]:
    message = copy.deepcopy(message)
    inner = message
    for key in path[:-1]:
        inner = inner[key]
    del inner[path[-1]]
    return message


def _with(value: Any, *path: str) -> dict[str, Any]:
    message = copy.deepcopy(write_observation(observation()))
    inner: Any = message
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return message


GOOD = write_observation(observation())
BAD = {
    "text": ("{}", "text frame"),
    "garbage": (b"\xc1\x00\xff" * 9, "msgpack"),
    "nothing": (b"", "msgpack"),
    "cut_off": (pack(GOOD)[:1000], "msgpack"),
    "object_array": (msgpack.packb({b"__ndarray__": True, b"data": b"", b"dtype": "|O", b"shape": [0]}), "dtype '|O'"),
    "no_mapping": ([1, 2], "the observation: a list is given"),
    "no_prompt": (_without(GOOD, "prompt"), "prompt is missing"),
    "misspelled": ({**GOOD, "promt": "a"}, "Did you mean 'prompt'"),
    "endless_prompt": (
        _with("pick up the cup " * 17_500, "prompt"),
        "prompt: 280000 characters are given, at most 65000",
    ),
    "number_for_prompt": (_with(3, "prompt"), "prompt: 3 is given, a text is wanted"),
    "reset_message_of_behavior": ({"reset": True}, "prompt is missing"),
    "no_body": (_without(GOOD, "proprioception"), "proprioception is missing"),
    "half_a_body": (_without(GOOD, "proprioception", "arm", "left"), "proprioception.arm: left is missing"),
    "arm_of_six": (_with(np.zeros(6), "proprioception", "arm", "left"), "(6,) float64 is given, (7,) numbers"),
    "arm_of_text": (_with("bent", "proprioception", "arm", "left"), "'bent' is given"),
    "nan": (_with(np.full(3, np.nan), "proprioception", "base_pose"), "not every value is finite"),
    "unknown_robot": (_with("r1por", "proprioception", "robot"), "Did you mean 'r1pro'"),
    "two_arms_of_one": (_with("fetch", "proprioception", "robot"), "unknown key 'left'"),
    "unknown_camera": (_with({}, "images", "chest"), "unknown key 'chest'"),
    "no_depth": (_without(GOOD, "images", "head", "depth"), "images.head: depth is missing"),
    "float_picture": (_with(np.zeros((8, 8, 3)), "images", "head", "rgb"), "(H, W, 3) uint8 is wanted"),
    "empty_picture": (_with(np.zeros((0, 8, 3), np.uint8), "images", "head", "rgb"), "(H, W, 3) uint8 is wanted"),
    "other_size": (_with(np.zeros((4, 4), np.float32), "images", "left", "depth"), "(8, 8) float32"),
    "endless_depth": (_with(np.full((8, 8), np.inf, np.float32), "images", "left", "depth"), "it is 0"),
    "labels_of_floats": (_with(np.zeros((8, 8)), "images", "left", "labels"), "int32"),
    "names_by_name": (_with({"cup": "1"}, "images", "left", "names"), "not a label id and a name"),
    "vocabulary_of_texts": (_with({"cup": "mug"}, "vocabulary"), "'cup': 'mug' is given, a list of texts"),
    "vocabulary_of_numbers": (_with({"cup": [1]}, "vocabulary"), "a list of texts is wanted"),
    "flat_matrix": (_with(np.zeros(9), "images", "left", "K"), "(3, 3) numbers"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_is_told_before_the_connection_ends(name: str) -> None:
    """A text frame with the kind of error and its place, then code 1011; others are served on."""
    message, said = BAD[name]
    with serving() as server, client(server) as other:
        other.recv(timeout=10)
        with client(server) as connection:
            connection.recv(timeout=10)
            told = ask(connection, message)
            assert isinstance(told, str)
            assert told.startswith("bad_message: ")
            assert said in told
            with pytest.raises(ConnectionClosed) as closed:
                connection.recv(timeout=10)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1011
        assert ask(other, GOOD)["actions"].shape == (15, 23)
        assert server.metrics.errors == {"bad_message": 1}


@pytest.mark.parametrize(
    ("infer", "said"),
    [
        (lambda observation: 1 / 0, "ZeroDivisionError"),
        (lambda observation: np.zeros((0, 23)), "(H, 23)"),
        (lambda observation: np.zeros(23), "(H, 23)"),
        (lambda observation: np.full((1, 23), np.nan), "finite"),
        (lambda observation: "go left", "ValueError"),
    ],
)
def test_a_policy_that_breaks_is_told_to_its_client(infer: Callable[[Any], Any], said: str) -> None:
    """Its exception goes to the client as text, with code 1011; no broken action goes to a robot."""

    def make(vocabulary: Vocabulary) -> Probe:
        policy = Probe()
        policy.infer = infer  # type: ignore[method-assign, assignment]
        return policy

    with serving(make) as server, client(server) as connection:
        connection.recv(timeout=10)
        told = ask(connection, GOOD)
        assert told.startswith("policy_failed: ")
        assert said in told
        with pytest.raises(ConnectionClosed):
            connection.recv(timeout=10)
        assert server.metrics.errors == {"policy_failed": 1}


def test_a_policy_that_cannot_be_made_is_told_too() -> None:
    """In the place of the metadata."""

    def make(vocabulary: Vocabulary) -> Probe:
        raise RuntimeError("no weights")

    with serving(make) as server, client(server) as connection:
        told = connection.recv(timeout=10)
        assert isinstance(told, str)
        assert "no weights" in told


def test_a_huge_frame_is_refused_before_it_is_read() -> None:
    """100 MB end the connection with code 1009; the server lives on."""
    with serving() as server, client(server) as connection:
        connection.recv(timeout=10)
        with contextlib.suppress(ConnectionClosed):  # it may be refused while it is being sent
            connection.send(bytes(MAX_BYTES + 1))
        with pytest.raises(ConnectionClosed) as closed:
            connection.recv(timeout=10)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1009
        with client(server) as again:
            again.recv(timeout=10)
            assert "actions" in ask(again, GOOD)


def _eventually(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not holds() and time.monotonic() < end:
        time.sleep(0.01)
    assert holds()


@pytest.mark.parametrize("when", ["idle", "thinking", "mid_frame"])
def test_clients_that_vanish_leave_nothing_behind(when: str) -> None:
    """A connection that is torn down, at rest, in an inference, or in a frame, is forgotten; its policy is closed."""
    threads = threading.active_count()
    go = threading.Event()
    made: list[Probe] = []

    def make(vocabulary: Vocabulary) -> Probe:
        made.append(Probe(work=lambda: go.wait(10)))
        return made[-1]

    with contextlib.ExitStack() as stack, serving(make) as server:
        connection = stack.enter_context(client(server))
        connection.recv(timeout=10)
        if when == "thinking":
            connection.send(pack(GOOD))
            time.sleep(0.1)
        elif when == "mid_frame":
            connection.socket.sendall(b"\x82\xff" + (1000).to_bytes(8, "big") + b"mask" + b"half")
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.socket.shutdown(socket.SHUT_RD) if when == "idle" else None
        connection.close_socket()
        _eventually(lambda: server.metrics.clients == 0)
        go.set()
        _eventually(lambda: made[0].closed)
        with client(server) as again:
            again.recv(timeout=10)
            assert "actions" in ask(again, GOOD)
    _eventually(lambda: threading.active_count() <= threads)


@pytest.mark.parametrize(
    "said", [b"\x00\x01\x02" * 100, b"GET / HTTP/1.1\r\n\r\n", b"POST /healthz HTTP/1.1\r\n\r\n", b""]
)
def test_what_is_no_websocket_is_turned_away(said: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    """Bytes that are not even HTTP harm nobody, and nothing is printed of them."""
    with serving() as server:
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw, contextlib.suppress(OSError):
            raw.sendall(said)
            raw.shutdown(socket.SHUT_WR)
            raw.recv(4096)
        with client(server) as connection:
            connection.recv(timeout=10)
            assert "actions" in ask(connection, GOOD)
    assert capfd.readouterr() == ("", "")


def _get(server: PolicyServer, path: str) -> tuple[int, str]:
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}{path}", timeout=10) as response:
        return response.status, response.read().decode()


def test_health_is_openpis() -> None:
    """`GET /healthz` is 200 with "OK"."""
    with serving() as server:
        assert _get(server, "/healthz") == (200, "OK\n")


def test_metrics_are_prometheus_text() -> None:
    """Every line is a comment or a sample; the buckets add up; what has happened is counted."""
    with serving() as server:
        with client(server) as connection:
            connection.recv(timeout=10)
            for _ in range(3):
                ask(connection, GOOD)
            ask(connection, "garbage")
            _eventually(lambda: server.metrics.clients == 0)
        status, text = _get(server, "/metrics")
    assert status == 200
    sample = re.compile(r'(mpvi_serve_[a-z_]+)(\{[a-z]+="[^"]+"\})? ([0-9.]+)')
    lines = [line for line in text.splitlines() if not line.startswith("# ")]
    samples = {match[1] + (match[2] or ""): float(match[3]) for line in lines if (match := sample.fullmatch(line))}
    assert len(samples) == len(lines)
    assert samples["mpvi_serve_infer_seconds_count"] == samples['mpvi_serve_infer_seconds_bucket{le="+Inf"}'] == 3
    assert samples['mpvi_serve_errors_total{kind="bad_message"}'] == 1
    assert samples["mpvi_serve_connections_total"] == 1
    assert samples["mpvi_serve_received_bytes_total"] == 3 * len(pack(GOOD))


def test_a_key_is_asked_for_where_one_is_set() -> None:
    """Without it, or with another, the handshake is refused with 401; health needs none."""
    with serving(api_key="sesame") as server:
        for headers in ({}, {"Authorization": "Api-Key open"}, {"Authorization": "Bearer sesame"}):
            with pytest.raises(InvalidStatus) as refused:
                client(server, additional_headers=headers)
            assert refused.value.response.status_code == 401
        assert _get(server, "/healthz")[0] == 200
        with client(server, additional_headers={"Authorization": "Api-Key sesame"}) as connection:
            connection.recv(timeout=10)
            assert "actions" in ask(connection, GOOD)


def test_no_web_page_may_drive_a_robot() -> None:
    """Browsers say where a script comes from; such a connection is refused."""
    with serving() as server, pytest.raises(InvalidStatus) as refused:
        client(server, origin="https://example.org")
    assert refused.value.response.status_code == 403


def test_too_many_clients_are_told_so() -> None:
    """Each client costs a policy and a thread; beyond the most, 503."""
    with serving() as server, contextlib.ExitStack() as stack:
        for _ in range(MOST_CLIENTS):
            stack.enter_context(client(server)).recv(timeout=10)
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://127.0.0.1:{server.port}")
        assert refused.value.response.status_code == 503


def test_idle_clients_make_room_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many as there may be that ask nothing are told to go (1001); who asks now and then stays."""
    monkeypatch.setattr("mpvi_bt.executive.remote.server.MOST_CLIENTS", 4)
    with serving(lambda _: Probe(), idle_s=2.0) as server, contextlib.ExitStack() as stack:
        busy, *idle = [stack.enter_context(client(server)) for _ in range(4)]
        received(busy)
        while server.metrics.clients > 1:
            busy.send(pack(GOOD))
            received(busy)
            time.sleep(0.1)
        for connection in idle:
            received(connection)  # the metadata
            with pytest.raises(ConnectionClosed) as closed:
                connection.recv(timeout=10)
            assert closed.value.rcvd is not None
            assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1001, "nothing was asked for 2 s")
        received(stack.enter_context(client(server)))


def test_a_client_that_was_let_go_comes_back() -> None:
    """Ours makes a new connection when it has something to ask."""
    with serving(idle_s=0.2) as server:
        policy = OpenpiPolicy(f"127.0.0.1:{server.port}", "mpvi")
        policy.reset()
        _eventually(lambda: server.metrics.clients == 0)
        assert policy.infer(observation()).shape == (15, 23)
        assert policy.connections == 2
        policy.close()


def test_a_client_counts_until_its_policy_is_done() -> None:
    """Who asks and leaves, again and again, gets no more threads than clients that stay."""
    go = threading.Event()
    with serving(lambda _: Probe(work=lambda: go.wait(30))) as server, contextlib.ExitStack() as stack:
        stack.callback(go.set)
        for _ in range(MOST_CLIENTS):
            with client(server) as connection:
                connection.recv(timeout=10)
                connection.send(pack(GOOD))
        _eventually(lambda: server.metrics.clients == 0)
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://127.0.0.1:{server.port}")
        assert refused.value.response.status_code == 503
        go.set()
        _eventually(lambda: not any(session.is_at_work() for session in server._sessions))
        with client(server) as again:
            again.recv(timeout=10)
            assert "actions" in ask(again, GOOD)


def test_who_does_not_wait_for_answers_gets_them_in_order() -> None:
    """Observations that come before an answer are held up on the way, not piled up, and none is lost."""
    with serving(lambda _: Probe()) as server, client(server) as connection:
        received(connection)
        packed = pack(write_observation(observation(size=64)))

        def send() -> None:
            for _ in range(50):
                connection.send(packed)

        sender = threading.Thread(target=send)
        sender.start()
        assert [received(connection)["note"] for _ in range(50)] == [f"call {n + 1}" for n in range(50)]
        sender.join(10)


def test_clients_are_told_when_the_server_ends() -> None:
    """Code 1001, even to one whose policy hangs."""
    go = threading.Event()
    with contextlib.ExitStack() as stack:
        with serving(lambda _: Probe(work=lambda: go.wait(30))) as server:
            connection = stack.enter_context(client(server))
            connection.recv(timeout=10)
            connection.send(pack(GOOD))
            time.sleep(0.1)
        with pytest.raises(ConnectionClosed) as closed:
            connection.recv(timeout=10)
        go.set()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1001


def _keys(message: Mapping[str, Any], where: str = "") -> set[str]:
    """Dotted keys of the values in a message; left and right, and the cameras, are one."""
    found = set()
    for key, value in message.items():
        key = {"head": "CAMERA", "left": "left", "right": "left"}.get(key, key)
        key = "CAMERA" if where == "images." and key == "left" else key
        deeper = isinstance(value, dict) and key not in ("names", "vocabulary")
        found |= _keys(value, f"{where}{key}.") if deeper else {f"{where}{key}"}
    return found


def test_what_is_sent_and_answered_is_documented() -> None:
    """The page's tables name every key, metric and error, and no other."""
    page = (Path(__file__).parent.parent / "docs" / "serving_policies.md").read_text()
    section = page[page.index("## Serving a policy") : page.index("## Writing a server")]
    sent, answered = section.split("### What it answers")
    rows = re.compile(r"^\| `([^`]+)`", re.MULTILINE)
    asked = {**write_observation(observation(), True, {"a": ["b"]}), "rate_hz": 10.0}  # a client of its own rate
    assert set(rows.findall(sent)) == _keys(asked)
    with serving() as server, client(server) as connection:
        metadata = received(connection)
        ask(connection, GOOD)
        answer = ask(connection, GOOD)
        ask(connection, "garbage")
        metrics = set(re.findall(r"# TYPE (\S+)", server.metrics.text()))
    documented = rows.findall(answered) + re.findall(r"`(mpvi_serve_\w+)", answered)
    told = _keys(answer) | {"rate_hz"}  # which this policy does not say
    assert {name.removesuffix("{kind}") for name in documented} == told | metrics
    assert all(f'"{key}": ' in section for key in metadata)


def test_reading_says_where() -> None:
    """Errors name the place in the message, and what is known there."""
    with pytest.raises(BadMessage, match=r"proprioception.arm: unknown key 'lef'. Did you mean 'left'"):
        read_observation(_with(np.zeros(7), "proprioception", "arm", "lef"))


PICTURES = """
import asyncio, resource
import numpy as np
from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.executive.remote.server import SocketServer
from tests.serving import grip

frame = pack({str(k): np.zeros((224, 224, 7), np.uint8) for k in range(3)})

def faults():
    for _ in range(5):
        unpack(bytes(bytearray(frame)))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        unpack(bytes(bytearray(frame)))
    return (resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before) / 20

async def serve():
    async with SocketServer("probe", grip).listening("127.0.0.1", 0):
        print(faults())

asyncio.run(serve())
"""


def test_a_server_asks_the_system_for_no_memory_for_each_message() -> None:
    """Of three pictures: hundreds of pages would be cleared for each, which takes longer than to unpack them."""
    done = subprocess.run([sys.executable, "-c", PICTURES], capture_output=True, text=True, check=True, timeout=120)
    assert float(done.stdout) < 20
