"""The dialect `openpi`: openpi's messages with our own keys, which lose nothing on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.observation import read_observation, write_observation
from mpvi_bt.executive.remote.reading import CHUNK, Reading, chunk_of, spoken
from mpvi_bt.ground.errors import BadMessage, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_rows import Resampler, as_absolute, most_of_kind, of_kind
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription

RATE = "rate_hz"  # of the client, if it does not want an action for each control step
COMMAND = "command"  # a key of ours: the targets that the robot has


class OwnKeys:
    """What `mpvi serve` takes for a policy, the robot's present targets beside it (docs/evaluator.md)."""

    name = "openpi"

    def read(self, message: Mapping[str, Any], robot: RobotDescription) -> Reading:
        """What an observation says. Raises BadMessage."""
        if (other := spoken(message)) not in ("", self.name):
            raise BadMessage(f"this is an observation of --protocol {other}, and --protocol {self.name} was chosen")
        said = {key: value for key, value in message.items() if key not in (COMMAND, CHUNK)}
        question = read_observation({"prompt": "", **said}, robot)
        seen = question.observation
        return Reading(
            body=_as_of(robot, seen["proprioception"]),
            images=seen["images"],
            command=_command(message[COMMAND], robot.layout.size) if COMMAND in message else None,
            instruction=seen["prompt"],
            vocabulary=question.vocabulary,
            steps=chunk_of(message) * _ticks(question.rate_hz or robot.layout.rate_hz),
        )

    def answer(
        self, actions: Array, asked: Mapping[str, Any], robot: RobotDescription, before: Array
    ) -> dict[str, Any]:
        """`actions`, (K, A); one for each row of a client that has a rate of its own, in the robot's kind.

        Deltas and velocities begin at the targets that the client tells, so that what it rounds does not add up.
        """
        layout = robot.layout
        rate_hz = asked.get(RATE, layout.rate_hz)
        if rate_hz != CONTROL_HZ:
            actions = Resampler(layout).resampled(actions, CONTROL_HZ, rate_hz, actions[0], whole=False)
        if layout.kind != "absolute":
            actions = of_kind(actions, layout.kind, rate_hz, np.asarray(asked.get(COMMAND, before), float), layout)
            most = most_of_kind(robot, layout.kind, rate_hz)
            actions[:, layout.joints] = np.clip(actions[:, layout.joints], -most, most)
        return {"actions": actions}

    def told(self, actions: Array, robot: RobotDescription, before: Array) -> Array:
        """(K, A) the control steps of an answer (H, A), by whoever has the robot; `before`: (A,) its targets.

        Raises:
            PolicyError: A joint is to go farther or faster than the robot is ever told to.
        """
        layout = robot.layout
        actions = as_absolute(actions, layout.kind, layout.rate_hz, before, robot)
        if layout.rate_hz == CONTROL_HZ:
            return actions
        return Resampler(layout).resampled(actions, layout.rate_hz, CONTROL_HZ, before)

    def write(self, observation: Mapping[str, Any], command: Array, vocabulary: Any = None) -> dict[str, Any]:
        """The message of an observation: the inverse of `read`."""
        return {**write_observation(observation, vocabulary=vocabulary), COMMAND: command}


def _ticks(rate_hz: float) -> int:
    """Control steps in a row of a client's. Raises BadMessage."""
    ticks = CONTROL_HZ / rate_hz
    if not ticks.is_integer():
        raise BadMessage(f"{RATE}: {rate_hz:g} is given; it must divide {CONTROL_HZ}, as 10 or 15 do")
    return int(ticks)


def _as_of(robot: RobotDescription, body: Proprioception) -> Proprioception:
    """What the robot feels, whatever name the client has for it. Raises BadMessage: it is of other joints."""
    joints = {side: len(body.arm[side]) for side in body.sides}
    due = {side: len(robot.arm_joints[side]) for side in robot.sides}
    if len(body.torso) != len(robot.torso_joints) or joints != due:
        raise BadMessage(f"proprioception.robot: joints of a {body.robot}, and --robot {robot.name} was chosen")
    return replace(body, robot=robot.name)


def _command(given: Any, size: int) -> Array:
    if not (isinstance(given, np.ndarray) and given.shape == (size,) and given.dtype.kind in "iuf"):
        what = f"{given.shape} {given.dtype}" if isinstance(given, np.ndarray) else shown(given)
        raise BadMessage(f"{COMMAND}: {what} is given, ({size},) numbers are wanted")
    if not np.isfinite(given).all():
        raise BadMessage(f"{COMMAND}: not every value is finite")
    return np.array(given, float)
