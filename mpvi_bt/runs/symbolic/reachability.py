"""Which condition of a goal no actions bring about in any order, and what stands in the way."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from mpvi_bt.runs.symbolic.grounded_actions import GroundedAction
from mpvi_bt.runs.symbolic.told_facts import Atom


@dataclass(frozen=True)
class OutOfReach:
    """A condition that cannot be met.

    Attributes:
        atom: The condition.
        so: Whether it has to be so at the end, or must not be.
        skill: That would bring it about, if its needs could be met; "" if there is none.
        lacks: A need of that skill which cannot be met either.
    """

    atom: Atom
    so: bool = True
    skill: str = ""
    lacks: Atom | None = None


def out_of_reach(
    actions: Sequence[GroundedAction], start: Collection[Atom], goal: Collection[Atom], never: Collection[Atom]
) -> OutOfReach | None:
    """The first condition that cannot be met even if no action ended what another one needs; None: there is none.

    Args:
        actions: To choose from.
        start: What is so.
        goal: What has to be so at the end.
        never: What must not be so at the end.
    """
    reached, left = set(start), list(actions)
    while doable := [action for action in left if action.needs <= reached]:
        left = [action for action in left if not action.needs <= reached]
        reached.update(*(action.adds for action in doable))
    lost = sorted({*goal} - reached)
    makers = {atom: [action for action in left if atom in action.adds] for atom in lost}
    for atom in sorted(lost, key=lambda atom: bool(makers[atom])):
        if not makers[atom]:
            return OutOfReach(atom)
        nearest = min(makers[atom], key=lambda action: len(action.needs - reached))
        return OutOfReach(atom, True, nearest.skill, min(nearest.needs - reached))
    ended = {atom for action in actions for atom in action.drops}
    lasting = sorted(({*never} & {*start}) - ended)
    return OutOfReach(lasting[0], False) if lasting else None
