"""A policy server of GR00T's for tests, written from its published format alone: it shares no code with the client."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np

SIZES = {"base_velocity": 3, "torso": 4, "left_arm": 7, "left_gripper": 1, "right_arm": 7, "right_gripper": 1}
HORIZON = 16


def npy(array: np.ndarray[Any, Any], allow_pickle: bool = False) -> dict[str, Any]:
    """An array as a map with its .npy file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=allow_pickle)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def _decoded(item: dict[str, Any]) -> Any:
    return np.load(io.BytesIO(item["as_npy"]), allow_pickle=False) if "__ndarray_class__" in item else item


def config(keys: list[str], indices: tuple[int, ...] = (0,), as_text: bool = False) -> dict[str, Any]:
    """What is said of a modality."""
    about = {"delta_indices": list(indices), "modality_keys": keys, "action_configs": None}
    text = f'{{"delta_indices": {list(indices)}, "modality_keys": {str(keys).replace(chr(39), chr(34))}}}'
    return {"__ModalityConfig_class__": True, "as_json": text if as_text else about}


def modalities(**changed: Any) -> dict[str, Any]:
    """What is said of all, of a checkpoint that was finetuned on a dataset of an r1."""
    return {
        "video": config(["head", "left", "right"]),
        "state": config(list(SIZES)),
        "action": config(list(SIZES), tuple(range(HORIZON))),
        "language": config(["annotation.human.task_description"]),
        **changed,
    }


def rows(observation: dict[str, Any]) -> dict[str, Any]:
    """Each part of an action is what is felt of it, and 1 more in each row."""
    more = np.arange(HORIZON, dtype=np.float32)[None, :, None]
    return {key: npy((observation["state"][key] + more).astype(np.float32)) for key in SIZES}


class GrootServer:
    """Answers as GR00T's server does, unless it is told otherwise.

    Args:
        answer: The action for an observation, or bytes that are sent as they are. What it raises is told as an error.
        about: What it says of modalities.
        key: What a client must send; None: nothing.
        port: 0: any.

    Attributes:
        asked: Endpoint and data of each question, in order.
        port: Where it listens.
    """

    def __init__(
        self,
        answer: Callable[[dict[str, Any]], Any] = rows,
        about: Any = None,
        key: str | None = None,
        port: int = 0,
    ) -> None:
        import zmq

        self.answer, self.about, self.key = answer, modalities() if about is None else about, key
        self.asked: list[tuple[str, Any]] = []
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVTIMEO, 50)
        self._socket.bind(f"tcp://127.0.0.1:{port or '*'}")
        self.port = int(self._socket.getsockopt_string(zmq.LAST_ENDPOINT).rpartition(":")[2])
        self._again, self._ended = zmq.Again, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def __enter__(self) -> GrootServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Go away, with every connection."""
        self._ended.set()
        self._thread.join(10)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                request = msgpack.unpackb(self._socket.recv(), object_hook=_decoded)
            except self._again:
                continue
            self.asked.append((request["endpoint"], request.get("data")))
            try:
                said = self._answered(request)
            except ConnectionAbortedError:
                break
            except Exception as error:
                said = {"error": str(error)}
            self._socket.send(said if isinstance(said, bytes) else msgpack.packb(said))
        self._socket.close()
        self._context.term()

    def _answered(self, request: dict[str, Any]) -> Any:
        if self.key is not None and request.get("api_token") != self.key:
            return {"error": "Unauthorized: Invalid API token"}
        if request["endpoint"] == "get_modality_config":
            return self.about
        if request["endpoint"] == "reset":
            assert request["data"] == {"options": None}
            return {}
        assert request["endpoint"] == "get_action"
        said = self.answer(request["data"]["observation"])
        return said if isinstance(said, bytes) else [said, {}]
