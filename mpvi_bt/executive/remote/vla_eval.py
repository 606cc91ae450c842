"""A model server of the vla-eval package: pi-0.5, GR00T, X-VLA, OpenVLA, LeRobot's policies behind one protocol.

Every message has a type, a payload and a number, which the answer repeats. The client says hello first; the server
answers what its actions are. An episode is started before its observations, and errors leave the connection open.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.codec import array_of, pack
from mpvi_bt.executive.remote.connection import Connection, one_line
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.observation import Vocabulary
from mpvi_bt.executive.remote.openpi import OpenpiPolicy, cameras_of, question
from mpvi_bt.executive.remote.wire_mapping import actions_of
from mpvi_bt.ground.errors import BadMessage, PolicyError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_rows import command_of
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robots import layout_of
from mpvi_bt.ground.version import __version__

VERSION = 1  # of the protocol
DEFAULT = "vla_eval"  # settings
_ARRAY = "__ndarray__"


class VlaEvalPolicy(OpenpiPolicy):
    """A remote policy that speaks vla-eval's protocol.

    Args:
        address: As `OpenpiPolicy` takes it.
        settings: How the server is spoken to, or the name or path of their file.
        vocabulary, called: As `OpenpiPolicy` takes them.

    Raises:
        UserError: The address or the settings are not valid.
    """

    kind = "vla_eval"

    def __init__(
        self,
        address: str,
        settings: DialectSettings | str = DEFAULT,
        vocabulary: Vocabulary | None = None,
        called: str = "",
    ) -> None:
        super().__init__(address, settings, vocabulary, called)
        self._number = 0
        self._sizes: dict[str, int] = {}  # of the parts of its actions, as it has said
        self._first = self.cameras
        self._episode: Connection | None = None  # the one on which an episode has been started

    def about(self) -> Mapping[str, Any]:
        """What the server says of itself, in its answer to hello."""
        return _read(super().about())[1]

    def hello(self) -> bytes:
        """The first message, which the server waits for."""
        return self._message("hello", {"harness_version": f"mpvi_bt {__version__}", "protocol_version": VERSION})

    def _message(self, kind: str, payload: Mapping[str, Any]) -> bytes:
        self._number += 1
        return pack({"type": kind, "payload": payload, "seq": self._number, "timestamp": time.time()})

    def _hear(self, message: Any) -> None:
        """Check what the server says of itself against the settings. Raises PolicyError."""
        kind, payload, _ = _read(message)
        if kind != "hello":
            raise PolicyError("bad_reply", f"a message of type {shown(kind)} in answer to hello")
        version = payload.get("protocol_version")
        if not (isinstance(version, int) and version == VERSION):
            raise PolicyError("bad_reply", f"version {shown(version)} of the protocol; {VERSION} is spoken here")
        self._sizes = _sizes(payload.get("action_spec"))
        if due := self._settings.action.told_size:
            self._check_sizes(due, "the settings say")
        wants = payload.get("observation_params")
        layout = self._settings.observation
        if isinstance(wants, dict) and wants.get("send_state") is True and layout is not None and not layout.state:
            raise PolicyError("bad_reply", "it reads a state, and the settings send none")
        first = wants if isinstance(wants, dict) else {}
        self.cameras = self._first = cameras_of(first, self._settings, self._settings.cameras)

    def _check_sizes(self, due: int, who: str) -> None:
        """Raise PolicyError if the server has said of its actions that they have another number of numbers."""
        if self._sizes and all(self._sizes.values()) and sum(self._sizes.values()) != due:
            parts = ", ".join(f"{one_line(name, 40)} {size}" for name, size in self._sizes.items())
            told = f"actions of {sum(self._sizes.values())} numbers ({parts}); {who} {due}"
            raise PolicyError("bad_reply", told)

    def _begin(self, connection: Connection, deadline: float) -> None:
        """The episode is started with its first observation, which has the prompt."""
        self.cameras = self._first

    def _ask(
        self, observation: Mapping[str, Any], held: Proprioception, connection: Connection, deadline: float
    ) -> Array:
        if not self._settings.action.told_size:
            self._check_sizes(layout_of(held).size, f"the {held.robot} has")
        if set(self.cameras) - set(observation["images"]):
            return command_of(observation["proprioception"])[None]
        if self._fresh or self._episode is not connection:
            if self._episode is connection:
                connection.send(self._message("episode_end", {}), deadline)
            connection.send(self._message("episode_start", {"task": {"name": observation["prompt"]}}), deadline)
            self._episode = connection
        payload = _with_plain_arrays(question(observation, self._settings, self._fresh, self._vocabulary))
        connection.send(self._message("observation", payload), deadline)
        answer = _answer(connection, self._number, deadline)
        actions = actions_of(answer, self._settings.action, held, observation["proprioception"])
        super()._hear(answer)
        self._hear_rate(answer)
        self._fresh, self._answered = False, True
        return actions


def _answer(connection: Connection, number: int, deadline: float) -> dict[str, Any]:
    """The payload of the action that answers the observation of a number. Raises PolicyError."""
    while True:
        kind, payload, answered = _read(connection.receive(deadline))
        if kind == "error":
            raise PolicyError("server_error", f"the server says: {one_line(str(payload.get('error')))}")
        if kind != "action" or answered > number:
            raise PolicyError(
                "bad_reply",
                f"a message of type {shown(kind)}, number {answered}; an action, number {number}, is awaited",
            )
        if answered == number:  # a lower one comes late: a server that infers on its own may send several
            return payload


def _read(message: Any) -> tuple[str, dict[str, Any], int]:
    """Type, payload and number of a message, arrays unpacked. Raises PolicyError."""
    if not isinstance(message, dict):
        raise PolicyError("bad_reply", f"a message that is {shown(message)}")
    kind, payload, number = (message.get(key) for key in ("type", "payload", "seq"))
    if not isinstance(kind, str) or not isinstance(payload, dict) or not isinstance(number, int):
        raise PolicyError("bad_reply", "a message without a type, a payload or a number")
    try:
        return kind, _unpacked(payload), number
    except (BadMessage, RecursionError) as error:
        raise PolicyError("bad_reply", str(error)) from None


def _unpacked(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if _ARRAY in value:
        return array_of(value.get("data"), value.get("dtype"), value.get("shape"))
    return {key: _unpacked(inner) for key, inner in value.items()}


def _with_plain_arrays(value: Any) -> Any:
    """Arrays as maps with text for keys, where openpi has bytes."""
    if isinstance(value, dict):
        return {key: _with_plain_arrays(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return {_ARRAY: True, "data": value.tobytes(), "dtype": value.dtype.str, "shape": list(value.shape)}
    return value


def _sizes(spec: Any) -> dict[str, int]:
    """How many numbers each part of an action has, 0 where the server does not say."""
    if not isinstance(spec, dict):
        return {}
    sizes = {str(name): part.get("dims") if isinstance(part, dict) else 0 for name, part in spec.items()}
    return {name: size if isinstance(size, int) else 0 for name, size in sizes.items()}
