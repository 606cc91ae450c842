"""A checkpoint of LeRobot's behind LeRobot's own PolicyServer, which loads what its client names."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.lerobot_checkpoint import (
    PICTURES,
    STATE,
    LerobotCheckpoint,
    fitting_checkpoint,
    rate_of,
)
from mpvi_bt.executive.remote.lerobot_frames import cameras_of_checkpoint, frame_of
from mpvi_bt.executive.remote.lerobot_wire import LerobotConnection
from mpvi_bt.executive.remote.patient_client import PatientClient
from mpvi_bt.executive.remote.server_address import address_of
from mpvi_bt.executive.remote.wire_mapping import actions_of
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.protocol import Proprioception

PORT = 8080
SCHEME = "grpc"


class LerobotServerPolicy(PatientClient[LerobotConnection]):
    """A remote policy; it is connected to when it is first needed, and the server loads its checkpoint then.

    Args:
        address: "grpc://host:port/folder"; the folder is that of the checkpoint, as the server has it. Its JSON files
            are read here, too, from there or from the `checkpoint` of the settings.
        settings: What its features are.
        called: Their name or file; "": there are none.
        robot: Name or file of the robot; None: that of the settings, of its dataset, or the default one.

    Raises:
        UserError: The address is none, the checkpoint cannot be read here, does not fit the robot or cannot be served,
            or grpcio is missing.

    Attributes:
        checkpoint: What it says of itself.
        name: "lerobot:" and the address.
        cameras: Those whose pictures it is shown.
        rate_hz: Rows a second, of the settings or of the dataset that it was trained on; None: nobody says.
        rate_from: Who says it.
        actions: What the joints in a row are.
    """

    def __init__(self, address: str, settings: DialectSettings, called: str = "", robot: str | None = None) -> None:
        self._address = address_of(address, (SCHEME,), PORT, path=True)
        super().__init__(f"lerobot:{self._address}", settings, called)
        self.checkpoint, self._there = _found(self._address, settings, robot)
        _require_servable(self.checkpoint)
        if importlib.util.find_spec("grpc") is None:
            raise UserError(f"LeRobot's server speaks gRPC, which needs grpcio: {install('lerobot-grpc')}")
        self.cameras = cameras_of_checkpoint(self.checkpoint, settings)
        self.rate_hz, self.rate_from = rate_of(self.checkpoint, settings)
        self.actions: ActionKind = settings.actions or self.checkpoint.actions or "absolute"

    def _open(self, deadline: float) -> LerobotConnection:
        return LerobotConnection(self._address, deadline, self._settings.max_mb << 20)

    def _meet(self, connection: LerobotConnection, deadline: float) -> None:
        """Have it load the checkpoint."""
        one = self.checkpoint
        features: dict[str, Any] = {STATE: {"dtype": "float32", "shape": (one.numbers[STATE],), "names": _names(one)}}
        for key, size in one.pictures.items():
            features[key] = {"dtype": "image", "shape": (*size, 3), "names": ["height", "width", "channels"]}
        setup = {
            "policy_type": one.kind,
            "pretrained_name_or_path": self._there,
            "lerobot_features": features,
            "actions_per_chunk": one.rows,
            "device": self._settings.device or one.device,
            "rename_map": {},
        }
        connection.ready(deadline)
        connection.instruct(setup, deadline)

    def _begin(self, connection: LerobotConnection, deadline: float) -> None:
        connection.ready(deadline)

    def _ask(
        self, observation: Mapping[str, Any], held: Proprioception, connection: LerobotConnection, deadline: float
    ) -> Array:
        frame = frame_of(observation, self.checkpoint, self._settings)
        told: dict[str, Any] = dict(zip(_names(self.checkpoint), frame[STATE].tolist(), strict=True))
        told |= {key.removeprefix(PICTURES): frame[key] for key in self.checkpoint.pictures}
        answer = connection.ask(told | {"task": observation["prompt"]}, deadline)
        action = self._settings.action.model_copy(update={"key": "actions"})
        rows = actions_of({"actions": answer}, action, held, observation["proprioception"])
        self._answered = True
        return rows


def _found(address: str, settings: DialectSettings, robot: str | None) -> tuple[LerobotCheckpoint, str]:
    """A checkpoint, and its folder as the server has it. Raises UserError."""
    named = urlsplit(address).path
    if not (here := settings.checkpoint or named):
        form = f"{SCHEME}://HOST:PORT/FOLDER"
        raise UserError(f"{address}: LeRobot's server loads the checkpoint that it is told: write {form}.")
    try:
        checkpoint = fitting_checkpoint(Path(here).expanduser(), settings, robot, weights=False)
    except UserError as error:
        more = (
            "" if settings.checkpoint else " (`checkpoint` in a file of settings names a copy of its JSON files here)"
        )
        raise UserError(f"{error}{more}") from None
    return checkpoint, named if named and settings.checkpoint else str(checkpoint.folder.absolute())


def _require_servable(one: LerobotCheckpoint) -> None:
    """Raise UserError for what LeRobot's server would not do, or would do silently otherwise."""
    called = f"the checkpoint {one.folder}"
    if not one.whole_chunks:
        raise UserError(f"{called} is asked for each row, and LeRobot's server answers chunks: run it in this process.")
    if STATE not in one.numbers:
        raise UserError(f"{called} wants no {STATE!r}, without which LeRobot's server takes no observation.")
    for key in one.pictures:
        if not key.startswith(PICTURES):
            raise UserError(f"{called} wants pictures as {key!r}; LeRobot's server passes on those of {PICTURES}NAME.")


def _names(one: LerobotCheckpoint) -> list[str]:
    """Of the numbers of its state, for LeRobot's server, which puts them together by name."""
    return [f"state_{k}" for k in range(one.numbers[STATE])]
