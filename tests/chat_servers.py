"""Chat servers for tests: a scripted one for exact cases, and transformers' own with tiny random models.

Written from the description of the protocol alone: the scripted one shares no code with the client.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from tests.tiny_chat_model import write_seeing, write_talking

HOST = "127.0.0.1"
READY_S = 300.0  # importing torch and transformers takes a while on a busy machine


@dataclass(frozen=True)
class Reply:
    """What one request gets.

    Attributes:
        body: Bytes and text are sent as they are, anything else as JSON.
        status: Of HTTP.
        headers: Besides length and type.
        delay_s: Before the first byte.
        drip: Bytes at a time and seconds between them; None: all at once.
        cut: Break the connection after so many bytes of the body; None: never. 0: before the headers.
        endless: Send the body again and again, as chunks, until the client goes away.
    """

    body: Any
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)
    delay_s: float = 0.0
    drip: tuple[int, float] | None = None
    cut: int | None = None
    endless: bool = False

    @property
    def data(self) -> bytes:
        if isinstance(self.body, bytes):
            return self.body
        return (self.body if isinstance(self.body, str) else json.dumps(self.body)).encode()


def completion(text: Any, finish: str = "stop", tokens: tuple[int, int] = (11, 3), **message: Any) -> dict[str, Any]:
    """The body of an answer; `message` has fields beside the text, such as refusal."""
    return {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 1,
        "model": "scripted-1",
        "choices": [
            {"index": 0, "finish_reason": finish, "message": {"role": "assistant", "content": text, **message}}
        ],
        "usage": {"prompt_tokens": tokens[0], "completion_tokens": tokens[1], "total_tokens": sum(tokens)},
    }


def failure(status: int, message: str = "no", code: str | None = None, **headers: str) -> Reply:
    """An error as servers send it; a header's _ stands for -, such as retry_after."""
    body = {"error": {"message": message, "type": "some_error", "param": None, "code": code}}
    return Reply(body, status, {name.replace("_", "-"): value for name, value in headers.items()})


class ChatServer:
    """Answers chat completions as it is told.

    Args:
        answer: The reply to a request, given its JSON: a text to say, the body of an answer, or a `Reply`. A list is
            replied in order, its last one for ever.

    Attributes:
        requests: The JSON of each, in order.
        headers: Of each, in order, with small letters.
    """

    def __init__(self, answer: Callable[[Any], Any] | Iterable[Any] = ("yes",)) -> None:
        self.requests: list[Any] = []
        self.headers: list[dict[str, str]] = []
        self.answers(answer)
        self._lock = threading.Lock()
        self._open: set[socket.socket] = set()
        self._server = ThreadingHTTPServer((HOST, 0), self._handler())
        self._server.daemon_threads = True
        self.port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    @property
    def url(self) -> str:
        """What a client is given."""
        return f"http://{HOST}:{self.port}/v1"

    def answers(self, answer: Callable[[Any], Any] | Iterable[Any]) -> None:
        """Answer so from now on."""
        if callable(answer):
            self._answer = answer
            return
        script = list(answer)
        self._answer = lambda request: script.pop(0) if len(script) > 1 else script[0]

    def stop(self) -> None:
        """Break every connection, and listen no more."""
        self._server.shutdown()
        self._server.server_close()
        for connection in list(self._open):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def __enter__(self) -> ChatServer:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def _handler(server) -> type[BaseHTTPRequestHandler]:  # noqa: N805 # `self` is the handler's
        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def setup(self) -> None:
                super().setup()
                server._open.add(self.connection)

            def finish(self) -> None:
                server._open.discard(self.connection)
                with contextlib.suppress(OSError):
                    super().finish()

            def do_POST(self) -> None:
                data = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                if urlsplit(self.path).path != "/v1/chat/completions":  # a proxy gets the whole URL
                    self._send(failure(404, f"no such path: {self.path}"))
                    return
                with server._lock:
                    server.requests.append(request := json.loads(data))
                    server.headers.append({name.lower(): value for name, value in self.headers.items()})
                    said = server._answer(request)
                said = completion(said) if isinstance(said, str) else said
                with contextlib.suppress(OSError):
                    self._send(said if isinstance(said, Reply) else Reply(said))

            def _send(self, reply: Reply) -> None:
                time.sleep(reply.delay_s)
                if reply.cut == 0:
                    self._break()
                    return
                self.send_response(reply.status)
                given = {name.lower() for name in reply.headers}
                for name, value in reply.headers.items():
                    self.send_header(name, value)
                if "content-type" not in given:
                    self.send_header("Content-Type", "application/json")
                if reply.endless:
                    self.send_header("Transfer-Encoding", "chunked")
                elif "content-length" not in given:
                    self.send_header("Content-Length", str(len(reply.data)))
                self.end_headers()
                data = reply.data if reply.cut is None else reply.data[: reply.cut]
                step, pause_s = reply.drip or (max(len(data), 1), 0.0)
                while True:
                    for begin in range(0, len(data), step):
                        part = data[begin : begin + step]
                        self.wfile.write(b"%x\r\n%s\r\n" % (len(part), part) if reply.endless else part)
                        time.sleep(pause_s)
                    if not reply.endless:
                        break
                if reply.cut is not None:
                    self._break()

            def _break(self) -> None:
                """As a process that dies does: without a farewell."""
                self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                self.close_connection = True
                self.connection.close()

            def log_message(self, format: str, *args: Any) -> None:
                """Be quiet."""

        return Handler


def free_port() -> int:
    """One that nobody listens on."""
    with socket.create_server((HOST, 0)) as listener:
        return int(listener.getsockname()[1])


@dataclass(frozen=True)
class RealServer:
    """Transformers' own server, with two models of tiny sizes and random weights.

    Attributes:
        url: What a client is given.
        talking: A model that reads text.
        seeing: One that sees as well.
    """

    url: str
    talking: str
    seeing: str


@contextlib.contextmanager
def real_server(folder: Path) -> Iterator[RealServer]:
    """Write the models below `folder`, serve them in a process of its own, and end it.

    Raises:
        RuntimeError: It ended, or was not ready in time; with what it said.
    """
    talking, seeing = write_talking(folder / "talking"), write_seeing(folder / "seeing")
    port = free_port()
    code = "import sys; from transformers.cli.transformers import main; sys.argv[0] = 'transformers'; main()"
    options = ["--host", HOST, "--port", str(port), "--device", "cpu", "--default-seed", "0"]
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "TRANSFORMERS_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    log = folder / "server.log"
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [sys.executable, "-c", code, "serve", *options], stdout=stream, stderr=stream, env=environment
        )
        try:
            _await(process, f"http://{HOST}:{port}/health", log)
            yield RealServer(f"http://{HOST}:{port}/v1", str(talking), str(seeing))
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _await(process: subprocess.Popen[bytes], url: str, log: Path) -> None:
    deadline = time.monotonic() + READY_S
    while process.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(OSError), urllib.request.urlopen(url, timeout=5) as answer:
            if answer.status == 200:
                return
        time.sleep(0.2)
    raise RuntimeError(f"the server is not ready:\n{log.read_text(errors='replace')[-3000:]}")


@pytest.fixture
def scripted_chat_server() -> Iterator[ChatServer]:
    """A server that says yes until it is told something else."""
    with ChatServer() as server:
        yield server


@pytest.fixture(scope="session")
def real_chat_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealServer]:
    """Transformers' own server, once for all tests; they are slow."""
    for module in ("torch", "fastapi", "uvicorn", "openai"):
        pytest.importorskip(module)
    with real_server(tmp_path_factory.mktemp("chat")) as server:
        yield server
