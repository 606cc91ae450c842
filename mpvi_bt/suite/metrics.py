"""The four metrics of an episode besides its goal: simulated time and three distances.

Directions: time and distances are lower-is-better as measured; normalized by the human mean (human / robot, as the
evaluator does, the inverse of the paper's wording) they are higher-is-better, 1.0 being as good as a human.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from mpvi_bt.paths import shipped
from mpvi_bt.robot.protocol import CONTROL_HZ, SIDES, Proprioception, Side
from mpvi_bt.robot.solids import Array, pose

DIRECTIONS: Mapping[str, str] = {
    "q_score": "0..1, higher is better",
    "goal_fraction": "0..1, higher is better",
    "time.simulator_time": "seconds, lower is better",
    "time.normalized_time": "human / robot, higher is better",
    "agent_distance": "metres in the world, lower is better",
    "agent_distance_base_relative": "metres of the hands in the base frame, lower is better",
    "normalized_agent_distance": "human / robot, higher is better",
}


class MeasuredRobot(Protocol):
    """What the meter reads of a robot."""

    def proprioception(self) -> Proprioception:
        """What the robot feels now."""
        ...

    def hand_pose_world(self, side: Side) -> Array:
        """(4, 4) pose of a hand, hand to world."""
        ...


class MeasuredWorld(Protocol):
    """What the meter reads of a world."""

    @property
    def robot(self) -> MeasuredRobot:
        """The robot in it."""
        ...


@dataclass(frozen=True)
class Human:
    """Means over the human demonstrations of a task.

    Attributes:
        steps: Control steps of 1/30 s.
        base_m: Distance driven.
        hand_m: Distance of each hand, in the base frame (proprioception), unlike the robot's official one.
    """

    steps: float
    base_m: float
    hand_m: Mapping[Side, float]

    @property
    def time_budget_s(self) -> float:
        """Twice the mean human time, in whole steps (BEHAVIOR challenge 2025: int(2 x mean steps))."""
        return int(2 * self.steps) / CONTROL_HZ


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


class Meter:
    """Adds up distances while an episode runs: a subscriber of the executive."""

    def __init__(self) -> None:
        self._steps = 0
        self._sums: dict[str, float] = {}
        self._last: dict[str, Array] = {}

    def start(self, world: MeasuredWorld) -> None:
        """Begin anew from where the robot is."""
        self._steps, self._last = 0, _positions(world.robot)
        self._sums = dict.fromkeys(self._last, 0.0)

    def step(self, world: MeasuredWorld) -> None:
        """Add what the last control step moved."""
        now = _positions(world.robot)
        for key, position in now.items():
            self._sums[key] += float(np.linalg.norm(position - self._last[key]))
        self._steps, self._last = self._steps + 1, now

    def end(self, world: MeasuredWorld) -> None:
        """Nothing is left to do."""

    @property
    def measurement(self) -> Measurement:
        """What was measured so far."""
        return Measurement(
            steps=self._steps,
            base_m=self._sums["base"],
            hand_world_m={side: self._sums[f"{side} world"] for side in SIDES},
            hand_base_m={side: self._sums[f"{side} base"] for side in SIDES},
        )


@cache
def human_stats() -> Mapping[str, Human]:
    """Task to the human means, from tasks/human_stats.csv, which names its source."""
    with (shipped() / "tasks" / "human_stats.csv").open(encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {
            row["task"]: Human(
                float(row["steps"]),
                float(row["base_m"]),
                {"left": float(row["left_hand_m"]), "right": float(row["right_hand_m"])},
            )
            for row in rows
        }


def ratio(human: float, robot: float) -> float | None:
    """Human / robot; None where the robot's is 0 (the evaluator writes inf, which is no JSON)."""
    return human / robot if robot > 0.0 else None


def _positions(robot: MeasuredRobot) -> dict[str, Array]:
    x, y, yaw = robot.proprioception().base_pose
    T_world_base = pose((x, y, 0.0), yaw)
    positions = {"base": np.array([x, y])}
    for side in SIDES:
        hand = robot.hand_pose_world(side)[:3, 3]
        positions[f"{side} world"] = hand
        positions[f"{side} base"] = T_world_base[:3, :3].T @ (hand - T_world_base[:3, 3])
    return positions
