"""Names of houses that no file has: "generated:7" is the one of seed 7."""

from __future__ import annotations

from mpvi_bt.ground.errors import UserError, shown

PREFIX = "generated:"
_MOST_DIGITS = 9


def seed_of(house: str) -> int | None:
    """The seed in a house's name; None: it is the name of a file.

    Raises:
        UserError: It begins like one, and has no seed.
    """
    if not house.startswith(PREFIX):
        return None
    digits = house.removeprefix(PREFIX)
    if not (digits.isascii() and digits.isdigit() and len(digits) <= _MOST_DIGITS):
        raise UserError(f"{shown(house)}: a house by its seed is written {PREFIX}7, with a whole number")
    return int(digits)
