"""Washers: a washer that begins to run removes its kinds of marks from the things in it.

Source: OmniGibson, transition_rules.py (WasherRule).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from mpvi_bt.house.states.marks import Marks
from mpvi_bt.house.states.relations import OPEN_FRACTION, inside
from mpvi_bt.house.states.world_state import WorldState


def begins(ran: bool, *, on: bool, closed: bool) -> bool:
    """Whether it begins to run in this step: it is on and closed, and was not before."""
    return on and closed and not ran


def washed(marks: Marks, solvents: Mapping[str, Collection[str]], there: Collection[str] = ()) -> Marks:
    """What is left on a thing in it.

    Args:
        marks: On the thing.
        solvents: Kinds that the washer takes, each with the solvents of which one is needed; empty: it needs none.
        there: Solvents that are in the washer.
    """
    kept = {
        kind: points
        for kind, points in marks.points.items()
        if kind not in solvents or (solvents[kind] and not set(solvents[kind]) & set(there))
    }
    return Marks(kept)


class Washing:
    """What the washers of a world do."""

    def __init__(self, solvents: Mapping[str, Mapping[str, Collection[str]]]) -> None:
        """None runs. `solvents`: by the names of washers, as of `washed`."""
        self._solvents = solvents
        self._ran = dict.fromkeys(solvents, False)

    def step(self, state: WorldState, marks: dict[str, Marks]) -> None:
        """One control step later."""
        for washer, solvents in self._solvents.items() if marks else ():
            on = state.toggled_on(washer)
            closed = all(fraction <= OPEN_FRACTION for fraction in state.joint_fractions(washer))
            if begins(self._ran[washer], on=on, closed=closed):
                for name, there in marks.items():
                    if inside(state, name, washer):
                        marks[name] = washed(there, solvents)
            self._ran[washer] = on and closed

    def save(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Do nothing: a washer that runs goes on."""
