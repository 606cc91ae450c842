"""One websocket to a policy server: opened, asked and closed, with an end to every wait and a reason for every failure.

Failures are `PolicyError`s; `Lost` is the one of them that a new connection may mend.
"""

from __future__ import annotations

import contextlib
import http.client
import logging
import os
import socket
import ssl
import struct
import threading
import time
import weakref
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from websockets.client import ClientProtocol
from websockets.exceptions import (
    ConnectionClosed,
    InvalidMessage,
    InvalidProxy,
    InvalidStatus,
    ProxyError,
    WebSocketException,
)
from websockets.protocol import State
from websockets.sync.client import ClientConnection, connect

from mpvi_bt.executive.remote.codec import unpack
from mpvi_bt.ground import proxies
from mpvi_bt.ground.errors import BadMessage, PolicyError

KEY = "OPENPI_API_KEY"  # environment variable
_POLL_S = 0.25  # between two looks whether a server is there now
_CLOSE_S = 1.0  # for a server to answer a farewell
_STARTING = (502, 503, 504)  # HTTP: behind a proxy, or too busy
_RESET = struct.pack("ii", 1, 0)  # value of SO_LINGER: on, and for no time
_GONE = (1000, 1001, 1005, 1006, 1012, 1013, 1014)  # closed for reasons that may not last
_log = logging.getLogger(
    "mpvi_bt.executive.remote.connection"
)  # what websockets would say of each failure, which is told here
_log.addHandler(logging.NullHandler())
_log.propagate = False


class Lost(PolicyError):
    """The connection is lost; what was asked may be asked again over a new one."""


class Connection:
    """An open websocket, and the metadata that the server sent first.

    Args:
        url: Of the server, ws:// or wss://.
        deadline: Until when to wait for it (`time.monotonic`).
        most_bytes: Of a message.
        hello: Sent before, to servers that wait for it.

    Raises:
        PolicyError: There is no such server by then, or it refuses.

    Attributes:
        metadata: As the server sent it.
    """

    def __init__(self, url: str, deadline: float, most_bytes: int, hello: bytes = b"") -> None:
        self._most_bytes = most_bytes
        stack = contextlib.ExitStack()
        self._socket = stack.enter_context(_open(url, deadline, most_bytes))
        self._end = weakref.finalize(
            self, _close, stack, self._socket.socket
        )  # when a policy is dropped, its server should know
        self._end.atexit = False  # when no more threads can be started, to end the wait
        try:
            if hello:
                self.send(hello, deadline)
            self.metadata = self.receive(deadline)
        except PolicyError:
            self.close()
            raise

    def send(self, message: bytes, deadline: float) -> None:
        """Send a message. Raises PolicyError."""
        with self._failures(deadline):
            self._socket.send(message)

    def expect_silence(self, deadline: float) -> None:
        """Raise PolicyError for an unrequested message: it would be taken for the next answer."""
        # If it is closed, sending will tell.
        with contextlib.suppress(TimeoutError, ConnectionClosed), _broken_off(self._socket.socket, deadline):
            frame = self._socket.recv(timeout=0)
            if isinstance(frame, str):
                raise _said(frame)
            raise PolicyError("bad_reply", "an answer that nobody asked for")

    def receive(self, deadline: float) -> Any:
        """The next message, unpacked. Raises PolicyError."""
        with self._failures(deadline):
            frame = self._socket.recv(timeout=max(deadline - time.monotonic(), 0.0))
        if isinstance(frame, str):
            raise _said(frame)
        try:
            return unpack(frame, self._most_bytes)
        except BadMessage as error:
            raise PolicyError("bad_reply", str(error)) from None

    def close(self) -> None:
        """End it, politely if the server answers within a second. Safe to call twice."""
        self._end()

    @contextlib.contextmanager
    def _failures(self, deadline: float) -> Iterator[None]:
        try:
            with _broken_off(self._socket.socket, deadline):
                yield
        except TimeoutError:
            raise PolicyError("server_timeout", "no answer in time") from None
        except ConnectionClosed as error:
            if time.monotonic() >= deadline:
                raise PolicyError("server_timeout", "no answer in time") from None
            raise _closed(error) from None


