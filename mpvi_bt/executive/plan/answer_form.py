"""The form in which a language model answers with a plan: its JSON Schema, a plan in it, and segments read from it.

It is the form of a plan with an extra key "hand". Known hands, rooms and targets are enumerated in the schema, so a
model that is constrained by it can name no other.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from mpvi_bt.executive.language.chat import Schema
from mpvi_bt.executive.plan.planning_context import PlanningContext
from mpvi_bt.executive.plan.schema import Manipulation, Plan, Segment

# Of one enumeration. OpenAI, Structured outputs: at most 1000 values in a schema (500 until 2025), whose length is
# limited, too, where one enumeration has more than 250. None is cut: what it left out could not be named.
MOST_VALUES = 250
MOST_LETTERS = 7500

_BY_HAND = re.compile(r"(?P<deed>.*\S) with the (?P<hand>left|right) hand", re.IGNORECASE)
_HAND = re.compile(r"\s*\b(?:hand|gripper|arm)s?$", re.IGNORECASE)
_ANY = ("", "any", "both", "either", "none", "null")  # what models say that are not held to the schema
_KEPT = ("type", "enum", "items", "properties", "anyOf", "additionalProperties")


def answer_schema(grounding: PlanningContext | None = None, task_name: str = "") -> Schema:
    """The form of an answer as a JSON Schema.

    Our choice, for the sake of servers that know but a part of JSON Schema: no references, no lengths (they are checked
    afterwards), every key required, and no further ones.

    Args:
        grounding: Rooms, hands and, where the things of a task are known, targets to choose from; None: any.
        task_name: Name of the plan; "": the model's to choose.
    """
    names = (task_name,) if task_name else ()
    if grounding is None:
        return _form(names, ("left", "right"), (), ())
    targets = tuple(grounding.phrases) if grounding.things else ()
    return _form(names, grounding.hands, tuple(grounding.room_names), targets)


def answer_text(plan: Plan) -> str:
    """A plan as a model should answer it: every key of the form, and no instruction."""
    return json.dumps(
        {"task_name": plan.task_name, "segments": [_as_answered(s) for s in plan.segments]}, ensure_ascii=False
    )


def read_segment(segment: Any) -> Any:
    """A segment of an answer as a plan has it, if it is one at all.

    The paper's "completion_criteria" is read as the "completion_criterion" of our files, and null as nothing.
    """
    if not isinstance(segment, dict):
        return segment
    segment = {key: value for key, value in segment.items() if value is not None}
    if "completion_criterion" not in segment and "completion_criteria" in segment:
        segment["completion_criterion"] = segment.pop("completion_criteria")
    deed, hand = segment.get("description"), segment.get("hand")
    if segment.get("type") == "manipulation" and isinstance(deed, str) and isinstance(hand, str):
        del segment["hand"]
        segment["description"] = _by(deed, hand)
    return segment


def _by(deed: str, hand: str) -> str:
    """An action, with the hand that does it."""
    hand = _HAND.sub("", hand.strip())
    if (
        not deed.strip()
        or hand.lower() in _ANY
        or re.search(rf"\b{re.escape(hand)} (?:hand|gripper|arm)\b", deed, re.IGNORECASE)
    ):
        return deed
    return f"{deed.rstrip(' .')} with the {hand} hand"


def _as_answered(segment: Segment) -> dict[str, Any]:
    data = segment.model_dump()
    if isinstance(segment, Manipulation):
        by_hand = _BY_HAND.fullmatch(segment.description)
        data["hand"] = by_hand["hand"].lower() if by_hand else None
        data["description"] = by_hand["deed"] if by_hand else segment.description
    return data


@cache
def _form(names: Sequence[str], hands: Sequence[str], rooms: Sequence[str], targets: Sequence[str]) -> Schema:
    """The schema, from the model of a plan; of no names, rooms or targets: any."""
    schema = Plan.model_json_schema()
    plan = _simple({k: v for k, v in schema.items() if k != "$defs"}, schema.get("$defs", {}))
    del plan["properties"]["instruction"]  # it is known
    plan["properties"]["task_name"] = _one_of(names)
    navigation, manipulation = plan["properties"]["segments"]["items"]["anyOf"]
    navigation["properties"]["target"] = _one_of(targets)
    navigation["properties"]["room"] = {"anyOf": [_one_of(rooms), {"type": "null"}]}
    manipulation["properties"]["hand"] = {"anyOf": [_one_of(hands), {"type": "null"}]}
    for form in (plan, navigation, manipulation):
        form["required"] = list(form["properties"])
    return plan


def _one_of(values: Sequence[str]) -> dict[str, Any]:
    """One of some texts; any text where there are none, or too many for a server."""
    if not values or len(values) > MOST_VALUES or sum(map(len, values)) > MOST_LETTERS:
        return {"type": "string"}
    return {"type": "string", "enum": list(values)}


def _simple(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> dict[str, Any]:
    if "$ref" in schema:
        return _simple(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    found = {key: value for key, value in schema.items() if key in _KEPT}
    if "const" in schema:
        found["enum"] = [schema["const"]]
    if "items" in found:
        found["items"] = _simple(found["items"], definitions)
    if choices := schema.get("anyOf") or schema.get("oneOf"):
        found["anyOf"] = [_simple(choice, definitions) for choice in choices]
    if "properties" in found:
        found["properties"] = {name: _simple(inner, definitions) for name, inner in found["properties"].items()}
    return found
