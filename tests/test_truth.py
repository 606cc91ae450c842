"""What the oracle's answers about the robot's own place rest on."""

from __future__ import annotations

import pytest

from mpvi_bt.runs.choices.world_truth import TrueState
from tests.small_house import placed, small_world


@pytest.mark.parametrize(
    ("phrase", "at"),
    [
        ("trash can", True),  # 0.8 m from the base's middle
        ("the other trash can", True),
        ("can of soda", False),  # 2.5 m
        ("hall", True),  # the room
        ("elephant", None),
    ],
)
def test_the_robot_is_where_it_reaches_or_in_the_room(phrase: str, at: bool | None) -> None:
    """Within the handoff distance and its slack; in a room by the room; nowhere where nothing is called so."""
    things = {"bin": placed("trash_can", 0.9, 0.0), "can": placed("can_of_soda", 0.0, 2.5)}
    assert TrueState(small_world(things)).at(phrase) is at
