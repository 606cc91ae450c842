"""Ways in which a policy's server fails, by name: over openpi's wire and over vla_eval's."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import msgpack
import numpy as np
from websockets.sync.server import ServerConnection

from tests.layouts import ACTION_SIZE, BASE, LAYOUT
from tests.remote_servers import HOST, PolicyServer, agreed, broken, free_port, packed, raw_server

Wire = Literal["openpi", "vla_eval"]
MOVING = np.zeros((4, ACTION_SIZE), np.float32)
MOVING[:, BASE] = [0.2, 0.1, 0.1]
MOVING[:, LAYOUT.arm["left"]] = MOVING[:, LAYOUT.arm["right"]] = 0.1
OVER = threading.Event()  # a server that waits need wait no more
WAIT_S = 8.0


@dataclass(frozen=True)
class ServerFault:
    """A way to fail.

    Attributes:
        wire: What is spoken.
        name: For a person.
        due: Reasons of which one has to be given; empty: it is no failure, or one that is mended,
        and the episode goes on.
        serve: The server, given the random numbers of a trial; gives its address.
    """

    wire: Wire
    name: str
    due: tuple[str, ...]
    serve: Callable[[random.Random], AbstractContextManager[str]]


FAULTS: list[ServerFault] = []


def _add(wire: Wire, name: str, due: str, serve: Callable[[random.Random], AbstractContextManager[str]]) -> None:
    FAULTS.append(ServerFault(wire, name, tuple(due.split()), serve))


# ------------------------------------------------------------------------------------------ before any answer


def _raw(talk: Callable[[socket.socket], object]) -> Callable[[random.Random], AbstractContextManager[str]]:
    def asked(client: socket.socket) -> None:
        talk(client)
        OVER.wait(0.1)

    return lambda draw: raw_server(asked)


def _http(answer: bytes) -> Callable[[socket.socket], None]:
    def talk(client: socket.socket) -> None:
        client.recv(4096)
        client.sendall(answer)

    return talk


def _slowly(client: socket.socket, data: bytes) -> None:
    """A byte now and then."""
    for k in range(len(data)):
        client.sendall(data[k : k + 1])
        if OVER.wait(0.1):
            return


def _status(status: str) -> bytes:
    return f"HTTP/1.1 {status}\r\nContent-Length: 0\r\n\r\n".encode()


def _asked(client: socket.socket, then: Callable[[], object]) -> None:
    client.recv(4096)
    then()


_HANDSHAKES: dict[str, tuple[str, Callable[[socket.socket], object]]] = {
    "says nothing": ("server_timeout", lambda c: OVER.wait(WAIT_S)),
    "hangs up at once": ("server_closed server_timeout", lambda c: c.close()),
    "hangs up in the handshake": ("server_closed server_timeout", _http(b"HTTP/1.1 101 Swi")),
    "stops in the handshake": ("server_timeout", lambda c: _asked(c, lambda: (c.sendall(b"HTTP/1.1 101 Swi"),
    OVER.wait(WAIT_S)))),
    "drips its handshake": ("server_timeout", lambda c: _asked(c, lambda: _slowly(c,
    b"HTTP/1.1 101 Yes\r\nX: " + b"x" * 99))),
    "404": ("bad_reply", _http(_status("404 Not Found"))),
    "429": ("bad_reply", _http(_status("429 Too Many Requests"))),
    "500": ("bad_reply", _http(_status("500 Oops"))),
    "302 to elsewhere": ("bad_reply", _http(_status("302 Found\r\nLocation: http://other/"))),
    "200 and no websocket": ("bad_reply", _http(_status("200 OK"))),
    "101 without an upgrade": ("bad_reply", _http(b"HTTP/1.1 101 Yes\r\n\r\n")),
    "another accept": ("bad_reply", _http(b"HTTP/1.1 101 Yes\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                                          b"Sec-WebSocket-Accept: AAAA\r\n\r\n")),
    "headers without end": ("bad_reply", _http(b"HTTP/1.1 101 Yes\r\n" + b"X: y\r\n" * 9000)),
    "401": ("unauthorized", _http(_status("401 No"))),
    "403": ("unauthorized", _http(_status("403 No"))),
    "503 for ever": ("server_absent", _http(_status("503 Starting"))),
    "SSH": ("bad_reply", lambda c: (c.sendall(b"SSH-2.0-OpenSSH_9.6\r\n"), OVER.wait(WAIT_S))),
    "bytes of no kind": ("bad_reply", lambda c: (c.sendall(bytes(range(256))), OVER.wait(WAIT_S))),
}  # fmt: skip
for _name, (_due, _talk) in _HANDSHAKES.items():
    _add("openpi", f"handshake: {_name}", _due, _raw(_talk))


@contextmanager
def _nobody(draw: random.Random) -> Iterator[str]:
    yield f"ws://{HOST}:{free_port()}"


@contextmanager
def _later(draw: random.Random) -> Iterator[str]:
    """One that begins to listen while it is waited for."""
    port, started = free_port(), list[PolicyServer]()
    timer = threading.Timer(0.5, lambda: started.append(PolicyServer(_answer, port=port)))
    timer.start()
    yield f"ws://{HOST}:{port}"
    timer.join()
    started[0].stop()


@contextmanager
def _starting(draw: random.Random) -> Iterator[str]:
    with PolicyServer(_answer, starting=draw.randint(1, 3)) as server:
        yield server.address


@contextmanager
def _plain(draw: random.Random) -> Iterator[str]:
    with PolicyServer(_answer) as server:
        yield server.address.replace("ws:", "wss:")


@contextmanager
def _other_key(draw: random.Random) -> Iterator[str]:
    with PolicyServer(_answer, key="sesame") as server:
        yield server.address


def _answer(message: Any) -> Any:
    return {"actions": MOVING}


_add("openpi", "nobody listens", "server_absent", _nobody)
_add("openpi", "it comes late", "", _later)
_add("openpi", "503, then it is there", "", _starting)
_add("openpi", "TLS is asked for and not spoken", "tls", _plain)
_add("openpi", "it wants a key", "unauthorized", _other_key)


# ---------------------------------------------------------------------------------------------- openpi's wire

Act = Callable[[ServerConnection, random.Random], object]


def _served(talk: Callable[[ServerConnection, int], None]) -> AbstractContextManager[str]:
    @contextmanager
    def serving() -> Iterator[str]:
        with PolicyServer(talk=talk) as server:
            yield server.address

    return serving()


def _at_metadata(act: Act) -> Callable[[random.Random], AbstractContextManager[str]]:
    def serve(draw: random.Random) -> AbstractContextManager[str]:
        def talk(connection: ServerConnection, number: int) -> None:
            act(connection, draw)
            for _ in connection:
                connection.send(packed({"actions": MOVING}))

        return _served(talk)

    return serve


def _at_answer(act: Act, once: bool = False) -> Callable[[random.Random], AbstractContextManager[str]]:
    """After some good answers it fails; `once`: and then no more."""

    def serve(draw: random.Random) -> AbstractContextManager[str]:
        good, answers, failed = draw.randint(0, 4), [0], [False]

        def talk(connection: ServerConnection, number: int) -> None:
            connection.send(packed({}))
            for _ in connection:
                answers[0] += 1
                if answers[0] > good and not (once and failed[0]):
                    failed[0] = True
                    act(connection, draw)
                else:
                    connection.send(packed({"actions": MOVING}))

        return _served(talk)

    return serve


def _say(value: Any) -> Act:
    return lambda connection, draw: connection.send(value if isinstance(value, bytes | str) else packed(value))


_DEEP = b"\x81\xa1a" * 2000 + b"\xc0"
_METADATA: dict[str, tuple[str, Act]] = {
    "never": ("server_timeout", lambda c, d: OVER.wait(WAIT_S)),
    "a list": ("bad_reply", _say(packed([1]))),
    "no msgpack": ("bad_reply", _say(b"\xc1\xff")),
    "an empty frame": ("bad_reply", _say(b"")),
    "deep": ("bad_reply", _say(_DEEP)),
    "too large": ("bad_reply", _say(bytes(3 << 20))),
    "text": ("server_error", _say("Traceback (most recent call last):\nRuntimeError: no weights")),
    "a refusal, 1008": ("unauthorized", lambda c, d: c.close(1008, "key")),
    "a failure, 1011": ("server_error", lambda c, d: c.close(1011, "no weights")),
    "a farewell, 1001": ("server_closed", lambda c, d: c.close(1001)),
    "twice": ("bad_reply", lambda c, d: (c.send(packed({})), c.send(packed({})))),
    "odd cameras": ("", _say({"cameras": [["head"], 7, None, np.array(["head"])]})),
    "odd keys": ("", _say({"note": ["x"], "progress": "half", "gave_up": 1, "ended": "no", "action_dim": np.ones(3)})),
    "a note like a terminal's": ("", _say({"note": "\x1b[2J\u202e" + "x" * 100_000})),
}
for _name, (_due, _act) in _METADATA.items():
    _add("openpi", f"metadata: {_name}", _due, _at_metadata(_act))


def _array(**changed: Any) -> dict[bytes, Any]:
    return {b"__ndarray__": True, b"data": MOVING.tobytes(), b"dtype": "<f4", b"shape": MOVING.shape} | {
        key.encode(): value for key, value in changed.items()
    }


def _with(value: float) -> Act:
    def act(connection: ServerConnection, draw: random.Random) -> None:
        actions = MOVING.copy()
        actions[draw.randrange(4), draw.randrange(ACTION_SIZE)] = value
        connection.send(packed({"actions": actions}))

    return act


_ACTIONS: dict[str, tuple[str, Act]] = {
    "nan": ("bad_reply", _with(np.nan)),
    "infinite": ("bad_reply", _with(np.inf)),
    "1e30": ("", _with(1e30)),
    "22 numbers": ("bad_reply", _say({"actions": MOVING[:, :22]})),
    "32 numbers": ("bad_reply", _say({"actions": np.zeros((4, 32))})),
    "three axes": ("bad_reply", _say({"actions": np.zeros((2, 4, ACTION_SIZE))})),
    "a batch of one": ("", _say({"actions": MOVING[None]})),
    "one action": ("", _say({"actions": MOVING[0]})),
    "an empty chunk": ("bad_reply", _say({"actions": MOVING[:0]})),
    "2000 actions": ("bad_reply", _say({"actions": np.zeros((2000, ACTION_SIZE), np.float32)})),
    "truth values": ("bad_reply", _say({"actions": MOVING > 0})),
    "text": ("bad_reply", _say({"actions": MOVING.astype("U4")})),
    "a list": ("bad_reply", _say({"actions": MOVING.tolist()})),
    "a number": ("bad_reply", _say({"actions": 1.5})),
    "nothing": ("bad_reply", _say({"actions": None})),
    "half precision": ("", _say({"actions": MOVING.astype(np.float16)})),
    "big-endian": ("", _say({"actions": MOVING.astype(">f8")})),
    "whole numbers": ("", _say({"actions": np.zeros((4, ACTION_SIZE), np.int32)})),
    "complex": ("bad_reply", _say({"actions": _array(dtype="<c8")})),
    "objects": ("bad_reply", _say({"actions": _array(dtype="|O")})),
    "records": ("bad_reply", _say({"actions": _array(dtype="[('a', '<f4')]")})),
    "a shape that lies": ("bad_reply", _say({"actions": _array(shape=[2**40, 23])})),
    "a negative shape": ("bad_reply", _say({"actions": _array(shape=[-1, 23])})),
    "half its bytes": ("bad_reply", _say({"actions": _array(data=MOVING.tobytes()[:-50])})),
    "text for bytes": ("bad_reply", _say({"actions": _array(data="x")})),
}
for _name, (_due, _act) in _ACTIONS.items():
    _add("openpi", f"actions: {_name}", _due, _at_answer(_act))


def _dripped(connection: ServerConnection, draw: random.Random) -> None:
    connection.socket.sendall(b"\x82\x7e\x10\x00")
    with contextlib.suppress(OSError):
        _slowly(connection.socket, b"x" * 60)


def _halved(connection: ServerConnection, draw: random.Random) -> None:
    connection.socket.sendall(b"\x82\x7e\xff\xff half")
    broken(connection)


def _pinging(connection: ServerConnection, draw: random.Random) -> None:
    """Pings without end, and reads nothing."""
    end = time.monotonic() + WAIT_S
    with connection.protocol_mutex, contextlib.suppress(OSError):
        while time.monotonic() < end and not OVER.is_set():
            connection.socket.sendall((b"\x89\x7d" + bytes(125)) * 10)


def _late(seconds: float) -> Act:
    return lambda c, d: OVER.wait(seconds) or c.send(packed({"actions": MOVING}))


_ANSWERS: dict[str, tuple[str, Act]] = {
    "random bytes": ("bad_reply", lambda c, d: c.send(d.randbytes(200))),
    "nothing": ("bad_reply", _say(b"")),
    "half a message": ("bad_reply", lambda c, d: c.send(packed({"actions": MOVING})[: d.randrange(1, 400)])),
    "two messages in one": ("bad_reply", _say(packed({"actions": MOVING}) * 2)),
    "a list": ("bad_reply", _say(packed([1, 2, 3]))),
    "another key": ("bad_reply", _say({"action": MOVING})),
    "keys like a terminal's": ("bad_reply", _say({"\x1b]0;evil\x07\n\x00": 1})),
    "an extension": ("bad_reply", lambda c, d: c.send(msgpack.packb({"actions": msgpack.ExtType(4, b"x")}))),
    "deep": ("bad_reply", _say(_DEEP)),
    "too many items": ("bad_reply", lambda c, d: c.send(msgpack.packb({"actions": [0] * 200_000}))),
    "too large": ("bad_reply", _say(bytes(3 << 20))),
    "too large, in pieces": ("bad_reply", lambda c, d: c.send(bytes(100_000) for _ in range(30))),
    "a traceback": ("server_error", lambda c, d: (c.send("Traceback:\nRuntimeError: out of memory"), c.close(1011))),
    "empty text": ("server_error", _say("")),
    "text of a megabyte": ("server_error", lambda c, d: c.send("boom\x1b[2J" + "y" * 500_000)),
    "never": ("server_timeout", lambda c, d: OVER.wait(WAIT_S)),
    "late": ("", _late(0.3)),
    "too late": ("server_timeout", _late(3.0)),
    "a byte now and then": ("server_timeout", _dripped),
    "twice": ("bad_reply", lambda c, d: (c.send(packed({"actions": MOVING})), c.send(packed({"actions": -MOVING})))),
    "pings, and nothing is read": ("server_timeout", _pinging),
    "half a frame": ("server_closed", _halved),
    "the connection breaks": ("server_closed", lambda c, d: broken(c)),
    "1000": ("server_closed", lambda c, d: c.close(1000)),
    "1012, a restart": ("server_closed", lambda c, d: c.close(1012)),
    "1011": ("server_error", lambda c, d: c.close(1011, "Internal server error")),
    "1008": ("unauthorized", lambda c, d: c.close(1008)),
    "4000": ("server_error", lambda c, d: c.close(4000, "busy\nbusy")),
}
for _name, (_due, _act) in _ANSWERS.items():
    _add("openpi", f"answer: {_name}", _due, _at_answer(_act))
for _name in ("the connection breaks", "1000", "1012, a restart", "half a frame"):
    _add("openpi", f"answer, once: {_name}", "", _at_answer(_ANSWERS[_name][1], once=True))

_FRAMES = {
    "an unknown opcode": b"\x83\x01x",
    "reserved bits": b"\xf2\x01x",
    "a mask": b"\x82\x81abcdx",
    "a length of 64 bits": b"\x82\xff" + b"\xff" * 12,
    "a gigabyte": b"\x82\x7f" + (1 << 30).to_bytes(8, "big"),
    "broken UTF-8": b"\x81\x02\xff\xff",
    "an end of nothing": b"\x80\x01x",
    "a long ping": b"\x89\x7e\x00\x80" + bytes(128),
    "a farewell of one byte": b"\x88\x01x",
}


def _framed(frame: bytes) -> Callable[[random.Random], AbstractContextManager[str]]:
    def talk(client: socket.socket) -> None:
        agreed(client)
        client.sendall(bytes([0x82, len(packed({}))]) + packed({}))
        client.recv(1 << 20)
        client.sendall(frame)
        OVER.wait(WAIT_S)

    return lambda draw: raw_server(talk)


for _name, _frame in _FRAMES.items():
    _add("openpi", f"frame: {_name}", "bad_reply", _framed(_frame))


@contextmanager
def _restarts(draw: random.Random) -> Iterator[str]:
    """It dies after some answers, and another one listens there soon."""
    count, dead = [0], threading.Event()

    def answer(message: Any) -> Any:
        count[0] += 1
        if count[0] == 3:
            dead.set()
        return {"actions": MOVING}

    first, later = PolicyServer(answer), list[PolicyServer]()

    def restart() -> None:
        dead.wait(WAIT_S)
        first.stop()
        time.sleep(0.2)
        later.append(PolicyServer(_answer, port=first.port))

    thread = threading.Thread(target=restart, daemon=True)
    thread.start()
    yield first.address
    dead.set()
    thread.join(WAIT_S)
    for server in later:
        server.stop()


_add("openpi", "it restarts", "", _restarts)


# -------------------------------------------------------------------------------------------- vla_eval's wire

Reply = Callable[[int, random.Random], Any]  # number of the question to messages: bytes, text, or a list of them


def _message(kind: Any, payload: Any, number: Any) -> bytes:
    return packed({"type": kind, "payload": payload, "seq": number, "timestamp": 0.0})


def _plain_array(array: Any, **changed: Any) -> dict[str, Any]:
    told = {"__ndarray__": True, "data": array.tobytes(), "dtype": array.dtype.str, "shape": list(array.shape)}
    return told | changed


def _action(actions: Any, number: Any) -> bytes:
    given = _plain_array(actions) if isinstance(actions, np.ndarray) else actions
    return _message("action", {"actions": given}, number)


def _model_server(hello: Any = None, reply: Reply | None = None, act: Act | None = None,
once: bool = False) -> Callable[
    [random.Random], AbstractContextManager[str]
]:  # fmt: skip
    """A server that greets, and fails from one of its answers on in what it replies or does."""

    def serve(draw: random.Random) -> AbstractContextManager[str]:
        good = draw.randint(0, 4) if hello is None else 1 << 30
        answers, failed = [0], [False]

        def send(connection: ServerConnection, replies: Any) -> None:
            for one in replies if isinstance(replies, list) else [replies]:
                connection.send(one)

        def talk(connection: ServerConnection, number: int) -> None:
            for frame in connection:
                message = msgpack.unpackb(bytes(frame), strict_map_key=False)  # type: ignore[arg-type]
                if message["type"] == "hello":
                    send(connection, _message("hello", {"protocol_version": 1}, 1) if hello is None else hello)
                if message["type"] != "observation":
                    continue
                answers[0] += 1
                if answers[0] <= good or (once and failed[0]):
                    send(connection, _action(MOVING, message["seq"]))
                    continue
                failed[0] = True
                if act is not None:
                    act(connection, draw)
                if reply is not None:
                    send(connection, reply(message["seq"], draw))

        return _served(talk)

    return serve


_HELLOS: dict[str, tuple[str, Any]] = {
    "never": ("server_timeout", []),
    "version 2": ("bad_reply", _message("hello", {"protocol_version": 2}, 1)),
    "no version": ("bad_reply", _message("hello", {}, 1)),
    "another type": ("bad_reply", _message("action", {}, 1)),
    "no msgpack": ("bad_reply", b"\xc1"),
    "text": ("server_error", "Traceback:\nRuntimeError: no weights"),
    "seven numbers": ("bad_reply", _message("hello", {"protocol_version": 1, "action_spec": {"arm": {"dims": 7}}}, 1)),
    "an odd spec": ("", _message("hello", {"protocol_version": 1, "action_spec": [1], "observation_params": "x"}, 1)),
}
for _name, (_due, _hello) in _HELLOS.items():
    _add("vla_eval", f"hello: {_name}", _due, _model_server(_hello))

_REPLIES: dict[str, tuple[str, Reply]] = {
    "no msgpack": ("bad_reply", lambda n, d: d.randbytes(60)),
    "text": ("server_error", lambda n, d: "Traceback: it broke"),
    "a list": ("bad_reply", lambda n, d: msgpack.packb([1])),
    "no payload": ("bad_reply", lambda n, d: msgpack.packb({"type": "action", "seq": n})),
    "no number": ("bad_reply", lambda n, d: msgpack.packb({"type": "action", "payload": {}})),
    "no actions": ("bad_reply", lambda n, d: _message("action", {}, n)),
    "another type": ("bad_reply", lambda n, d: _message("hello", {}, n)),
    "a number of the future": ("bad_reply", lambda n, d: _action(MOVING, n + 1)),
    "old answers alone": ("server_timeout", lambda n, d: [_action(MOVING, n - 1)] * 3),
    "an old answer first": ("", lambda n, d: [_action(-MOVING, n - 1), _action(MOVING, n)]),
    "seven numbers": ("bad_reply", lambda n, d: _action(np.zeros((2, 7)), n)),
    "an empty chunk": ("bad_reply", lambda n, d: _action(MOVING[:0], n)),
    "nan": ("bad_reply", lambda n, d: _action(MOVING * np.float32(np.nan), n)),
    "text for actions": ("bad_reply", lambda n, d: _action("left", n)),
    "objects": ("bad_reply", lambda n, d: _action(_plain_array(MOVING, dtype="|O"), n)),
    "a shape that lies": ("bad_reply", lambda n, d: _action(_plain_array(MOVING, shape=[1 << 40, 23]), n)),
    "deep": ("bad_reply", lambda n, d: b"\x83\xa4type\xa6action\xa3seq\x01\xa7payload" + _DEEP),
    "an error": ("server_error", lambda n, d: _message("error", {"error": "out of memory"}, n)),
    "too large": ("bad_reply", lambda n, d: bytes(3 << 20)),
    "never": ("server_timeout", lambda n, d: []),
}
for _name, (_due, _reply) in _REPLIES.items():
    _add("vla_eval", f"answer: {_name}", _due, _model_server(reply=_reply))
_add("vla_eval", "answer: the connection breaks", "server_closed", _model_server(act=lambda c, d: broken(c)))
_add("vla_eval", "answer, once: the connection breaks", "", _model_server(act=lambda c, d: broken(c), once=True))
_add("vla_eval", "answer: 1011", "server_error", _model_server(act=lambda c, d: c.close(1011)))
