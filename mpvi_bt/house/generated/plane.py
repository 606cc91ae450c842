"""Rectangles on the floor, and the four walls of one with coordinates along and away from each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Rect = tuple[float, float, float, float]  # x0, y0, x1, y1 [m]
Side = Literal["south", "east", "north", "west"]
SIDES: tuple[Side, ...] = ("south", "east", "north", "west")
_YAW_DEG = {"south": 90.0, "east": 180.0, "north": 270.0, "west": 0.0}
_HAIR_M = 1e-6


@dataclass(frozen=True)
class WallFrame:
    """One wall of a rectangle: u runs along it (east or north), v away from it into the rectangle [m].

    Attributes:
        rect: Of the room.
        side: Which wall.
    """

    rect: Rect
    side: Side

    @property
    def yaw_deg(self) -> float:
        """Where a thing faces that stands with its back to the wall: 0 east, 90 north."""
        return _YAW_DEG[self.side]

    @property
    def length_m(self) -> float:
        """Of the wall."""
        x0, y0, x1, y1 = self.rect
        return x1 - x0 if self.side in ("south", "north") else y1 - y0

    @property
    def depth_m(self) -> float:
        """To the opposite wall."""
        x0, y0, x1, y1 = self.rect
        return y1 - y0 if self.side in ("south", "north") else x1 - x0

    def point(self, u: float, v: float) -> tuple[float, float]:
        """x, y of a place."""
        x0, y0, x1, y1 = self.rect
        match self.side:
            case "south":
                return x0 + u, y0 + v
            case "north":
                return x0 + u, y1 - v
            case "west":
                return x0 + v, y0 + u
            case "east":
                return x1 - v, y0 + u

    def area(self, u0: float, u1: float, v0: float, v1: float) -> Rect:
        """The rectangle between two places."""
        (xa, ya), (xb, yb) = self.point(u0, v0), self.point(u1, v1)
        return min(xa, xb), min(ya, yb), max(xa, xb), max(ya, yb)


def overlap(a: Rect, b: Rect) -> bool:
    """Whether two rectangles have floor in common."""
    across = min(a[2], b[2]) - max(a[0], b[0])
    up = min(a[3], b[3]) - max(a[1], b[1])
    return across > _HAIR_M and up > _HAIR_M


def within(inner: Rect, outer: Rect) -> bool:
    """Whether a rectangle lies in another."""
    low = inner[0] >= outer[0] - _HAIR_M and inner[1] >= outer[1] - _HAIR_M
    return low and inner[2] <= outer[2] + _HAIR_M and inner[3] <= outer[3] + _HAIR_M


def grown(rect: Rect, by_m: float) -> Rect:
    """The rectangle with a margin around it; a negative one makes it smaller."""
    return rect[0] - by_m, rect[1] - by_m, rect[2] + by_m, rect[3] + by_m


def shared_edge(a: Rect, b: Rect) -> tuple[Side, float, float, float] | None:
    """The wall of `a` that is one of `b` too: its side, its level, and between which places along it [m]."""
    for side, one, two, low, high in (
        ("west", a[0], b[2], max(a[1], b[1]), min(a[3], b[3])),
        ("east", a[2], b[0], max(a[1], b[1]), min(a[3], b[3])),
        ("south", a[1], b[3], max(a[0], b[0]), min(a[2], b[2])),
        ("north", a[3], b[1], max(a[0], b[0]), min(a[2], b[2])),
    ):
        if abs(one - two) < _HAIR_M and high - low > _HAIR_M:
            return side, one, low, high  # type: ignore[return-value]
    return None
