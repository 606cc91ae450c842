"""A skill's needs and effects, in terms of its phrases' slots: all that rehearsal and planner know of skills.

Scripted policies read less: `needs.held`, and of the effects `held`, `open`, `inside`, `ontop`, `nextto` and `under`.
The other terms tell these two alone, so that a term more changes no motion: pouring ends `poured`, not `inside`, since
no hand lets go of a payload there, and for the same reason a hand-over ends `passed`, not `held`.
"""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from mpvi_bt.executive.plan.pattern import Slot
from mpvi_bt.ground.marked_yaml import Record

Pair = tuple[Slot, Slot]


class Terms(Record):
    """Relations of things; each thing is told by its slot."""

    @property
    def slots(self) -> list[str]:
        """Every slot that is told."""
        told = (term for term in self.model_dump().values() if term and not isinstance(term, int))
        return [slot for term in told for slot in ((term,) if isinstance(term, str) else term)]


RELEASING = ("inside", "ontop", "nextto", "under", "attached")  # terms after which the payload is in no hand
_EXCLUDED = {  # effects on one thing that exclude each other
    "closed": ("open",),
    "clean": ("sprayed",),
    "held": ("passed", "cut", *RELEASING),
    "inside": ("ontop", "attached"),
}


def payload(told: Slot | Pair | None) -> Slot | None:
    """The thing of an effect, or the first one of a pair."""
    return told[0] if isinstance(told, tuple) else told


class SkillNeeds(Terms):
    """What has to be so before a skill begins.

    Attributes:
        hands: How many hands have to be free.
        held: Slots of the payload: what the first of them names that is said has to be in a hand.
        near: What has to be in reach.
        open, closed: What has to stand open, or be closed, if it is a thing that can be opened at all.
        on: What has to be turned on.
    """

    hands: Annotated[int, Field(ge=0, le=2)] = 0
    held: tuple[Slot, ...] = ()
    near: tuple[Slot, ...] = ()
    open: tuple[Slot, ...] = ()
    closed: tuple[Slot, ...] = ()
    on: tuple[Slot, ...] = ()

    @model_validator(mode="after")
    def _agree(self) -> Self:
        """Raises ValueError for needs that exclude each other."""
        if both := {*self.open} & {*self.closed}:
            raise ValueError(f"{min(both)!r} cannot be open and closed at once; leave one of the two out")
        if self.hands == 2 and self.held:
            raise ValueError(
                f"both hands have to be free, and {self.held[0]!r} has to be in one; leave one of the two out"
            )
        return self


class SkillEffects(Terms):
    """What is so once a skill is done. The keys are relations, as of criteria and goals; the values are slots.

    Attributes:
        held: The payload that a hand has taken, or both hands if the skill takes two.
        passed: The payload that the other hand has taken over.
        open: What has been opened.
        closed: What has been closed.
        on: What has been turned on; off, where the slot `state` says "off".
        inside: The payload that a hand has let go of, and the container.
        ontop, nextto, under: The payload that a hand has let go of, and the thing on, beside or under which it is.
        attached: The payload that a hand has let go of, and what it is mounted on.
        poured: A vessel, and where its contents are now.
        pushed: What has been pushed, and beside what it is now, if that is said.
        clean: What has no marks any more.
        sprayed: What is covered by what the tool sprays.
        burning: What burns.
        cut: What is in pieces; the criterion says what they are, and where.
        meanwhile: What the robot has waited for: what is at a source of heat is cooked, what is in a fridge is frozen,
            what touches a fire burns.
        at: Where the robot is.
    """

    held: Slot | None = None
    passed: Slot | None = None
    open: Slot | None = None
    closed: Slot | None = None
    on: Slot | None = None
    inside: Pair | None = None
    ontop: Pair | None = None
    nextto: Pair | None = None
    under: Pair | None = None
    attached: Pair | None = None
    poured: Pair | None = None
    pushed: Pair | None = None
    clean: Slot | None = None
    sprayed: Slot | None = None
    burning: Slot | None = None
    cut: Slot | None = None
    meanwhile: Slot | None = None
    at: Slot | None = None

    @model_validator(mode="after")
    def _agree(self) -> Self:
        """Raises ValueError for effects that exclude each other: of one thing, or of a pair that is one thing."""
        for term in type(self).model_fields:
            told = getattr(self, term)
            if isinstance(told, tuple) and told[0] == told[1]:
                raise ValueError(f"{term}: {told[0]!r} cannot be its own place")
            for other in _EXCLUDED.get(term, ()):
                if told is not None and payload(told) == payload(getattr(self, other)):
                    raise ValueError(
                        f"{payload(told)!r} cannot be {term} and {other} at once; leave one of the two out"
                    )
        return self

    def contradiction(self, needs: SkillNeeds) -> str:
        """Why these effects do not go with needs, in words; "" if they do."""
        for term in ("open", "closed", "held"):
            if (slot := getattr(self, term)) is not None and slot in getattr(needs, term):
                return f"{slot!r} is {term} before the skill already: take {term!r} out of needs or out of effects"
        for term in RELEASING:
            if (told := getattr(self, term)) is not None and told[0] not in needs.held:
                return f"{term!r} lets go of {told[0]!r}, and needs do not tell that it is held"
        return ""

    @property
    def put(self) -> Pair | None:
        """The payload after release, and its place."""
        return self.inside or self.beside

    @property
    def beside(self) -> Pair | None:
        """As `put`, but not into a container. Only a container may itself be in a hand."""
        return self.ontop or self.nextto or self.under

    @property
    def target(self) -> Slot | None:
        """The hand's target: the payload to take, or the place for the one it holds."""
        return self.put[1] if self.put is not None else self.held
