"""The end of a pick or a place as the hands feel it, for policies that never say that they have ended."""

from __future__ import annotations

from mpvi_bt.executive.plan.skill_effects import RELEASING
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.protocol import Proprioception, Side

STEADY_S = 1.0  # our choice: a hand that has slipped off, or only touches, holds nothing for so long
MISSED_S = 8.0  # our choice: twice a long chunk of 4 s, so that a policy which looks again has opened its hand by then


class FeltEnd:
    """Watches the hands during a clause whose skill brings something into a hand, or lets it go.

    Args:
        skill: Of the clause; None: it has none, so that nothing is felt of its end.
        body: What is felt as it begins.
    """

    def __init__(self, skill: Skill | None, body: Proprioception | None = None) -> None:
        told = skill.effects.model_dump() if skill is not None else {}
        self._more = 1 if told.get("held") else -1 if any(told.get(term) for term in RELEASING) else 0
        self._before: int | None = None  # hands that held something when it began
        self._so_for_s = 0.0
        self._empty_s: dict[Side, float] = {}  # of hands that have been open: how long each is closed on nothing
        if body is not None:
            self.felt(body, 0.0)
            self.missed(body, 0.0)

    def felt(self, body: Proprioception, since_s: float) -> bool:
        """Whether a hand has held something, or let go of it, for a second.

        Args:
            body: What is felt now.
            since_s: Time since it was asked last.
        """
        holding = sum(body.holds(side) for side in body.sides)
        if self._before is None:
            self._before = holding
        changed = self._more and (holding - self._before) * self._more > 0
        self._so_for_s = self._so_for_s + since_s if changed else 0.0
        return self._so_for_s >= STEADY_S

    def missed(self, body: Proprioception, since_s: float) -> bool:
        """Whether a hand that was to bring something has closed on nothing, and stayed so for `MISSED_S`.

        A hand that has not been open since the clause began says nothing: it may only be on its way. One that opened in
        between, as `acts` knows, tries again.

        Args:
            body, since_s: As of `felt`.
        """
        if self._more <= 0:
            return False
        for side in body.sides:
            if body.gripper_command[side] >= 0 or body.holds(side):
                self._empty_s[side] = 0.0
            elif side in self._empty_s:
                self._empty_s[side] += since_s
        return any(empty_s >= MISSED_S for empty_s in self._empty_s.values())

    def acts(self, chunk: Array, layout: ActionLayout) -> None:
        """Take note of what hands are told before they are felt again: in a chunk (H, A), of that layout."""
        if self._more > 0:
            for side, column in layout.gripper.items():
                if (chunk[:, column] >= 0).any():
                    self._empty_s[side] = 0.0
