"""Plan -> tree (Paper, Orchestrator)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import groupby

from mpvi_bt.behaviors.parameters import Criterion, Limit, Memory, NavigateTo, NoParameters, Prompt
from mpvi_bt.behaviors.references import escaped
from mpvi_bt.plan.primitives import Primitive, primitives
from mpvi_bt.plan.schema import Navigation, Plan
from mpvi_bt.plan.skills import Skill
from mpvi_bt.tree.spec import NodeSpec, TreeSpec

NAVIGATION_TIMEOUT_S = 300.0  # Our choice (the paper is silent): what looking through a whole house may take
_LONGEST_NAME = 120  # of a unit that joins many segments; its prompt holds them all
MANIPULATION_TIMEOUT_S = 90.0  # Our choice: of a segment that no skill file gives a time


def compile_plan(plan: Plan, skills: Mapping[str, Skill]) -> TreeSpec:
    """The tree of a plan.

    Navigation segments stand alone. Consecutive manipulation segments form one unit: its prompt joins their
    descriptions with ", then ", its criterion and its triggers are those of the last segment, its time is the sum of
    theirs. Each unit has a time limit, and one that fails is recorded and passed over. Nothing in a plan refers to the
    blackboard: a dollar sign is a dollar sign.
    """
    found = primitives(plan, skills)
    units = [
        _attempt(number, segments, plan, _unit(segments, plan, found))
        for number, segments in enumerate(_groups(plan), start=1)
    ]
    root = NodeSpec("sequence", Memory(memory=True), plan.task_name, tuple(units))
    return TreeSpec(plan.task_name, root, plan.instruction)


def _groups(plan: Plan) -> Iterator[tuple[int, ...]]:
    """Indices of the segments of each execution unit."""
    moves = enumerate(isinstance(s, Navigation) for s in plan.segments)
    for navigation, run in groupby(moves, key=lambda item: item[1]):
        indices = tuple(i for i, _ in run)
        yield from ((i,) for i in indices) if navigation else (indices,)


def _attempt(number: int, segments: tuple[int, ...], plan: Plan, unit: NodeSpec) -> NodeSpec:
    name = f"{number} " + ", then ".join(plan.segments[i].description for i in segments)
    name = name if len(name) <= _LONGEST_NAME else name[: _LONGEST_NAME - 3].rstrip() + "..."
    return NodeSpec("attempt", NoParameters(), name, (unit,), segments)


def _unit(segments: tuple[int, ...], plan: Plan, found: Mapping[int, Primitive]) -> NodeSpec:
    parts = [plan.segments[i] for i in segments]
    if isinstance(first := parts[0], Navigation):
        seconds = NAVIGATION_TIMEOUT_S
        node = NodeSpec(
            "navigate",
            NavigateTo(target=escaped(first.target), room=first.room and escaped(first.room)),
            segments=segments,
        )
    else:
        skills = [call.skill if (call := found[i].call) else None for i in segments]
        seconds = sum(skill.timeout_s if skill else MANIPULATION_TIMEOUT_S for skill in skills)
        prompt = Prompt(prompt=escaped(", then ".join(part.description for part in parts)))
        last = skills[-1]
        criterion = Criterion(criterion=escaped(parts[-1].completion_criterion), skill=last.name if last else None)
        children = (
            NodeSpec("manipulate", prompt, segments=segments),
            NodeSpec("check_complete", criterion, segments=segments[-1:]),
        )
        node = NodeSpec("until_complete", NoParameters(), "", children, segments)
    return NodeSpec("timeout", Limit(limit=seconds), "", (node,), segments)
