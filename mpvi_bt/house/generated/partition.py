"""The floor of a generated house, cut into rooms: two rows of rooms, with a corridor between them and a garden outside.

A corridor between two rows is what subdivisions of rectangles come to as well (Marson and Musse, "Automatic real-time
generation of floor plans based on squarified treemaps algorithm", 2010). Rows need not end together, the living room
may close the corridor, and the whole is mirrored and turned.
"""

from __future__ import annotations

import numpy as np

from mpvi_bt.house.generated.house_kind import GardenSize, HouseKind, RoomSize, Row
from mpvi_bt.house.generated.plane import Rect

# All our choice.
DAY_DEPTH_M = (4.7, 5.6)
NIGHT_DEPTH_M = (3.9, 4.7)
_CLOSES_CORRIDOR = 0.35  # share of houses whose living room does
_UTILITY_BY_DAY = 0.4  # share of houses whose utility room is beside the kitchen
_LIVING_FIRST = 0.25  # share of houses whose living room is where the rows begin
_GARDEN_AT_END = 0.6  # share of gardens that lie at an end of the rows, not along one
_LAST_DOOR_M = 1.5  # of the corridor before the last room of a row, for its door
_STEP_M = 0.1  # to which lengths are rounded


def partition(rooms: Row, kind: HouseKind, rng: np.random.Generator) -> dict[str, Rect] | None:
    """Rooms of a house of some kind, and their rectangles; None: this draw came to nothing."""
    day, night = _rows(rooms, kind, rng)
    corridor_m = _rounded(rng.uniform(*kind.corridor_m)) if "corridor" in rooms else 0.0
    day_m, night_m = _rounded(rng.uniform(*DAY_DEPTH_M)), _rounded(rng.uniform(*NIGHT_DEPTH_M))
    closes = corridor_m > 0 and day[-1] == "living_room" and rng.random() < _CLOSES_CORRIDOR
    floor: dict[str, Rect] = {}
    x = 0.0
    ends: dict[str, float] = {}
    for name in day:
        depth = day_m + corridor_m if closes and name == "living_room" else day_m
        width = _width(kind.rooms[name], depth, rng)
        floor[name] = (x, 0.0, _rounded(x + width), depth)
        ends[name] = x
        x = _rounded(x + width)
    day_end = ends["living_room"] if closes else x
    x = 0.0
    for name in night:
        width = _width(kind.rooms[name], night_m, rng)
        floor[name] = (x, day_m + corridor_m, _rounded(x + width), day_m + corridor_m + night_m)
        ends[name] = x
        x = _rounded(x + width)
    if corridor_m:
        last = _rounded(max(ends[row[-1]] for row in (day, night) if row) + _LAST_DOOR_M)
        length = day_end if closes else max(last, min(day_end, x or day_end))
        if closes and last > day_end + 1e-9:
            return None
        floor["corridor"] = (0.0, day_m, length, _rounded(day_m + corridor_m))
    if "garden" in rooms and kind.garden is not None:
        floor["garden"] = _garden(floor, kind.garden, rng)
    return _turned({name: floor[name] for name in rooms}, rng)


def _rows(rooms: Row, kind: HouseKind, rng: np.random.Generator) -> tuple[list[str], list[str]]:
    """The order of the rooms by day, and of those by night and of work."""
    orders = list(dict.fromkeys(tuple(name for name in order if name in rooms) for order in kind.day))
    by_day = list(orders[int(rng.integers(len(orders))) if len(orders) > 1 else 0])
    if rng.random() < _LIVING_FIRST:
        by_day.reverse()
    sleeping = [name for name in kind.night if name in rooms and name not in ("utility_room", "garage")]
    rng.shuffle(sleeping)
    working = [name for name in ("garage", "utility_room") if name in rooms]
    if "utility_room" in working and by_day[0] == "kitchen" and rng.random() < _UTILITY_BY_DAY:
        working.remove("utility_room")
        by_day = ["utility_room", *by_day]
    return by_day, [*working, *sleeping]


def _width(size: RoomSize, depth: float, rng: np.random.Generator) -> float:
    return _rounded(max(float(rng.uniform(*size.area_m2)) / depth, size.shorter_m))


def _garden(floor: dict[str, Rect], size: GardenSize, rng: np.random.Generator) -> Rect:
    """At the end where the rows begin, or along the rooms by day."""
    depth, length = (_rounded(rng.uniform(*bounds)) for bounds in (size.deep_m, size.long_m))
    if rng.random() < _GARDEN_AT_END:
        high = max(rect[3] for rect in floor.values())
        return -depth, 0.0, 0.0, max(high, length)
    return 0.0, -depth, length, 0.0


def _turned(floor: dict[str, Rect], rng: np.random.Generator) -> dict[str, Rect]:
    """Mirrored along x and y, and turned, by chance; the lowest corner comes to (0, 0)."""
    flip_x, flip_y, turn = rng.random(3) < 0.5
    for name, (x0, y0, x1, y1) in floor.items():
        x0, x1 = (-x1, -x0) if flip_x else (x0, x1)
        y0, y1 = (-y1, -y0) if flip_y else (y0, y1)
        floor[name] = (y0, x0, y1, x1) if turn else (x0, y0, x1, y1)
    low_x, low_y = (min(rect[k] for rect in floor.values()) for k in (0, 1))
    return {
        name: (_rounded(x0 - low_x), _rounded(y0 - low_y), _rounded(x1 - low_x), _rounded(y1 - low_y))
        for name, (x0, y0, x1, y1) in floor.items()
    }


def _rounded(length: float) -> float:
    return round(round(length / _STEP_M) * _STEP_M, 3)
