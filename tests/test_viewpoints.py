"""Going to look: one look after the other until one is enough."""

from __future__ import annotations

from itertools import count

import numpy as np

from mpvi_bt.hands.motion.viewpoints import Look, climb, look_from


def played(look: Look) -> tuple[int, bool]:
    """How many actions a look takes, and what it returns."""
    actions = 0
    while True:
        try:
            next(look)
        except StopIteration as end:
            return actions, bool(end.value)
        actions += 1


def step(answer: bool) -> Look:
    """One action."""
    yield np.zeros(1)
    return answer


def test_looks_end_with_the_first_that_is_enough() -> None:
    """What comes after it is not even asked for."""
    assert played(climb(step(k == 1) for k in count())) == (2, True)
    assert played(climb(step(False) for _ in range(3))) == (3, False)


def test_nothing_is_looked_at_from_where_no_way_leads() -> None:
    """A look costs actions only where there is a way."""
    assert played(look_from(step(False), step(True))) == (1, False)
    assert played(look_from(step(True), step(False))) == (2, True)
