"""A house by a seed: the text of its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.house.generated.doorways import DrawnDoor, doors, openings, outer_walls
from mpvi_bt.house.generated.furnished_rooms import FURNISH
from mpvi_bt.house.generated.house_kind import HouseKind, Row, load_kind
from mpvi_bt.house.generated.house_text import house_text
from mpvi_bt.house.generated.on_walls import hang_on_walls
from mpvi_bt.house.generated.partition import partition
from mpvi_bt.house.generated.placement import Furnishing, NoRoom, RoomFloor
from mpvi_bt.house.generated.plane import Rect
from mpvi_bt.house.generated.seeded_name import FAMILY
from mpvi_bt.house.generated.tints import Tints
from mpvi_bt.house.generated.walkable import out_of_reach
from mpvi_bt.house.things.catalogue import Catalogue, load_catalogue

_FLOORS = 400  # draws of a floor plan
_FURNISHINGS = 12  # draws of one room's furniture, before another floor plan is drawn


def generated_house(seed: int, rooms: Sequence[str] = (), kind: str = FAMILY) -> str:
    """The text of a house's file. The same arguments give the same text.

    Args:
        seed: Of everything that is drawn.
        rooms: Which rooms; all that the kind has if none are named.
        kind: Name or file of a kind of house.

    Raises:
        UserError: As of `load_kind` and `HouseKind.chosen`.
        BackendError: No draw would do.
    """
    known = load_kind(kind)
    return _generated(seed, known.chosen(rooms), kind, known.model_dump_json())


@lru_cache(maxsize=64)  # more than most suites have; a text has 20 kB
def _generated(seed: int, rooms: Row, name: str, text: str) -> str:
    kind = HouseKind.model_validate_json(text)
    rng = np.random.default_rng([seed, 0])
    catalogue = load_catalogue()
    for _ in range(_FLOORS):
        floor = partition(rooms, kind, rng)
        drawn = None if floor is None else doors(floor, rng)
        if floor is None or drawn is None:
            continue
        tints = Tints(rng)
        pieces = _furnished(floor, drawn, tints, catalogue, rng)
        for room, size in kind.rooms.items():
            if pieces is not None and room in pieces:
                pieces[room] = [piece for piece in pieces[room] if piece.entry not in size.without]
        if pieces is not None:
            like = "" if name == FAMILY else f" --like {name}"
            about = f"Drawn by `mpvi new house --seed {seed}{like}`: x runs east, y north, meters."
            return house_text(about, floor, drawn, pieces, tints)
    raise BackendError(f"no house of the kind {name} could be drawn with seed {seed}")


def _furnished(
    floor: Mapping[str, Rect], drawn: list[DrawnDoor], tints: Tints, catalogue: Catalogue, rng: np.random.Generator
) -> dict[str, list[Furnishing]] | None:
    """What stands in each room; None: one of them could not be furnished so that a robot gets to all."""
    pieces: dict[str, list[Furnishing]] = {}
    for name in (name for name in FURNISH if name in floor):
        rect = floor[name]
        for _ in range(_FURNISHINGS):
            room = RoomFloor(name, rect, openings(name, floor, drawn), outer_walls(name, floor), catalogue, rng)
            try:
                FURNISH[name](room, tints)
            except NoRoom:
                continue
            if not out_of_reach(room):
                hang_on_walls(room, tints)
                pieces[name] = room.pieces
                break
        else:
            return None
    return pieces
