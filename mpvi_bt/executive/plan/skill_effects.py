"""A skill's needs and effects, in terms of its phrases' slots."""

from __future__ import annotations

from mpvi_bt.executive.plan.pattern import Slot
from mpvi_bt.ground.marked_yaml import Record

Pair = tuple[Slot, Slot]


class Terms(Record):
    """Relations of things; each thing is told by its slot."""

    @property
    def slots(self) -> list[str]:
        """Every slot that is told."""
        told = (term for term in self.model_dump().values() if term)
        return [slot for term in told for slot in ((term,) if isinstance(term, str) else term)]


class SkillNeeds(Terms):
    """What has to be so before a skill begins.

    Attributes:
        held: Slots of the payload: what the first of them names that is said has to be in a hand.
    """

    held: tuple[Slot, ...] = ()


class SkillEffects(Terms):
    """What is so once a skill is done. The keys are relations, as of criteria and goals; the values are slots.

    Attributes:
        held: The payload that a hand has taken.
        open: What has been opened.
        closed: What has been closed.
        inside: The payload that a hand has let go of, and the container.
        ontop, nextto, under: The payload that a hand has let go of, and the thing on, beside or under which it is.
    """

    held: Slot | None = None
    open: Slot | None = None
    closed: Slot | None = None
    inside: Pair | None = None
    ontop: Pair | None = None
    nextto: Pair | None = None
    under: Pair | None = None

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
