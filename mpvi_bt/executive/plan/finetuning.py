"""Pairs of instruction and plan as chats, to fine-tune a planner on (the paper fine-tunes its own on human plans).

One JSON object a line, {"messages": [system, user, assistant]}: what the fine-tuning of OpenAI-compatible services and
TRL's trainer read. The messages are those of `mpvi_bt.executive.plan.prompt`: a model is trained on what it is asked.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping

from mpvi_bt.executive.plan.answer_form import answer_text
from mpvi_bt.executive.plan.planning_context import PlanningContext
from mpvi_bt.executive.plan.prompt import checked_instruction, system_text, user_text
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import Skill


def chats(plans: Iterable[tuple[Plan, PlanningContext | None]], skills: Mapping[str, Skill]) -> Iterator[str]:
    """A line of JSON for every plan with an instruction.

    Args:
        plans: Each with where it is carried out; None: nothing is told of that.
        skills: By name.

    Raises:
        UserError: A plan's instruction is none.
    """
    for plan, grounding in plans:
        if plan.instruction:
            told = {
                "system": system_text(skills, grounding),
                "user": user_text(checked_instruction(plan.instruction)),
                "assistant": answer_text(plan),
            }
            messages = [{"role": role, "content": text} for role, text in told.items()]
            yield json.dumps({"messages": messages}, ensure_ascii=False)
