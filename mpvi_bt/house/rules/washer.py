"""Washers: as one begins to run, what is in it loses the marks that it takes.

Source: OmniGibson, transition_rules.py (WasherRule).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mpvi_bt.house.rules.marks import Marks


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
