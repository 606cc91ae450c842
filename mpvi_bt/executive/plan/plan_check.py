"""Checks of a plan beyond its form: all problems at once, as for trees."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import islice

from mpvi_bt.executive.plan.action_like import action_in
from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.planning_context import PlanningContext
from mpvi_bt.executive.plan.schema import Manipulation, Navigation, Plan
from mpvi_bt.executive.plan.skills import Skill, SkillCall
from mpvi_bt.ground.errors import Problem, did_you_mean, nearest, shown
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, SourceMarks
from mpvi_bt.ground.words.phrases import normalize

_NO_MARKS = SourceMarks("")
_HAND = re.compile(
    r"\b(?:with|using|in|to|from) (?:the |its |your |my |robot's )*"
    r"(left|right|middle|center|central|third|fourth|fifth|upper|lower|front|rear|back) "
    r"(?:hand|gripper|arm)s?\b(?! of)",
    re.IGNORECASE,
)


def plan_problems(
    plan: Plan,
    skills: Mapping[str, Skill],
    grounding: PlanningContext | None = None,
    marks: SourceMarks = _NO_MARKS,
    begins: bool = True,
) -> list[Problem]:
    """Criteria, rooms, targets and hands that are not there; `MAX_PROBLEMS` at most, in the order of the plan.

    A manipulation that is no skill is no problem (Paper, Subtask Planning appendix: primitives are looked for, and need
    not be found).

    Args:
        plan: A valid plan.
        skills: By name.
        grounding: What is where, and what the robot has; None: nothing is known of that.
        marks: Of the plan's file, for exact places.
        begins: Whether the plan is the first of its episode: then the hands are empty, and the robot is at nothing.
    """
    return list(islice(_problems(plan, skills, grounding, marks, begins), MAX_PROBLEMS))


def _problems(
    plan: Plan, skills: Mapping[str, Skill], grounding: PlanningContext | None, marks: SourceMarks, begins: bool
) -> Iterator[Problem]:
    for i, segment in enumerate(plan.segments):
        at = ("segments", i)
        call = match(segment.description, skills) if isinstance(segment, Manipulation) else None
        if (action := action_in(segment.completion_criterion)) is not None:
            message = f"{shown(action)} tells of an action; say what is so once it is done{_so(segment, call)}"
            yield marks.problem((*at, "completion_criterion"), "action-like-criterion", message)
        if isinstance(segment, Navigation):
            if grounding is not None:
                yield from _places(segment, grounding, marks, i)
            continue
        if i == 0 and begins:
            message = "the plan begins with the hands, and the robot is at nothing yet; go somewhere first"
            yield marks.problem((*at, "type"), "nowhere", message, severity="warning")
        if grounding is not None:
            for found in _HAND.finditer(segment.description):
                if found[1].lower() not in grounding.hands:
                    yield marks.unknown((*at, "description"), "hand", found[1].lower(), grounding.hands)


def _so(segment: Navigation | Manipulation, call: SkillCall | None) -> str:
    """A state that the segment may end in, as an example."""
    state = f"the robot is at the {segment.target}" if isinstance(segment, Navigation) else call and call.criterion
    return f", such as {state!r}" if state else ""


def _places(segment: Navigation, grounding: PlanningContext, marks: SourceMarks, i: int) -> Iterator[Problem]:
    known = grounding.room_names
    if segment.room is not None and normalize(segment.room) not in known:
        near = grounding.room_called(segment.room) or nearest(normalize(segment.room), known)
        message = f"unknown room {shown(segment.room)}.{did_you_mean(near, known)}"
        at = ("segments", i, "room")
        yield marks.problem(at, "unknown-room", message, nearest=near, known=tuple(known))
    if grounding.things and not grounding.vocabulary.named(segment.target):
        phrases = grounding.phrases
        near = nearest(normalize(segment.target), phrases)
        message = f"nothing there is called {shown(segment.target)}.{did_you_mean(near, phrases)}"
        at = ("segments", i, "target")
        yield marks.problem(at, "unknown-target", message, severity="warning", nearest=near, known=tuple(phrases))
