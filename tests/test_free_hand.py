"""Hands that should be empty by now: what they hold is set down, and the motion begins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.skills import free_hand
from mpvi_bt.hands.skills.free_hand import with_a_free_hand


class Hands:
    """Stands in for a `Work`: what each hand holds, and that a basket can be filled."""

    def __init__(self, **held: str) -> None:
        self.names = cast("dict[Side, str]", held)
        self.scene = SimpleNamespace(volumes=lambda name: ["inside"] if name == "basket" else [])

    def held(self) -> dict[Side, Any]:
        return {side: SimpleNamespace(name=name) for side, name in self.names.items()}


@pytest.fixture
def floor(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was set down on the floor, in order."""
    down: list[str] = []

    def set_on_floor(work: Any, side: Side, tried: list[Any]) -> Actions:
        down.append(work.names.pop(side))
        yield from ()

    monkeypatch.setattr(free_hand, "set_on_floor", set_on_floor)
    return down


def needing(free: int) -> Any:
    """A motion that needs so many empty hands, or the one that is named."""

    def perform(work: Any, words: Words, tried: list[Any]) -> Actions:
        full = words["hand"] in work.names if "hand" in words else 2 - len(work.names) < free
        if full:
            raise MotionFailure("hands_full")
        yield from ()

    return perform


@pytest.mark.parametrize(
    ("held", "free", "words", "down"),
    [
        ({"left": "gift"}, 1, {}, []),
        ({"left": "basket", "right": "gift"}, 1, {}, ["gift"]),
        ({"left": "gift", "right": "basket"}, 1, {}, ["gift"]),
        ({"left": "gift", "right": "basket"}, 1, {"hand": "right"}, ["basket"]),
        ({"left": "gift", "right": "basket"}, 2, {}, ["gift", "basket"]),
    ],
)
def test_only_what_is_in_the_way_is_set_down(
    held: dict[str, str], free: int, words: dict[str, str], down: list[str], floor: list[str]
) -> None:
    """An empty hand is used as it is; else the named one is emptied, and a container before nothing else."""
    list(with_a_free_hand(needing(free))(cast("Work", Hands(**held)), words, []))
    assert floor == down


def test_other_failures_go_through(floor: list[str]) -> None:
    """A motion that fails for another reason sets nothing down."""

    def slips(work: Work, words: Words, tried: list[Any]) -> Actions:
        raise MotionFailure("slipped")
        yield

    with pytest.raises(MotionFailure, match="slipped"):
        list(with_a_free_hand(slips)(cast("Work", Hands(left="gift", right="can")), {}, []))
    assert floor == []


def test_a_motion_that_wants_more_than_empty_hands_fails_as_before(floor: list[str]) -> None:
    """Where nothing is held any more and hands still count as full, as by a thing between them, that is told."""
    with pytest.raises(MotionFailure, match="hands_full"):
        list(with_a_free_hand(needing(3))(cast("Work", Hands(left="gift")), {}, []))
    assert floor == ["gift"]
