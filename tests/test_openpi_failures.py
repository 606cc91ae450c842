"""Policy servers that fail, over real sockets: every wait ends, every failure has a reason, what can be mended is."""

from __future__ import annotations

import contextlib
import os
import random
import re
import socket
import ssl
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.server import ServerConnection

import mpvi_bt
from mpvi_bt.executive.remote.connection import KEY
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.ground.errors import PolicyError
from mpvi_bt.testing import check_policy
from tests.layouts import ACTION_SIZE, BASE, LAYOUT
from tests.remote_clients import CHUNK, QUICK, fails, observation, policy_at, quick
from tests.remote_servers import (
    HOST,
    PolicyServer,
    agreed,
    broken,
    certificate,
    free_port,
    packed,
    raw_server,
    unpacked,
)


@pytest.fixture(autouse=True)
def _no_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(KEY, raising=False)


def talking(first: Callable[[ServerConnection], None]) -> PolicyServer:
    """A server that misbehaves on every connection after good metadata and one message."""

    def talk(connection: ServerConnection, number: int) -> None:
        connection.send(packed({}))
        connection.recv()
        first(connection)
        time.sleep(0.2)

    return PolicyServer(talk=talk)


def test_every_reason_is_documented() -> None:
    """The page lists each reason code that the package gives, and no other."""
    package = Path(mpvi_bt.__file__).parent
    texts = [path.read_text(encoding="utf-8") for path in (package / "executive" / "remote").glob("*.py")]
    given = {reason for text in texts for reason in re.findall(r'(?:PolicyError|Lost)\(\s*"(\w+)"', text)}
    given |= {"unauthorized", "server_error"}  # chosen by close code
    page = (package.parent / "docs" / "policy_servers.md").read_text(encoding="utf-8")
    table = page.partition("## When a server fails")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == given


# A server that is not there, or comes late


def test_an_absent_server() -> None:
    """It is waited for as long as the settings say, at reset and at inference, and no longer."""
    policy = OpenpiPolicy(f"{HOST}:{free_port()}", quick(connect_s=0.6))
    with fails("server_absent", 1.5, "connection refused, for 0.6", "connect_s"):
        policy.reset()
    with fails("server_absent", 1.5):
        policy.infer(observation())


def test_a_host_that_does_not_exist() -> None:
    """Waiting helps no misspelled name: it is told at once."""
    with fails("server_absent", 8.0, "no such host"):
        policy_at("ws://no-such-host.invalid:8000", connect_s=30.0).reset()


