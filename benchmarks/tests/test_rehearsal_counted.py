"""`python -m benchmarks.rehearsal`: which mutants are drawn, and what is counted of them."""

from __future__ import annotations

from collections import Counter

from benchmarks.rehearsal import KINDS, Mutant, Trial, drawn, judged, table, tried
from tests.test_plans50 import plan_of


def test_the_same_mutants_are_drawn_again() -> None:
    """As many of each kind, each of another task, none of which is the plan on file; another seed draws others."""
    mutants = drawn(3, seed=0)
    assert mutants == drawn(3, seed=0) != drawn(3, seed=1)
    assert Counter(m.kind for m in mutants) == dict.fromkeys(KINDS, 3)
    assert len({(m.kind, m.task) for m in mutants}) == len(mutants)
    assert all(m.plan != plan_of(m.task) for m in mutants)


def test_a_plan_on_file_works_and_one_without_its_open_door_fails() -> None:
    """The judge passes the first, the rehearsal blames nothing in it; of the second both say why."""
    whole = plan_of("bringing_water").segments
    shut = tuple(s for s in whole if not s.description.startswith("open"))
    good, bad = (Mutant("bringing_water", "a step left out", "", segments) for segments in (whole, shut))
    assert judged(good) == ""
    first, second = tried([good, bad])
    assert (first.judged, first.found, first.doubt) == ("", "", "")
    assert second.judged
    assert "fridge is closed" in second.found


def test_a_row_counts_each_trial_once() -> None:
    """What fails is found, in doubt, or missed; what works may be blamed or doubted for nothing."""
    kind = next(iter(KINDS))
    cases = [
        ("why", "this", "far"),
        ("why", "", "far"),
        ("why", "", ""),
        ("", "", ""),
        ("", "this", ""),
        ("", "", "far"),
    ]
    trials = [Trial("task", kind, "", *case) for case in cases]
    assert table(trials)[0] == [kind, 6, 3, 1, 1, 1, 3, 2]
