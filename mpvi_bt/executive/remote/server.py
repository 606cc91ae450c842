"""Whatever answers observations behind openpi's websocket protocol: a metadata frame, then an answer for each.

Each client has its own, such as a policy, in a thread of its own: they keep state, and a slow one holds up nobody.
What a client sends wrong ends that client's connection, as in openpi: a text frame says what was wrong, then the server
closes with code 1011.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
import time
from collections.abc import AsyncIterator, Callable, Mapping
from http import HTTPStatus
from typing import Any, Protocol, Self

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from mpvi_bt.executive.remote.codec import MAX_BYTES, pack
from mpvi_bt.executive.remote.connection import one_line
from mpvi_bt.executive.remote.server_metrics import Metrics
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.version import __version__

MOST_CLIENTS = 64  # each has a policy and a thread
INTERNAL_ERROR = 1011  # what openpi closes with after an error
_KEPT_BYTES = 30 << 20  # of memory that is kept from one message for the next; glibc has no more than 32 MB of such
_log = logging.getLogger("mpvi_bt.executive.remote.server")  # what websockets would say of each bad handshake
_log.addHandler(logging.NullHandler())
_log.propagate = False


Given = str | bytes | Mapping[str, Any]  # a frame, or an observation that somebody else has unpacked


class Refused(Exception):
    """An observation that gets no answer.

    Attributes:
        kind: "bad_message": it is not as docs/serving_policies.md says; "policy_failed": the policy raised.
        message: What was wrong, or the traceback.
    """

    def __init__(self, kind: str, message: str) -> None:
        self.kind, self.message = kind, message
        super().__init__(f"{kind}: {message}")


class Unseen(Refused):
    """An observation without pictures that the last answer asked for."""


class Talk(Protocol):
    """One client's conversation, in a thread of its own."""

    def begin(self) -> asyncio.Future[dict[str, Any]]:
        """Make ready; what the metadata say of it. The future raises Refused."""
        ...

    def answer(self, given: Given) -> asyncio.Future[tuple[dict[str, Any] | None, float]]:
        """The answer to a frame, None where it gets none, and how long it took [s]. The future raises Refused."""
        ...

    def end(self) -> None:
        """The client is gone: let the thread end after what it is doing."""
        ...

    def is_at_work(self) -> bool:
        """Whether the thread has not ended yet, be the client gone or not."""
        ...


