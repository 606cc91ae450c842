"""One connection to a policy server of GR00T's: ZeroMQ, msgpack, arrays as the bytes of a .npy file.

Nothing that was received is trusted: a message is bounded in size, and an array is built only of plain numbers whose
bytes are exactly as many as its header says.
"""

from __future__ import annotations

import io
import socket
import time
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from mpvi_bt.executive.remote.codec import array_of, pack, unpack
from mpvi_bt.executive.remote.connection import Lost, one_line
from mpvi_bt.ground.errors import BadMessage, PolicyError, shown

_ARRAY, _BYTES = "__ndarray_class__", "as_npy"
_POLL_S = 0.25  # between two looks whether a server is there now
_GREETING = b"\xff"  # the first byte that whoever speaks ZeroMQ says, without being asked
_DENIED = "Unauthorized"  # how its refusal of a key begins


class GrootConnection:
    """A ZeroMQ socket that asks and is answered.

    Args:
        address: Such as "tcp://localhost:5555".
        deadline: Until when to wait for a server (`time.monotonic`).
        most_bytes: Of a message.
        key: Sent with every question; "": none.

    Raises:
        PolicyError: Nobody is there by then, or who is there speaks something else.
    """

    def __init__(self, address: str, deadline: float, most_bytes: int, key: str = "") -> None:
        import zmq
        from zmq.utils.monitor import recv_monitor_message

        host, port = _await(address, deadline)
        self._most_bytes, self._key = most_bytes, key
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, most_bytes)
        self._socket.setsockopt(zmq.IPV6, ":" in host)
        broken = zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
        self._events = self._socket.get_monitor_socket(broken)
        self._told = recv_monitor_message
        self._poller = zmq.Poller()
        for one in (self._socket, self._events):
            self._poller.register(one, zmq.POLLIN)
        self._socket.connect(f"tcp://[{host}]:{port}" if ":" in host else f"tcp://{host}:{port}")

    def ask(self, endpoint: str, data: Any, deadline: float) -> Any:
        """What an endpoint answers.

        Args:
            endpoint: Such as "get_action".
            data: Its arguments by name; None: it has none.
            deadline: Until when to wait (`time.monotonic`).

        Raises:
            PolicyError: No answer, none that can be read, or one that tells an error. The connection is of no more use.
        """
        message = {"endpoint": endpoint} | ({} if data is None else {"data": _with_npy(data)})
        self._socket.send(pack(message | ({"api_token": self._key} if self._key else {})))
        ready = dict(self._poller.poll(round(max(deadline - time.monotonic(), 0.0) * 1000)))
        if self._socket not in ready:
            if not ready:
                raise PolicyError("server_timeout", "no answer in time")
            self._told(self._events)
            raise Lost(
                "server_closed", f"the connection broke, or a message is larger than {self._most_bytes >> 20} MiB"
            )
        try:
            answer = _unpacked(unpack(self._socket.recv(), self._most_bytes))
        except (BadMessage, RecursionError) as error:
            raise PolicyError("bad_reply", str(error)) from None
        if isinstance(answer, dict) and "error" in answer:
            said = one_line(str(answer["error"]))
            raise PolicyError(
                "unauthorized" if said.startswith(_DENIED) else "server_error", f"the server says: {said}"
            )
        return answer

    def close(self) -> None:
        """End it. Safe to call twice."""
        self._context.destroy(linger=0)


def _await(address: str, deadline: float) -> tuple[str, int]:
    """Number and port of a server of ZeroMQ's, once it is there. Raises PolicyError."""
    parts = urlsplit(address)
    where = (parts.hostname or "", parts.port or 0)
    while True:
        try:
            with socket.create_connection(where, max(deadline - time.monotonic(), 0.01)) as channel:
                channel.settimeout(max(deadline - time.monotonic(), 0.01))
                first, peer = channel.recv(1), channel.getpeername()
            if first not in (b"", _GREETING):
                raise PolicyError("bad_reply", f"it does not speak ZeroMQ: it says {first!r} first")
            if first:
                return peer[0], peer[1]
            failure = PolicyError("server_closed", "it hangs up")
        except socket.gaierror as error:
            raise PolicyError("server_absent", f"no such host: {one_line(str(error.strerror))}") from None
        except TimeoutError:
            failure = PolicyError("server_timeout", "it does not answer as ZeroMQ does")
        except OSError as error:
            failure = PolicyError("server_absent", one_line(str(error.strerror or error).lower()))
        time.sleep(max(min(_POLL_S, deadline - time.monotonic()), 0.0))
        if time.monotonic() >= deadline:
            raise failure


def _with_npy(value: Any) -> Any:
    """The same with arrays as GR00T sends them."""
    if isinstance(value, dict):
        return {key: _with_npy(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        file = io.BytesIO()
        np.save(file, value, allow_pickle=False)
        return {_ARRAY: True, _BYTES: file.getvalue()}
    return value


def _unpacked(value: Any) -> Any:
    """The same with arrays built. Raises BadMessage."""
    if isinstance(value, list):
        return [_unpacked(inner) for inner in value]
    if not isinstance(value, dict):
        return value
    if _ARRAY in value:
        return _array(value.get(_BYTES))
    return {key: _unpacked(inner) for key, inner in value.items()}


def _array(data: Any) -> np.ndarray[Any, Any]:
    """An array of the bytes of a .npy file: numpy's own reader believes the header before it has seen the numbers."""
    if not isinstance(data, bytes):
        raise BadMessage(f"an array whose file is {shown(data)}, not bytes")
    file = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError("another version than 1.0")
        shape, by_columns, dtype = np.lib.format.read_array_header_1_0(file)
    except (ValueError, SyntaxError, TypeError, KeyError, RecursionError, MemoryError) as error:
        raise BadMessage(f"an array that is no .npy file: {one_line(str(error))}") from None
    array = array_of(data[file.tell() :], dtype.str, shape[::-1] if by_columns else shape)
    return array.T if by_columns else array
