"""`python -m benchmarks.plans`: which levels a plan has, which tasks are drawn, and what a model is told."""

from __future__ import annotations

import pytest

from benchmarks.plans import LEVELS, Noted, asked, sample
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
from mpvi_bt.executive.plan.answer_form import answer_text
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.house.instances.tasks import load_task

TASK = load_task("bringing_water")
GOOD = RecordedPlanner().plan("bringing_water")


def without(*segments: int) -> Plan:
    """The plan on file without some of its segments."""
    return GOOD.model_copy(update={"segments": tuple(s for i, s in enumerate(GOOD.segments) if i not in segments)})


def noted(*answers: str, most: int = 2) -> Noted:
    return Noted(ScriptedChatModel(list(answers)), free=False, most=most)


OPENS = next(i for i, segment in enumerate(GOOD.segments) if segment.description.startswith("open"))
CLOSES = next(i for i, segment in enumerate(GOOD.segments) if segment.description.startswith("close"))


@pytest.mark.parametrize(
    ("answer", "has", "code"),
    [
        (answer_text(GOOD), LEVELS, None),
        (answer_text(without(CLOSES)), ("form", "rehearsed"), "goal-unmet"),
        (answer_text(without(OPENS)), ("form",), "impossible"),
        ("no plan at all", (), "syntax"),
    ],
)
def test_a_plan_has_the_levels_up_to_its_first_flaw(answer: str, has: tuple[str, ...], code: str | None) -> None:
    """The plan on file has all; a forgotten close costs the goal, a closed fridge the rehearsal, no JSON the form."""
    row = asked(TASK, noted(answer, most=1), shown=True, rehearse=False)
    assert row.first == has
    assert (code is None and row.found == ()) or code in row.found
    assert row.answers == 1


def test_only_a_rehearsing_run_tells_the_model_what_is_impossible() -> None:
    """With --rehearse the flaw is sent back and the mended plan counts; without it nothing is, and the flaw stays."""
    bad, good = answer_text(without(OPENS)), answer_text(GOOD)
    told = asked(TASK, noted(bad, good), shown=True, rehearse=True)
    assert (told.first, told.last, told.answers) == (("form",), LEVELS, 2)
    untold = asked(TASK, noted(bad, good), shown=True, rehearse=False)
    assert (untold.first, untold.last, untold.answers) == (("form",), ("form",), 1)


def test_a_sample_is_drawn_by_its_seed() -> None:
    """The same seed draws the same tasks, another one others; none has a longer plan on file than is asked for."""
    names = ["bringing_water", "picking_up_trash", "turning_on_radio", "sorting_vegetables", "spraying_for_bugs"]
    drawn = [sample(names, 20, 2, seed) for seed in range(8)]
    assert drawn == [sample(names, 20, 2, seed) for seed in range(8)]
    assert len(set(map(frozenset, drawn))) > 1
    assert sorted(sample(names, 20, 99, 0)) == sorted(set(names) - {"sorting_vegetables"})
