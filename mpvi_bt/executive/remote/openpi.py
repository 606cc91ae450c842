"""A policy behind a websocket, spoken to as openpi's own client does, or as BEHAVIOR's evaluator does.

A server is trusted with nothing: every wait ends, what it sends is bounded in size and checked, and what goes wrong is
a `PolicyError` with a reason code. A lost connection is made anew a few times; what the server refused is not repeated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.codec import pack
from mpvi_bt.executive.remote.connection import Connection, one_line
from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
from mpvi_bt.executive.remote.observation import Vocabulary, write_observation
from mpvi_bt.executive.remote.patient_client import PatientClient
from mpvi_bt.executive.remote.server_address import address_of
from mpvi_bt.executive.remote.wire_mapping import actions_of, message_of
from mpvi_bt.ground.errors import PolicyError, UserError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import KINDS, ActionKind
from mpvi_bt.ground.robot.action_rows import check_rate, command_of
from mpvi_bt.ground.robot.protocol import Proprioception

PORT = 8000
DEFAULT = "mpvi"  # settings
# What metadata call the rate: our own name, LeRobot's, vla-eval's (of its evaluator), robosuite's and openpi's (of its
# client). No published server of theirs sends one by itself; openpi's sends what its config has as `policy_metadata`.
RATE_NAMES = ("rate_hz", "fps", "hz", "control_frequency", "control_freq", "max_hz")


def url_of(address: str) -> str:
    """The websocket's URL of an address. Raises UserError."""
    return address_of(address, ("ws", "wss"), PORT, path=True)


def question(
    observation: Mapping[str, Any], settings: DialectSettings, fresh: bool, vocabulary: Vocabulary | None = None
) -> dict[str, Any]:
    """The message of an observation: what the settings map, or all of it.

    Args:
        observation: As `Policy.infer` takes it.
        settings: How the server is spoken to.
        fresh, vocabulary: As `write_observation` takes them; only the whole observation has them.
    """
    if settings.observation is None:
        return write_observation(observation, fresh, vocabulary)
    return message_of(observation, settings.observation)


def cameras_of(message: Mapping[str, Any], settings: DialectSettings, before: tuple[str, ...]) -> tuple[str, ...]:
    """The server's wanted cameras for its next answer, among those of the settings; unchanged if it names none."""
    wanted = message.get("cameras")
    if isinstance(wanted, list) and all(isinstance(c, str) and c in settings.known_cameras for c in wanted):
        return tuple(camera for camera in settings.cameras if camera in wanted)
    return before


