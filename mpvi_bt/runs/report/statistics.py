"""Means over instances and then over tasks, with bootstrap intervals and permutation tests; knows no episodes.

Our choice of the bootstrap: the tasks are the benchmark and stay as they are; within each task its instances are drawn
anew, with all their seeds. Of n instances n - 1 are drawn, so that the spread is that of the unbiased variance, which a
bootstrap of n falls short of by a tenth where n is 10 (Rao and Wu, "Resampling inference with complex survey data",
1988). Bounds are percentiles. Where there are several houses, these are drawn anew instead, each with all its tasks and
instances: a table of houses stands for the tables of tasks. A second draw, of instances within a house, would count
their spread twice, as it is in that of the houses' means already (Davison and Hinkley, "Bootstrap methods and their
application", 1997, section 3.8).

Our choice of the test: paired, two-sided, of the same mean of differences. If a method made no difference, either of a
pair's two figures could be either's: the sign of each instance's difference is drawn anew, all its seeds together, or
of each house's, where there are several. scipy does it, exactly where there are few.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Statistic = Callable[[Array], Array]

LEVEL = 0.95
RESAMPLES = 4000  # Our choice: a bound's place among the percentiles is then sure to 0.25 points
SEED = 0
FLIPS = 9999  # scipy's default: of up to 13 instances that differ every choice of signs is tried, of more so many


@dataclass(frozen=True)
class Estimate:
    """A figure and its confidence interval.

    Attributes:
        mean: The figure.
        low, high: Bounds; None where a task has but one instance, so that nothing tells how instances spread.
    """

    mean: float
    low: float | None = None
    high: float | None = None


def estimate(
    tasks: Sequence[Array],
    statistic: Statistic | None = None,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Estimate | None:
    """A statistic of the means over instances, then tasks, with its interval.

    Args:
        tasks: For each task, (n,) a figure of every instance, or (n, k) figures of the instance that belong together,
            such as those of two methods. Tasks without instances are left out.
        statistic: From means (..., k) to figures (...); None: the first of them.
        level: Of confidence.
        resamples: How often instances are drawn anew.
        seed: Of the draws: the same figures always give the same interval.

    Returns:
        None where there are no instances, or where the statistic is not finite.
    """
    tables = [np.asarray(task, float).reshape(len(task), -1) for task in tasks if len(task)]
    if not tables:
        return None
    of = statistic or _first
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = float(of(np.mean([table.mean(0) for table in tables], axis=0)))
        if not np.isfinite(mean):
            return None
        if min(map(len, tables)) < 2:
            return Estimate(mean)
        drawn = of(resampled(tables, resamples, seed))
    # Infinite where a draw has nothing to divide by; its place among the percentiles is then still right.
    low, high = np.quantile(drawn, [(1 - level) / 2, (1 + level) / 2], method="inverted_cdf")
    return Estimate(mean, *(float(bound) if np.isfinite(bound) else None for bound in (low, high)))


@dataclass(frozen=True)
class Chance:
    """How probable a difference at least as great is where there is none.

    Attributes:
        p: Two-sided.
        exact: Every choice of signs was tried; otherwise `FLIPS` were drawn, always the same ones.
    """

    p: float
    exact: bool


def permutation_test(tasks: Sequence[Array]) -> Chance:
    """A paired permutation test of the mean over instances, then tasks.

    Args:
        tasks: For each task, (n,) the difference of every instance. Instances without one tell nothing, whatever their
            sign.
    """
    from scipy import stats  # takes half a second to load

    tables = [np.asarray(task, float) for task in tasks if len(task)]
    shares = np.concatenate([table / len(table) / len(tables) for table in tables] or [np.zeros(0)])
    shares = shares[np.abs(shares) > 1e-12]
    if len(shares) < 2:  # a single one is as great with either sign
        return Chance(1.0, True)
    found = stats.permutation_test(
        (shares,), lambda x, axis: x.sum(axis), permutation_type="samples", vectorized=True, n_resamples=FLIPS,
        batch=1000, rng=np.random.default_rng(SEED),
    )  # fmt: skip
    return Chance(float(found.pvalue), 2 ** len(shares) <= FLIPS)


def resampled(tables: Sequence[Array], resamples: int, seed: int) -> Array:
    """(resamples, k) means over instances drawn anew, then over tasks; each table (n, k), n at least 2."""
    means = [_weights(len(table), resamples, seed, i) @ table for i, table in enumerate(tables)]
    return np.asarray(np.mean(means, axis=0))


@lru_cache(maxsize=64)  # a report asks for the same draws for every measure
def _weights(n: int, resamples: int, seed: int, place: int) -> Array:
    """(resamples, n) how often each of n instances is among n - 1 that are drawn, as a share of these."""
    rng = np.random.default_rng([seed, place])
    return rng.multinomial(n - 1, np.full(n, 1 / n), size=resamples) / (n - 1)


def difference(means: Array) -> Array:
    """The second of two figures less the first."""
    return np.asarray(means[..., 1] - means[..., 0])


def relative(means: Array) -> Array:
    """How much the second of two figures is above the first, as a share of the first; 1.13 is the paper's 113 %."""
    return np.asarray(means[..., 1] / means[..., 0] - 1.0)


def _first(means: Array) -> Array:
    return np.asarray(means[..., 0])
