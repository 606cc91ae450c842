"""Dicing: which pieces a knife is brought down on, and what is said of those that it was not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills import cut as cutting

HALVES = ["half_1", "half_2", "half_3"]


@pytest.mark.parametrize(
    ("failures", "pressed", "reason"),
    [
        ({}, HALVES, None),
        ({"half_1": "no_stance"}, HALVES, "no_stance"),
        ({"half_2": "not_cut"}, HALVES, "not_cut"),
        ({"half_2": "dropped"}, ["half_1", "half_2"], "dropped"),
    ],
)
def test_one_piece_without_room_is_no_reason_to_leave_the_others_whole(
    monkeypatch: pytest.MonkeyPatch, failures: dict[str, str], pressed: list[str], reason: str | None
) -> None:
    """All others are diced, then it is said; with the knife lost there is nothing to go on with."""
    went, left = [], list(HALVES)

    def press(work: Work, side: Side, name: str, tried: object) -> Actions:
        went.append(name)
        yield from ()
        if name in failures:
            raise MotionFailure(failures[name])
        left.remove(name)

    def nothing(*_: object, **__: object) -> Actions:
        yield from ()

    def find(phrase: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(name=name) for name in left] if phrase.startswith("half ") else []

    monkeypatch.setattr(cutting, "_press", press)
    monkeypatch.setattr(cutting, "settle", nothing)
    monkeypatch.setattr(cutting, "tool_hand", lambda *_: "right")
    scene = SimpleNamespace(knowledge=lambda: SimpleNamespace(find=find))
    work = cast("Work", SimpleNamespace(scene=scene, motion=SimpleNamespace(wait=nothing)))

    def dice() -> None:
        list(cutting.dice(work, {"object": "the tomato"}, []))

    if reason is None:
        dice()
    else:
        with pytest.raises(MotionFailure, match=reason):
            dice()
    assert went == pressed
