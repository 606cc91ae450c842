"""Grains: diced food, popcorn or the like, many small bodies that vessels hold.

Source: OmniGibson, object_states/contains.py and filled.py.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mpvi_bt.ground.geometry.solids import Solid

FILLED = 0.2  # of a vessel's volume


def contains(grains: int) -> bool:
    """Whether a vessel holds any of a kind: one of so many grains is enough."""
    return grains > 0


def filled(grains_m3: float, volume_m3: float) -> bool:
    """Whether a vessel of a volume is filled with a kind; each grain counts as the cube about it."""
    return grains_m3 > FILLED * volume_m3


def space_m3(solids: Iterable[Solid]) -> float:
    """What solids take up [m^3], such as those of a grain or the volumes of a vessel; a sphere as the cube about it."""
    return sum(float(np.prod(2 * s.half_m)) * (np.pi / 4 if s.kind == "cylinder" else 1.0) for s in solids)