class _Websocket(ClientConnection):
    """One that hangs up as soon as the server has broken the rules, or closed it; else the server would have to."""

    _first = b""  # five bytes that the server said
    _no_http = ""  # what the server said instead

    def __init__(self, channel: socket.socket, protocol: ClientProtocol, **options: Any) -> None:
        feed = protocol.reader.feed_data

        def noted(data: bytes | bytearray) -> None:
            self._first += data[: 5 - len(self._first)]
            feed(data)

        protocol.reader.feed_data = noted  # type: ignore[method-assign]  # lines that were read are not kept there
        super().__init__(channel, protocol, **options)

    def handshake(self, *args: Any, **options: Any) -> None:
        """Raise the first error in the server's answer, not the later error that it caused.

        To websockets a server that speaks before it is asked, such as of SSH or mail, is an AssertionError at times.
        """
        try:
            super().handshake(*args, **options)
        except Exception:
            if self._no_http:
                raise InvalidMessage(self._no_http) from None
            if (error := self.protocol.handshake_exc) is not None:
                raise error from error.__cause__
            raise

    def send_data(self) -> None:
        """Called whenever something has been received, too."""
        super().send_data()
        protocol, reader, failed = self.protocol, self.protocol.reader, self.protocol.handshake_exc
        if protocol.state is State.CONNECTING and not reader.eof:
            if isinstance(failed, InvalidMessage):
                self._no_http = str(_root(failed))
            elif not b"HTTP/".startswith(self._first):
                self._no_http = repr(self._first)
        if protocol.parser_exc:  # to be reset at the end: who sends a huge frame would wait minutes for it to be read
            with contextlib.suppress(OSError):
                self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
        if self._no_http or failed or protocol.parser_exc or protocol.close_rcvd:
            _shut_down(self.socket)


def _root(error: BaseException) -> BaseException:
    """What an error comes from."""
    return error if error.__cause__ is None else _root(error.__cause__)


def _close(stack: contextlib.ExitStack, channel: socket.socket) -> None:
    with _broken_off(channel, time.monotonic() + _CLOSE_S):
        stack.close()


@contextlib.contextmanager
def _broken_off(channel: socket.socket, deadline: float) -> Iterator[None]:
    """Shut a socket down if the block is not done by then, which ends whatever waits for it.

    Timeouts alone do not: to close or to send, websockets waits for its receiving thread, which a server that sends
    pings and reads no pongs holds up for ever.
    """
    stop = threading.Timer(max(deadline - time.monotonic(), 0.0), _shut_down, [channel])
    stop.daemon = True
    stop.start()
    try:
        yield
    finally:
        stop.cancel()


def _shut_down(channel: socket.socket) -> None:
    with contextlib.suppress(OSError):  # it is closed
        channel.shutdown(socket.SHUT_RDWR)


def _said(text: str) -> PolicyError:
    """The error in a server's text frame: the last line of its traceback."""
    return PolicyError("server_error", f"the server says: {one_line(text.strip().rpartition(chr(10))[2])}")


def _closed(error: ConnectionClosed) -> PolicyError:
    if error.sent is not None and not (error.rcvd and error.rcvd_then_sent):  # it was us who refused
        return PolicyError("bad_reply", f"a frame that is not allowed: {one_line(str(error.sent))}")
    if error.rcvd is None:
        return Lost("server_closed", "the connection broke")
    said = one_line(str(error.rcvd))
    if error.rcvd.code in _GONE:
        return Lost("server_closed", f"the server closed the connection: {said}")
    reason = "unauthorized" if error.rcvd.code == 1008 else "server_error"
    return PolicyError(reason, f"the server closed the connection: {said}")


