"""Types of node parameters (durations, blackboard keys, values, texts), and a model for each kind of node."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, PlainValidator, WithJsonSchema, model_validator

from mpvi_bt.executive.plan.schema import Paragraph, Phrase
from mpvi_bt.ground.errors import shown
from mpvi_bt.ground.marked_yaml import Record

_STEPS = re.compile(r"([1-9][0-9]{0,8}) steps?")


def _duration(given: Any) -> float | str:
    if isinstance(given, int | float) and not isinstance(given, bool) and 0 < given <= _LONGEST_S:
        return float(given)
    if isinstance(given, str) and (found := _STEPS.fullmatch(given)):
        return f"{found[1]} step" + "s" * (found[1] != "1")
    valid = f"simulated seconds, above 0 and at most {_LONGEST_S}, or steps, such as '90 steps'"
    raise ValueError(f"a duration is {valid}, not {shown(given)}")


def _value(given: Any) -> bool | int | float | str:
    if isinstance(given, float) and not math.isfinite(given):
        raise ValueError("a value must be a finite number")
    if isinstance(given, bool | int | float) or (isinstance(given, str) and len(given) <= _LONGEST_TEXT):
        return given
    raise ValueError(f"a value is true or false, a number or a text, not {_what(given)}")


def _what(given: Any) -> str:
    return {dict: "a mapping", list: "a list", type(None): "nothing", str: "so long a text"}.get(type(given), "this")


_LONGEST_S = 86400
_LONGEST_TEXT = 5000
_EXACT = 1e15  # whole numbers below it are written without an exponent
_DURATION_SCHEMA = {
    "anyOf": [
        {"type": "number", "exclusiveMinimum": 0, "maximum": _LONGEST_S},
        {"type": "string", "pattern": "^[1-9][0-9]{0,8} steps?$"},
    ]
}
_ELSEWHERE = "true: not where the base stands now"
_AT_ONCE = "true asks once, without waiting for a trigger, and a no is a failure"
_MEMORY = "true resumes at the child that was running, false asks every child again"
_ON_FAILURE = "advance goes on with the next child, replan asks the planner for another plan for the rest"
_VALUE_SCHEMA = {"type": ["boolean", "number", "string"]}

Duration = Annotated[float | str, PlainValidator(_duration), WithJsonSchema(_DURATION_SCHEMA)]
Value = Annotated[bool | int | float | str, PlainValidator(_value), WithJsonSchema(_VALUE_SCHEMA)]
Line = Annotated[Paragraph, Field(max_length=1000)]  # longer than a plan's phrase with every dollar sign doubled
Key = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]
Number = Annotated[float, Field(allow_inf_nan=False)]


def steps_of(duration: float | str) -> int | None:
    """Control steps of a duration such as "90 steps"; None if it is in seconds."""
    return int(duration.split()[0]) if isinstance(duration, str) else None


def duration_text(duration: float | str) -> str:
    """A duration for a person: "60 s" or "90 steps"."""
    return duration if isinstance(duration, str) else f"{as_text(duration)} s"


def as_text(value: object) -> str:
    """A value as it stands in a text, with all its digits: true, 3, 0.5."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer() and abs(value) < _EXACT:
        return str(int(value))
    return str(value)


class Parameters(Record):
    """A node's parameters, strictly typed: "60" is not a number."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class NoParameters(Parameters):
    """Of a node that has none."""


class MemoryFlag(Parameters):
    """Of a sequence or selector: whether it resumes at the child that was running. Always said, never assumed."""

    memory: Annotated[bool, Field(description=_MEMORY)]


class OnFailure(Parameters):
    """Of attempt: what follows a recorded failure. "advance": the next sibling (Paper, Orchestrator).

    "replan": the run's planner is asked for what is left to do, and its plan takes the place of all later siblings.
    """

    on_failure: Annotated[Literal["advance", "replan"], Field(description=_ON_FAILURE)] = "advance"


class ParallelSuccess(Parameters):
    """Of a parallel: what makes it succeed. Any failure fails it."""

    policy: Literal["success_on_all", "success_on_one"]


class Limit(Parameters):
    """Of timeout and cooldown: simulated seconds, or control steps such as "90 steps"."""

    limit: Duration


class Tries(Parameters):
    """Of retry: how often the child is begun at most."""

    tries: Annotated[int, Field(ge=1, le=1000)]


class Times(Parameters):
    """Of repeat: how often the child must succeed."""

    times: Annotated[int, Field(ge=1, le=1_000_000)]


class Comparison(Parameters):
    """Of condition and test: a blackboard key, and what its value must be; nothing more said, it must have one."""

    key: Key
    equals: Value | None = None
    not_equals: Value | None = None
    at_least: Number | None = None
    at_most: Number | None = None

    @property
    def text(self) -> str:
        """Such as "cups at least 3"."""
        parts = [
            f"{word} {as_text(wanted)}"
            for word, wanted in (
                ("=", self.equals),
                ("!=", self.not_equals),
                (">=", self.at_least),
                ("<=", self.at_most),
            )
            if wanted is not None
        ]
        return f"{self.key} " + (" and ".join(parts) if parts else "is set")


class Call(Parameters):
    """Of subtree: the name of a tree or the file of one beside this file, and what its parameters are."""

    tree: Phrase
    arguments: dict[str, Value] = {}


class Watch(Parameters):
    """Of monitor: the skill for the thresholds (none: only record), and the conditions of an alarm.

    That many signals must agree, or "stall" or "grip" alone must last so long (nothing said: one alone is no alarm).
    """

    skill: str | None = None
    agree: Annotated[int, Field(ge=1, le=4)] = 2
    alone: Duration | None = None


class Back(Parameters):
    """Of back_off: how far back along their way the arms go; nothing said, to where the handoff began."""

    duration: Duration | None = None


class NavigateTo(Parameters):
    """Of navigate: what to drive to, the room to look for it first, and whether to stop elsewhere than now."""

    target: Line
    room: Line | None = None
    elsewhere: Annotated[bool, Field(description=_ELSEWHERE)] = False


class Prompt(Parameters):
    """Of manipulate: what to tell the policy."""

    prompt: Paragraph


class CriterionToCheck(Parameters):
    """Of check_complete: the unit's criterion, and the skill whose triggers ask about it (none: all)."""

    criterion: Line
    skill: str | None = None
    at_once: Annotated[bool, Field(description=_AT_ONCE)] = False


class Pause(Parameters):
    """Of wait: simulated seconds, or control steps such as "90 steps"."""

    duration: Duration


class NamedPosture(Parameters):
    """Of posture: "travel" folds empty hands and straightens up."""

    posture: Literal["travel"]


class Turn(Parameters):
    """Of look_around: how far to turn on the spot, counter-clockwise, in degrees; 360 if nothing is said."""

    degrees: Annotated[float, Field(ge=-720, le=720, allow_inf_nan=False)] | None = None


class SaidText(Parameters):
    """Of say: what to show as the node's feedback."""

    text: Line


class Assignment(Parameters):
    """Of set: a blackboard key, and its new value or what to add to it (0 if it has none)."""

    key: Key
    value: Value | None = None
    add: Number | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Assignment:
        if (self.value is None) == (self.add is None):
            raise ValueError("'set' needs either 'value' or 'add'")
        return self


class Reason(Parameters):
    """Of fail: the reason code that the failure carries."""

    reason: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)] | None = None