@pytest.mark.parametrize("proxy", ["http://127.0.0.1:{port}", "socks5://127.0.0.1:{port}", "gopher://x"])
def test_a_proxy_that_does_not_work(proxy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A proxy of the environment leads elsewhere, and its failure is told; to this machine there is none."""
    for name in ("http_proxy", "https_proxy", "all_proxy", "ws_proxy"):
        monkeypatch.setenv(name, proxy.format(port=free_port()))
    with fails("server_absent", 3.0):
        policy_at("ws://gpu.example:8000", connect_s=0.5).reset()
    with PolicyServer() as server:
        policy_at(server).reset()


def test_a_server_that_comes_late() -> None:
    """One that begins to listen while it is waited for is used."""
    port = free_port()
    started: list[PolicyServer] = []
    later = threading.Timer(0.7, lambda: started.append(PolicyServer(port=port)))
    later.start()
    policy = policy_at(f"{HOST}:{port}", connect_s=10.0)
    policy.reset()
    assert policy.infer(observation()).shape == (4, ACTION_SIZE)
    started[0].stop()


def test_a_server_that_is_starting() -> None:
    """While a proxy answers 503 for it, /healthz is asked until it is well."""
    with PolicyServer(starting=3) as server:
        policy_at(server, connect_s=10.0).infer(observation())
        assert server.health == 3
    with PolicyServer(starting=1000) as server, fails("server_absent", 2.0, "503"):
        policy_at(server, connect_s=0.5).reset()


def raw_web(healthz: Callable[[socket.socket], None]) -> Callable[[socket.socket], None]:
    """A web server that is starting, and answers /healthz otherwise."""

    def talk(client: socket.socket) -> None:
        if b"/healthz" in client.recv(4096):
            healthz(client)
        else:
            client.sendall(b"HTTP/1.1 503 Starting\r\nContent-Length: 0\r\n\r\n")

    return talk


def test_health_that_drips() -> None:
    """A byte of /healthz now and then keeps nobody longer than a connection may take."""

    def drip(client: socket.socket) -> None:
        client.sendall(b"HTTP/1.1 200 OK\r\nX: ")
        for _ in range(60):
            client.sendall(b"x")
            time.sleep(0.1)

    with raw_server(raw_web(drip)) as address, fails("server_absent", 2.5, "503"):
        policy_at(address, connect_s=1.0).reset()


def test_health_that_points_elsewhere() -> None:
    """Nobody else is asked: where /healthz is said to be is not looked at."""
    asked: list[bytes] = []

    def other(client: socket.socket) -> None:
        asked.append(client.recv(4096))

    with raw_server(other) as elsewhere:
        there = f"HTTP/1.1 302 Found\r\nLocation: http{elsewhere[2:]}/\r\nContent-Length: 0\r\n\r\n".encode()
        with raw_server(raw_web(lambda client: client.sendall(there))) as address, fails("server_absent", 2.5, "503"):
            policy_at(address, connect_s=1.0).reset()
    assert not asked


# A server that breaks


def test_a_server_that_dies_in_mid_chunk_and_comes_back() -> None:
    """A connection that breaks is made anew, and the same observation is sent again."""

    def talk(connection: ServerConnection, number: int) -> None:
        connection.send(packed({}))
        for _ in range(1 if number == 0 else 9):
            messages.append(unpacked(bytes(connection.recv())))  # type: ignore[arg-type]
            connection.send(packed({"actions": CHUNK + number}))
        connection.recv()
        broken(connection)

    messages: list[Any] = []
    with PolicyServer(talk=talk) as server:
        policy = policy_at(server)
        first, second = policy.infer(observation()), policy.infer(observation())
        assert not np.array_equal(first, second)
        assert policy.connections == server.connections == 2
        assert np.array_equal(messages[0]["observation/state"], messages[1]["observation/state"])


def test_a_server_that_breaks_every_connection() -> None:
    """It is tried so often as the settings say, then the backend has failed."""
    with talking(broken) as server:
        with fails("server_closed", 6.0, "the connection broke"):
            policy_at(server).infer(observation())
        assert server.connections == 1 + QUICK["tries"]


@pytest.mark.parametrize("code", [1000, 1001, 1012, 1013])
def test_a_server_that_goes_away_politely(code: int) -> None:
    """A close that says "later" or "restarting" is tried again like a broken connection."""
    with talking(lambda c: c.close(code, "bye\nbye")) as server:
        with fails("server_closed", 6.0, str(code)):
            policy_at(server).infer(observation())
        assert server.connections == 3


def test_a_server_that_dies_and_stays_away() -> None:
    """Reconnecting ends: it was there, so it is closed, not absent."""
    server = PolicyServer()
    policy = policy_at(server, connect_s=0.6, answer_s=5.0)
    policy.infer(observation())
    server.stop()
    with fails("server_closed", 4.0, "connection refused"):
        policy.infer(observation())


def test_a_server_that_restarts() -> None:
    """Between two inferences or in the middle of one, a restart at the same address costs only time."""
    server = PolicyServer()
    policy = policy_at(server, connect_s=10.0, answer_s=10.0)
    policy.infer(observation())
    server.stop()
    again: list[PolicyServer] = []
    threading.Timer(0.5, lambda: again.append(PolicyServer(port=server.port))).start()
    assert policy.infer(observation()).shape == (4, ACTION_SIZE)
    policy.reset()
    again[0].stop()


def test_a_restarted_server_may_want_other_pictures() -> None:
    """One that forgot is fresh: if it wants pictures that were not taken, the robot is held still for that step."""
    with PolicyServer(lambda message: {"actions": CHUNK, "cameras": []}, {"cameras": ["head"]}) as server:
        policy = policy_at(server)
        policy.reset()
        policy.infer(observation(("head",)))
        broken(server.open[0])
        without = observation(())
        felt = without["proprioception"]
        still = policy.infer(without)
        assert policy.cameras == ("head",)
        assert not still[:, BASE].any()
        assert (still[0, LAYOUT.arm["left"]] == felt.arm_command.get("left", felt.arm["left"])).all()
        assert np.array_equal(policy.infer(observation(("head",)))[:, 3:], CHUNK[:, 3:].astype(float))


def test_a_frame_that_ends_in_the_middle() -> None:
    """A connection that breaks within a frame is a broken connection."""

    def halve(connection: ServerConnection) -> None:
        connection.socket.sendall(b"\x82\x7e\xff\xff half")
        broken(connection)

    with talking(halve) as server, fails("server_closed", 6.0):
        policy_at(server).infer(observation())


# A server that hangs


def test_a_server_that_never_answers() -> None:
    """The wait for an answer ends; it is not asked again, and a late answer is never taken for that of a later call."""
    slow = iter([1.5, 0.0])

    def answer(message: Any) -> Any:
        time.sleep(next(slow))
        return {"actions": CHUNK + len(server.received)}

    with PolicyServer(answer) as server:
        policy = policy_at(server, answer_s=0.7)
        with fails("server_timeout", 3.0):
            policy.infer(observation())
        assert len(server.received) == 1
        time.sleep(1.2)
        assert np.array_equal(policy.infer(observation())[:, 3:], (CHUNK + 2)[:, 3:])


def test_a_server_that_accepts_and_says_nothing() -> None:
    """Neither a handshake nor metadata that never come are waited for longer than a connection may take."""
    with raw_server(lambda client: time.sleep(1.5)) as address, fails("server_timeout", 2.0):
        policy_at(address, connect_s=0.5).reset()
    with PolicyServer(talk=lambda c, n: time.sleep(1.5)) as server, fails("server_timeout", 3.0):
        policy_at(server, connect_s=0.5).reset()


def test_a_server_that_does_not_read() -> None:
    """An observation that does not fit into what the network buffers is not sent for ever."""

    def talk(connection: ServerConnection, number: int) -> None:
        connection.send(packed({}))
        with connection.protocol_mutex:  # its reader stops
            over.wait(20)

    over = threading.Event()
    settings = quick(observation=None, answer_s=0.7)
    seen = observation()
    image = seen["images"]["head"]
    big = np.zeros((2000, 3000, 3), np.uint8)
    seen["images"]["head"] = type(image)("head", big, np.zeros(big.shape[:2], np.float32), None, {}, image.K, np.eye(4))
    with PolicyServer(talk=talk) as server:
        with fails("server_timeout", 6.0):
            OpenpiPolicy(server.address, settings).infer(seen)
        over.set()


def pinging(during: Callable[[ServerConnection], object] = lambda c: None) -> PolicyServer:
    """A server that pings without end and reads nothing, so that the client's receiving thread waits to answer."""

    def talk(connection: ServerConnection, number: int) -> None:
        connection.send(packed({}))
        during(connection)
        end = threading.Timer(12.0, broken, [connection])
        end.start()
        with connection.protocol_mutex, contextlib.suppress(OSError):  # its reader stops
            while True:
                connection.socket.sendall((b"\x89\x7d" + bytes(125)) * 100)
        end.cancel()

    return PolicyServer(talk=talk)


def test_a_server_that_pings_and_does_not_read() -> None:
    """A client that is stuck in answering pings still ends when its time is up."""
    with pinging(lambda c: c.recv()) as server, fails("server_timeout", 4.0):
        policy_at(server, answer_s=0.7).infer(observation())


@pytest.mark.parametrize("dropped", [False, True])
def test_leaving_a_server_that_pings_and_does_not_read(dropped: bool) -> None:
    """To close the policy, or only to drop it, takes no longer than a farewell."""
    with pinging() as server:
        policy = policy_at(server)
        policy.reset()
        there = weakref.ref(policy)
        time.sleep(0.7)  # until both ends are stuck
        began = time.monotonic()
        if dropped:
            del policy
            assert there() is None  # a collection of the tests' garbage would count as leaving
        else:
            policy.close()
        assert time.monotonic() - began < 3.0


def test_a_server_that_drips() -> None:
    """One byte now and then is no answer: the wait is for the whole of it."""

    def drip(connection: ServerConnection) -> None:
        connection.socket.sendall(b"\x82\x7e\x10\x00")
        for _ in range(30):
            connection.socket.sendall(b"x")
            time.sleep(0.1)

    with talking(drip) as server, fails("server_timeout", 3.5):
        policy_at(server, answer_s=0.7).infer(observation())


def test_an_interrupted_wait_leaves_no_answer_behind() -> None:
    """After Ctrl-C in the middle of a question, the next question gets its own answer."""
    with PolicyServer(lambda message: {"actions": CHUNK + len(server.received)}) as server:
        policy = policy_at(server)
        policy.reset()
        asked = policy._connection
        assert asked is not None

        def interrupt(deadline: float) -> Any:
            raise KeyboardInterrupt

        asked.receive = interrupt  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            policy.infer(observation())
        assert np.array_equal(policy.infer(observation())[:, 3:], (CHUNK + 2)[:, 3:])


def test_an_answer_that_nobody_asked_for() -> None:
    """A server that answers twice is a question ahead: it is found out before its answer is taken for another's."""

    def talk(connection: ServerConnection, number: int) -> None:
        connection.send(packed({}))
        while True:
            connection.recv()
            connection.send(packed({"actions": CHUNK}))
            if number == 0:
                connection.send(packed({"actions": -CHUNK}))

    with PolicyServer(talk=talk) as server:
        policy = policy_at(server)
        policy.infer(observation())
        time.sleep(0.2)
        with fails("bad_reply", 3.9, "nobody asked for"):
            policy.infer(observation())
        assert (policy.infer(observation())[:, 3:] >= 0).all()


# A server that answers garbage

SPOILED = {
    "nan": np.where(CHUNK == CHUNK[1, 7], np.nan, CHUNK),
    "infinite": np.where(CHUNK == CHUNK[1, 7], np.inf, CHUNK),
    "too few numbers": CHUNK[:, :22],
    "too many numbers": np.zeros((4, 32)),
    "three axes": np.zeros((2, 4, ACTION_SIZE)),
    "an empty chunk": CHUNK[:0],
    "truth values": CHUNK > 0,
    "text": CHUNK.astype("U4"),
    "a list": CHUNK.tolist(),
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_chunk_that_no_robot_can_carry_out(name: str) -> None:
    """Wrong numbers, shapes and dtypes are a bad reply at once; a later call begins on a new connection."""
    replies = iter([SPOILED[name], CHUNK])
    with PolicyServer(lambda message: {"actions": next(replies)}) as server:
        policy = policy_at(server)
        with fails("bad_reply", 3.9):
            policy.infer(observation())
        assert policy.infer(observation()).shape == (4, ACTION_SIZE)
        assert server.connections == 2


def test_a_chunk_far_out_of_reach_is_still_a_chunk() -> None:
    """1e30 radians are finite: they come through, for the limits of the robot to clip and count."""
    with PolicyServer(lambda message: {"actions": np.full((1, ACTION_SIZE), 1e30)}) as server:
        assert (policy_at(server).infer(observation())[:, 3:] == 1e30).all()


GARBAGE = {
    "random bytes": random.Random(0).randbytes(200),
    "nothing": b"",
    "half a message": packed({"actions": CHUNK})[:-1],
    "two messages": packed({"actions": CHUNK}) * 2,
    "no mapping": packed([1, 2, 3]),
    "another key": packed({"action": CHUNK}),
    "an array of objects": packed({"actions": {b"__ndarray__": True, b"data": b"x", b"dtype": "|O", b"shape": [1]}}),
    "an array that is not there": packed(
        {"actions": {b"__ndarray__": True, b"data": b"x", b"dtype": "<f8", b"shape": [2**40, 23]}}
    ),
}


@pytest.mark.parametrize("name", GARBAGE)
def test_a_frame_that_is_no_reply(name: str) -> None:
    """Whatever a binary frame holds, it is refused at once."""
    with PolicyServer(lambda message: GARBAGE[name]) as server, fails("bad_reply", 3.9):
        policy_at(server).infer(observation())


@pytest.mark.parametrize("metadata", [b"\xc1", packed([1]), packed("hello"), b""], ids=repr)
def test_metadata_that_are_none(metadata: bytes) -> None:
    """The first frame is a mapping, or the server is none of ours."""
    with PolicyServer(talk=lambda connection, number: connection.send(metadata)) as server, fails("bad_reply", 3.9):
        policy_at(server).reset()


@pytest.mark.parametrize(
    "said",
    [b"SSH-2.0-OpenSSH_9.6\r\n", b"\x00" * 50 + b"\r\n", b"HTTP/1.1 two hundred\r\n\r\n", b"HTTP/1.1 200 OK\r\n\r\n"],
    ids=repr,
)
def test_a_server_of_another_kind(said: bytes) -> None:
    """What speaks something else at that port is told from a server that is not there."""

    def talk(client: socket.socket) -> None:
        client.recv(4096)
        client.sendall(said)
        time.sleep(0.2)

    with raw_server(talk) as address, fails("bad_reply", 3.9):
        policy_at(address).reset()


BANNERS = {
    "SSH": b"SSH-2.0-OpenSSH_9.6\r\n",
    "SMTP": b"220 mail.example.org ESMTP Postfix\r\n",
    "MySQL": b"J\x00\x00\x00\n8.0.35\x00\x08\x00\x00\x00abcdefgh\x00\xff\xff\xff\x02\x00",
    "telnet": b"\xff\xfd\x18\xff\xfd\x20",
}


@pytest.mark.parametrize("name", BANNERS)
def test_a_server_that_speaks_first(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """It is no websocket, which is known at once, whoever is quicker with the first word, line end or not."""
    over = threading.Event()

    def talk(client: socket.socket) -> None:
        client.sendall(BANNERS[name])
        over.wait(30)

    with raw_server(talk) as address:
        for _ in range(10):
            with fails("bad_reply", 2.5, "does not speak HTTP"):
                policy_at(address).reset()
    over.set()
    assert capfd.readouterr() == ("", "")


def test_a_handshake_in_small_pieces() -> None:
    """It speaks HTTP wherever the network cuts its answer: within the first line, after it, within a header."""

    def talk(client: socket.socket) -> None:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        answer = Pieces(client)
        agreed(answer)  # type: ignore[arg-type]
        client.sendall(bytes([0x82, len(packed({}))]) + packed({}))
        over.wait(30)

    class Pieces:
        def __init__(self, client: socket.socket) -> None:
            self.recv, self._send = client.recv, client.sendall

        def sendall(self, data: bytes) -> None:
            for k in range(0, len(data), 7):
                self._send(data[k : k + 7])
                time.sleep(0.01)

    over = threading.Event()
    with raw_server(talk) as address:
        policy_at(address).reset()
    over.set()


def test_what_hangs_up_in_the_middle_of_the_handshake() -> None:
    """It may be starting, so it is tried until time is up, and then it was there."""

    def talk(client: socket.socket) -> None:
        client.recv(4096)
        client.sendall(b"HTTP/1.1 101 Swi")

    with raw_server(talk) as address, fails("server_closed", 2.0):
        policy_at(address, connect_s=0.6).reset()


@pytest.mark.parametrize("status", [b"404 Not Found", b"302 Found\r\nLocation: http://other/", b"400 Bad", b"500 Oops"])
def test_a_web_server_without_a_policy(status: bytes) -> None:
    """Its answer is told, and it is followed to no other protocol."""

    def talk(client: socket.socket) -> None:
        client.recv(4096)
        client.sendall(b"HTTP/1.1 " + status + b"\r\nContent-Length: 0\r\n\r\n")

    with (
        raw_server(talk) as address,
        fails("bad_reply", 3.9, *([] if b"Location" in status else [status[:3].decode()])),
    ):
        policy_at(address).reset()


AGAINST_THE_RULES = {
    "an unknown opcode": (b"\x83\x01x", "opcode"),
    "reserved bits": (b"\xf2\x01x", "reserved bits"),
    "a mask": (b"\x82\x81abcdx", "masking"),
    "a length of 64 bits": (b"\x82\xff" + b"\xff" * 12, "1002"),
    "a gigabyte": (b"\x82\x7f" + (1 << 30).to_bytes(8, "big"), "1073741824 bytes"),
    "broken UTF-8": (b"\x81\x02\xff\xff", "1007"),
    "an end of nothing": (b"\x80\x01x", "continuation"),
}


@pytest.mark.parametrize("when", ["metadata", "answer"])
@pytest.mark.parametrize("name", AGAINST_THE_RULES)
def test_frames_against_the_rules(name: str, when: str) -> None:
    """They are the server's fault, and told at once as what they are, though the server neither reads nor closes."""
    frame, words = AGAINST_THE_RULES[name]
    over = threading.Event()

    def talk(client: socket.socket) -> None:
        agreed(client)
        if when == "answer":
            client.sendall(bytes([0x82, len(packed({}))]) + packed({}))
            client.recv(1 << 20)
        client.sendall(frame)
        over.wait(30)

    with raw_server(talk) as address, fails("bad_reply", 2.5, words):
        policy_at(address).infer(observation())
    over.set()


def test_a_farewell_that_does_not_hang_up() -> None:
    """A server that closes the websocket, and keeps the socket, has said all that there is to wait for."""
    over = threading.Event()

    def talk(client: socket.socket) -> None:
        agreed(client)
        client.sendall(b"\x88\x06\x03\xf3oops")
        over.wait(30)

    with raw_server(talk) as address, fails("server_error", 2.5, "1011", "oops"):
        policy_at(address).reset()
    over.set()


ASK = """
import resource, sys
from mpvi_bt.ground.errors import PolicyError
from tests.remote_clients import observation, policy_at
policy = policy_at(sys.argv[1])
policy.reset()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    policy.infer(observation())
except PolicyError as error:
    print(error.reason, "1009" in str(error), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.parametrize("fragments", [1, 50])
def test_frames_of_a_hundred_megabytes(fragments: int) -> None:
    """What is larger than the settings allow is refused while it comes in, whole or in pieces, and takes no memory."""

    def flood(connection: ServerConnection) -> None:
        piece = bytes(100_000_000 // fragments)
        connection.send(piece if fragments == 1 else (piece for _ in range(fragments)))

    with talking(flood) as server:  # the client is a process of its own: the server needs memory, too
        command = [sys.executable, "-c", ASK, server.address]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    reason, is_told, more_kb = done.stdout.split()
    assert (reason, is_told) == ("bad_reply", "True")
    assert int(more_kb) < 20_000


# A server that says no


def test_an_error_frame_is_told_by_its_last_line() -> None:
    """A traceback's end says what was wrong; it is not asked again, and the next call begins anew."""
    answers: Iterator[Any] = iter([KeyError("observation/state"), {"actions": CHUNK}])

    def answer(message: Any) -> Any:
        if isinstance(reply := next(answers), Exception):
            raise reply
        return reply

    with PolicyServer(answer) as server:
        policy = policy_at(server)
        with fails("server_error", 3.9, "KeyError: 'observation/state'"):
            policy.infer(observation())
        assert len(server.received) == 1
        assert policy.infer(observation()).shape == (4, ACTION_SIZE)


def test_an_error_without_words() -> None:
    """BEHAVIOR's servers close with 1011 and say nothing more."""
    with talking(lambda c: c.close(1011, "Internal server error")) as server, fails("server_error", 3.9, "1011"):
        policy_at(server).infer(observation())


@pytest.mark.parametrize("code", [1003, 1007, 1011, 1000])
def test_a_server_that_answers_nothing_may_not_fit_the_settings(code: int) -> None:
    """However it hangs up on the first observation, the message names the settings in use and the others."""
    with talking(lambda c: c.close(code, "")) as server:
        policy = OpenpiPolicy(server.address, quick(tries=0), called="openpi_comet")
        with pytest.raises(
            PolicyError, match=r"settings openpi_comet may not fit it .*--policy-settings: .*behavior_2026"
        ):
            policy.infer(observation())
    sent = "when sent prompt, observation/egocentric_camera"
    with (
        PolicyServer(lambda message: {"actions": message["observation/image"]}) as server,
        fails("server_error", 3.9, "KeyError: 'observation/image'", sent),
    ):
        policy_at(server).infer(observation())
    with PolicyServer(lambda message: {"actions": CHUNK} if len(server.received) < 2 else message["never"]) as server:
        policy = policy_at(server)
        policy.infer(observation())
        with pytest.raises(PolicyError) as later:
            policy.infer(observation())
    assert "may not fit" not in str(later.value)


def test_an_error_that_came_before_the_question() -> None:
    """An openpi server that is sent a reset breaks on it: its words are still told at the next inference."""
    with PolicyServer(lambda message: {"actions": message["never"]}) as server:
        policy = policy_at(server, reset_message=True)
        policy.reset()
        time.sleep(0.3)
        with fails("server_error", 3.9, "KeyError: 'never'"):
            policy.infer(observation())


@pytest.mark.parametrize("where", ["reply", "metadata"])
@pytest.mark.parametrize("wanted", [np.array(["head", "left"]), ["head"], {"head": 1}, None, 7])
def test_cameras_that_are_no_names_are_passed_over(where: str, wanted: Any) -> None:
    """A list of cameras that has anything but names in it changes nothing, and breaks nothing."""
    said = {"cameras": [wanted]}
    with PolicyServer(lambda message: {"actions": CHUNK, **said}, said if where == "metadata" else None) as server:
        policy = policy_at(server)
        assert policy.infer(observation()).shape == (4, ACTION_SIZE)
        assert policy.cameras == ("head", "left", "right")


def test_keys_of_a_server_are_no_escape_sequences() -> None:
    """What its reply has in place of actions is told in printable words."""
    with PolicyServer(lambda message: {"\x1b]0;evil\x07\n\x00": 1}) as server, fails("bad_reply", 3.9, "evil"):
        policy_at(server).infer(observation())


def test_what_a_server_says_is_no_escape_sequence() -> None:
    """Its words are printed on a terminal: they are made printable, and short."""
    words = "boom\x1b]0;evil\x07\u2028" + "y" * 100_000
    with talking(lambda c: c.send(words)) as server, fails("server_error", 3.9, "boom ]0;evil yyy"):
        policy_at(server).infer(observation())


@pytest.mark.parametrize("key", ["", "wrong"])
def test_a_wrong_key(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told at once, with the name of the variable and not with the key."""
    if key:
        monkeypatch.setenv(KEY, key)
    with PolicyServer(key="sesame") as server:
        with fails("unauthorized", 5.0, "401", KEY):
            policy_at(server, connect_s=30.0).reset()
        with pytest.raises(PolicyError) as caught:
            policy_at(server).infer(observation())
        assert "wrong" not in str(caught.value)


def test_a_key_that_no_header_can_carry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Line breaks would forge headers."""
    monkeypatch.setenv(KEY, "a\r\nX-Evil: 1")
    with PolicyServer() as server, fails("unauthorized", 5.0):
        policy_at(server).reset()


def test_a_session_that_is_refused() -> None:
    """Closed with 1008, policy violation, right after the handshake: a key was wanted."""
    with PolicyServer(talk=lambda c, n: c.close(1008, "key")) as server, fails("unauthorized", 3.9, "1008"):
        policy_at(server).reset()


# TLS


@pytest.fixture(scope="module")
def pem(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    try:
        return certificate(tmp_path_factory.mktemp("tls"))
    except FileNotFoundError:
        pytest.skip("openssl, which makes a certificate, is not installed")


def served_with(pem: tuple[Path, Path]) -> PolicyServer:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*map(os.fspath, pem))
    return PolicyServer(context=context)


def test_a_certificate_that_nobody_signed(pem: tuple[Path, Path]) -> None:
    """It is refused at once."""
    with served_with(pem) as server, fails("tls", 3.9, "certificate"):
        policy_at(f"wss://{HOST}:{server.port}").reset()


def test_a_certificate_that_is_trusted(pem: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """SSL_CERT_FILE names more that are good; the name must fit, too."""
    monkeypatch.setenv("SSL_CERT_FILE", str(pem[0]))
    with served_with(pem) as server:
        # Time enough for a machine that is busy with other things: handshakes of TLS take the server's thread, too.
        check_policy(policy_at(f"wss://{HOST}:{server.port}", connect_s=30.0, answer_s=30.0))
        with fails("tls", 3.9, "ertificate"):
            policy_at(f"wss://localhost:{server.port}").reset()


def test_no_tls_where_it_is_asked_for() -> None:
    """wss:// to a server without TLS is a TLS failure, not a wait."""
    with PolicyServer() as server, fails("tls", 3.9):
        policy_at(f"wss://{HOST}:{server.port}").reset()


def test_tls_where_it_is_not_asked_for(pem: tuple[Path, Path]) -> None:
    """ws:// to a server with TLS ends, whatever it is called."""
    with served_with(pem) as server, pytest.raises(PolicyError):
        policy_at(server, connect_s=0.8).reset()
