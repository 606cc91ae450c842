"""The motions that can be learned: whether the hand closes or opens in each, and how large its target may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

_TOLD = 0.5  # a command of the gripper beyond it, -1 closed to 1 open, is meant to close or to open
_HIDES = -0.95  # a hand that is told to close more than so hides what it closes on


@dataclass(frozen=True)
class LearnedMotion:
    """One motion of one hand.

    Attributes:
        opens: Whether the hand holds a payload and lets go of it; else it is free and takes one.
        most_m: Standard deviation of a target's points, along x or y, above which it is larger than any that was
            trained on, as a fridge is beside baskets. Our choice: the benchmark's largest basket has 0.151; of 696
            demonstrated picks all but four have less than 0.09 at the first look, and a trash can 0.097.
    """

    opens: bool
    most_m: float = math.inf

    def ahead(self, grip: float) -> bool:
        """Whether closing or opening is still to come, by the gripper's command in force."""
        return grip < -_TOLD if self.opens else grip > _TOLD

    def sees(self, grip: float) -> bool:
        """Whether cameras show the target: a hand that closes on it hides it."""
        return self.opens or grip > _HIDES


MOTIONS: Mapping[str, LearnedMotion] = {
    "pick": LearnedMotion(opens=False, most_m=0.09),
    "place_in": LearnedMotion(opens=True, most_m=0.16),
    "place_on": LearnedMotion(opens=True),
    "place_next_to": LearnedMotion(opens=True),
}
