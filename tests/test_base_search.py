"""Searching base poses: which candidates are looked at, and when a search ends."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.stance.base_search import Alike, SearchBudget, about, first, ranked
from mpvi_bt.hands.stance.effort import Effort

ROW = np.column_stack([np.arange(10) * 0.1, np.zeros((10, 2))])  # base poses 10 cm apart


def looked_at(
    failed: list[Array],
    budget: SearchBudget,
    alike: Alike = Alike(0.01, 0.1),  # noqa: B008
    reached: Callable[[int], bool] = lambda k: True,
    spreads: bool = False,
) -> list[int]:
    """Which of a row of candidates a search looks at that finds nothing."""
    seen: list[int] = []

    def check(k: int) -> tuple[None, float]:
        seen.append(k)
        failed.extend([ROW[k]] if spreads else [])
        return None, 1.0

    assert first(ROW, check, alike, failed, budget, reached) is None
    return seen


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.2, 1.0), st.floats(-0.4, 0.4))
def test_a_place_is_where_a_candidate_has_it(x: float, y: float, yaw: float, ahead: float, left: float) -> None:
    """As seen from each base pose, the place is so far ahead and to the left."""
    base = about(np.array([x, y]), yaw, ahead, left)
    np.testing.assert_allclose(kin.inverse(kin.base(base)) @ [x, y, 0.0, 1.0], [ahead, left, 0.0, 1.0], atol=1e-9)


def test_of_candidates_that_cost_the_same_the_first_is_first() -> None:
    """The order is the same on every machine."""
    assert ranked(np.array([1.0, 0.5, 1.0, 0.5])).tolist() == [1, 3, 0, 2]


def test_what_is_near_to_what_failed_is_left_out() -> None:
    """What failed before counts, and what a check adds; a base pose that is turned otherwise is another one."""
    assert looked_at([ROW[4]], SearchBudget(), Alike(0.15, 0.1)) == [0, 1, 2, 6, 7, 8, 9]
    assert looked_at([ROW[4] + [0.0, 0.0, 0.2]], SearchBudget(), Alike(0.15, 0.1)) == list(range(10))
    assert looked_at([], SearchBudget(), Alike(0.25, 0.1), spreads=True) == [0, 3, 6, 9]


def test_a_search_ends_when_its_budget_is_used_up() -> None:
    """Its own, or that of all searches; it tells how many candidates were left."""
    own, shared = SearchBudget(3.0), SearchBudget(effort=Effort(left=2.0))
    assert looked_at([], own) == [0, 1, 2]
    assert own.left == 7
    assert looked_at([], shared) == [0, 1]
    assert shared.left == 8
    assert looked_at([], SearchBudget()) == list(range(10))


def test_what_the_base_does_not_get_to_costs_nothing() -> None:
    """Candidates without a way are passed over, and the budget is for the others."""
    assert looked_at([], SearchBudget(2.0), reached=lambda k: k > 5) == [6, 7]


def test_the_first_that_is_found_ends_the_search() -> None:
    """Nothing is looked at after it, and what it took is counted."""
    budget = SearchBudget(10.0)
    assert first(ROW, lambda k: ("found" if k == 2 else None, 1.0), Alike(0.01), [], budget) == "found"
    assert budget.spent == 3.0
