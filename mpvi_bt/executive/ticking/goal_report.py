"""The state of an episode's goal: scores, and what is met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class GoalCondition:
    """One condition of the goal, as printed, and whether it holds."""

    text: str
    satisfied: bool


@dataclass(frozen=True)
class GoalReport:
    """How an episode's goal stands.

    The scores are 0..1, higher is better, and exact: no way of reaching the goal is left out (docs/scoring.md).

    Attributes:
        satisfied: The goal is true.
        q: BEHAVIOR's official q: 1 if satisfied, else the share of literals that were false at the start and hold now,
            in the best option.
        fraction: Share of literals that hold now, in the best option: what held from the start counts too.
        conditions: What must hold, `forall` and `and` written out.
    """

    satisfied: bool
    q: float
    fraction: float
    conditions: tuple[GoalCondition, ...]

    @property
    def conditions_met(self) -> float:
        """The plain fraction: share of the conditions that hold now, whatever held at the start."""
        return conditions_met([condition.satisfied for condition in self.conditions])


def conditions_met(conditions: Sequence[bool]) -> float:
    """Share of a goal's conditions that hold, 0..1, higher is better; 1 if the goal has none."""
    return sum(conditions) / len(conditions) if conditions else 1.0
