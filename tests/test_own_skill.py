"""A skill's file may name its own motion; what it names is found, or told. The page on it is run by test_own_tasks."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpvi_bt.executive.plan.skills import Skill, load_skill, load_skills
from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.hands.policies.repertoire import REPERTOIRE, motion_of

FILE = """\
name: turn_knob
about: Turn a knob.
motion: {motion}
phrases: ["turn the knob of {{object}}"]
triggers: [{{event: rest, camera: head}}]
timeout_s: 60
{more}
"""


def skill(tmp_path: Path, motion: str, more: str = "") -> Skill:
    """A skill's file, read."""
    (tmp_path / "turn_knob.yaml").write_text(FILE.format(motion=motion, more=more))
    return load_skill(tmp_path / "turn_knob.yaml")


def test_a_motion_is_found_by_its_import_path(tmp_path: Path) -> None:
    """Skills of ours have the motion of their name, a skill of one's own the function that its file names."""
    assert motion_of(skill(tmp_path, "mpvi_bt.hands.skills.press:press")) is not REPERTOIRE["press"]
    assert all(motion_of(ours) is REPERTOIRE[name] for name, ours in load_skills().items())


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ("no_such_module:turn", "skill turn_knob: motion: there is no module 'no_such_module'"),
        (
            "mpvi_bt.hands.skills.press:pres",
            "module 'mpvi_bt.hands.skills.press' has no 'pres'. Did you mean 'press'?",
        ),
        ("mpvi_bt.hands.skills.wait:WAIT_S", "is no class or function, but float"),
    ],
)
def test_a_motion_that_is_not_there_is_told(tmp_path: Path, motion: str, words: str) -> None:
    """In one line that names the skill, the path and the nearest name."""
    with pytest.raises(UserError) as told:
        motion_of(skill(tmp_path, motion))
    assert words in str(told.value)


@pytest.mark.parametrize(("motion", "more"), [("turn", ""), ("a b:c", ""), ("knobs:turn", "like: press")])
def test_a_motion_is_a_path_and_the_only_one(tmp_path: Path, motion: str, more: str) -> None:
    """What is no import path is refused with its line, and so is one beside `like`."""
    with pytest.raises(FileProblems) as problems:
        skill(tmp_path, motion, more)
    assert problems.value.problems[0].line == 3
