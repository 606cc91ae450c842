"""The payload of each hand along a plan, as far as it is certain."""

from __future__ import annotations

from dataclasses import dataclass

from mpvi_bt.executive.plan.skills import SkillCall
from mpvi_bt.ground.words.phrases import read


@dataclass(frozen=True)
class _Held:
    """Something in the hands.

    Attributes:
        thing: What it is called.
        hands: The hands that hold it; empty: one that nobody named.
        segment: The 0-based segment that took it.
    """

    thing: str
    hands: frozenset[str]
    segment: int


class Hands:
    """Follows the segments of a plan by their skills' triggers: a grasp takes hold, a release lets go.

    Only what is certain is told: a segment that names no skill may do anything with the hands, and so may one that lets
    go of what nobody took.
    """

    def __init__(self, hands: tuple[str, ...]) -> None:
        """`hands` are the robot's; at first they are empty."""
        self._all = frozenset(hands)
        self._held: list[_Held] = []

    @property
    def held(self) -> frozenset[int]:
        """The segments that took the payloads now in hand."""
        return frozenset(held.segment for held in self._held)

    def take(self, call: SkillCall | None, segment: int) -> None:
        """Go on by one segment with the skill `call`."""
        if call is None:
            self._held.clear()
            return
        events = {trigger.event for trigger in call.skill.triggers}
        hand, thing = call.arguments.get("hand"), call.arguments.get("object", "")
        if "release" in events:
            if call.skill.hands == 2:
                self._held.clear()  # passes it on
            else:
                self._release(thing, hand)
            return
        if call.skill.hands == 2:
            self._held = [_Held(thing, self._all, segment)]
            return
        if "grasp" not in events:
            return
        taken = [held for held in self._held if hand in held.hands] if hand else []
        full = len(self._held) >= len(self._all) or any(held.hands == self._all for held in self._held)
        against = taken or (self._held if full else [])
        if any(_same(held.thing, thing) for held in taken):
            against = []  # it takes better hold of it
        self._held = [held for held in self._held if held not in (*against, *taken)]
        self._held.append(_Held(thing, frozenset({hand} if hand else ()), segment))

    def _release(self, thing: str, hand: str | None) -> None:
        named = [held for held in self._held if hand in held.hands] if hand else []
        named = named or [held for held in self._held if _same(held.thing, thing)]
        if named:
            self._held.remove(named[0])
        else:
            self._held.clear()


def _same(a: str, b: str) -> bool:
    """Whether two phrases may mean one thing: what is not of one noun is another thing."""
    one, other = read(a), read(b)
    return one is None or other is None or one.noun == other.noun
