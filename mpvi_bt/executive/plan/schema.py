"""A plan as data: an instruction split into navigation and manipulation segments (Paper, Subtask Planning)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, StringConstraints

from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import Record, SourceMarks, load_marked, validate_data


def _one_line(text: str) -> str:
    if not text.isprintable():
        raise ValueError("must be one line of printable text")
    return text


Phrase = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=300), AfterValidator(_one_line)
]
MOST_OF_PROMPT = 65_000  # characters: enough for 200 segments joined
Paragraph = Annotated[  # a prompt with every dollar sign doubled
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=2 * MOST_OF_PROMPT),
    AfterValidator(_one_line),
]


class Navigation(Record):
    """Drive to a named place.

    Attributes:
        description: What to do, for a person.
        completion_criterion: The state of the world that ends it, such as "the robot is at the fridge".
        target: What to drive to, such as "fridge"; another one of these where the description says "another fridge",
            and likewise an empty bowl, or the bowl with the leeks.
        room: Where to look for it first, such as "kitchen".
    """

    type: Literal["navigation"]
    description: Phrase
    completion_criterion: Phrase
    target: Phrase
    room: Phrase | None = None


class Manipulation(Record):
    """Do something with the hands.

    Attributes:
        description: What to do; it prompts the policy.
        completion_criterion: The state of the world that ends it, such as "the can is in the trash can": a state can be
            told from one image, an action cannot (Paper, Completion Checker appendix).
        target: Always null; language models write it, and it means nothing here.
    """

    type: Literal["manipulation"]
    description: Phrase
    completion_criterion: Phrase
    target: None = None


Segment = Annotated[Navigation | Manipulation, Field(discriminator="type")]


class Plan(Record):
    """An instruction as segments, carried out in order.

    Attributes:
        task_name: Short, such as "picking_up_trash".
        instruction: What the user said; "" if unknown.
        segments: At least one, at most 200.
    """

    task_name: Phrase
    instruction: Annotated[str, StringConstraints(strip_whitespace=True, max_length=2000)] = ""
    segments: tuple[Segment, ...] = Field(min_length=1, max_length=200)

    def to_json(self) -> str:
        """The plan as an indented JSON text that `load_plan` reads back."""
        return json.dumps(self.model_dump(exclude_none=True), indent=2, ensure_ascii=False) + "\n"


def load_plan(path: str | Path) -> Plan:
    """A plan from a JSON or YAML file.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return check_plan(*load_marked(path))


def check_plan(data: Any, marks: SourceMarks) -> Plan:
    """As `load_plan`, of data that is already loaded."""
    expect("plan", data, marks)
    return validate_data(data, marks, Plan)
