"""A policy server of GR00T's, from N1.6 on: pictures, states and language by the names of its modalities."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.connection import key_of_environment
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.groot_wire import GrootConnection
from mpvi_bt.executive.remote.patient_client import PatientClient
from mpvi_bt.executive.remote.server_address import address_of
from mpvi_bt.executive.remote.wire_mapping import actions_of, picture, state
from mpvi_bt.ground.errors import PolicyError, UserError, shown
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.protocol import Proprioception

PORT = 5555
DEFAULT = "groot"  # settings
_VIDEO, _STATE, _LANGUAGE = "video", "state", "language"  # what keys of settings begin with
_SENT = (_VIDEO, _STATE, _LANGUAGE)


@dataclass(frozen=True)
class Modality:
    """What a server says of pictures, states, language or actions.

    Attributes:
        keys: Their names, in order.
        moments: How many moments it wants of each.
    """

    keys: Sequence[str]
    moments: int


class GrootPolicy(PatientClient[GrootConnection]):
    """A remote policy; it is connected to when it is first needed.

    Args:
        address: "tcp://host:port" or "host:port"; the port is 5555 where none is given.
        settings: How the server is spoken to.
        called: Their name or file.

    Raises:
        UserError: The address or the settings are not valid, or pyzmq is missing.

    Attributes:
        name: "groot:" and the address.
        cameras: Those that the settings map.
        rate_hz: Rows a second, as the settings say; None: they do not.
        rate_from: Who says it.
        actions: What the joints in a row are.
    """

    def __init__(self, address: str, settings: DialectSettings, called: str = "") -> None:
        self._address = address_of(address, ("tcp",), PORT)
        super().__init__(f"groot:{self._address}", settings, called)
        self._keys = _keys(settings, called)
        if importlib.util.find_spec("zmq") is None:
            raise UserError(f"GR00T's servers speak ZeroMQ, which needs pyzmq: {install('groot')}")
        self.cameras: tuple[str, ...] = settings.cameras
        self.rate_hz: float | None = settings.rate_hz
        self.rate_from = settings.rate_from
        self.actions: ActionKind = settings.actions or "absolute"
        self._order: Sequence[str] = ()  # of the parts of an action

    def _open(self, deadline: float) -> GrootConnection:
        return GrootConnection(self._address, deadline, self._settings.max_mb << 20, key_of_environment())

    def _meet(self, connection: GrootConnection, deadline: float) -> None:
        """Check that the settings send what it wants."""
        wants = _modalities(connection.ask("get_modality_config", None, deadline))
        for kind in _SENT:
            for key in wants[kind].keys if kind in wants else ():
                if key not in self._keys[kind]:
                    sent = ", ".join(self._keys[kind]) or "nothing"
                    raise PolicyError("bad_reply", f"it wants {kind} {shown(key)}, and the settings send: {sent}")
            if kind in wants and wants[kind].moments != 1:
                moments = wants[kind].moments
                raise PolicyError("bad_reply", f"it wants {kind} of {moments} moments, and only the present is sent")
        self._order = wants["action"].keys if "action" in wants else ()

    def _begin(self, connection: GrootConnection, deadline: float) -> None:
        connection.ask("reset", {"options": None}, deadline)

    def _ask(
        self, observation: Mapping[str, Any], held: Proprioception, connection: GrootConnection, deadline: float
    ) -> Array:
        data = {"observation": self._question(observation), "options": None}
        answer = connection.ask("get_action", data, deadline)
        parts = answer[0] if isinstance(answer, list) and answer else answer
        action = self._settings.action.model_copy(update={"key": "actions"})
        rows = actions_of({"actions": _joined(parts, self._order)}, action, held, observation["proprioception"])
        self._answered = True
        return rows

    def _question(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """An observation as GR00T has it: a batch of one, of one moment."""
        layout, body = self._settings.observation, observation["proprioception"]
        assert layout is not None  # `_keys` has seen to it
        video = {
            key: np.ascontiguousarray(picture(observation["images"][image.camera], image))[None, None]
            for key, image in layout.images.items()
        }
        states = {key: state(body, vector).astype(np.float32)[None, None] for key, vector in layout.state.items()}
        texts = {layout.prompt: [[observation["prompt"]]]} if layout.prompt else {}
        texts |= {key: [[text]] for key, text in layout.constants.items() if isinstance(text, str)}
        message: dict[str, Any] = {kind: {} for kind in _SENT}
        for key, value in {**video, **states, **texts}.items():
            kind, _, name = key.partition(".")
            message[kind][name] = value
        return message


def _keys(settings: DialectSettings, called: str) -> dict[str, list[str]]:
    """What the settings send, by kind. Raises UserError if they are of another protocol."""
    layout = settings.observation
    if layout is None:
        raise UserError(f"the settings {called} send the whole observation, which GR00T's servers do not read")
    said: dict[str, list[str]] = {kind: [] for kind in _SENT}
    texts = [key for key, text in layout.constants.items() if isinstance(text, str)]
    texts += [layout.prompt] if layout.prompt else []
    for kind, keys in ((_VIDEO, layout.images), (_STATE, layout.state), (_LANGUAGE, texts)):
        for key in keys:
            begins, _, name = key.partition(".")
            if begins != kind or not name:
                raise UserError(f"the settings {called} have the key {key!r}; for GR00T it begins with '{kind}.'")
            said[kind].append(name)
    return said


def _modalities(answer: Any) -> dict[str, Modality]:
    """What a server says of itself, by kind. Raises PolicyError."""
    if not isinstance(answer, dict):
        raise PolicyError("bad_reply", f"a modality config that is {shown(answer)}")
    said: dict[str, Modality] = {}
    for kind, config in answer.items():
        try:
            about = config["as_json"]
            about = json.loads(about) if isinstance(about, str) else about
            keys, moments = about["modality_keys"], about["delta_indices"]
            if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
                raise ValueError
            said[str(kind)] = Modality(keys, len(moments))
        except (KeyError, TypeError, ValueError, RecursionError):
            raise PolicyError("bad_reply", f"a modality config of {shown(kind)} without keys and indices") from None
    return said


def _joined(parts: Any, order: Sequence[str]) -> np.ndarray[Any, Any]:
    """(H, n) the parts of an action, (1, H, n) each, one after the other. Raises PolicyError."""
    if not isinstance(parts, dict) or not parts:
        raise PolicyError("bad_reply", f"an action that is {shown(parts)}")
    arrays = []
    for key in order or list(parts):
        part = parts.get(key, parts.get(f"action.{key}"))
        if not isinstance(part, np.ndarray):
            raise PolicyError(
                "bad_reply", f"no part {shown(key)} in the action, which has: {', '.join(map(str, parts))[:200]}"
            )
        if part.ndim != 3 or len(part) != 1 or part.dtype.kind not in "fiu":
            raise PolicyError(
                "bad_reply", f"part {shown(key)} of shape {part.shape} {part.dtype}, not (1, H, n) numbers"
            )
        arrays.append(part[0])
    if len({len(array) for array in arrays}) != 1:
        raise PolicyError("bad_reply", f"parts of an action with {[len(array) for array in arrays]} rows")
    return np.concatenate(arrays, axis=1)
