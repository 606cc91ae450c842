"""Post-processing of a plan: the primitive of each manipulation, and which ones the checker has to confirm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby

from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.schema import Manipulation, Navigation, Plan
from mpvi_bt.executive.plan.skills import Skill, SkillCall


@dataclass(frozen=True)
class Primitive:
    """What post-processing found out about one manipulation segment.

    Attributes:
        call: The skill that its description names, or None.
        terminal: A navigation segment, or the plan's end, comes next: only then is completion verified (Paper,
            Completion Checker appendix, Subtask sequencing).
    """

    call: SkillCall | None
    terminal: bool


def primitives(plan: Plan, skills: Mapping[str, Skill]) -> dict[int, Primitive]:
    """The primitive of each manipulation segment, by the segment's index (Paper, Subtask Planning appendix)."""
    following = [*plan.segments[1:], None]
    return {
        i: Primitive(match(segment.description, skills), not isinstance(following[i], Manipulation))
        for i, segment in enumerate(plan.segments)
        if isinstance(segment, Manipulation)
    }


def units(plan: Plan) -> Iterator[tuple[int, ...]]:
    """The plan's execution units, each the indices of its segments: a navigation, or a run of manipulations."""
    moves = enumerate(isinstance(segment, Navigation) for segment in plan.segments)
    for navigation, run in groupby(moves, key=lambda item: item[1]):
        indices = tuple(i for i, _ in run)
        yield from ((i,) for i in indices) if navigation else (indices,)
