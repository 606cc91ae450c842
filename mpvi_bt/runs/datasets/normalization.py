"""What training normalizes a dataset by: of each number and each color channel, exact over all rows and pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.runs.datasets.parquet import Table

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}

Statistics = dict[str, NDArray[Any]]


def of_rows(tables: Sequence[Table]) -> dict[str, Statistics]:
    """Of each column, over the rows of all tables: min, max, mean, std, count and quantiles, each (size,)."""
    found = {}
    for key, first in tables[0].items():
        if first.size == 0:  # an entry that is there for its name alone
            continue
        columns = (
            np.concatenate([t[key].reshape(len(t[key]), -1)[:, i] for t in tables]) for i in range(_width(first))
        )
        each = [_of_numbers(column.astype(np.float64)) for column in columns]
        found[key] = {name: np.array([of[name] for of in each]) for name in each[0]}
        found[key]["count"] = np.array([sum(len(table[key]) for table in tables)])
    return found


def _width(column: NDArray[Any]) -> int:
    return column.shape[1] if column.ndim > 1 else 1


def _of_numbers(values: NDArray[np.float64]) -> dict[str, float]:
    quantiles = np.quantile(values, list(QUANTILES.values()))
    return {
        "min": values.min(),
        "max": values.max(),
        "mean": values.mean(),
        "std": values.std(),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }


def of_pictures(histograms: Sequence[NDArray[np.int64]], pictures: int) -> Statistics:
    """The same of pictures: over all their pixels, by channel (3, 1, 1), black 0 to white 1.

    Args:
        histograms: (3, 256) how often each channel has each value, of each video.
        pictures: How many there are.
    """
    shade = np.arange(256) / 255
    histogram = np.stack(histograms).astype(np.float64).sum(0)
    share = histogram / histogram.sum(1, keepdims=True)
    up_to = share.cumsum(1)
    mean = matmul(share, shade)
    each = {
        "min": shade[(histogram > 0).argmax(1)],
        "max": shade[255 - (histogram[:, ::-1] > 0).argmax(1)],
        "mean": mean,
        "std": np.sqrt(np.maximum(matmul(share, shade**2) - mean**2, 0.0)),
        **{name: shade[(up_to >= q - 1e-12).argmax(1)] for name, q in QUANTILES.items()},
    }
    return {**{name: value.reshape(3, 1, 1) for name, value in each.items()}, "count": np.array([pictures])}


def written(statistics: Mapping[str, Statistics]) -> dict[str, dict[str, list[Any]]]:
    """As JSON has them."""
    return {key: {name: value.tolist() for name, value in found.items()} for key, found in statistics.items()}
