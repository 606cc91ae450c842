"""Names of houses that no file has: "generated:7" is the one of seed 7, "generated:flat:7" a flat."""

from __future__ import annotations

import re
from dataclasses import dataclass

from mpvi_bt.ground.errors import UserError, shown

PREFIX = "generated:"
FAMILY = "family"  # the kind of house where none is named
SEEDED = r"generated:([A-Za-z0-9][A-Za-z0-9_\-]*:)?[0-9]{1,9}"
_SEEDED = re.compile(SEEDED)


@dataclass(frozen=True)
class SeededName:
    """What a house is drawn by.

    Attributes:
        seed: Of everything that is drawn.
        kind: Name of a kind of house.
    """

    seed: int
    kind: str = FAMILY


def seeded(house: str) -> SeededName | None:
    """Kind and seed in a house's name; None: it is the name of a file.

    Raises:
        UserError: It begins like one, and has no seed.
    """
    if not house.startswith(PREFIX):
        return None
    if not house.isascii() or not _SEEDED.fullmatch(house):
        raise UserError(f"{shown(house)}: a house by its seed is written {PREFIX}7 or {PREFIX}flat:7")
    kind, _, digits = house.removeprefix(PREFIX).rpartition(":")
    return SeededName(int(digits), kind or FAMILY)
