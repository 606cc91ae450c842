"""The four metrics of an episode besides its goal: simulated time and three distances.

Directions: time and distances are lower-is-better as measured; normalized by the human mean (human / robot, as the
evaluator does, the inverse of the paper's wording) they are higher-is-better, 1.0 being as good as a human.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from mpvi_bt.errors import BackendError
from mpvi_bt.executive.loop import Watcher, World
from mpvi_bt.robot.protocol import CONTROL_HZ, SIDES, Proprioception, Side
from mpvi_bt.robot.solids import Array, pose
from mpvi_bt.tree.build import Tree

_PARTS = ("base", *(f"{side} {frame}" for side in SIDES for frame in ("world", "base")))

DIRECTIONS: Mapping[str, str] = {
    "q_score": "0..1, higher is better",
    "goal_fraction": "0..1, higher is better",
    "time.simulator_time": "seconds, lower is better",
    "time.normalized_time": "human / robot, higher is better",
    "agent_distance": "metres in the world, lower is better",
    "agent_distance_base_relative": "metres of the hands in the base frame, lower is better",
    "normalized_agent_distance": "human / robot, higher is better",
}


@runtime_checkable
class MeasuredRobot(Protocol):
    """What the meter reads of a robot."""

    def proprioception(self) -> Proprioception:
        """What the robot feels now."""
        ...

    def hand_pose_world(self, side: Side) -> Array:
        """(4, 4) pose of a hand, hand to world."""
        ...


@dataclass(frozen=True)
class Measurement:
    """What was measured over an episode.

    Attributes:
        steps: Control steps.
        base_m: Sum of the base's steps on the floor.
        hand_world_m: Sum of each hand's steps in the world: driving counts.
        hand_base_m: Sum of each hand's steps in the base frame: driving does not count.
    """

    steps: int
    base_m: float
    hand_world_m: Mapping[Side, float]
    hand_base_m: Mapping[Side, float]

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.steps / CONTROL_HZ


class Meter(Watcher):
    """Adds up steps and distances while an episode runs."""

    def __init__(self) -> None:
        self._steps = 0
        self._sums: dict[str, float] = dict.fromkeys(_PARTS, 0.0)
        self._last: dict[str, Array] = {}

    def start(self, tree: Tree, world: World) -> None:
        """Begin anew from where the robot is. Raises BackendError if it cannot tell where its hands are."""
        robot = world.robot
        if not isinstance(robot, MeasuredRobot):
            raise BackendError(f"{type(robot).__name__} has no hand_pose_world, so its hands cannot be measured")
        self._robot: MeasuredRobot = robot
        self._steps, self._last = 0, _positions(robot)
        self._sums = dict.fromkeys(_PARTS, 0.0)

    def step(self, tree: Tree, world: World) -> None:
        """Add what moved since the last call."""
        now = _positions(self._robot)
        for part in _PARTS:
            self._sums[part] += float(np.linalg.norm(now[part] - self._last[part]))
        self._steps, self._last = world.steps, now

    @property
    def measurement(self) -> Measurement:
        """What was measured so far."""
        return Measurement(
            steps=self._steps,
            base_m=self._sums["base"],
            hand_world_m={side: self._sums[f"{side} world"] for side in SIDES},
            hand_base_m={side: self._sums[f"{side} base"] for side in SIDES},
        )


def ratio(human: float, robot: float) -> float | None:
    """Human / robot; None where the robot's is 0 (the evaluator writes inf, which is no JSON)."""
    return human / robot if robot > 0.0 else None


def _positions(robot: MeasuredRobot) -> dict[str, Array]:
    """(2,) or (3,) position [m] of each of `_PARTS`."""
    x, y, yaw = robot.proprioception().base_pose
    T_world_base = pose((x, y, 0.0), yaw)
    positions = {"base": np.array([x, y])}
    for side in SIDES:
        hand = robot.hand_pose_world(side)[:3, 3]
        positions[f"{side} world"] = hand
        positions[f"{side} base"] = T_world_base[:3, :3].T @ (hand - T_world_base[:3, 3])
    return positions
