"""Temperature: sources warm and cool a thing, the room draws it back, and what it once came to is kept.

A thing's temperature T follows dT/dt = DECAY (ROOM - T) + sum over sources of rate (source - T). So a thing never quite
comes to the temperature of its source: in a fridge of -18 degrees to -11.2, in a microwave of 100 to 87.2.

Source of all numbers: OmniGibson, object_states/temperature.py, heat_source_or_sink.py, cooked.py and the like.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from pydantic import Field

from mpvi_bt.ground.marked_yaml import Record

ROOM_C = 23.0
DECAY_PER_S = 0.02
FREEZES_C, HEATED_C, COOKED_C = 0.0, 40.0, 70.0  # of what says nothing else
APPLIANCE_PER_S, OPEN_PER_S = 0.1, 0.04  # rates: of what things are shut in; of fire, and where nothing is said
REACH_M = 0.2  # from what is not shut in, to the nearest point of the box about a thing

Placing = Literal["inside", "near"]


class Thermal(Record):
    """What heat does to a kind of thing.

    Attributes:
        cooked_c: It is cooked once it was so hot; None: it cannot be.
        heated_c: It is hot now.
        freezes_c: It is frozen now, if it is as cold.
        ignites_c: It is on fire from then on; None: it does not burn.
    """

    cooked_c: Annotated[float, Field(ge=30, le=400)] | None = None
    heated_c: Annotated[float, Field(ge=24, le=200)] = HEATED_C
    freezes_c: Annotated[float, Field(ge=-100, le=20)] = FREEZES_C
    ignites_c: Annotated[float, Field(ge=100, le=1000)] | None = None


@dataclass(frozen=True)
class Heat:
    """A thing's temperature.

    Attributes:
        now_c: Now.
        highest_c: That it ever had.
        on_fire: Whether it burns.
    """

    now_c: float = ROOM_C
    highest_c: float = ROOM_C
    on_fire: bool = False


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


def warmed(heat: Heat, sources: Iterable[Source], dt_s: float) -> Heat:
    """The temperature a step later: sources add up, and the room always draws it back; what burns stays as it is."""
    if heat.on_fire:
        return heat
    change = DECAY_PER_S * (ROOM_C - heat.now_c) + sum(s.per_s * (s.at_c - heat.now_c) for s in sources)
    now = heat.now_c + change * dt_s
    return replace(heat, now_c=now, highest_c=max(heat.highest_c, now))


def settles_at(sources: Iterable[Source]) -> float:
    """What a thing comes to that stays with sources for long [degrees]."""
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
