"""Sizes of mistakes, as an address gives them: "miss=0.1,jitter=2". Detectors and checkers read them alike."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mpvi_bt.errors import UnknownName, UserError, shown


def read_sizes(address: str, most: Mapping[str, float], where: str, example: str) -> dict[str, float]:
    """Name to size of each that an address names.

    Args:
        address: Such as "miss=0.1,jitter=2"; "" names none.
        most: The names that there are, and the largest size of each; the least is 0.
        where: Whose address it is, for messages, such as "detector segmentation".
        example: An address as it should be, likewise.

    Raises:
        UnknownName: There is no such mistake.
        UserError: It is not written so, a size is out of range, or given twice.
    """
    sizes: dict[str, float] = {}
    for part in address.split(",") if address else []:
        name, equals, text = (side.strip() for side in part.partition("="))
        if not equals:
            raise UserError(f"{where}: {shown(part)} is not NAME=SIZE, such as {example}.")
        if name not in most:
            raise UnknownName("mistake", name, most, where)
        if name in sizes:
            raise UserError(f"{where}: {name} is given twice.")
        try:
            size = float(text)
        except ValueError:
            raise UserError(f"{where}: {name}={text[:40]} is no number.") from None
        if not (math.isfinite(size) and 0 <= size <= most[name]):
            raise UserError(f"{where}: {name} is 0 to {most[name]:g}, not {text[:40]}.")
        sizes[name] = size
    return sizes
