"""Wiping: a remover, such as a brush, takes marks off what comes into the box about it.

Source: OmniGibson, object_states/particle_modifier.py (ParticleRemover).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.states.in_world import ThingLike
from mpvi_bt.house.states.marks import Marks
from mpvi_bt.house.states.world_state import WorldState

GROWN_M = 0.02  # of the box about a remover: what is within it is taken, whether they touch or not
CAPACITY = 200  # marks of one kind that a remover takes; it is saturated then


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


class Wiping:
    """What removers do to the marks of a world."""

    def __init__(self, things: Mapping[str, ThingLike], solvents: Mapping[str, Mapping[str, Collection[str]]]) -> None:
        """Nothing is wiped yet.

        Args:
            things: All that there are, by name.
            solvents: By the names of removers, as of `Remover`.
        """
        self._things = things
        self._removers: dict[str, Remover] = {}
        self._boxes: dict[str, Array] = {}
        for name, kinds in solvents.items():
            low, high = things[name].description.extent(visible=True)
            self._removers[name] = Remover(kinds, tuple(((high - low) / 2).tolist()))
            self._boxes[name] = kin.transform(np.eye(3), (low + high) / 2)

    def step(self, state: WorldState, marks: dict[str, Marks]) -> None:
        """One control step later."""
        for name, remover in self._removers.items() if marks else ():
            self._removers[name] = self._wipe(name, remover, marks)

    def _wipe(self, name: str, remover: Remover, marks: dict[str, Marks]) -> Remover:
        frame = kin.inverse(matmul(self._things[name].T_world_body(), self._boxes[name]))
        wet = [kind for kind, points in marks.get(name, Marks()).points.items() if len(points)]
        for marked, there in marks.items():
            if marked != name and any(remover.takes(kind, wet) for kind, points in there.points.items() if len(points)):
                T = matmul(frame, self._things[marked].T_world_body())
                marks[marked], remover = wiped(there, remover, T, wet)
        return remover

    def save(self) -> dict[str, Any]:
        """What each remover has taken, as JSON values."""
        return {"taken": {name: dict(remover.taken) for name, remover in self._removers.items() if remover.taken}}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Have every remover have taken what it had."""
        taken = saved.get("taken", {})
        self._removers = {n: replace(remover, taken=dict(taken.get(n, {}))) for n, remover in self._removers.items()}
