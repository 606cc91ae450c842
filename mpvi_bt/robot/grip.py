"""Noticing from what a hand feels that it closed on nothing, or that what it held is gone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from mpvi_bt.robot import r1
from mpvi_bt.robot.protocol import EMPTY_M, SIDES, Proprioception, Side

_STEADY_M = 0.0005  # a width that changes by less than this in a step, so many steps in a row, is that of a thing held
_STEADY_STEPS = 4


class GripWatch:
    """Watches the fingers: both kinds of notice come as soon as they meet, once for each time that they do.

    Our choice: a closed hand narrower than `EMPTY_M` is empty, at once; one that stays wider than it is told to be
    holds something. Waiting for the arm to come to rest, as completion does, would cost seconds.
    """

    def __init__(self, felt: Proprioception) -> None:
        """Take a hand as it is: one that is closed on nothing now is no news."""
        self._width = dict(felt.gripper_width)
        self._steady = dict.fromkeys(SIDES, _STEADY_STEPS)
        self._holds = {side: self._stopped(felt, side) for side in SIDES}
        self._told = {side: _shut(felt, side) for side in SIDES}

    def update(self, felt: Proprioception) -> Iterator[tuple[Literal["empty", "lost"], Side]]:
        """What is new at this step; to be asked once a step."""
        for side in SIDES:
            width = felt.gripper_width[side]
            steady = abs(width - self._width[side]) < _STEADY_M
            self._steady[side] = self._steady[side] + 1 if steady else 0
            self._width[side] = width
            if felt.gripper_command[side] >= 0:
                self._holds[side] = self._told[side] = False
            elif _shut(felt, side):
                if not self._told[side]:
                    yield ("lost" if self._holds[side] else "empty"), side
                self._holds[side], self._told[side] = False, True
            elif self._steady[side] >= _STEADY_STEPS and self._stopped(felt, side):
                self._holds[side], self._told[side] = True, False

    @staticmethod
    def _stopped(felt: Proprioception, side: Side) -> bool:
        """Whether something keeps the fingers of a closing hand farther apart than it is told to have them."""
        told_m = (felt.gripper_command[side] + 1.0) * r1.FINGER_TRAVEL_M
        return felt.holds(side) and felt.gripper_width[side] > told_m + EMPTY_M


def _shut(felt: Proprioception, side: Side) -> bool:
    return felt.gripper_command[side] < 0 and felt.gripper_width[side] <= EMPTY_M
