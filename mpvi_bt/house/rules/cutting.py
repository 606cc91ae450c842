"""Cutting: an active slicer makes halves of what it touches, and dice of what can be diced.

Source: OmniGibson, object_states/slicer_active.py, transition_rules.py (SlicingRule, DicingRule).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from mpvi_bt.ground.marked_yaml import Record

REARMED_S = 2.0  # so long after it last touched what can be sliced a slicer is active again

Cut = Literal["halves", "dice"]


@dataclass(frozen=True)
class Slicer:
    """A blade.

    Attributes:
        active: Whether it cuts.
        untouched_s: How long it has touched nothing that can be sliced.
    """

    active: bool = True
    untouched_s: float = 0.0


class Cuttable(Record):
    """What cutting does to a kind of thing: whole vegetables become halves, halves become dice; none does both.

    Attributes:
        half: The catalogue's entry of its two halves, or None.
        diced: The entry of its dice, or None.
        dice: How many dice it becomes.
    """

    half: str | None = None
    diced: str | None = None
    dice: Annotated[int, Field(ge=1, le=12)] = 2


def cut(slicer: Slicer, kind: Cuttable) -> Cut | None:
    """What becomes of a thing that the slicer touches now."""
    if not slicer.active:
        return None
    return "halves" if kind.half is not None else "dice" if kind.diced is not None else None


def rearmed(slicer: Slicer, touches_sliceable: bool, dt_s: float) -> Slicer:
    """The slicer a step later: off once it has touched what can be sliced, on again after 2 s without such a touch."""
    if touches_sliceable:
        return Slicer(active=False)
    if slicer.active:
        return slicer
    untouched = slicer.untouched_s + dt_s
    return Slicer(active=untouched >= REARMED_S - 1e-9, untouched_s=untouched)
