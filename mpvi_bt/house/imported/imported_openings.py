"""Doorways between the rectangles of an imported floor, from doors and walls that are not built."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from mpvi_bt.house.generated.doorways import DrawnDoor
from mpvi_bt.house.generated.placement import WALL_M
from mpvi_bt.house.generated.plane import Rect, Side, shared_edge

NARROWEST_M, WIDEST_M = 0.9, 6.0  # a doorway of a house's file
_OFF_M = 0.05  # a door so far from a wall is in it

Point = tuple[float, float]


@dataclass(frozen=True)
class Hole:
    """An opening of the original house.

    Attributes:
        rooms: Ids of the two rooms.
        ends: x, y of both of its ends [m].
    """

    rooms: tuple[str, str]
    ends: tuple[Point, Point]


class Openings:
    """Doorways, more with each call; those that have no room are told.

    Args:
        parts: The rectangles of each room, by the names that they get.
        room_of: The original room of each.
    """

    def __init__(self, parts: Mapping[str, Rect], room_of: Mapping[str, str]) -> None:
        self._parts, self._room_of = parts, room_of
        self.doors: list[DrawnDoor] = []
        self.said: list[str] = []

    def join_parts(self) -> None:
        """An opening as wide as possible wherever two rectangles of one room meet."""
        for a, b in combinations(self._parts, 2):
            if self._room_of[a] == self._room_of[b] and (edge := shared_edge(self._parts[a], self._parts[b])):
                self._open((a, b), edge)

    def add_open_wall(self, hole: Hole) -> None:
        """What there is of a wall that is not built."""
        for pair, (side, level, low, high) in self._edges(hole):
            along = sorted(end[_axis(side)] for end in hole.ends)
            self._open(pair, (side, level, max(low, along[0]), min(high, along[1])))

    def add_door(self, hole: Hole, names: str) -> None:
        """A door, in the wall of the two rectangles that have most of it."""
        best: tuple[float, tuple[str, str], Side, float, float, float] | None = None
        for pair, (side, level, low, high) in self._edges(hole):
            a, b = sorted(end[_axis(side)] for end in hole.ends)
            width = min(max(b - a, NARROWEST_M), WIDEST_M, high - low - 2 * WALL_M)
            if width < NARROWEST_M - 1e-9:
                continue
            middle = min(max((a + b) / 2, low + width / 2 + WALL_M), high - width / 2 - WALL_M)
            moved = abs(middle - (a + b) / 2) + abs(width - (b - a))
            if best is None or moved < best[0]:
                best = (moved, pair, side, level, middle, width)
        if best is None:
            self.said.append(f"the door between {names} has no wall of {NARROWEST_M:g} m here, and is left out")
            return
        moved, pair, side, level, middle, width = best
        if moved > _OFF_M:
            self.said.append(f"the door between {names} is moved or resized by {moved * 100:.0f} cm, to fit its wall")
        self._put(pair, side, level, middle, width)

    def cut_off(self) -> list[str]:
        """Rectangles that no way leads to from the first one."""
        reached = {next(iter(self._parts))}
        pairs = [set(door.between) for door in self.doors]
        while new := [pair for pair in pairs if pair & reached and pair - reached]:
            reached = reached.union(*new)
        return [name for name in self._parts if name not in reached]

    def _edges(self, hole: Hole) -> Iterator[tuple[tuple[str, str], tuple[Side, float, float, float]]]:
        """Walls between rectangles of the two rooms that an opening is in."""
        one, two = ([name for name, room in self._room_of.items() if room == given] for given in hole.rooms)
        for pair in ((a, b) for a in one for b in two):
            edge = shared_edge(self._parts[pair[0]], self._parts[pair[1]])
            if edge is None:
                continue
            across = 1 - _axis(edge[0])
            if all(abs(end[across] - edge[1]) < _OFF_M for end in hole.ends):
                along = sorted(end[1 - across] for end in hole.ends)
                if min(along[1], edge[3]) - max(along[0], edge[2]) > _OFF_M:
                    yield pair, edge

    def _open(self, pair: tuple[str, str], edge: tuple[Side, float, float, float]) -> None:
        side, level, low, high = edge
        width = min(high - low - 2 * WALL_M, WIDEST_M)
        if width >= NARROWEST_M:
            self._put(pair, side, level, (low + high) / 2, width)

    def _put(self, pair: tuple[str, str], side: Side, level: float, middle: float, width: float) -> None:
        at = (middle, level) if side in ("south", "north") else (level, middle)
        width = int(width * 100) / 100
        for other in self.doors:
            if set(other.between) == set(pair):  # they have one wall in common
                axis = _axis(side)
                if abs(other.at[axis] - middle) < (other.width_m + width) / 2:
                    return
        self.doors.append(DrawnDoor(pair, (round(at[0], 3), round(at[1], 3)), width, side))


def _axis(side: Side) -> int:
    """The coordinate along a wall: 0 for x, 1 for y."""
    return 0 if side in ("south", "north") else 1


def rounded(corners: Sequence[Point]) -> list[Point]:
    """Corners to the centimeter, so that walls that meet have the same place."""
    return [(round(x, 2), round(y, 2)) for x, y in corners]
