"""The shipped skills: what names them, and nothing else; what they should end in."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skill_effects import SkillEffects
from mpvi_bt.executive.plan.skill_phrases import example, filled
from mpvi_bt.executive.plan.skills import Skill, SkillCall, load_skill, load_skills
from mpvi_bt.executive.tree.yaml_io import check_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.marked_yaml import SourceMarks
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode import capability_checks

SKILLS = load_skills()
PHRASES = [(skill.name, phrase) for skill in SKILLS.values() for phrase in skill.phrases]
LISTED = {"hand": "left", "to_hand": "right", "state": "on", "direction": "left"}

nouns = st.sampled_from(["cup", "trash can", "bowl", "toy car", "kitchen table", "box of oatmeal", "vase"])


@pytest.mark.parametrize("path", sorted((paths.shipped() / "skills").glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_skills_load(path: Path) -> None:
    """Every skill file is valid and bears its skill's name."""
    assert load_skill(path).name == path.stem


@pytest.mark.parametrize(("name", "phrase"), PHRASES)
@given(st.data())
def test_slots_come_back_as_they_went_in(name: str, phrase: str, data: st.DataObject) -> None:
    """What a phrase reads like, filled with plain nouns, is matched to its own skill with those nouns."""
    text = example(phrase)
    words = {slot: LISTED.get(slot) or data.draw(nouns) for slot in re.findall(r"\{(\w+)\}", text)}
    listed = dict(re.findall(r"\{(\w+):(\w+)", phrase))  # of which the example has the first word
    call = match(filled(text, words) or "", SKILLS)
    assert call is not None
    assert (call.skill.name, dict(call.arguments)) == (name, words | listed)


@pytest.mark.parametrize(
    ("description", "skill", "arguments"),
    [
        ("take the milk out of the fridge", "pick", "object milk, source fridge"),
        ("put the cup down on the table", "place_on", "object cup, surface table"),
        ("throw the can away in the bin", "place_in", "object can, container bin"),
        ("put the shoes next to the sofa", "place_next_to", "object shoes, target sofa"),
        ("place the shoes on the floor next to the sofa", "place_next_to", "object shoes, surface floor, target sofa"),
        ("put the cup in front of the TV", "place_next_to", "object cup, target TV"),
        ("put the ball under the table with the right hand", "place_under", "object ball, target table, hand right"),
        ("open the door of the fridge", "open", "object fridge"),
        ("pull the top drawer open", "open", "object top drawer"),
        ("push the drawer shut", "close", "object drawer"),
        ("shut the lid of the box", "close", "object box"),
        ("turn on the radio", "press", "object radio, state on"),
        ("switch the lamp OFF with the left hand", "press", "object lamp, state off, hand left"),
        ("press the power button of the radio", "press", "object radio"),
        ("push the button on the microwave", "press", "object microwave"),
        ("toggle the switch", "press", "object switch"),
        ("push the box to the left", "push", "object box, direction left"),
        ("push the chair under the table", "push", "object chair, target table"),
        ("hand the stick over from the left to the right hand", "hand_over", "object stick, hand left, to_hand right"),
        ("pass the cup to your left hand", "hand_over", "object cup, to_hand left"),
        ("move the cup from the right hand to the left hand", "hand_over", "object cup, hand right, to_hand left"),
        ("hand the cup over to the other hand", "hand_over", "object cup"),
        ("lift the box with both hands", "lift", "object box"),
        ("pick up the box from the floor using two arms", "lift", "object box, source floor"),
        ("lift the box", "pick", "object box"),
        ("pour the water into the bowl", "pour", "object water, container bowl"),
        ("shake the sugar out of the jar into the bowl", "pour", "object sugar, source jar, container bowl"),
        ("empty the bottle into the sink", "pour", "source bottle, container sink"),
        ("wipe the table with the sponge", "wipe", "target table, tool sponge"),
        ("wipe the table with the left hand", "wipe", "target table, hand left"),
        ("wipe the dust off the table with the rag", "wipe", "object dust, target table, tool rag"),
        ("use the sponge to wipe the table", "wipe", "target table, tool sponge"),
        ("spray the plant with the spray bottle", "spray", "target plant, tool spray bottle"),
        ("spray cleaner on the table", "spray", "target table, tool cleaner"),
    ],
)  # fmt: skip
def test_the_ways_in_which_people_ask(description: str, skill: str, arguments: str) -> None:
    """Natural descriptions name one skill, with the right words in each slot."""
    call = match(description, SKILLS)
    assert call is not None
    assert (call.skill.name, dict(call.arguments)) == (
        skill,
        dict(pair.split(" ", 1) for pair in arguments.split(", ")),
    )


