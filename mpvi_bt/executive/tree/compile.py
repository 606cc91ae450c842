"""Plan -> tree (Paper, Orchestrator)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

from mpvi_bt.executive.behaviors.parameters import (
    CriterionToCheck,
    Limit,
    MemoryFlag,
    NavigateTo,
    NoParameters,
    OnFailure,
    Prompt,
    Tries,
)
from mpvi_bt.executive.behaviors.references import escaped
from mpvi_bt.executive.plan.primitives import Primitive, primitives, units
from mpvi_bt.executive.plan.schema import Navigation, Plan, Segment
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.ground.errors import UserError, nearest, shown
from mpvi_bt.ground.words.phrases import OTHER

NAVIGATION_TIMEOUT_S = 300.0  # Our choice (the paper is silent): what looking through a whole house may take
_LONGEST_NAME = 120  # of a unit that joins many segments; its prompt holds them all
MANIPULATION_TIMEOUT_S = 90.0  # Our choice: of a segment that no skill file gives a time
DRIVING = "go_to"  # the skill whose triggers tell that a drive has ended
Drive = Literal["navigator", "policy"]
# From prompt, criterion, skill and place (the last navigation's target; "": none came before) to the node that carries
# a unit of manipulation out, timeout apart; None: as ever.
UNIT_PARAMETERS = ("prompt", "criterion", "skill", "place")
Arrange = Callable[[Mapping[str, str]], NodeSpec | None]
_SETTING = re.compile(r"(advance|replan)|retry:([1-9][0-9]{0,2})")


def compile_plan(
    plan: Plan,
    skills: Mapping[str, Skill],
    on_failure: str = "advance",
    drive: Drive = "navigator",
    arrange: Arrange | None = None,
) -> TreeSpec:
    """The tree of a plan.

    Navigation segments stand alone. Consecutive manipulation segments form one unit: its prompt joins their
    descriptions with ", then ", its criterion and its triggers are those of the last segment, its time is the sum of
    theirs. Each unit has a time limit, and one that fails is recorded and passed over. Nothing in a plan refers to the
    blackboard: a dollar sign is a dollar sign.

    Args:
        plan: To compile.
        skills: By name.
        on_failure: What becomes of a unit that fails, see `parse_on_failure`.
        drive: Who carries out navigation segments. "policy": each is a unit as of manipulation, its description the
            prompt (Paper, Ablation Study, Subtask Prediction).
        arrange: Makes the node of each unit of manipulation that ends with a known skill. None: the policy works until
            the checker says that it is complete.

    Raises:
        UserError: There is no such setting.
    """
    root = NodeSpec(
        "sequence",
        MemoryFlag(memory=True),
        plan.task_name,
        compile_units(plan, skills, on_failure, drive, arrange=arrange),
    )
    return TreeSpec(plan.task_name, root, plan.instruction)


def compile_instruction(name: str, instruction: str) -> TreeSpec:
    """The tree of a policy on its own: it gets the whole instruction, and nobody tells it when it is done."""
    return TreeSpec(name, NodeSpec("manipulate", Prompt(prompt=escaped(instruction))), instruction)


def prompts_of(plan: Plan) -> list[str]:
    """Prompts of a policy that also drives, one a unit."""
    return [_joined([plan.segments[i] for i in segments]) for segments in units(plan)]


def compile_units(
    plan: Plan,
    skills: Mapping[str, Skill],
    on_failure: str = "advance",
    drive: Drive = "navigator",
    number: int = 1,
    index: int = 0,
    arrange: Arrange | None = None,
) -> tuple[NodeSpec, ...]:
    """The units of `compile_plan`.

    Args:
        plan, skills, on_failure, drive, arrange: As of `compile_plan`.
        number: Of the first unit, more than 1 of a plan that is the rest of another.
        index: Of the first segment, likewise.
    """
    parameters, retries = parse_on_failure(on_failure)
    found = primitives(plan, skills)
    return tuple(
        _attempt(n, segments, plan, _unit(segments, plan, found, index, skills, drive, arrange), parameters, retries)
        for n, segments in enumerate(units(plan), start=number)
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


def _attempt(
    number: int, segments: tuple[int, ...], plan: Plan, unit: NodeSpec, parameters: OnFailure, retries: int
) -> NodeSpec:
    name = f"{number} " + ", then ".join(plan.segments[i].description for i in segments)
    name = name if len(name) <= _LONGEST_NAME else name[: _LONGEST_NAME - 3].rstrip() + "..."
    if retries:
        unit = NodeSpec("retry", Tries(tries=retries + 1), "", (unit,), unit.segments)
    return NodeSpec("attempt", parameters, name, (unit,), unit.segments)


def _unit(
    segments: tuple[int, ...],
    plan: Plan,
    found: Mapping[int, Primitive],
    index: int,
    skills: Mapping[str, Skill],
    drive: Drive,
    arrange: Arrange | None,
) -> NodeSpec:
    parts = [plan.segments[i] for i in segments]
    numbers = tuple(index + i for i in segments)
    if isinstance(first := parts[0], Navigation):
        seconds = NAVIGATION_TIMEOUT_S
        if drive == "policy":
            node = _by_policy(parts, numbers, skills.get(DRIVING))
        else:
            room = first.room and escaped(first.room)
            node = NodeSpec("navigate", NavigateTo(target=escaped(_meant(first)), room=room), segments=numbers)
    else:
        known = [call.skill if (call := found[i].call) else None for i in segments]
        seconds = sum(skill.timeout_s if skill else MANIPULATION_TIMEOUT_S for skill in known)
        node = _by_policy(parts, numbers, known[-1])
        if arrange is not None and known[-1] is not None:
            before = plan.segments[segments[0] - 1] if segments[0] else None
            place = _meant(before) if isinstance(before, Navigation) else ""
            if (arranged := arrange(_told(parts, known[-1], place))) is not None:
                node = replace(arranged, segments=numbers)
    return NodeSpec("timeout", Limit(limit=seconds), "", (node,), numbers)


def _meant(segment: Navigation) -> str:
    """The target of a drive, with the details that the description adds.

    Of a "cup" the description may say that it is another one ("the last cup"), empty, open or closed, or what is in it
    ("the cup with the pens"). Where it says nothing of the kind it is the target itself.
    """
    target = re.escape(segment.target)
    said = re.search(
        rf"\b(?P<other>{OTHER.pattern} )?(?P<state>(?:empty|open|closed) )?{target}(?!\w)"
        r"(?P<contents> with(?:out)? .+)?",
        segment.description,
        re.IGNORECASE,
    )
    if said is None:
        return segment.target
    return ("another " if said["other"] else "") + (said["state"] or "") + segment.target + (said["contents"] or "")


def _by_policy(parts: Sequence[Segment], numbers: tuple[int, ...], last: Skill | None) -> NodeSpec:
    """The policy at work on some segments, until the checker confirms the last one (done by skill `last`)."""
    prompt = Prompt(prompt=escaped(_joined(parts)))
    criterion = CriterionToCheck(criterion=escaped(parts[-1].completion_criterion), skill=last.name if last else None)
    children = (
        NodeSpec("manipulate", prompt, segments=numbers),
        NodeSpec("check_complete", criterion, segments=numbers[-1:]),
    )
    return NodeSpec("until_complete", NoParameters(), "", children, numbers)


def _joined(parts: Sequence[Segment]) -> str:
    """The prompt of a unit."""
    return ", then ".join(part.description for part in parts)


def _told(parts: Sequence[Segment], last: Skill, place: str) -> dict[str, str]:
    """The arguments of a unit's arrangement."""
    told = {"prompt": _joined(parts), "criterion": parts[-1].completion_criterion, "place": place}
    return {name: escaped(text) for name, text in told.items()} | {"skill": last.name}