def _open(url: str, deadline: float, most_bytes: int) -> ClientConnection:
    """A websocket, as soon as the server is there. Raises PolicyError."""
    began = time.monotonic()
    while True:
        try:
            return connect(
                url,
                compression=None,
                max_size=most_bytes,
                max_queue=4,  # frames that nobody asked for take no more memory than so many messages
                additional_headers=_headers(),
                proxy=None if proxies.is_this_machine(url) else True,
                open_timeout=max(deadline - time.monotonic(), 0.01),
                ping_timeout=None,  # while it infers, a server of openpi answers no ping
                close_timeout=_CLOSE_S,
                create_connection=_Websocket,
                logger=_log,
            )
        except (OSError, ValueError, ImportError, WebSocketException) as error:
            failure = _refused(error, proxies.proxy_for(url))
        starting = True
        while starting:
            time.sleep(max(min(_POLL_S, deadline - time.monotonic()), 0.0))
            starting = health(url, deadline) in _STARTING
            if time.monotonic() >= deadline:
                waited_s = time.monotonic() - began
                raise PolicyError(failure.reason, f"{failure}, for {waited_s:.2g} s (connect_s of the settings)")


def _headers() -> dict[str, str]:
    key = key_of_environment()
    return {"Authorization": f"Api-Key {key}"} if key else {}


def key_of_environment() -> str:
    """What clients send and servers ask for; "": nothing. Raises PolicyError."""
    key = os.environ.get(KEY, "")
    if not (key.isascii() and key.isprintable() and key == key.strip()):
        raise PolicyError("unauthorized", f"the key in {KEY} has characters that no header can carry")
    return key


def _refused(error: Exception, proxy: str) -> PolicyError:
    """The error to report if a refusing server never comes up. Raises it at once if waiting cannot help.

    Args:
        error: Of the connection.
        proxy: Through which it was to go; "": none.
    """
    if isinstance(error, ssl.SSLError):
        raise PolicyError("tls", f"TLS: {one_line(str(error))}") from None
    if isinstance(error, socket.gaierror) and error.errno != socket.EAI_AGAIN:
        whose = f" of {proxies.told(proxy)}" if proxy else ""
        raise PolicyError("server_absent", f"no such host{whose}: {one_line(str(error.strerror))}") from None
    if isinstance(error, InvalidProxy | ProxyError | ImportError):  # a SOCKS proxy needs a library of its own
        said = one_line(str(error).replace(proxy, "it") if proxy else str(error))
        raise PolicyError("server_absent", f"through {proxies.told(proxy)}: {said}") from None
    if isinstance(error, InvalidStatus):
        status = error.response.status_code
        words = f"HTTP {status} {http.client.responses.get(status, '')}".strip()
        if status in (401, 403):
            raise PolicyError("unauthorized", f"{words}; a key is read from {KEY} in the environment") from None
        if status not in _STARTING:
            raise PolicyError("bad_reply", f"{words}: no websocket is served there") from None
        return PolicyError("server_absent", words)
    if isinstance(error, InvalidMessage) and not isinstance(error.__cause__, EOFError | OSError):
        raise PolicyError("bad_reply", f"it does not speak HTTP: {one_line(str(error))}") from None
    if isinstance(error, InvalidMessage | ConnectionResetError):
        return PolicyError("server_closed", "it hangs up")
    if not isinstance(error, OSError):
        raise PolicyError("bad_reply", f"it serves no websocket: {one_line(str(error))}") from None
    if isinstance(error, TimeoutError):
        return PolicyError("server_timeout", "it does not answer")
    said = os.strerror(error.errno).lower() if error.errno else one_line(str(error))
    return PolicyError("server_absent", f"{proxies.told(proxy)}, is not there: {said}" if proxy else said)


def health(url: str, deadline: float) -> int | None:
    """The HTTP status of /healthz, wherever it may point to; None if there is no answer by then."""
    parts = urlsplit(url)
    kind = http.client.HTTPSConnection if parts.scheme == "wss" else http.client.HTTPConnection
    server = kind(parts.hostname or "", parts.port, timeout=max(deadline - time.monotonic(), 0.01))
    try:
        server.connect()
        with _broken_off(server.sock, deadline):  # its timeout is for each read
            server.request("GET", "/healthz")
            return server.getresponse().status
    except (OSError, http.client.HTTPException, ValueError):
        return None
    finally:
        server.close()


def one_line(text: str, most: int = 300) -> str:
    """Text from elsewhere as a message can quote it: printable, on one line, not long."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text[: 4 * most]).split())
    return line if len(line) <= most else line[: most - 3] + "..."
