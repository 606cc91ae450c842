"""The temperature of a thing, and what heat does to its kind. Source of the numbers: OmniGibson, as of `heat.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from mpvi_bt.ground.marked_yaml import Record

ROOM_C = 23.0
FREEZES_C, HEATED_C = 0.0, 40.0  # of what says nothing else


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