NEEDED = {
    "pour": {"container"}, "place_in": {"object", "container"}, "place_on": {"object", "surface"},
    "place_next_to": {"object", "target"}, "place_under": {"object", "target"}, "wipe": {"target"}, "spray": {"target"},
    "go_to": {"target"}, "light": {"target", "tool"}, "mount": {"object", "target"},
}  # fmt: skip


@pytest.mark.parametrize(("name", "phrase"), PHRASES)
def test_every_phrase_gives_what_its_motion_needs(name: str, phrase: str) -> None:
    """A call without a place to pour to, say, could only fail."""
    given = set(re.findall(r"\{(\w+)", re.sub(r"\[[^\[\]]*\]", "", re.sub(r"\[[^\[\]]*\]", "", phrase))))
    assert given >= NEEDED.get(name, {"object"})


@pytest.mark.parametrize(
    ("description", "criterion"),
    [
        ("pick up the cup with the left hand", "the cup is held in a gripper"),
        ("turn the radio off", "the radio is turned off"),
        ("press the button of the radio", None),
        ("hand the cup over to the right hand", "the cup is held in the right gripper"),
        ("hand over the cup", None),
    ],
)
def test_a_call_says_what_it_should_end_in(description: str, criterion: str | None) -> None:
    """The skill's sentence with the call's words, or none where its words do not say."""
    call = match(description, SKILLS)
    assert call is not None
    assert call.criterion == criterion


def test_what_has_no_words_is_left_out() -> None:
    """Of a template; what may not be left out makes all of it unsaid."""
    assert filled("the {object} is held[ in the {hand} hand]", {"object": "cup"}) == "the cup is held"
    assert filled("the {object} is held[ in the {hand} hand]", {"object": "cup", "hand": "left"}) == (
        "the cup is held in the left hand"
    )
    assert filled("the {object} is {state}", {"object": "cup"}) is None
    assert filled("[the {object}]", {"object": "cup {object}"}) == "the cup {object}", (
        "what is filled in stays as it is"
    )


def test_skills_that_take_two_hands_say_so() -> None:
    """A two-handed lift and a hand-over; a call carries its skill."""
    assert {name for name, skill in SKILLS.items() if skill.hands == 2} == {"lift", "hand_over"}
    one = Skill.model_validate(
        {"name": "x", "about": "x", "phrases": ["x"], "timeout_s": 1, "triggers": [{"event": "rest", "camera": "head"}]}
    )
    assert SkillCall(one, {}).criterion is None


WAVE = """\
name: wave_at
about: Wave a hand at something.
phrases: ["wave (at|to) {object}"]
triggers: [{event: rest, camera: head}]
timeout_s: 20
"""


def test_a_skill_that_nobody_can_do_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By check as a warning, as a policy's server may know how; and when a tree is run that asks for it."""
    path = tmp_path / "skills" / "wave_at.yaml"
    path.parent.mkdir()
    path.write_text(WAVE)
    problem, silent = problems_in(str(path))
    assert (silent.code, silent.severity) == ("no-effects", "warning")
    assert (problem.code, problem.severity, problem.line) == ("no-doer", "warning", 1)
    assert "(expert, reactive) knows how to do 'wave_at'" in problem.message
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    skills = load_skills()
    data = {"tree": "t", "root": {"manipulate": "pick up the cup and wave at the vase"}}
    spec = check_tree(data, SourceMarks("t.yaml"), skills)
    for policy, told in (("expert", True), ("reactive", True), ("openpi:ws://localhost:1", False)):
        doubt = capability_checks.doubt(EpisodeConfig("", policy=policy), spec, skills)
        assert ("does not know how to do 'wave_at'" in doubt) is told
    assert (
        capability_checks.doubt(
            EpisodeConfig(""), check_tree({**data, "root": {"say": "hi"}}, SourceMarks("t.yaml"), skills), skills
        )
        == ""
    )