class OpenpiPolicy(PatientClient[Connection]):
    """A remote policy; it is connected to when it is first needed.

    Args:
        address: "ws://host:port", "wss://host:port" or "host:port"; the port is 8000 where none is given.
        settings: How the server is spoken to, or the name or path of their file.
        vocabulary: What labels of pictures are called; told to a server that takes the whole observation.
        called: Name or file of the settings, where those themselves are given.

    Raises:
        UserError: The address or the settings are not valid.

    Attributes:
        name: "openpi:" and the URL.
        cameras: Those that the settings map; fewer if the server names its own (docs/serving_policies.md).
        note: What the server says that it is doing; one line.
        gave_up: Whether it says that it will do no more about the prompt.
        ended: Whether it says that it thinks the prompt done, or has given up.
        progress: How far along it takes itself to be, 0 to 1; None if it does not say, or says what no progress is.
        rate_hz: Rows a second, as the settings or else the server says; None: neither does.
        rate_from: Who says it.
        actions: What the joints in a row are, likewise.
        connections: How many have been made.
    """

    kind = "openpi"

    def __init__(
        self,
        address: str,
        settings: DialectSettings | str = DEFAULT,
        vocabulary: Vocabulary | None = None,
        called: str = "",
    ) -> None:
        self._url = url_of(address)
        told = load_settings(settings) if isinstance(settings, str) else settings
        super().__init__(f"{self.kind}:{self._url}", told, settings if isinstance(settings, str) else called)
        self._vocabulary = vocabulary
        self.cameras: tuple[str, ...] = self._settings.cameras
        self._unheard()
        self.rate_hz: float | None = self._settings.rate_hz
        self.rate_from = self._settings.rate_from
        self.actions: ActionKind = self._settings.actions or "absolute"
        self._fresh = True

    def reset(self) -> None:
        """Let the server begin anew, once it is there. Raises PolicyError."""
        self._fresh = True
        self._unheard()
        super().reset()

    def _open(self, deadline: float) -> Connection:
        return Connection(self._url, deadline, self._settings.max_mb << 20, self.hello())

    def _meet(self, connection: Connection, deadline: float) -> None:
        self.cameras = self._settings.cameras
        self._hear(connection.metadata)
        self._hear_rate(self.about())

    def about(self) -> Mapping[str, Any]:
        """What the server says of itself."""
        assert self._connection is not None
        about: Mapping[str, Any] = self._connection.metadata  # `_hear` has seen that it is one
        return about

    def hello(self) -> bytes:
        """What a new server is told first; openpi's speak first."""
        return b""

    def _begin(self, connection: Connection, deadline: float) -> None:
        self.cameras = self._settings.cameras
        self._hear(connection.metadata)  # what it wants first
        if self._settings.reset_message:
            connection.send(pack({"reset": True}), deadline)

    def _ask(
        self, observation: Mapping[str, Any], held: Proprioception, connection: Connection, deadline: float
    ) -> Array:
        # A server that came back may want pictures that it had not wanted before: the robot holds still once.
        if set(self.cameras) - set(observation["images"]):
            return command_of(observation["proprioception"])[None]
        action = self._settings.action
        message = question(observation, self._settings, self._fresh, self._vocabulary)
        asked = self._settings.request_chunk
        if asked is not None:
            message["__action_chunk_size__"] = asked
        self._sent = tuple(message)
        connection.expect_silence(deadline)
        connection.send(pack(message), deadline)
        reply = connection.receive(deadline)
        actions = actions_of(reply, action, held, observation["proprioception"])
        if asked is not None and "action_chunk" in reply:
            whole = action.model_copy(update={"key": "action_chunk"})
            first, actions = actions, actions_of(reply, whole, held, observation["proprioception"])
            if len(actions) != asked or not np.array_equal(first[0], actions[0]):
                raise PolicyError(
                    "bad_reply",
                    f"a chunk of {len(actions)} that begins otherwise than the action, or is not of {asked}",
                )
        self._hear(reply)
        self._hear_rate(reply)
        self._fresh, self._answered = False, True
        return actions

    def _hear_rate(self, about: Mapping[str, Any]) -> None:
        """Take in the rate of rows from metadata or an answer. Raises PolicyError: not a rate, or an unknown kind."""
        name = next((name for name in RATE_NAMES if name in about), None)
        if name is not None:
            try:
                rate_hz = check_rate(about[name])
            except UserError as error:
                raise PolicyError("bad_reply", f"{name} in the metadata: {error}") from None
            own = self._settings.rate_hz
            if own is None:
                self.rate_hz, self.rate_from = rate_hz, "the server"
            elif own != rate_hz:
                self.rate_from = f"{self._settings.rate_from}; the server says {rate_hz:g}"
        kind = about.get("actions")
        if self._settings.actions is None and isinstance(kind, str):
            if kind not in KINDS:
                raise PolicyError("bad_reply", f"actions in the metadata: {shown(kind)}; known: {', '.join(KINDS)}")
            self.actions = kind

    def _unheard(self) -> None:
        self.note, self.gave_up, self.ended = "", False, False
        self.progress: float | None = None

    def _hear(self, message: Any) -> None:
        """Take in what a server may say beside the actions, in its metadata and in each answer."""
        if not isinstance(message, dict):
            raise PolicyError("bad_reply", f"metadata that are {shown(message)}, not a mapping")
        self.cameras = cameras_of(message, self._settings, self.cameras)
        if isinstance(note := message.get("note"), str):
            self.note = one_line(note)
        self.gave_up = message.get("gave_up") is True
        self.ended = self.gave_up or message.get("ended") is True
        progress = message.get("progress")
        self.progress = None
        if isinstance(progress, int | float | np.floating) and not isinstance(progress, bool) and 0 <= progress <= 1:
            self.progress = float(progress)
