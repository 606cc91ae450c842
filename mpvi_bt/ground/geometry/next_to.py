"""Geometry of "next to": rays from a thing's middle to its neighbor (BEHAVIOR's definition)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpvi_bt.ground.geometry.rays import crosses
from mpvi_bt.ground.geometry.solids import Array, Solid

RAY_M = 5.0  # length of a ray
NEXT_TO_GAP = 1 / 6  # of the two sizes' sum, averaged over the axes
NEXT_TO_PLANES = 5  # horizontal coordinate frames, turned from 0 to 90 degrees


def beside(middle: Array, solids: Sequence[Solid]) -> bool:
    """Whether a horizontal ray from a thing's middle (3,) meets the solids of another one."""
    for turn in np.linspace(0.0, np.pi / 2, NEXT_TO_PLANES):
        c, s = np.cos(turn), np.sin(turn)
        for x, y in ((c, s), (-c, -s), (-s, c), (s, -c)):
            if crosses(solids, middle, np.array([x, y, 0.0]), RAY_M):
                return True
    return False
