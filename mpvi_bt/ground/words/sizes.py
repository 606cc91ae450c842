"""Mistakes with sizes, as an address gives them: "miss=0.1,jitter=2". Detectors and checkers read them alike."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import ClassVar, Self

from mpvi_bt.ground.errors import UnknownName, UserError, shown


@dataclass(frozen=True)
class Mistakes:
    """Sizes of mistakes, each a field; 0 switches one off.

    Attributes:
        MOST: The largest size of each.
        EXAMPLE: An address as it should be.
    """

    MOST: ClassVar[Mapping[str, float]]
    EXAMPLE: ClassVar[str]

    @classmethod
    def read(cls, address: str, where: str) -> Self:
        """Sizes from an address such as `EXAMPLE`; those not named are off.

        Args:
            address: Of a detector or a checker.
            where: Whose it is, for messages, such as "detector segmentation".

        Raises:
            UnknownName: There is no such mistake.
            UserError: It is not written so, a size is out of range, or given twice.
        """
        sizes: dict[str, float] = {}
        for part in address.split(",") if address else []:
            name, equals, text = (side.strip() for side in part.partition("="))
            if not equals:
                raise UserError(f"{where}: {shown(part)} is not NAME=SIZE, such as {cls.EXAMPLE}.")
            if name not in cls.MOST:
                raise UnknownName("mistake", name, cls.MOST, where)
            if name in sizes:
                raise UserError(f"{where}: {name} is given twice.")
            try:
                size = float(text)
            except ValueError:
                raise UserError(f"{where}: {name}={text[:40]} is no number.") from None
            if not (math.isfinite(size) and 0 <= size <= cls.MOST[name]):
                raise UserError(f"{where}: {name} is 0 to {cls.MOST[name]:g}, not {text[:40]}.")
            sizes[name] = size
        return cls(**sizes)

    @property
    def address(self) -> str:
        """As `read` takes it, what is off left out."""
        sizes = {field.name: getattr(self, field.name) for field in fields(self)}
        return ",".join(f"{name}={size:g}" for name, size in sizes.items() if size)
