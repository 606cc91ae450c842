"""Percentiles are those of numpy, to the last bit: what is fitted to pictures hangs on comparisons."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.geometry.percentiles import percentile

ASKED = (1, 60, 99.5, [0.5, 99.5], [2, 98], [0, 50, 100], [15, 85])


@pytest.mark.parametrize("count", [1, 2, 3, 5, 33, 100, 101, 1000])
def test_they_are_numpys(count: int) -> None:
    """Of values, of points, of whole numbers and of many alike, for one percent and for several."""
    rng = np.random.default_rng(count)
    values = (
        rng.normal(size=count),
        rng.normal(size=(count, 3)),
        rng.integers(0, 9, count).astype(float),
        rng.random(count).round(1),
    )
    for of in values:
        for percents in ASKED:
            wanted = np.percentile(of, percents, axis=0)
            assert np.shape(percentile(of, percents)) == wanted.shape
            assert np.array_equal(percentile(of, percents), wanted)
