"""Marks: dust, dirt, mud or a spray that sits on things, at points of each.

Source: OmniGibson, object_states/covered.py and particle_modifier.py.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array

GROWN_M = 0.02  # of the box about a remover: what is within it is taken, whether they touch or not
CAPACITY = 200  # marks of one kind that a remover takes; it is saturated then


@dataclass(frozen=True, eq=False)
class Marks:
    """What sits on a thing.

    Attributes:
        points: (n, 3) places of the marks in the thing's frame [m], by kind, such as "dust.n.01".
    """

    points: Mapping[str, Array] = field(default_factory=dict)

    def count(self, kind: str) -> int:
        """How many marks of a kind there are."""
        return len(self.points.get(kind, ()))

    def with_kind(self, kind: str, points: Array) -> Marks:
        """The same with other points (n, 3) of one kind."""
        return Marks({**self.points, kind: points})


def covered(marks: Marks, kind: str, grains: int = 0) -> bool:
    """Whether at least one mark of a kind is on a thing, or one of so many grains of it touches the thing."""
    return marks.count(kind) > 0 or grains > 0


@dataclass(frozen=True)
class Remover:
    """What takes marks off things, such as a brush.

    Attributes:
        solvents: Kinds that it takes, each with the solvents of which one has to be on it; empty: it takes it dry.
        half_m: Half sizes of the box about its bristles [m].
        taken: Marks by kind that it has taken already.
    """

    solvents: Mapping[str, Collection[str]]
    half_m: tuple[float, float, float]
    taken: Mapping[str, int] = field(default_factory=dict)

    def takes(self, kind: str, wet_with: Collection[str] = ()) -> bool:
        """Whether it takes marks of a kind now."""
        if kind not in self.solvents or self.taken.get(kind, 0) >= CAPACITY:
            return False
        return not self.solvents[kind] or bool(set(self.solvents[kind]) & set(wet_with))


def wiped(
    marks: Marks, remover: Remover, T_remover_thing: Array, wet_with: Collection[str] = ()
) -> tuple[Marks, Remover]:
    """What is left on a thing after a step beside a remover, and the remover then.

    Args:
        marks: On the thing.
        remover: Beside it.
        T_remover_thing: (4, 4) from the thing's frame to that of the remover's box.
        wet_with: Kinds that are on the remover.
    """
    half = np.array(remover.half_m) + GROWN_M
    for kind, points in marks.points.items():
        if not len(points) or not remover.takes(kind, wet_with):
            continue
        at = matmul(points, T_remover_thing[:3, :3].T) + T_remover_thing[:3, 3]
        within = np.flatnonzero((np.abs(at) <= half).all(1))[: CAPACITY - remover.taken.get(kind, 0)]
        if len(within):
            marks = marks.with_kind(kind, np.delete(points, within, axis=0))
            taken = {**remover.taken, kind: remover.taken.get(kind, 0) + len(within)}
            remover = replace(remover, taken=taken)
    return marks, remover
