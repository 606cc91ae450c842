"""Plan -> tree (Paper, Orchestrator)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import groupby

from mpvi_bt.behaviors.parameters import Criterion, Limit, Memory, NavigateTo, NoParameters, OnFailure, Prompt, Tries
from mpvi_bt.behaviors.references import escaped
from mpvi_bt.errors import UserError, nearest, shown
from mpvi_bt.plan.primitives import Primitive, primitives
from mpvi_bt.plan.schema import Navigation, Plan
from mpvi_bt.plan.skills import Skill
from mpvi_bt.tree.spec import NodeSpec, TreeSpec

NAVIGATION_TIMEOUT_S = 300.0  # Our choice (the paper is silent): what looking through a whole house may take
_LONGEST_NAME = 120  # of a unit that joins many segments; its prompt holds them all
MANIPULATION_TIMEOUT_S = 90.0  # Our choice: of a segment that no skill file gives a time
_SETTING = re.compile(r"(advance|replan)|retry:([1-9][0-9]{0,2})")


def compile_plan(plan: Plan, skills: Mapping[str, Skill], on_failure: str = "advance") -> TreeSpec:
    """The tree of a plan.

    Navigation segments stand alone. Consecutive manipulation segments form one unit: its prompt joins their
    descriptions with ", then ", its criterion and its triggers are those of the last segment, its time is the sum of
    theirs. Each unit has a time limit, and one that fails is recorded and passed over. Nothing in a plan refers to the
    blackboard: a dollar sign is a dollar sign.

    Args:
        plan: To compile.
        skills: By name.
        on_failure: What becomes of a unit that fails, see `parse_on_failure`.

    Raises:
        UserError: There is no such setting.
    """
    root = NodeSpec("sequence", Memory(memory=True), plan.task_name, compile_units(plan, skills, on_failure))
    return TreeSpec(plan.task_name, root, plan.instruction)


def compile_units(
    plan: Plan, skills: Mapping[str, Skill], on_failure: str = "advance", number: int = 1, index: int = 0
) -> tuple[NodeSpec, ...]:
    """The units of `compile_plan`.

    Args:
        plan, skills, on_failure: As of `compile_plan`.
        number: Of the first unit, more than 1 of a plan that is the rest of another.
        index: Of the first segment, likewise.
    """
    parameters, retries = parse_on_failure(on_failure)
    found = primitives(plan, skills)
    return tuple(
        _attempt(n, segments, plan, _unit(segments, plan, found, index), parameters, retries)
        for n, segments in enumerate(_groups(plan), start=number)
    )


def parse_on_failure(given: str) -> tuple[OnFailure, int]:
    """What a setting asks for: the parameters of each unit's `attempt`, and how often a unit is tried again.

    "advance": a unit that fails is given up (Paper, Orchestrator). "retry:N": it is tried N more times before it is.
    "replan": it is given up, and a new plan is made for the rest.

    Raises:
        UserError: It is none of these.
    """
    if (setting := _SETTING.fullmatch(given)) is None:
        near = nearest(given, ("advance", "replan", "retry:1"))
        hint = f" Did you mean {near!r}?" if near else ""
        raise UserError(
            f"on failure: 'advance', 'retry:N' with N from 1 to 999, or 'replan', not {shown(given)}.{hint}"
        )
    return OnFailure(on_failure="replan" if setting[1] == "replan" else "advance"), int(setting[2] or 0)


def _groups(plan: Plan) -> Iterator[tuple[int, ...]]:
    """Indices of the segments of each execution unit."""
    moves = enumerate(isinstance(s, Navigation) for s in plan.segments)
    for navigation, run in groupby(moves, key=lambda item: item[1]):
        indices = tuple(i for i, _ in run)
        yield from ((i,) for i in indices) if navigation else (indices,)


def _attempt(
    number: int, segments: tuple[int, ...], plan: Plan, unit: NodeSpec, parameters: OnFailure, retries: int
) -> NodeSpec:
    name = f"{number} " + ", then ".join(plan.segments[i].description for i in segments)
    name = name if len(name) <= _LONGEST_NAME else name[: _LONGEST_NAME - 3].rstrip() + "..."
    if retries:
        unit = NodeSpec("retry", Tries(tries=retries + 1), "", (unit,), unit.segments)
    return NodeSpec("attempt", parameters, name, (unit,), unit.segments)


def _unit(segments: tuple[int, ...], plan: Plan, found: Mapping[int, Primitive], index: int) -> NodeSpec:
    parts = [plan.segments[i] for i in segments]
    numbers = tuple(index + i for i in segments)
    if isinstance(first := parts[0], Navigation):
        seconds = NAVIGATION_TIMEOUT_S
        node = NodeSpec(
            "navigate",
            NavigateTo(target=escaped(first.target), room=first.room and escaped(first.room)),
            segments=numbers,
        )
    else:
        skills = [call.skill if (call := found[i].call) else None for i in segments]
        seconds = sum(skill.timeout_s if skill else MANIPULATION_TIMEOUT_S for skill in skills)
        prompt = Prompt(prompt=escaped(", then ".join(part.description for part in parts)))
        last = skills[-1]
        criterion = Criterion(criterion=escaped(parts[-1].completion_criterion), skill=last.name if last else None)
        children = (
            NodeSpec("manipulate", prompt, segments=numbers),
            NodeSpec("check_complete", criterion, segments=numbers[-1:]),
        )
        node = NodeSpec("until_complete", NoParameters(), "", children, numbers)
    return NodeSpec("timeout", Limit(limit=seconds), "", (node,), numbers)