@pytest.mark.parametrize("suffix", ["yaml", "yml", "json"])
def test_a_skill_that_passes_check_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    """Whatever the suffix of its file is, of those that check reads."""
    (tmp_path / "skills").mkdir()
    text = json.dumps(yaml.safe_load(WAVE)) if suffix == "json" else WAVE
    (tmp_path / "skills" / f"wave_at.{suffix}").write_text(text)
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    assert "wave_at" in load_skills()


def test_a_skill_that_has_changed_is_read_anew(tmp_path: Path) -> None:
    """Though one that has not is not."""
    file = tmp_path / "wave_at.yaml"
    file.write_text(WAVE)
    first = load_skills([tmp_path])["wave_at"]
    assert load_skills([tmp_path])["wave_at"] is first
    file.write_text(WAVE.replace("about: ", "about: now "))
    assert load_skills([tmp_path])["wave_at"].about == f"now {first.about}"


STASH = """\
name: stash
about: Put a held object away.
phrases: ["stash {{object}} in {{container}}"]
triggers: [{{event: release, camera: head}}]
timeout_s: 20
{more}
"""


def write(folder: Path, name: str, text: str) -> Path:
    """A skill's file below a folder."""
    (folder / "skills").mkdir(exist_ok=True)
    path = folder / "skills" / f"{name}.yaml"
    path.write_text(text)
    return path


def test_a_skill_that_is_like_another_needs_and_does_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless its own file tells; and so does a file of one's own that bears the name of a skill of ours."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    write(tmp_path, "stash", STASH.format(more="like: place_in\neffects: {ontop: [object, container]}"))
    write(tmp_path, "place_in", STASH.format(more="").replace("stash", "place_in"))
    skills = load_skills()
    assert skills["place_in"].phrases == ("place_in {object} in {container}",)
    assert skills["place_in"].effects == SKILLS["place_in"].effects
    assert skills["stash"].needs == SKILLS["place_in"].needs
    assert skills["stash"].effects == SkillEffects(ontop=("object", "container"))


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("needs: {held: [tool]}", "no phrase gives 'tool'"),
        ("effects: {ontop: [object, surface]}", "no phrase gives 'surface'"),
        ("effects: {held: thing}", "thing"),
        ("effects: {hold: object}", "Did you mean 'held'?"),
        ("unseen: [source]", "no phrase gives 'source'"),
    ],
)
def test_needs_and_effects_are_told_by_the_slots_of_phrases(tmp_path: Path, more: str, told: str) -> None:
    """Of what no phrase names nothing is known; check tells the line."""
    (problem,) = (p for p in problems_in(str(write(tmp_path, "stash", STASH.format(more=more)))) if p.code != "no-doer")
    assert problem.line == 6
    assert told in problem.message


@pytest.mark.parametrize(
    ("said", "slot"),
    [
        ("shake the sugar out of the jar into the bowl", "source"),
        ("pour the can of soda into the bowl", "object"),
        ("wipe the table with the sponge", "tool"),
        ("wipe the table", None),
        ("pick up the cup", None),
    ],
)
def test_a_call_says_what_has_to_be_in_a_hand(said: str, slot: str | None) -> None:
    """The first of the skill's slots of a payload that its words fill."""
    call = match(said, SKILLS)
    assert call is not None
    assert call.in_hand == slot


def test_only_a_release_has_a_witness() -> None:
    """The hand's picture is kept when it lets go; beside another event it would do nothing, and is refused."""
    skill = {"name": "x", "about": "x", "phrases": ["x"], "timeout_s": 1}
    trigger = {"camera": "head", "witness": "hand"}
    Skill.model_validate({**skill, "triggers": [{"event": "release", **trigger}]})
    with pytest.raises(ValueError, match="only a release has a witness, not the event 'idle'"):
        Skill.model_validate({**skill, "triggers": [{"event": "idle", **trigger}]})
