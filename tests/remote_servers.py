"""Policy servers for tests, written from the description of the protocol alone: they share no code with the client."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import socket
import ssl
import subprocess
import threading
from collections.abc import Callable, Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import Server, ServerConnection, serve

HOST = "127.0.0.1"


def packed(value: Any) -> bytes:
    """Msgpack in which an array is a map of its bytes, dtype and shape."""

    def encoded(item: Any) -> Any:
        if isinstance(item, np.ndarray):
            data = {b"__ndarray__": True, b"data": item.tobytes(), b"dtype": item.dtype.str, b"shape": item.shape}
        else:
            data = {b"__npgeneric__": True, b"data": item.item(), b"dtype": item.dtype.str}
        return data

    return bytes(msgpack.packb(value, default=encoded))


def unpacked(message: bytes) -> Any:
    def decoded(item: Any) -> Any:
        if b"__ndarray__" in item:
            return np.frombuffer(item[b"data"], item[b"dtype"]).reshape(item[b"shape"])
        if b"__npgeneric__" in item:
            return np.dtype(item[b"dtype"]).type(item[b"data"])
        return item

    return msgpack.unpackb(message, object_hook=decoded)


class PolicyServer:
    """Answers observations as a native openpi server does, unless it is told how to misbehave.

    Args:
        answer: The reply to a message; None: no reply. What it raises is an error frame, then close code 1011. Bytes
            are sent as they are, text as a text frame.
        metadata: Sent on connecting; by default an empty mapping.
        key: What a client must send; "": nothing.
        starting: How many requests of any kind get 503 first.
        talk: Does all of the talking on a connection, given its number from 0, in place of the above.
        context: For TLS.
        port: 0: any.

    Attributes:
        received: Messages, in order.
        headers: Of each handshake, in order.
        connections: How many there were.
        health: How often /healthz was asked.
    """

    def __init__(
        self,
        answer: Callable[[Any], Any] = lambda message: {"actions": np.zeros((4, 23), np.float32)},
        metadata: Any = None,
        key: str = "",
        starting: int = 0,
        talk: Callable[[ServerConnection, int], None] | None = None,
        context: ssl.SSLContext | None = None,
        port: int = 0,
    ) -> None:
        self.answer, self.metadata, self.key, self.starting = answer, metadata, key, starting
        self.received: list[Any] = []
        self.headers: list[Any] = []
        self.connections = self.health = 0
        self.open: list[ServerConnection] = []
        self._talk = talk
        self._server: Server = serve(
            self._client, HOST, port, process_request=self._before, compression=None, max_size=None, ssl=context
        )
        self.port: int = self._server.socket.getsockname()[1]
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        return f"ws://{HOST}:{self.port}"

    def stop(self) -> None:
        """Break every connection, and listen no more."""
        self._server.shutdown()
        for connection in self.open:
            broken(connection)

    def __enter__(self) -> PolicyServer:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def _before(self, connection: ServerConnection, request: Request) -> Response | None:
        self.health += request.path == "/healthz"
        if self.starting > 0:
            self.starting -= 1
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "starting\n")
        if request.path == "/healthz":
            return connection.respond(HTTPStatus.OK, "OK\n")
        self.headers.append(request.headers)
        if self.key and request.headers.get("Authorization") != f"Api-Key {self.key}":
            return connection.respond(HTTPStatus.UNAUTHORIZED, "no\n")
        return None

    def _client(self, connection: ServerConnection) -> None:
        number, self.connections = self.connections, self.connections + 1
        self.open.append(connection)
        with contextlib.suppress(ConnectionClosed, OSError):
            if self._talk is not None:
                self._talk(connection, number)
                return
            connection.send(packed({} if self.metadata is None else self.metadata))
            for frame in connection:
                self.received.append(message := unpacked(bytes(frame)))  # type: ignore[arg-type]
                self._reply(connection, message)

    def _reply(self, connection: ServerConnection, message: Any) -> None:
        try:
            reply = self.answer(message)
        except Exception as error:
            connection.send(f"Traceback (most recent call last):\n  File ...\n{type(error).__name__}: {error}")
            connection.close(1011, "Internal server error. Traceback included in previous frame.")
            return
        if reply is not None:
            connection.send(reply if isinstance(reply, bytes | str) else packed(reply))


def broken(connection: ServerConnection) -> None:
    """Break a connection as a dying process does, without a farewell."""
    with contextlib.suppress(OSError):
        connection.socket.shutdown(socket.SHUT_RDWR)
    with contextlib.suppress(OSError):
        connection.socket.close()


@contextlib.contextmanager
def raw_server(talk: Callable[[socket.socket], None]) -> Iterator[str]:
    """A TCP server that does what `talk` does with each connection; gives its address."""
    listener = socket.create_server((HOST, 0))

    def accept() -> None:
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=run, args=[client], daemon=True).start()

    def run(client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            talk(client)
        with contextlib.suppress(OSError):
            client.close()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield f"ws://{HOST}:{listener.getsockname()[1]}"
    finally:
        listener.close()


def agreed(client: socket.socket) -> None:
    """Agree to a websocket; frames are the caller's to write."""
    request = b""
    while not request.endswith(b"\r\n\r\n"):
        request += client.recv(4096)
    key = next(line for line in request.split(b"\r\n") if line.lower().startswith(b"sec-websocket-key:"))[18:].strip()
    accept = base64.b64encode(hashlib.sha1(key + b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11").digest())  # of RFC 6455
    client.sendall(b"HTTP/1.1 101 Yes\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n")
    client.sendall(b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n")


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.create_server((HOST, 0)) as listener:
        return int(listener.getsockname()[1])


def certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate for 127.0.0.1 signed by itself, and its key."""
    pem, key = folder / "cert.pem", folder / "key.pem"
    names = ["-subj", "/CN=a policy server", "-addext", "subjectAltName=IP:127.0.0.1"]
    make = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "2",
        "-keyout",
        str(key),
        "-out",
        str(pem),
    ]
    subprocess.run([*make, *names], check=True, capture_output=True)
    return pem, key
