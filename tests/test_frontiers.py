"""Laws of frontiers and of the way to the nearest one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mpvi_bt.finding.navigation.frontiers import frontier, nearest_frontier
from mpvi_bt.finding.navigation.grid import shortest_path
from tests.test_navigation_grid import dijkstra, grids

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 12), st.integers(1, 12), st.floats(0, 1), st.floats(0, 1))
def test_a_frontier_is_seen_and_borders_the_unseen(
    seed: int, rows: int, columns: int, free_share: float, seen_share: float
) -> None:
    """Exactly the free seen cells with a free unseen one above, below, left or right."""
    rng = np.random.default_rng(seed)
    free, seen = rng.random((rows, columns)) < free_share, rng.random((rows, columns)) < seen_share
    expected = np.zeros((rows, columns), bool)
    for r in range(rows):
        for c in range(columns):
            for rr, cc in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
                inside = 0 <= rr < rows and 0 <= cc < columns
                expected[r, c] |= free[r, c] and seen[r, c] and inside and free[rr, cc] and not seen[rr, cc]
    found = frontier(free, seen)
    assert found.dtype == bool
    np.testing.assert_array_equal(found, expected)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_views_of_larger_maps_have_the_frontiers_of_their_copies(seed: int) -> None:
    """Neither strides nor the order of memory matter."""
    rng = np.random.default_rng(seed)
    free, seen = rng.random((30, 40)) < 0.7, rng.random((40, 30)) < 0.5
    expected = frontier(free[::2, 3:].copy(), seen.T[::2, 3:].copy())
    np.testing.assert_array_equal(frontier(free[::2, 3:], seen.T[::2, 3:]), expected)


@settings(max_examples=80, deadline=None)
@given(grids(), SEEDS, st.floats(0, 0.3))
def test_the_nearest_frontier_is_the_one_that_costs_least(cost: NDArray[np.float32], seed: int, share: float) -> None:
    """Its cost is the least of a plain Dijkstra's over all targets, and its path that of the shortest path there."""
    targets = np.random.default_rng(seed).random(cost.shape) < share
    reached = dijkstra(cost, (0, 0))
    least = min((float(c) for c in reached[targets]), default=math.inf)
    found = nearest_frontier(cost, (0, 0), targets)
    assert (found is None) == math.isinf(least)
    if found is not None:
        path, paid = found
        assert targets[tuple(path[-1])]
        assert tuple(path[0]) == (0, 0)
        assert math.isclose(paid, least, rel_tol=1e-9)
        there = shortest_path(cost, (0, 0), (int(path[-1, 0]), int(path[-1, 1])))
        assert there is not None
        assert math.isclose(there[1], paid, rel_tol=1e-9)


def test_a_target_underfoot_costs_nothing() -> None:
    """Who stands on a frontier is there."""
    path, paid = nearest_frontier(np.ones((3, 3), np.float32), (1, 1), np.ones((3, 3), bool)) or (None, None)
    assert paid == 0.0
    assert path is not None
    assert path.tolist() == [[1, 1]]


def test_no_target_and_no_place_to_start_have_no_way() -> None:
    """Without targets, from a blocked cell or from off the map there is no way, and no error."""
    cost, all_ = np.ones((3, 3), np.float32), np.ones((3, 3), bool)
    assert nearest_frontier(cost, (1, 1), ~all_) is None
    assert nearest_frontier(cost, (-1, 1), all_) is None
    cost[1, 1] = np.inf
    assert nearest_frontier(cost, (1, 1), all_) is None


def test_masks_of_another_shape_are_refused() -> None:
    """A mask that does not fit is a mistake that names both shapes."""
    with pytest.raises(ValueError, match=r"\(2, 3\).*\(3, 3\)"):
        frontier(np.ones((2, 3), bool), np.ones((3, 3), bool))
    with pytest.raises(ValueError, match=r"\(2, 3\).*\(3, 3\)"):
        nearest_frontier(np.ones((3, 3), np.float32), (0, 0), np.ones((2, 3), bool))
