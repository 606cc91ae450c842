"""Rooms and doorways, and the walls that follow from them.

Every room has its own wall panels inside its rectangle, so that each side of a wall has its room's color.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from mpvi_bt.ground.geometry.solids import Solid, box
from mpvi_bt.house.things.description import Color

PANEL_M = 0.05  # half a wall
HEDGE_M = 0.3

Rect = tuple[float, float, float, float]  # x0, y0, x1, y1 [m]
Edge = Literal["x", "y"]


@dataclass(frozen=True)
class Room:
    """A rectangle of floor.

    Attributes:
        name: Such as "living_room".
        rect: x0, y0, x1, y1 [m].
        phrases: What people call it.
        floor_color, wall_color: sRGB.
        outdoors: Open to the sky, with a hedge around it instead of walls.
    """

    name: str
    rect: Rect
    phrases: tuple[str, ...]
    floor_color: Color
    wall_color: Color
    outdoors: bool

    @property
    def floor(self) -> Solid:
        """Its floor: 10 cm thick, the top at z = 0."""
        x0, y0, x1, y1 = self.rect
        return box(((x0 + x1) / 2, (y0 + y1) / 2, -0.05), (x1 - x0, y1 - y0, 0.1))


@dataclass(frozen=True)
class Doorway:
    """An opening in the wall between two rooms.

    Attributes:
        rooms: The two.
        at: x, y of its middle [m].
        width_m: Clear width.
        wall: "x" if the wall runs along x, else "y".
    """

    rooms: tuple[str, str]
    at: tuple[float, float]
    width_m: float
    wall: Edge


@dataclass(frozen=True, eq=False)
class Wall:
    """A panel of a wall or hedge, seen from one room ("outside" for the house's shell)."""

    room: str
    solid: Solid
    color: Color


def shared_wall(a: Room, b: Room) -> tuple[Edge, float, float, float] | None:
    """Direction, level and interval of the edge that two rooms have in common."""
    ax0, ay0, ax1, ay1 = a.rect
    bx0, by0, bx1, by1 = b.rect
    for one, two in ((ax1, bx0), (ax0, bx1)):
        low, high = max(ay0, by0), min(ay1, by1)
        if abs(one - two) < 1e-6 and high - low > 1e-6:
            return "y", one, low, high
    for one, two in ((ay1, by0), (ay0, by1)):
        low, high = max(ax0, bx0), min(ax1, bx1)
        if abs(one - two) < 1e-6 and high - low > 1e-6:
            return "x", one, low, high
    return None


def walls(
    rooms: Iterable[Room], doorways: Iterable[Doorway], outside: Color, height_m: float, hedge_height_m: float
) -> Iterator[Wall]:
    """Every room's panels, the shell around the house, and the hedge around what is outdoors."""
    openings = [(d.wall, d.at[1] if d.wall == "x" else d.at[0], *_span(d)) for d in doorways]
    rooms = list(rooms)
    for room in rooms:
        x0, y0, x1, y1 = room.rect
        for wall, level, inward, low, high in (
            ("x", y0, 1, x0, x1), ("x", y1, -1, x0, x1), ("y", x0, 1, y0, y1), ("y", x1, -1, y0, y1),
        ):  # fmt: skip
            holes = [(a, b) for direction, at, a, b in openings if direction == wall and abs(at - level) < 1e-6]
            neighbors = [
                (other, span)
                for other in rooms
                if other is not room and (span := _touching(room, other, wall, level)) is not None
            ]
            trim = PANEL_M if wall == "y" else 0.0
            if room.outdoors:
                free = _without([(low, high)], [*holes, *(span for _, span in neighbors)])
                for a, b in free:
                    yield Wall(room.name, _panel(wall, level, inward, HEDGE_M, a, b, hedge_height_m), room.wall_color)
                continue
            for a, b in _without([(low + trim, high - trim)], holes):
                yield Wall(room.name, _panel(wall, level, inward, PANEL_M, a, b, height_m), room.wall_color)
            inside = [span for other, span in neighbors if not other.outdoors]
            for a, b in _without([(low, high)], [*holes, *inside]):
                yield Wall("outside", _panel(wall, level, -inward, PANEL_M, a, b, height_m), outside)


def _span(doorway: Doorway) -> tuple[float, float]:
    middle = doorway.at[0] if doorway.wall == "x" else doorway.at[1]
    return middle - doorway.width_m / 2, middle + doorway.width_m / 2


def _touching(room: Room, other: Room, wall: str, level: float) -> tuple[float, float] | None:
    """Interval of `room`'s edge at `level` that is `other`'s edge too."""
    shared = shared_wall(room, other)
    if shared is None or shared[0] != wall or abs(shared[1] - level) > 1e-6:
        return None
    return shared[2], shared[3]


def _without(spans: list[tuple[float, float]], holes: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The spans less the holes; slivers under 1 cm are dropped."""
    for a, b in holes:
        parts = (part for low, high in spans for part in ((low, min(high, a)), (max(low, b), high)))
        spans = [(low, high) for low, high in parts if high > low]
    return [(low, high) for low, high in spans if high - low > 0.01]


def _panel(wall: str, level: float, side: int, thick: float, low: float, high: float, height: float) -> Solid:
    """A panel on one side of an edge."""
    across, middle, length = level + side * thick / 2, (low + high) / 2, high - low
    if wall == "x":
        return box((middle, across, height / 2), (length, thick, height))
    return box((across, middle, height / 2), (thick, length, height))
