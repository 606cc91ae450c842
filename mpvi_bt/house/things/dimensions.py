"""Types of the numbers in house and catalogue files."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from mpvi_bt.ground.errors import shown

_HEX = re.compile(r"#[0-9a-fA-F]{6}")


def _color(value: Any) -> Any:
    if isinstance(value, str):
        if not _HEX.fullmatch(value):
            raise ValueError(f"a color is written like '#d8c9a8' (red, green, blue), not {shown(value)}")
        return tuple(int(value[i : i + 2], 16) / 255 for i in (1, 3, 5))
    if isinstance(value, tuple):
        return value
    raise ValueError(f"a color is written like '#d8c9a8' (red, green, blue), not {shown(value)}")


Length = Annotated[float, Field(gt=0, le=30)]  # m
Size = tuple[Length, Length, Length]  # along x (front to back), y (across) and z (up), m
Rgb = Annotated[tuple[float, float, float], BeforeValidator(_color)]
Count = Annotated[int, Field(ge=1, le=12)]
