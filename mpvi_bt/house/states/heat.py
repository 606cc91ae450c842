"""Heat: sources warm and cool a thing, the room draws it back, fire spreads, and the highest temperature is kept.

A thing's temperature T follows dT/dt = DECAY (ROOM - T) + sum over sources of rate (source - T). So a thing never quite
comes to the temperature of its source: in a fridge of -18 degrees to -11.2, in a microwave of 100 to 87.2.

Source of all numbers: OmniGibson, object_states/temperature.py, heat_source_or_sink.py, cooked.py, on_fire.py and the
like.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Record
from mpvi_bt.house.states.relations import OPEN_FRACTION, inside
from mpvi_bt.house.states.temperature import ROOM_C, Heat, Thermal
from mpvi_bt.house.states.world_state import WorldState, aabb

DECAY_PER_S = 0.02
COOKED_C = 70.0  # of what says nothing else
APPLIANCE_PER_S, OPEN_PER_S = 0.1, 0.04  # rates: of what things are shut in; of fire, and where nothing is said
REACH_M = 0.2  # from what is not shut in, to the nearest point of the box about a thing
BURNS_C = 1000.0
_LOOKS_STEPS = 5  # control steps between two looks at what is where: nothing is carried into a fridge and out in 1/6 s

Placing = Literal["inside", "near"]


class Source(Record):
    """What warms or cools things.

    Attributes:
        at_c: Its temperature.
        per_s: How fast things come to it.
        placing: Whether things have to be "inside" of it, or "near" it.
        switched: It has to be on.
        shut: Its doors have to be closed.
    """

    at_c: Annotated[float, Field(ge=-100, le=2000)]
    per_s: Annotated[float, Field(gt=0, le=1)] = APPLIANCE_PER_S
    placing: Placing = "inside"
    switched: bool = False
    shut: bool = False

    def acts(self, *, on: bool = False, closed: bool = False, inside: bool = False, apart_m: float = 1e9) -> bool:
        """Whether it acts on a thing now.

        Args:
            on: Whether it is switched on.
            closed: Whether all of its doors are.
            inside: Whether the thing is in it.
            apart_m: From where its heat is to the nearest point of the box about the thing.
        """
        there = inside if self.placing == "inside" else apart_m <= REACH_M
        return there and (on or not self.switched) and (closed or not self.shut)


FIRE = Source(at_c=BURNS_C, per_s=OPEN_PER_S, placing="near")


def warmed(heat: Heat, sources: Iterable[Source], dt_s: float) -> Heat:
    """The temperature a step later: sources add up, and the room always draws it back; what burns stays as it is."""
    if heat.on_fire:
        return heat
    change = DECAY_PER_S * (ROOM_C - heat.now_c) + sum(s.per_s * (s.at_c - heat.now_c) for s in sources)
    now = heat.now_c + change * dt_s
    return replace(heat, now_c=now, highest_c=max(heat.highest_c, now))


def settles_at(sources: Iterable[Source]) -> float:
    """Final temperature of a thing that stays with sources for long [degrees]."""
    of = [(DECAY_PER_S, ROOM_C), *((s.per_s, s.at_c) for s in sources)]
    return sum(rate * at for rate, at in of) / sum(rate for rate, _ in of)


def cooked(heat: Heat, kind: Thermal) -> bool:
    """Whether it was ever hot enough: never undone."""
    return kind.cooked_c is not None and heat.highest_c >= kind.cooked_c


def frozen(heat: Heat, kind: Thermal) -> bool:
    """Whether it is cold enough now."""
    return heat.now_c <= kind.freezes_c


def heated(heat: Heat, kind: Thermal) -> bool:
    """Whether it is hot now."""
    return heat.now_c >= kind.heated_c


def ignited(heat: Heat, kind: Thermal) -> Heat:
    """Set on fire if it can burn and is hot enough; what burns stays at the temperature of fire."""
    if heat.on_fire or (kind.ignites_c is not None and heat.now_c >= kind.ignites_c):
        return Heat(BURNS_C, max(heat.highest_c, BURNS_C), on_fire=True)
    return heat


def spread(
    heats: Mapping[str, Heat],
    kinds: Mapping[str, Thermal],
    sources: Mapping[str, Sequence[Source]],
    near: Mapping[str, Sequence[str]],
    dt_s: float,
) -> dict[str, Heat]:
    """Temperatures of all things a step later. Burning things warm their neighbors; newly lit things burn next.

    Args:
        heats: Of each thing.
        kinds: Of each thing; one that is missing takes nothing from heat but its temperature.
        sources: That act on each thing now, without those that are on fire.
        near: Things within reach of each thing.
        dt_s: Of the step.
    """
    out: dict[str, Heat] = {}
    for name, heat in heats.items():
        fires = [FIRE for other in near.get(name, ()) if other != name and heats[other].on_fire]
        out[name] = ignited(warmed(heat, [*sources.get(name, ()), *fires], dt_s), kinds.get(name, Thermal()))
    return out


class Temperatures:
    """How warm the things of a world are.

    Only things whose catalogue entry says what heat does to them are followed: a world without them pays nothing.
    """

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
        """Heat of a thing, and the effects of heat on it. Things not followed stay at room temperature for ever."""
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
