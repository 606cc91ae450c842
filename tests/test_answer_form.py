"""The form in which a model answers with a plan: what is known is enumerated, and what fits it is read as it is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import jsonschema
import pytest

from mpvi_bt.executive.plan.answer_form import MOST_VALUES, answer_schema, answer_text, read_segment
from mpvi_bt.executive.plan.language_planner import read_answer
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.schema import load_plan
from mpvi_bt.ground import paths
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.planning import ground

HOUSE = ground("family_house", load_task("picking_up_trash"))
TRASH = load_plan(paths.find("tasks/plans", "picking_up_trash"))
SCHEMA = answer_schema(HOUSE, TRASH.task_name)


def changed(i: int, **values: Any) -> Any:
    """The plan of the trash as it is answered, with other values in a segment."""
    data = json.loads(answer_text(TRASH))
    data["segments"][i].update(values)
    return data


def fits(data: Any, schema: Any = SCHEMA) -> bool:
    return bool(jsonschema.Draft202012Validator(schema).is_valid(data))


def walk(schema: Any) -> Iterator[dict[str, Any]]:
    """A schema and all within it."""
    yield schema
    inner = [*schema.get("properties", {}).values(), *schema.get("anyOf", []), schema.get("items", {})]
    for part in filter(None, inner):
        yield from walk(part)


@pytest.mark.parametrize("schema", [answer_schema(), SCHEMA])
def test_the_schema_is_what_servers_take(schema: Any) -> None:
    """It has every key required, none beyond, no reference and no keyword that some server does not know."""
    known = {"type", "enum", "items", "properties", "anyOf", "additionalProperties", "required"}
    for part in walk(schema):
        assert set(part) <= known
        if part.get("type") == "object":
            assert part["required"] == list(part["properties"])
            assert part["additionalProperties"] is False


def test_what_is_not_there_cannot_be_named() -> None:
    """Neither a room, a target nor a hand, nor the plan by another name; what is there can."""
    assert fits(changed(0))
    assert not fits(changed(0) | {"task_name": "dancing"})
    for wrong in ({"room": "attic"}, {"target": "unicorn"}):
        assert not fits(changed(0, **wrong))
        assert fits(changed(0, **wrong), answer_schema())
    assert fits(changed(0, room=None))
    assert fits(changed(0, target="can of soda", room="living room"))
    assert [fits(changed(1, hand=hand)) for hand in ("left", "right", None, "third")] == [True, True, True, False]
    one_handed = answer_schema(replace(HOUSE, hands=("right",)), TRASH.task_name)
    assert not fits(changed(1, hand="left"), one_handed)


def test_targets_are_free_where_the_things_are_not_known() -> None:
    """Of an instruction alone the house is known, and nothing that can be carried."""
    schema = answer_schema(ground("family_house"))
    assert fits(changed(0, target="unicorn") | {"task_name": "dancing"}, schema)
    assert not fits(changed(0, room="attic"), schema)


def test_too_many_names_are_not_enumerated() -> None:
    """Servers refuse them; and a part of them would forbid what is there."""
    for count, enumerated in ((MOST_VALUES, True), (MOST_VALUES + 1, False)):
        many = replace(HOUSE, names={f"thing_{i}": (f"thing {i}",) for i in range(count)})
        assert fits(changed(0, target="unicorn"), answer_schema(many)) is not enumerated
    long = replace(HOUSE, names={f"thing_{i}": (f"thing {i} {'x' * 250}",) for i in range(40)})
    assert fits(changed(0, target="unicorn"), answer_schema(long))


@pytest.mark.parametrize("name", paths.names("tasks"))
def test_the_schemas_of_our_tasks_keep_to_the_limits_of_services(name: str) -> None:
    """OpenAI takes 500 values of all enumerations at the least, and is strict about lengths from 250 in one."""
    task = load_task(name)
    found = [
        part["enum"] for part in walk(answer_schema(ground(task.house, task), task.plan or name)) if "enum" in part
    ]
    assert max(map(len, found)) > 3
    assert sum(map(len, found)) <= 500
    assert max(map(len, found)) <= 250
    assert sum(len(value) for values in found for value in values) <= 15_000


def test_a_plan_is_read_as_it_is_told() -> None:
    """Every plan on file comes back from its text, its hands from their key."""
    by_hand = 0
    for plan in RecordedPlanner().all():
        text = answer_text(plan)
        data, problems = read_answer(text)
        assert problems == []
        assert data["segments"] == [segment.model_dump(exclude_none=True) for segment in plan.segments]
        by_hand += text.count('"hand": "')
        assert "with the left hand" not in text
    assert by_hand > 10


@pytest.mark.parametrize(
    ("deed", "hand", "read"),
    [
        ("pick up the cup", "left", "pick up the cup with the left hand"),
        ("pick up the cup.", " Right hand ", "pick up the cup with the Right hand"),
        ("pick up the cup with the left hand", "left", "pick up the cup with the left hand"),
        ("pass it from the left hand to the right hand", "right", "pass it from the left hand to the right hand"),
        ("lift the box", "both", "lift the box"),
        ("lift the box", "both hands", "lift the box"),
        ("lift the box", "", "lift the box"),
        ("pick up the cup", "third", "pick up the cup with the third hand"),
        (" ", "left", " "),
    ],
)  # fmt: skip
def test_the_hand_is_part_of_what_is_done(deed: str, hand: str, read: str) -> None:
    """Once, whether the model says it in its key, in words or in both; one that is not there is told by the check."""
    segment = {"type": "manipulation", "description": deed, "completion_criterion": "it is held", "hand": hand}
    assert read_segment(segment)["description"] == read
    assert "hand" not in read_segment(segment)
    assert segment["hand"] == hand
