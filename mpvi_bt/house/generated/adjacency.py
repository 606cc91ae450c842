"""Which rooms of a generated house have a door between them, and how wide it is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

Pair = frozenset[str]


@dataclass(frozen=True)
class Wish:
    """A door that people expect between two rooms that share a wall.

    Attributes:
        chance: How often it is there.
        width_m: Between which its width is drawn. ADA Standards (2010, 404.2.3) ask for 0.815 m clear; a house's file
            for 0.9 m.
    """

    chance: float
    width_m: tuple[float, float]


_DOOR, _OPEN = (0.95, 1.1), (1.2, 1.5)
WISHES: Mapping[Pair, Wish] = {
    frozenset(pair): Wish(chance, width)
    for *pair, chance, width in (
        ("kitchen", "dining_room", 1.0, (1.1, 1.3)),
        ("kitchen", "living_room", 1.0, _OPEN),
        ("dining_room", "living_room", 0.8, _OPEN),
        ("corridor", "kitchen", 1.0, (1.0, 1.2)),
        ("corridor", "living_room", 1.0, (1.0, 1.2)),
        ("corridor", "dining_room", 0.4, _DOOR),
        ("corridor", "bathroom", 1.0, _DOOR),
        ("corridor", "bedroom", 1.0, _DOOR),
        ("corridor", "childs_room", 1.0, _DOOR),
        ("corridor", "utility_room", 1.0, _DOOR),
        ("corridor", "garage", 1.0, _DOOR),
        ("corridor", "meeting_room", 1.0, _DOOR),
        ("corridor", "shared_office", 1.0, _DOOR),
        ("corridor", "private_office", 1.0, _DOOR),
        ("utility_room", "garage", 0.4, _DOOR),
        ("garage", "garden", 1.0, (2.4, 2.6)),
        ("dining_room", "garden", 1.0, (1.1, 1.3)),
        ("living_room", "garden", 1.0, (1.1, 1.4)),
        ("kitchen", "garden", 0.3, _DOOR),
    )
}


def unreached(rooms: Collection[str], doors: Collection[Pair]) -> set[str]:
    """The rooms that no doors lead to from the first one."""
    reached = {next(iter(rooms))}
    while new := [pair for pair in doors if pair & reached and pair - reached]:
        reached = reached.union(*new)
    return set(rooms) - reached
