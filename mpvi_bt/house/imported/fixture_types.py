"""What the things of ProcTHOR are here: its type of a thing to an entry of the catalogue."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class FixtureType:
    """An entry of the catalogue, as it is put up.

    Attributes:
        entry: Of the catalogue.
        front_m: How far the floor before it stays free, for who opens or uses it.
        shape: What is changed of its shape.
    """

    entry: str
    front_m: float = 0.0
    shape: Mapping[str, Any] = field(default_factory=dict)


# A type in small letters; of RoboTHOR's, the longest beginning, since names of models follow. Sizes: our choice.
TYPES: Mapping[str, FixtureType] = {
    "armchair": FixtureType("sofa", shape={"size_m": [0.85, 0.9, 0.82], "seats": 1}),
    "bed": FixtureType("bed"),
    "bookcase": FixtureType("bookcase", 0.7),
    "chair": FixtureType("chair"),
    "coffeetable": FixtureType("coffee_table"),
    "countertop": FixtureType("counter", 0.9),
    "desk": FixtureType("desk"),
    "diningtable": FixtureType("breakfast_table"),
    "dishwasher": FixtureType("dishwasher", 0.9),
    "dresser": FixtureType("chest_of_drawers", 0.9),
    "floorlamp": FixtureType("floor_lamp"),
    "fridge": FixtureType("refrigerator", 0.9),
    "houseplant": FixtureType("houseplant"),
    "officechair": FixtureType("swivel_chair"),
    "shelvingunit": FixtureType("shelf", 0.7),
    "sidetable": FixtureType("nightstand"),
    "sofa": FixtureType("sofa"),
    "toilet": FixtureType("toilet", 0.5),
    "tvstand": FixtureType("table", shape={"size_m": [0.45, 1.2, 0.5]}),
    "washingmachine": FixtureType("washer", 0.9),
}
SINK = {True: FixtureType("kitchen_sink", 0.9), False: FixtureType("bathroom_sink", 0.9)}  # in a kitchen, or not
PICTURE, WINDOW = "picture", "window"


def type_of(identity: str) -> str:
    """The type in the name of a thing: "Dining_Table_12_1|4|3" is "Dining_Table"."""
    return re.sub(r"[_\d]+$", "", identity.split("|")[0]) or identity[:40]


def fixture_type(named: str, room: str) -> FixtureType | None:
    """What a type is here, in a room of that type; None: nothing."""
    letters = _letters(named)
    if letters == "sink":
        return SINK[room == "Kitchen"]
    if letters.startswith(("countertop", "robothor")):  # its form, or its model, follows
        letters = letters.removeprefix("robothor")
        known = (name for name in sorted(TYPES, key=len, reverse=True) if letters.startswith(name))
        return TYPES.get(next(known, ""))
    return TYPES.get(letters)


def is_picture(named: str) -> bool:
    """Whether a thing of that type hangs on a wall and is looked at."""
    return _letters(named).startswith(("walldecor", "painting"))


def _letters(named: str) -> str:
    return re.sub(r"[^a-z]", "", named.lower())
