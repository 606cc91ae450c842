"""What a language model is told of skills: their needs and effects in words, from their files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from mpvi_bt.executive.completion.criteria import Relation, parse
from mpvi_bt.executive.plan.prompt import system_text
from mpvi_bt.executive.plan.skill_effects import SkillEffects, SkillNeeds
from mpvi_bt.executive.plan.skill_phrases import slots
from mpvi_bt.executive.plan.skill_words import EFFECTS, NEEDS, effects_words, needs_words, shown_phrase
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.house.instances.tasks import plans_of

SKILLS = load_skills()
OF_HANDS = [name for name, skill in SKILLS.items() if skill.hands]


def test_every_term_has_words() -> None:
    """No need and no effect is left out because nobody wrote words for it."""
    assert {*NEEDS, "hands"} == set(SkillNeeds.model_fields)
    assert set(EFFECTS) == set(SkillEffects.model_fields)


@pytest.mark.parametrize("name", OF_HANDS)
def test_the_prompt_tells_what_a_skill_of_hands_needs_and_does(name: str) -> None:
    """Its line has both, and both speak only of slots that the phrase in that line has."""
    skill = SKILLS[name]
    line = next(line for line in system_text(SKILLS, None).splitlines() if skill.about in line)
    assert f" Then {effects_words(skill)}." in line
    assert (f" Needs {needs_words(skill)}." in line) is (skill.needs != SkillNeeds())
    assert {*slots(needs_words(skill)), *slots(effects_words(skill))} <= set(slots(shown_phrase(skill)))


def test_the_words_follow_the_file() -> None:
    """A skill whose file is changed is told of as changed: there is no second table."""
    pick = SKILLS["pick"]
    assert needs_words(pick) == "a free hand, {object} in reach"
    changed = pick.model_copy(update={"needs": SkillNeeds(hands=2, open=("object",)), "effects": SkillEffects()})
    assert (needs_words(changed), effects_words(changed)) == ("both hands free, {object} not closed", "")


@pytest.mark.parametrize("term", sorted({*EFFECTS} & {*get_args(Relation)}))
def test_an_effect_is_told_in_words_of_a_criterion(term: str) -> None:
    """A model that ends its segment with them has a criterion that the checker reads, of the same relation."""
    read = parse(re.sub(r"\bno the", "no", EFFECTS[term].format("the pear", "the shelf")))
    assert read is not None
    assert (read.relation, read.subject) == (term, "pear")


def test_plans_for_the_same_problem_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user's task with the problem of ours has a plan that would tell the answer; so has a task with mistakes."""
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks" / "my_water.yaml").write_text("problem: bringing_water\nplan: my_water\n")
    (tmp_path / "tasks" / "none.yaml").write_text("problem: [")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    assert plans_of("bringing_water") == {"bringing_water", "my_water"}
    assert all(plans_of(name) == {name} for name in ("picking_up_trash", "tidying_bedroom"))
