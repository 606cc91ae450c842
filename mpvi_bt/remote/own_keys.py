"""The dialect `openpi`: openpi's messages with our own keys, which lose nothing on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mpvi_bt.errors import BadMessage, shown
from mpvi_bt.remote.observation import read_observation, write_observation
from mpvi_bt.remote.reading import CHUNK, Reading, chunk_of, spoken
from mpvi_bt.robot.model import RobotModel
from mpvi_bt.robot.protocol import ACTION_SIZE
from mpvi_bt.robot.solids import Array

COMMAND = "command"  # a key of ours: the targets that the robot has


class OwnKeys:
    """What `mpvi serve` takes for a policy, the robot's present targets beside it (docs/evaluator.md)."""

    name = "openpi"

    def read(self, message: Mapping[str, Any], robot: RobotModel) -> Reading:
        """What an observation says. Raises BadMessage."""
        if (other := spoken(message)) not in ("", self.name):
            raise BadMessage(f"this is an observation of --protocol {other}, and --protocol {self.name} was chosen")
        said = {key: value for key, value in message.items() if key not in (COMMAND, CHUNK)}
        question = read_observation({"prompt": "", **said})
        seen = question.observation
        return Reading(
            body=replace(seen["proprioception"], robot=robot.name),
            images=seen["images"],
            command=_command(message[COMMAND]) if COMMAND in message else None,
            instruction=seen["prompt"],
            vocabulary=question.vocabulary,
            steps=chunk_of(message),
        )

    def answer(self, actions: Array, asked: Mapping[str, Any]) -> dict[str, Any]:
        """`actions`, (K, 23)."""
        return {"actions": actions}

    def write(self, observation: Mapping[str, Any], command: Array, vocabulary: Any = None) -> dict[str, Any]:
        """The message of an observation: the inverse of `read`."""
        return {**write_observation(observation, vocabulary=vocabulary), COMMAND: command}


def _command(given: Any) -> Array:
    if not (isinstance(given, np.ndarray) and given.shape == (ACTION_SIZE,) and given.dtype.kind in "iuf"):
        what = f"{given.shape} {given.dtype}" if isinstance(given, np.ndarray) else shown(given)
        raise BadMessage(f"{COMMAND}: {what} is given, ({ACTION_SIZE},) numbers are wanted")
    if not np.isfinite(given).all():
        raise BadMessage(f"{COMMAND}: not every value is finite")
    return np.array(given, float)
