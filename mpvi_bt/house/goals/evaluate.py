"""Evaluation of a goal from the states at the start and at the end of an episode: truth, scores, unmet conditions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mpvi_bt.executive.ticking.goal_report import GoalCondition, GoalReport
from mpvi_bt.house.goals.formula import All, Formula, Literal, Truth, holds, literals, signed
from mpvi_bt.house.goals.predicates import OF_HEAT
from mpvi_bt.house.goals.problem import AGENT, BddlProblem, Fact
from mpvi_bt.house.goals.qscore import fraction, qscore

Snapshot = Mapping[Literal, bool]


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
    """Facts of :init that do not hold yet; the sampler has to correct them.

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
    """Goal literals that are already true without being in :init; a start should have none."""
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
