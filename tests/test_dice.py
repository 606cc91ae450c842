"""Dicing: which pieces a knife is brought down on, and what is said of those that it was not."""

from __future__ import annotations

from collections.abc import Generator
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.robot.collision import Load
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
    went: list[str] = []
    left = list(HALVES)

    def press(work: Work, side: Side, name: str, tried: object, first: int) -> Generator[Array, None, int]:
        assert first == (1 if set(went) - set(failures) else 0), "the end that has cut goes first"
        went.append(name)
        yield from ()
        if name in failures:
            raise MotionFailure(failures[name])
        left.remove(name)
        return 1

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


def test_of_a_tool_that_is_known_as_one_piece_either_half_may_be_the_blade() -> None:
    """A picture tells no blade from a handle; whoever knows the parts has the one that is farthest off."""
    box, handle = Solid("box", np.array([0.01, 0.1, 0.02]), pose((0.0, 0.03, 0.1))), Solid("box", np.full(3, 0.02))

    def held(*solids: Solid) -> Held:
        return Held("knife", "right", np.eye(4), solids, cast("Load", None))

    halves = cutting._blades(held(box))
    assert [half.aabb()[:, 1].round(3).tolist() for half in halves] == [[0.03, 0.13], [-0.07, 0.03]]
    assert [half.aabb()[:, [0, 2]].tolist() for half in halves] == [box.aabb()[:, [0, 2]].tolist()] * 2
    (blade,) = cutting._blades(held(handle, box))
    assert blade.aabb().tolist() == box.aabb().tolist()
