"""Means, intervals and how often they hold what they should."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.runs.report.statistics import (
    Array,
    Chance,
    Estimate,
    difference,
    estimate,
    permutation_test,
    relative,
    resampled,
)


def test_the_mean_is_over_instances_and_then_over_tasks() -> None:
    """A task with many instances counts no more than one with few."""
    found = estimate([np.zeros(8), np.ones(2)])
    assert found is not None
    assert found.mean == 0.5


def draws(kind: str) -> tuple[float, Callable[[np.random.Generator], list[Array]]]:
    """The true mean of a benchmark of 12 tasks with 10 instances each, and what draws results of it."""
    shares = np.linspace(0.05, 0.95, 12)
    if kind == "success":
        return float(shares.mean()), lambda rng: [(rng.random(10) < p).astype(float) for p in shares]
    if kind == "thirds":  # q of three literals
        return float(shares.mean()), lambda rng: [rng.binomial(3, p, 10) / 3 for p in shares]
    scales = np.linspace(20, 400, 12)  # times, skewed
    return float(scales.mean()), lambda rng: [rng.gamma(4.0, s / 4.0, 10) for s in scales]


@pytest.mark.parametrize("kind", ["success", "thirds", "times"])
def test_intervals_hold_the_truth_as_often_as_they_say(kind: str) -> None:
    """Of 600 suites drawn from known distributions, 95 % of the intervals hold the true mean, to within two points."""
    truth, draw = draws(kind)
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(600):
        found = estimate(draw(rng), resamples=2000)
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        held += found.low <= truth <= found.high
    assert held / 600 == pytest.approx(0.95, abs=0.02)


def test_draws_spread_as_the_unbiased_variance_says() -> None:
    """The standard error of a stratified mean is known in closed form; tasks of 2 to 20 instances, no two alike."""
    rng = np.random.default_rng(3)
    tables = [rng.normal(0, n, (n, 1)) for n in (2, 3, 5, 10, 20)]
    error = np.sqrt(sum(t.var(ddof=1) / len(t) for t in tables)) / len(tables)
    assert resampled(tables, 40_000, 0).std() == pytest.approx(error, rel=0.02)


def test_what_belongs_together_is_drawn_together() -> None:
    """Two methods that differ by the same everywhere differ by just that in every draw, however instances spread."""
    rng = np.random.default_rng(0)
    first = [rng.random(10) for _ in range(4)]
    found = estimate([np.stack([a, a + 0.25], 1) for a in first], difference)
    assert found is not None
    assert [found.mean, found.low, found.high] == pytest.approx([0.25] * 3)


def test_relative_improvement_is_of_the_means() -> None:
    """As the paper's: 0.08 to 0.17 is 112.5 %, whatever single tasks did."""
    found = estimate([np.array([[0.16, 0.0]] * 3), np.array([[0.0, 0.34]] * 3)], relative)
    assert found is not None
    assert found.mean == pytest.approx(0.17 / 0.08 - 1)


def test_nothing_is_said_of_what_nothing_tells() -> None:
    """No figures, no estimate; one instance, no interval; no improvement over a baseline of 0."""
    assert estimate([]) is None
    assert estimate([np.array([])]) is None
    assert estimate([np.ones(1), np.ones(10)]) == Estimate(1.0)
    assert estimate([np.array([[0.0, 0.5]] * 3)], relative) is None


def test_a_bound_that_is_endless_is_left_out() -> None:
    """Draws in which the baseline has nothing make the improvement endless: no upper bound then."""
    found = estimate([np.array([[0.0, 0.5], [0.0, 0.5], [0.2, 0.5]])], relative)
    assert found is not None
    assert found.low is not None
    assert found.high is None


@given(
    tasks=st.lists(st.lists(st.floats(0, 1), min_size=2, max_size=6), min_size=1, max_size=4),
    seed=st.integers(0, 2**32),
)
def test_intervals_are_within_what_was_seen(tasks: list[list[float]], seed: int) -> None:
    """The same figures and seed give the same interval; it lies between the least and the greatest figures."""
    arrays = [np.array(task) for task in tasks]
    found, again = (estimate(arrays, resamples=50, seed=seed) for _ in range(2))
    assert found == again
    assert found is not None
    assert found.low is not None
    assert found.high is not None
    least, most = np.mean([a.min() for a in arrays]), np.mean([a.max() for a in arrays])
    assert least - 1e-9 <= found.low <= found.high <= most + 1e-9
    assert least - 1e-9 <= found.mean <= most + 1e-9


def flipped(tasks: Sequence[Array]) -> float:
    """The p of a paired permutation test, by its definition: every choice of signs, one by one."""
    shares = np.concatenate([task / len(task) / len(tasks) for task in tasks])
    means = [abs(shares @ signs) for signs in itertools.product((1.0, -1.0), repeat=len(shares))]
    return float(np.mean([mean >= means[0] - 1e-12 for mean in means]))


@settings(max_examples=30)
@given(
    st.lists(st.lists(st.sampled_from([-1.0, -0.5, 0.0, 1 / 3, 0.5]), min_size=1, max_size=4), min_size=1, max_size=2)
)
def test_few_pairs_are_tested_exactly(differences: list[list[float]]) -> None:
    """As by hand; instances without a difference change nothing, whatever their sign."""
    tasks = [np.array(task) for task in differences]
    found = permutation_test(tasks)
    assert found.exact
    assert found.p == pytest.approx(flipped(tasks))


def test_chance_is_told_as_often_as_it_is_at_work() -> None:
    """Of 300 suites in which a method makes no difference, one in twenty has p < 0.05; the same figures, the same p."""
    rng = np.random.default_rng(11)
    suites = [[rng.normal(0, 1 + task, 8) for task in range(3)] for _ in range(300)]
    found = [permutation_test(suite) for suite in suites]
    assert not found[0].exact
    assert np.mean([chance.p < 0.05 for chance in found]) == pytest.approx(0.05, abs=0.03)
    assert permutation_test(suites[0]) == found[0]


def test_a_great_difference_is_hardly_by_chance() -> None:
    """Nobody is sure of one by two pairs, and everybody by thirty."""
    assert permutation_test([np.ones(2)]).p == 0.5
    assert permutation_test([np.ones(10), np.ones(20)]).p < 0.001
    assert permutation_test([np.zeros(5)]) == permutation_test([]) == Chance(1.0, True)
