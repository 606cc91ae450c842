"""What a clause may mean by the things that it names."""

from __future__ import annotations

import pytest

from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.hands.policies.readings import count, readings

SKILLS = load_skills()


@pytest.mark.parametrize(
    ("clause", "things", "number"),
    [
        ("pick up the can of soda", {"object": "can of soda"}, 1),
        ("pick up two cans of soda", {"object": "can of soda"}, 2),
        (
            "Put the three cans of soda from the living room in the trash can in the kitchen.",
            {"object": "can of soda", "container": "trash can"},
            3,
        ),
        ("pick up 4 dice cubes", {"object": "dice cube"}, 4),
    ],
)
def test_counts_and_places_may_be_left_out(clause: str, things: dict[str, str], number: int) -> None:
    """The last reading has only the bare names, the first is what was said; the count is how often it is to be done."""
    call = match(clause, SKILLS)
    assert call is not None
    assert count(call) == number
    understood = list(readings(call))
    assert dict(understood[0].arguments) == dict(call.arguments)
    assert any(dict(reading.arguments) == things for reading in understood)


def test_what_has_no_count_stays_as_it_is() -> None:
    """A thing whose name ends in s is no plural."""
    call = match("pick up the glass", SKILLS)
    assert call is not None
    assert [dict(r.arguments) for r in readings(call)] == [{"object": "glass"}]
