"""Temperatures of the things in a world: which sources act on each, and what that makes of them, step by step.

Only things whose catalogue entry says what heat does to them are followed: a world without them pays nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.goals.predicates import OPEN_FRACTION, inside
from mpvi_bt.house.goals.world_state import WorldState, aabb
from mpvi_bt.house.rules.fire import spread
from mpvi_bt.house.rules.heat import REACH_M, Heat, Source, Thermal

_LOOKS_STEPS = 5  # control steps between two looks at what is where: nothing is carried into a fridge and out in 1/6 s


class Temperatures:
    """How warm things are."""

    def __init__(self, kinds: Mapping[str, Thermal], sources: Mapping[str, Source]) -> None:
        """Everything is as warm as the room.

        Args:
            kinds: What heat does to each thing that is followed.
            sources: Of each thing that warms or cools others.
        """
        self._kinds, self._sources = dict(kinds), dict(sources)
        self._heats = {name: Heat() for name in kinds}
        self._acting: dict[str, list[Source]] = {}
        self._near: dict[str, list[str]] = {}
        self._looked = 0

    def of(self, name: str) -> tuple[Heat, Thermal]:
        """How warm a thing is, and what heat does to it; what is not followed is as warm as the room for ever."""
        return self._heats.get(name, Heat()), self._kinds.get(name, Thermal())

    def acting(self, name: str) -> Sequence[Source]:
        """What warms or cools a thing now."""
        return self._acting.get(name, [])

    def step(self, state: WorldState, dt_s: float) -> None:
        """One control step later."""
        if not self._heats:
            return
        if self._looked <= 0:
            self._look(state)
            self._looked = _LOOKS_STEPS
        self._looked -= 1
        self._heats = spread(self._heats, self._kinds, self._acting, self._near, dt_s)

    def inherit(self, name: str, of: str) -> None:
        """Have a thing be as warm as what it comes of."""
        if name in self._heats and of in self._heats:
            self._heats[name] = self._heats[of]
        self._looked = 0

    def save(self) -> dict[str, Any]:
        """As JSON values; empty where nothing is followed."""
        return {name: [heat.now_c, heat.highest_c, heat.on_fire] for name, heat in self._heats.items()}

    def restore(self, saved: Mapping[str, Sequence[Any]]) -> None:
        """Bring everything to how warm it was; what is not among it is as warm as the room."""
        self._heats = {name: Heat(*saved[name]) if name in saved else Heat() for name in self._kinds}
        self._looked = 0

    def _look(self, state: WorldState) -> None:
        boxes = {name: aabb(state, name) for name in self._heats if state.exists(name)}
        places = {by: aabb(state, by) for by in self._sources}
        self._acting = {
            name: [s for by, s in self._sources.items() if self._acts(state, by, places[by], name, box)]
            for name, box in boxes.items()
        }
        self._near = {
            name: [other for other in boxes if other != name and _apart(boxes[name], boxes[other].mean(0)) <= REACH_M]
            for name in boxes
        }

    def _acts(self, state: WorldState, by: str, place: Array, name: str, box: Array) -> bool:
        source = self._sources[by]
        if not (place[0] - REACH_M <= box[1]).all() or not (box[0] <= place[1] + REACH_M).all():
            return False
        closed = all(fraction <= OPEN_FRACTION for fraction in state.joint_fractions(by))
        heart = np.append(place.mean(0)[:2], place[1, 2])  # Our choice: what is not shut in works from its middle's top
        within = source.placing == "inside" and inside(state, name, by)
        return source.acts(on=state.toggled_on(by), closed=closed, inside=within, apart_m=_apart(box, heart))


def _apart(box: Array, place: Array) -> float:
    """From a place (3,) to the nearest point of a box (2, 3) [m]."""
    return float(norm(np.maximum(np.maximum(box[0] - place, place - box[1]), 0.0)))
