"""Evaluation of a goal from the states at the start and at the end of an episode: truth, scores, unmet conditions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mpvi_bt.goals.formula import All, Formula, Literal, Truth, holds, literals, signed
from mpvi_bt.goals.predicates import OF_HEAT
from mpvi_bt.goals.problem import AGENT, BddlProblem, Fact
from mpvi_bt.goals.qscore import fraction, qscore

Snapshot = Mapping[Literal, bool]


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
    """Share of a goal's conditions that hold, 0..1, higher is better; 1 of a goal that asks for nothing."""
    return sum(conditions) / len(conditions) if conditions else 1.0


def snapshot(problem: BddlProblem, truth: Truth) -> Snapshot:
    """The truth of every literal of the goal now: take one at the start, one at the end."""
    return {literal: truth(literal) for literal in dict.fromkeys(literals(problem.goal))}


def judge(problem: BddlProblem, start: Snapshot, end: Snapshot) -> GoalReport:
    """Score the goal from its snapshots at the start and at the end of an episode."""
    goal, now = problem.goal, end.__getitem__
    return GoalReport(
        satisfied=holds(goal, now),
        q=qscore(goal, start.__getitem__, now),
        fraction=fraction(goal, now),
        conditions=tuple(GoalCondition(str(c), holds(c, now)) for c in _flat(problem.conditions)),
    )


def unmet(problem: BddlProblem, truth: Truth) -> list[Fact]:
    """Facts of :init that do not hold: what a sampler still has to mend.

    Left out: where fixtures are (`inroom`), what exists later (`future`), substances' taps (`insource`), the robot's
    own place, and how warm things are.
    """
    return [
        fact
        for fact in problem.init
        if fact.literal.predicate not in {"inroom", "future", "insource", *OF_HEAT}
        and problem.objects.get(fact.literal.args[0]) != AGENT
        and truth(fact.literal) != fact.positive
    ]


def early(problem: BddlProblem, truth: Truth) -> list[Literal]:
    """Literals that the goal wants true, that are true now, and that :init does not state: a start should have none."""
    stated = {fact.literal for fact in problem.init if fact.positive}
    return [
        literal
        for literal, positive in dict.fromkeys(signed(problem.goal))
        if positive and literal not in stated and truth(literal)
    ]


def _flat(formulas: Iterable[Formula]) -> Iterable[Formula]:
    for formula in formulas:
        if isinstance(formula, All):
            yield from _flat(formula.children)
        else:
            yield formula
