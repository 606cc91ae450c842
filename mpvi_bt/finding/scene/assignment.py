"""Assignment of the things in a picture to known things."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from mpvi_bt.ground.geometry.solids import Array

NEVER = 1e6  # a price that is never paid; above all others


def associated(misfits: Array) -> list[int | None]:
    """Assign seen things to known things, each to another one, with the least sum of misfits.

    Args:
        misfits: (n, m) how badly each seen thing fits each known one, 0 to 1; `NEVER`: it is another.

    Returns:
        The index of the known thing, None for one that is new, which counts as a misfit of 1.
    """
    seen, known = misfits.shape
    prices = np.full((seen, known + seen), NEVER)
    prices[:, :known] = misfits
    prices[np.arange(seen), known + np.arange(seen)] = 1.0
    return [int(k) if k < known else None for k in linear_sum_assignment(prices)[1]]
