"""One connection to LeRobot's PolicyServer: gRPC, whose messages are pickles with a few bytes before them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import urlsplit

from mpvi_bt.executive.remote.connection import Lost, one_line
from mpvi_bt.executive.remote.lerobot_pickles import read_chunk, written
from mpvi_bt.ground import proxies
from mpvi_bt.ground.errors import BadMessage, PolicyError
from mpvi_bt.ground.geometry.solids import Array

_SERVICE = "/transport.AsyncInference/"
_PIECE = 2 << 20  # bytes of an observation that go out at once, as LeRobot's own client has it
_BEGIN, _MIDDLE, _END = 1, 2, 3  # what a piece says of itself
_DATA = {"PolicySetup": 1, "Observation": 2, "Actions": 1}  # number of the field that has the pickle


class LerobotConnection:
    """A channel to a PolicyServer.

    Args:
        address: Such as "grpc://localhost:8080".
        deadline: Until when to wait for a server (`time.monotonic`).
        most_bytes: Of an answer.

    Raises:
        PolicyError: Nobody is there by then.
    """

    def __init__(self, address: str, deadline: float, most_bytes: int) -> None:
        import grpc

        own = proxies.is_this_machine(address)
        options = [("grpc.max_receive_message_length", most_bytes), ("grpc.enable_http_proxy", int(not own))]
        self._errors, self._code = grpc.RpcError, grpc.StatusCode
        self._channel = grpc.insecure_channel(urlsplit(address).netloc, options)
        self._step = 0
        try:
            grpc.channel_ready_future(self._channel).result(max(deadline - time.monotonic(), 0.01))
        except grpc.FutureTimeoutError:
            self.close()
            raise PolicyError("server_absent", "no server of gRPC is there") from None

    def ready(self, deadline: float) -> None:
        """Have the server forget what it was asked. Raises PolicyError."""
        self._call("Ready", b"", deadline)

    def instruct(self, setup: Mapping[str, Any], deadline: float) -> None:
        """Have the server load a checkpoint: a `RemotePolicyConfig`. Raises PolicyError."""
        self._call(
            "SendPolicyInstructions", _field(_DATA["PolicySetup"], written("RemotePolicyConfig", setup)), deadline
        )

    def ask(self, observation: Mapping[str, Any], deadline: float) -> Array:
        """(H, n) the actions for an observation. Raises PolicyError."""
        self._step += 1
        told = {"timestamp": time.time(), "timestep": self._step, "observation": dict(observation), "must_go": True}
        self._call("SendObservations", _pieces(written("TimedObservation", told)), deadline)
        try:
            message = _data(self._call("GetActions", b"", deadline), _DATA["Actions"])
            if not message:
                # Its answer to an error; also where it was started anew, and has loaded nothing: it is told again.
                raise Lost("server_error", "it has no actions; its own terminal says why (Error in StreamActions)")
            step, rows = read_chunk(message)
        except BadMessage as error:
            raise PolicyError("bad_reply", str(error)) from None
        if step != self._step:
            raise PolicyError(
                "bad_reply", f"actions for observation {step}, and {self._step} was sent: has it two clients?"
            )
        return rows

    def close(self) -> None:
        """End it. Safe to call twice."""
        self._channel.close()

    def _call(self, name: str, message: bytes | Iterator[bytes], deadline: float) -> bytes:
        """What a method answers. Raises PolicyError."""
        make = self._channel.unary_unary if isinstance(message, bytes) else self._channel.stream_unary
        try:
            answer: bytes = make(_SERVICE + name)(message, timeout=max(deadline - time.monotonic(), 0.01))
        except self._errors as error:
            code, said = error.code(), one_line(str(error.details()))
            if code is self._code.DEADLINE_EXCEEDED:
                raise PolicyError("server_timeout", "no answer in time") from None
            if code is self._code.UNAVAILABLE:
                raise Lost("server_closed", f"the connection broke: {said}") from None
            if code is self._code.UNIMPLEMENTED:
                raise PolicyError("bad_reply", "it is a server of gRPC, but no PolicyServer of LeRobot's") from None
            if code is self._code.RESOURCE_EXHAUSTED:
                raise PolicyError("bad_reply", f"an answer that is too large: {said}") from None
            raise PolicyError("server_error", f"the server says: {said}") from None
        return answer


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


def _field(number: int, data: bytes) -> bytes:
    """Bytes as a field of a message of Protocol Buffers."""
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _pieces(pickled: bytes) -> Iterator[bytes]:
    """An observation in pieces, each of which says whether it is the first, one between, or the last."""
    for begin in range(0, len(pickled), _PIECE):
        piece = pickled[begin : begin + _PIECE]
        state = _END if begin + _PIECE >= len(pickled) else _MIDDLE if begin else _BEGIN
        yield _varint(1 << 3) + _varint(state) + _field(_DATA["Observation"], piece)


def _data(message: bytes, number: int) -> bytes:
    """The bytes of a message that has but one field; b"": it has none. Raises BadMessage."""
    if not message:
        return b""
    length, at = 0, 1
    while at < min(len(message), 10):
        length |= (message[at] & 127) << 7 * (at - 1)
        at += 1
        if message[at - 1] < 128:
            break
    if message[0] != number << 3 | 2 or len(message) != at + length:
        raise BadMessage("a message that is no Actions of LeRobot's")
    return message[at:]
