"""A stand-in for LeRobot's PolicyServer, written from its messages alone: it shares no code with the client."""

from __future__ import annotations

import io
import pickle
import struct
import sys
import types
from collections.abc import Callable, Iterator
from concurrent import futures
from typing import Any

import numpy as np

HOME = "lerobot.async_inference.helpers"
ROWS = 8


class Record:
    """An object of a class of LeRobot's, with whatever attributes it came with."""


class _Reader(pickle.Unpickler):
    """Reads what a client sends; the classes of LeRobot's are records here."""

    def find_class(self, module: str, name: str) -> Any:
        if module == HOME:
            return type(name, (Record,), {})
        assert module.startswith("numpy"), f"{module}.{name}"
        return super().find_class(module, name)


def pickled_chunk(first: int, rows: np.ndarray[Any, Any], name: str = "TimedAction") -> bytes:
    """The pickle that LeRobot's server makes of a chunk: its rows are views of one tensor of torch's."""
    import torch

    made = type(name, (Record,), {"__module__": HOME})
    homes = {home: types.ModuleType(home) for home in ("lerobot", "lerobot.async_inference", HOME)}
    setattr(homes[HOME], name, made)
    before = {home: sys.modules.get(home) for home in homes}
    sys.modules.update(homes)
    try:
        chunk = []
        for k, row in enumerate(torch.from_numpy(rows)):
            one = made()
            one.__dict__ |= {"timestamp": 0.1 * k, "timestep": first + k, "action": row}
            chunk.append(one)
        return pickle.dumps(chunk)
    finally:
        for home, module in before.items():
            if module is None:
                del sys.modules[home]
            else:
                sys.modules[home] = module


def actions(data: bytes) -> bytes:
    """A message `Actions`, whose only field are bytes."""
    length, size = len(data), b""
    while length > 127:
        size, length = size + struct.pack("B", length & 127 | 128), length >> 7
    return b"\x0a" + size + struct.pack("B", length) + data


def fields(message: bytes) -> dict[int, Any]:
    """Number to value of a message of Protocol Buffers, of integers and bytes."""
    at, found = 0, dict[int, Any]()

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            value |= (message[at] & 127) << shift
            at, shift = at + 1, shift + 7
            if message[at - 1] < 128:
                return value

    while at < len(message):
        key = number()
        if key & 7 == 0:
            found[key >> 3] = number()
        else:
            size = number()
            found[key >> 3], at = message[at : at + size], at + size
    return found


class LerobotServer:
    """Answers each observation with a chunk, unless it is told otherwise.

    Args:
        answer: The bytes of `Actions.data` for a step and its observation; what it raises breaks the call.
        service: Name of what it serves.

    Attributes:
        calls: Names of the methods that were called, in order.
        setups: What it was told to load.
        seen: Observations, as they came.
        pieces: What the pieces of the last observation said of themselves.
        port: Where it listens.
    """

    def __init__(
        self,
        answer: Callable[[int, dict[str, Any]], bytes] | None = None,
        service: str = "transport.AsyncInference",
        port: int = 0,
    ) -> None:
        import grpc

        self.answer = answer or (lambda step, seen: pickled_chunk(step, chunk_of(seen)))
        self.calls: list[str] = []
        self.setups: list[dict[str, Any]] = []
        self.seen: list[dict[str, Any]] = []
        self.pieces: list[int] = []
        self._last: Any = None
        methods = {
            "Ready": grpc.unary_unary_rpc_method_handler(self._ready),
            "SendPolicyInstructions": grpc.unary_unary_rpc_method_handler(self._instructions),
            "SendObservations": grpc.stream_unary_rpc_method_handler(self._observations),
            "GetActions": grpc.unary_unary_rpc_method_handler(self._actions),
        }
        self._server = grpc.server(futures.ThreadPoolExecutor(4))
        self._server.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(service, methods)])
        self.port = self._server.add_insecure_port(f"127.0.0.1:{port}")
        self._server.start()

    @property
    def address(self) -> str:
        return f"grpc://127.0.0.1:{self.port}"

    def __enter__(self) -> LerobotServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Go away, with every connection."""
        self._server.stop(0).wait(10)

    def _ready(self, request: bytes, context: Any) -> bytes:
        self.calls.append("Ready")
        assert request == b""
        return b""

    def _instructions(self, request: bytes, context: Any) -> bytes:
        self.calls.append("SendPolicyInstructions")
        told = _Reader(io.BytesIO(fields(request)[1])).load()
        assert type(told).__name__ == "RemotePolicyConfig"
        self.setups.append(vars(told))
        return b""

    def _observations(self, requests: Iterator[bytes], context: Any) -> bytes:
        self.calls.append("SendObservations")
        pieces = [fields(request) for request in requests]
        self.pieces = [piece[1] for piece in pieces]
        self._last = vars(_Reader(io.BytesIO(b"".join(piece[2] for piece in pieces))).load())
        self.seen.append(self._last)
        return b""

    def _actions(self, request: bytes, context: Any) -> bytes:
        self.calls.append("GetActions")
        data = self.answer(self._last["timestep"], self._last["observation"]) if self.setups else b""
        return actions(data) if data else b""


def chunk_of(seen: dict[str, Any]) -> np.ndarray[Any, Any]:
    """What is felt, and 1 more in each row."""
    state = np.array([seen[f"state_{k}"] for k in range(23)], np.float32)
    return state[None] + np.arange(ROWS, dtype=np.float32)[:, None]
