"""Percentiles as `numpy.percentile` has them, to the last bit, at a fraction of the cost for a few hundred values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mpvi_bt.ground.geometry.solids import Array


def percentile(values: Array, percents: Sequence[float] | float) -> Any:
    """Percentiles along the first axis of values (n, ...), of which there is at least one.

    Returns:
        For several percents (k, ...), for a single one (...).
    """
    last = len(values) - 1
    at = [percent / 100 * last for percent in ([percents] if isinstance(percents, int | float) else percents)]
    ends = [(int(x), min(int(x) + 1, last)) for x in at]
    ordered = np.partition(values, [k for pair in ends for k in pair], axis=0)
    found = [_between(ordered[i], ordered[j], x - i) for x, (i, j) in zip(at, ends, strict=True)]
    return found[0] if isinstance(percents, int | float) else np.array(found)


def _between(low: Any, high: Any, share: float) -> Any:
    """A share of the way from one value to the next, reckoned from the nearer one."""
    return low + (high - low) * share if share < 0.5 else high - (high - low) * (1 - share)
