"""Recorded plans as few-shot examples for a planner: few, short, and never the task's own."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from mpvi_bt.executive.plan.primitives import primitives
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import Skill

MOST_EXAMPLES = 2
LONGEST_EXAMPLE = 16  # segments


def examples(
    recorded: Sequence[Plan], skills: Mapping[str, Skill], instruction: str, without: Collection[str] = ()
) -> list[Plan]:
    """The plans that show most skills with fewest segments, one by one; the same for the same question.

    Our choice (the paper fine-tunes, and shows none): a plan that was recorded for the task, or for the same
    instruction in whatever case and spacing, is left out, so that a score says what the planner can do. One for an
    instruction in other words cannot be told.

    Args:
        recorded: Plans on file.
        skills: By name.
        instruction: What is to be planned.
        without: Names of plans to leave out.
    """
    own = _plain(instruction)
    left = [
        plan
        for plan in recorded
        if plan.task_name not in without
        and plan.instruction
        and _plain(plan.instruction) != own
        and len(plan.segments) <= LONGEST_EXAMPLE
    ]
    shows = {plan.task_name: _shown(plan, skills) for plan in left}
    chosen: list[Plan] = []
    known: set[str] = set()
    while left and len(chosen) < MOST_EXAMPLES:
        best = min(left, key=lambda p: (-len(shows[p.task_name] - known), len(p.segments), p.task_name))
        chosen.append(best)
        known |= shows[best.task_name]
        left.remove(best)
    return chosen


def _shown(plan: Plan, skills: Mapping[str, Skill]) -> set[str]:
    return {found.call.skill.name for found in primitives(plan, skills).values() if found.call}


def _plain(instruction: str) -> str:
    return " ".join("".join(c if c.isalnum() else " " for c in instruction.casefold()).split())