class Promise:
    """A future of the running loop that another thread keeps.

    Attributes:
        future: Which is awaited.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.future: asyncio.Future[Any] = self._loop.create_future()

    def keep(self, value: Any) -> None:
        """Give what was promised."""
        self._later(lambda: self.future.set_result(value))

    def fail(self, error: Exception) -> None:
        """Say why it cannot be had."""
        self._later(lambda: self.future.set_exception(error))

    def _later(self, settle: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the server has ended meanwhile
            self._loop.call_soon_threadsafe(lambda: None if self.future.done() else settle())


class SocketServer:
    """Answers clients until it is told to stop.

    Args:
        name: Of what is served, for the metadata.
        open_: Begins the conversation with a client.
        api_key: What clients must send as `Authorization: Api-Key ...`; "": nothing.
        idle_s: A client that asks nothing for so long is told to go (1001), so that others can come; None: never.
        say: Told what a person should know, in one line, when it happens.
        pong_s: How long a client may take to answer a ping before it counts as lost; None: any time.
        parting_s: How long the end waits for what conversations have still to write.

    Attributes:
        name: Of what is served.
        metrics: What has happened so far.
        port: Where it listens, once it does.
    """

    def __init__(
        self,
        name: str,
        open_: Callable[[], Talk],
        api_key: str = "",
        say: Callable[[str], None] = lambda line: None,
        idle_s: float | None = None,
        pong_s: float | None = 20.0,
        parting_s: float = 0.0,
    ) -> None:
        self.metrics = Metrics()
        self.port = 0
        self.name, self._open, self._say, self._idle_s, self._pong_s = name, open_, say, idle_s, pong_s
        self._parting_s = parting_s
        self._sessions: list[Talk] = []
        self._authorization = f"Api-Key {api_key}".encode() if api_key else b""

    @contextlib.asynccontextmanager
    async def listening(self, host: str, port: int) -> AsyncIterator[Self]:
        """Serve at an address (port 0: any free one) within the block; then close all connections (1001).

        Raises:
            OSError: The address cannot be had.
        """
        _keep_memory()
        async with serve(
            self._client,
            host,
            port,
            process_request=self._before,
            compression=None,  # pictures hardly shrink, and it takes long
            max_size=MAX_BYTES,
            max_queue=1,  # who sends more before an answer must wait
            origins=[None],  # no page in somebody's browser
            close_timeout=2,
            ping_timeout=self._pong_s,
            logger=_log,
            server_header=None,
        ) as server:
            self.port = _port(server)
            yield self
        until = time.monotonic() + self._parting_s
        while any(session.is_at_work() for session in self._sessions) and time.monotonic() < until:
            await asyncio.sleep(0.01)

    def _before(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer plain HTTP; None: go on to the websocket."""
        path = request.path.partition("?")[0]
        if path == "/healthz":
            return connection.respond(HTTPStatus.OK, "OK\n")
        if path == "/metrics":
            return connection.respond(HTTPStatus.OK, self.metrics.text())
        given = " ".join(request.headers.get_all("Authorization")).encode()
        if self._authorization and not hmac.compare_digest(given, self._authorization):
            return connection.respond(HTTPStatus.UNAUTHORIZED, "An Authorization: Api-Key header is wanted.\n")
        self._sessions = [talk for talk in self._sessions if talk.is_at_work()]
        if len(self._sessions) >= MOST_CLIENTS:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, f"There are {MOST_CLIENTS} clients already.\n")
        return None

    async def _client(self, connection: ServerConnection) -> None:
        """One client, from its first frame to its last."""
        self.metrics.clients += 1
        self.metrics.connections += 1
        self._sessions.append(talk := self._open())
        gone = asyncio.ensure_future(connection.wait_closed())
        try:
            await self._converse(connection, talk, gone)
        except Refused as error:
            self.metrics.errors[error.kind] += 1
            self._say(
                f"client {_address(connection)}: {error.kind}: {one_line(error.message.strip().splitlines()[-1])}"
            )
            with contextlib.suppress(ConnectionClosed):
                await connection.send(str(error))
                await connection.close(INTERNAL_ERROR, "what went wrong is in the frame before")
        finally:
            gone.cancel()
            talk.end()
            self.metrics.clients -= 1

    async def _converse(self, connection: ServerConnection, talk: Talk, gone: asyncio.Future[None]) -> None:
        with contextlib.suppress(ConnectionClosed):
            about = await _unless(gone, talk.begin())
            if about is None:
                return
            await connection.send(pack(self._metadata(about)))
            total_s = None
            while (frame := await self._next(connection)) is not None:
                started = time.perf_counter()
                answer = await _unless(gone, talk.answer(frame))
                if answer is None:
                    return
                message, infer_s = answer
                self.metrics.received_bytes += len(frame)
                if message is None:
                    continue
                self.metrics.inferred(infer_s)
                timing = {"infer_ms": infer_s * 1000}
                if total_s is not None:
                    timing["prev_total_ms"] = total_s * 1000
                packed = pack({**message, "server_timing": timing})
                await connection.send(packed)
                self.metrics.sent_bytes += len(packed)
                total_s = time.perf_counter() - started

    async def _next(self, connection: ServerConnection) -> str | bytes | None:
        """A client's next frame; None: it has been idle for too long, and is told to go."""
        try:
            async with asyncio.timeout(self._idle_s):
                return await connection.recv()
        except TimeoutError:
            self._say(f"client {_address(connection)}: let go, as it asked nothing for {self._idle_s:g} s")
            await connection.close(CloseCode.GOING_AWAY, f"nothing was asked for {self._idle_s:g} s")
            return None

    def _metadata(self, about: dict[str, Any]) -> dict[str, Any]:
        return {
            "policy": self.name,
            **about,
            "control_hz": CONTROL_HZ,
            "mpvi_bt": __version__,
        }


async def _unless(gone: asyncio.Future[None], wanted: asyncio.Future[Any]) -> Any:
    """What is wanted; None if the client is gone before."""
    await asyncio.wait((gone, wanted), return_when=asyncio.FIRST_COMPLETED)
    if wanted.done():
        return wanted.result()
    wanted.cancel()
    return None


def _keep_memory() -> None:
    """Have glibc keep the memory of a message for the next one.

    What is larger than 128 kB it asks the system for anew, whose pages are cleared one by one, unless it has once freed
    something larger. With three pictures of 224 pixels that takes longer than all else that is done with a message.
    """
    bytes(_KEPT_BYTES)  # no page of it is touched


def _port(server: Server) -> int:
    return int(next(iter(server.sockets)).getsockname()[1])


def _address(connection: ServerConnection) -> str:
    address = connection.remote_address
    return f"{address[0]}:{address[1]}" if isinstance(address, tuple) else "unknown"
