"""How people did the tasks: what time and distances are normalized by."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.paths import shipped
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side


@dataclass(frozen=True)
class Human:
    """Means over the human demonstrations of a task.

    Attributes:
        task_id: BEHAVIOR's number of the task.
        steps: Control steps of 1/30 s.
        base_m: Distance driven.
        hand_m: Distance of each hand, in the base frame (proprioception), unlike the robot's official one.
    """

    task_id: int
    steps: float
    base_m: float
    hand_m: Mapping[Side, float]

    @property
    def time_budget_s(self) -> float:
        """Twice the mean human time, in whole steps (BEHAVIOR challenge 2025: int(2 x mean steps))."""
        return int(2 * self.steps) / CONTROL_HZ


@cache
def human_stats() -> Mapping[str, Human]:
    """Task to the human means, from tasks/human_stats.csv, which names its source."""
    with (shipped() / "tasks" / "human_stats.csv").open(encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {
            row["task"]: Human(
                int(row["task_id"]),
                float(row["steps"]),
                float(row["base_m"]),
                {"left": float(row["left_hand_m"]), "right": float(row["right_hand_m"])},
            )
            for row in rows
        }


def task_of_id(number: int) -> str:
    """The task that BEHAVIOR's evaluators mean by a number. Raises UserError if none of ours is meant."""
    tasks = {human.task_id: name for name, human in human_stats().items()}
    if number not in tasks:
        raise UserError(
            f"task_id {number} is not known here, where there are {min(tasks)} to {max(tasks)}: "
            "say what is to be done by --task or --instruction."
        )
    return tasks[number]
