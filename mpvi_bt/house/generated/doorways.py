"""Doorways of a generated house: between which rooms, where in the wall, how wide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mpvi_bt.house.generated.adjacency import WISHES, Pair, unreached
from mpvi_bt.house.generated.placement import WALL_M, WallOpening
from mpvi_bt.house.generated.plane import SIDES, Rect, Side, WallFrame, shared_edge

_OPPOSITE: dict[Side, Side] = {"south": "north", "north": "south", "east": "west", "west": "east"}
_JAMB_M = 0.35  # from a doorway's edge to the end of the wall, at the least; our choice
_NEAR_END = 0.7  # share of doorways near an end of the wall, which leaves it to furniture; our choice


@dataclass(frozen=True)
class DrawnDoor:
    """A doorway between two rooms.

    Attributes:
        between: The two.
        at: x, y of its middle [m].
        width_m: Clear width.
        side: Wall of the first room that it is in.
    """

    between: tuple[str, str]
    at: tuple[float, float]
    width_m: float
    side: Side


def doors(floor: Mapping[str, Rect], rng: np.random.Generator) -> list[DrawnDoor] | None:
    """A door wherever people expect one; None: some room would have none, or the garden too many."""
    drawn: dict[Pair, DrawnDoor] = {}
    for pair, wish in WISHES.items():
        a, b = sorted(pair)
        if not pair <= floor.keys() or (edge := shared_edge(floor[a], floor[b])) is None:
            continue
        if rng.random() > wish.chance or (_entered(drawn) and pair - {"garage"} == pair and "garden" in pair):
            continue
        side, level, low, high = edge
        width = round(round(float(rng.uniform(*wish.width_m)) / 0.05) * 0.05, 2)
        if width + 2 * _JAMB_M > high - low:
            continue
        along = _along(low, high, width, rng)
        at = (along, level) if side in ("south", "north") else (level, along)
        drawn[pair] = DrawnDoor((a, b), at, width, side)
    if unreached(floor, drawn):
        return None
    return list(drawn.values())


def _entered(drawn: Mapping[Pair, DrawnDoor]) -> bool:
    """Whether the garden has a door of the rooms by day already."""
    return any("garden" in pair and "garage" not in pair for pair in drawn)


def _along(low: float, high: float, width: float, rng: np.random.Generator) -> float:
    """Where along a wall a doorway has its middle."""
    first, last = low + width / 2 + _JAMB_M, high - width / 2 - _JAMB_M
    end = first if rng.random() < 0.5 else last
    along = end if rng.random() < _NEAR_END else first + float(rng.random()) * (last - first)
    return round(min(max(round(along / 0.05) * 0.05, low + width / 2 + WALL_M), high - width / 2 - WALL_M), 3)


def openings(room: str, floor: Mapping[str, Rect], drawn: list[DrawnDoor]) -> list[WallOpening]:
    """The doorways of one room, each by its own wall."""
    found = []
    for door in drawn:
        if room not in door.between:
            continue
        side = door.side if room == door.between[0] else _OPPOSITE[door.side]
        x0, y0, _, _ = floor[room]
        along = door.at[0] - x0 if side in ("south", "north") else door.at[1] - y0
        found.append(WallOpening(side, along, door.width_m))
    return found


def outer_walls(room: str, floor: Mapping[str, Rect]) -> list[tuple[Side, float, float]]:
    """Stretches of a room's walls that no other room has too, the garden apart: side, and between which places [m]."""
    stretches: list[tuple[Side, float, float]] = []
    for side in SIDES:
        x0, y0, _, _ = floor[room]
        start = x0 if side in ("south", "north") else y0
        spans = [(0.0, WallFrame(floor[room], side).length_m)]
        for other, rect in floor.items():
            edge = shared_edge(floor[room], rect) if other not in (room, "garden") else None
            if edge is not None and edge[0] == side:
                low, high = edge[2] - start, edge[3] - start
                parts = [part for a, b in spans for part in ((a, min(b, low)), (max(a, high), b))]
                spans = [(a, b) for a, b in parts if b - a > 1e-6]
        stretches += [(side, a, b) for a, b in spans]
    return stretches
