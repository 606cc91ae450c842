"""Detects from proprioception an empty grasp and a lost payload."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from mpvi_bt.ground.robot.protocol import Proprioception, Side

_STEADY_M = 0.0005  # a width that changes by less than this in a step, so many steps in a row, is that of a thing held
_STEADY_STEPS = 4


class GripWatch:
    """Watches the fingers: both kinds of notice come as soon as they meet, once for each time that they do.

    Our choice: a closed hand narrower than its `grasp_m` is empty, at once; one that stays wider than it is told to be
    holds something, and has lost it when it gets about as narrow as told, which need not be shut: learned policies
    seldom say -1. Waiting for the arm to come to rest, as completion does, would cost seconds.

    Attributes:
        grasped: How often each hand closed on something.
        opened: How often each was told to open after it had been told to close.
    """

    def __init__(self, felt: Proprioception) -> None:
        """Take a hand as it is: one that is closed on nothing now is no news."""
        self._width = dict(felt.gripper_width)
        self._steady = dict.fromkeys(felt.sides, _STEADY_STEPS)
        self._held_m = {side: felt.gripper_width[side] if _stopped(felt, side) else None for side in felt.sides}
        self._told = {side: _shut(felt, side) for side in felt.sides}
        self._closing = {side: felt.gripper_command[side] < 0 for side in felt.sides}
        self.grasped: dict[Side, int] = dict.fromkeys(felt.sides, 0)
        self.opened: dict[Side, int] = dict.fromkeys(felt.sides, 0)

    def update(self, felt: Proprioception) -> Iterator[tuple[Literal["empty", "lost"], Side]]:
        """What is new at this step; to be asked once a step."""
        for side in felt.sides:
            width, held_m = felt.gripper_width[side], self._held_m[side]
            steady = abs(width - self._width[side]) < _STEADY_M
            self._steady[side] = self._steady[side] + 1 if steady else 0
            self._width[side] = width
            closing = felt.gripper_command[side] < 0
            self.opened[side] += self._closing[side] and not closing
            self._closing[side] = closing
            if not closing:
                self._told[side] = False
            if held_m is not None and held_m <= _narrowest_m(felt, side):
                self._held_m[side] = None  # it was told to let go
            elif held_m is not None and not _stopped(felt, side):
                yield "lost", side
                self._held_m[side], self._told[side] = None, True
            elif _shut(felt, side):
                if not self._told[side]:
                    yield "empty", side
                self._told[side] = True
            elif self._steady[side] >= _STEADY_STEPS and _stopped(felt, side):
                self.grasped[side] += held_m is None and closing
                self._held_m[side], self._told[side] = width, False


def _narrowest_m(felt: Proprioception, side: Side) -> float:
    """The gripper width [m] above which a payload keeps the fingers from their commanded place."""
    return (felt.gripper_command[side] + 1.0) * (felt.open_m / 2) + felt.grasp_m


def _stopped(felt: Proprioception, side: Side) -> bool:
    """Whether something keeps the fingers farther apart than they are told to be."""
    return felt.gripper_width[side] > _narrowest_m(felt, side)


def _shut(felt: Proprioception, side: Side) -> bool:
    return felt.gripper_command[side] < 0 and felt.gripper_width[side] <= felt.grasp_m
