"""The rooms that a generated house may have, and how large each is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.errors import UnknownName, UserError

Row = tuple[str, ...]


@dataclass(frozen=True)
class RoomSize:
    """Bounds of one kind of room.

    Attributes:
        area_m2: Between which its area is drawn.
        least_m: Its shorter side at the least.
    """

    area_m2: tuple[float, float]
    least_m: float


# The Nationally described space standard (UK, 2015) asks for 7.5 m2 and 2.15 m in a single bedroom, 11.5 m2 and 2.75 m
# in a double one. These are larger, and so are the other rooms: a robot turns before each fixture in a circle of
# 1.525 m, as a wheelchair does (ADA Standards, 2010, 304.3). Our choice.
SIZES = {
    "kitchen": RoomSize((23.0, 29.0), 4.3),
    "dining_room": RoomSize((15.5, 19.0), 3.3),
    "living_room": RoomSize((31.0, 40.0), 4.9),
    "bathroom": RoomSize((9.5, 12.0), 2.35),
    "bedroom": RoomSize((15.5, 19.0), 3.6),
    "childs_room": RoomSize((13.5, 17.0), 3.3),
    "utility_room": RoomSize((9.8, 12.5), 2.45),
    "garage": RoomSize((24.0, 28.0), 5.4),
}
CORRIDOR_M = (1.7, 2.1)  # wide: two robots' widths and a hallstand
GARDEN_M = ((6.3, 7.2), (10.0, 11.8))  # depth from the house, and length along it
DAY: Row = ("kitchen", "dining_room", "living_room")
NIGHT: Row = ("bathroom", "bedroom", "childs_room", "utility_room", "garage")
ROOMS: Row = (*DAY, "corridor", *NIGHT, "garden")
FEWEST = 2


def checked_rooms(names: Sequence[str]) -> Row:
    """The rooms of a house, in our order; all if none are named.

    Raises:
        UnknownName: One cannot be generated.
        UserError: They are too few, or nothing leads from one to the others.
    """
    for name in names:
        if name not in ROOMS:
            raise UnknownName("room", name, ROOMS)
    rooms = tuple(name for name in ROOMS if name in names) or ROOMS
    if len(rooms) < FEWEST:
        raise UserError(f"a generated house has {FEWEST} rooms at least")
    if "corridor" not in rooms and any(room in NIGHT for room in rooms):
        night = ", ".join(room for room in rooms if room in NIGHT)
        raise UserError(f"a house with {night} needs a corridor")
    if not any(room in DAY for room in rooms):
        raise UserError(f"a generated house needs one of these rooms: {', '.join(DAY)}")
    return rooms


def drawn_area(room: str, rng: np.random.Generator) -> float:
    """The area [m2] of a room."""
    return float(rng.uniform(*SIZES[room].area_m2))
