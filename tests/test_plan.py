"""Plans, skills and what post-processing finds in them."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.pattern import pattern
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.primitives import primitives
from mpvi_bt.executive.plan.schema import Manipulation, Navigation, Plan, load_plan
from mpvi_bt.executive.plan.skills import load_skill, load_skills
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName

SKILLS = load_skills()
PLANS = sorted((paths.shipped() / "tasks" / "plans").glob("*.json"))

words = st.text(st.characters(categories=["L", "Nd", "P", "S", "Zs"]), min_size=1, max_size=30).filter(
    lambda t: bool(t.strip()) and t.isprintable()
)
navigations = st.builds(
    Navigation,
    type=st.just("navigation"),
    description=words,
    completion_criterion=words,
    target=words,
    room=st.none() | words,
)
manipulations = st.builds(
    Manipulation, type=st.just("manipulation"), description=words, completion_criterion=words, target=st.none()
)
plans = st.builds(
    Plan,
    task_name=words,
    instruction=words | st.just(""),
    segments=st.lists(navigations | manipulations, min_size=1, max_size=6).map(tuple),
)


@pytest.mark.parametrize("suffix", ["yaml", "yml", "json"])
def test_a_plan_that_passes_check_is_found_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    """Whatever the suffix of its file is, of those that check reads: by planners, by tasks, and in a folder."""
    plan = load_plan(PLANS[0]).model_copy(update={"task_name": "mine"})
    path = tmp_path / "tasks" / "plans" / f"mine.{suffix}"
    path.parent.mkdir(parents=True)
    path.write_text(plan.to_json() if suffix == "json" else yaml.safe_dump(plan.model_dump(exclude_none=True)))
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    assert RecordedPlanner().plan("mine") == RecordedPlanner(path.parent).plan("mine") == plan
    assert plan in RecordedPlanner().all()
    assert paths.find("tasks/plans", "mine") == path


@given(plan=plans)
def test_a_plan_survives_its_file(tmp_path_factory: pytest.TempPathFactory, plan: Plan) -> None:
    """Writing a plan and reading it gives the same plan."""
    path = tmp_path_factory.mktemp("plan") / "plan.json"
    path.write_text(plan.to_json(), encoding="utf-8")
    assert load_plan(path) == plan


def test_a_broken_plan_lists_every_problem(tmp_path: Path) -> None:
    """Each defect of a plan is named with its line."""
    path = tmp_path / "plan.json"
    path.write_text(
        '{"task_name": "t",\n "segments": [\n'
        '  {"type": "navigation", "description": "go", "completion_criterion": "there"},\n'
        '  {"type": "manipulate", "description": "x", "completion_criterion": "y"},\n'
        '  {"type": "manipulation", "description": "a\\nb", "completion_criteria": "y"}\n]}'
    )
    with pytest.raises(FileProblems) as caught:
        load_plan(path)
    assert [(p.line, p.code) for p in caught.value.problems] == [
        (3, "missing-key"),
        (4, "unknown-value"),
        (5, "missing-key"),
        (5, "invalid-value"),
        (5, "unknown-key"),
    ]
    assert "Did you mean 'completion_criterion'?" in str(caught.value)


@pytest.mark.parametrize("path", PLANS, ids=lambda p: p.stem)
def test_recorded_plans_say_things_as_skills_do(path: Path) -> None:
    """Every shipped plan loads, and what a skill is said to do in it is said in the skill's words.

    What fits no skill is what none does, such as to dice; "leave" and "let" are skills' verbs only where
    they say a place.
    """
    plan = load_plan(path)
    assert plan.task_name == path.stem
    other = [plan.segments[i].description for i, found in primitives(plan, SKILLS).items() if found.call is None]
    verbs = {verb for skill in SKILLS.values() for verb in skill.verbs} - {"leave", "let"}
    assert [description for description in other if description.split()[0] in verbs] == []


def test_the_recorded_planner_says_what_it_has(tmp_path: Path) -> None:
    """An unrecorded task is an error that names the recorded ones; a given instruction replaces the recorded one."""
    assert RecordedPlanner().plan("picking_up_trash", "tidy up").instruction == "tidy up"
    with pytest.raises(UnknownName, match="Did you mean 'picking_up_trash'"):
        RecordedPlanner().plan("picking_up_trsh")
    with pytest.raises(UnknownName, match="Known: none"):
        RecordedPlanner(tmp_path).plan("picking_up_trash")


def test_only_manipulations_before_navigation_or_the_end_are_terminal() -> None:
    """Completion is verified where control goes back to navigation, and at the end."""
    plan = RecordedPlanner().plan("picking_up_trash")
    found = primitives(plan, SKILLS)
    assert {i: p.terminal for i, p in found.items()} == {
        i: i + 1 == len(plan.segments) or isinstance(plan.segments[i + 1], Navigation) for i in found
    }
    assert [i for i, p in found.items() if not p.terminal] == [3, 6, 9]


@given(plan=plans)
def test_post_processing_covers_every_plan(plan: Plan) -> None:
    """Each manipulation, and nothing else, is looked at; it is terminal before navigation and at the end.

    A group of them is judged by its last criterion, and asked for by all of their descriptions.
    """
    found = primitives(plan, SKILLS)
    kinds = [isinstance(segment, Manipulation) for segment in plan.segments]
    assert list(found) == [i for i, hands in enumerate(kinds) if hands]
    assert all(p.terminal is not any(kinds[i + 1 : i + 2]) for i, p in found.items())
    nodes = [placed.spec for placed in compile_plan(plan, SKILLS).nodes]
    judged = [node.segments[0] for node in nodes if node.kind == "check_complete"]
    assert judged == [i for i, p in found.items() if p.terminal]
    asked = [node.segments for node in nodes if node.kind == "manipulate"]
    assert [i for group in asked for i in group] == list(found)
    assert [group[-1] for group in asked] == judged


@pytest.mark.parametrize(
    ("description", "skill", "arguments"),
    [
        ("pick up the trash can with the left hand", "pick", {"object": "trash can", "hand": "left"}),
        ("Put the can of soda in the trash can.", "place_in", {"object": "can of soda", "container": "trash can"}),
        ("place the bowl on the table with the right hand", "place_on",
         {"object": "bowl", "surface": "table", "hand": "right"}),
        ("put the apple in the bowl on the table", "place_in", {"object": "apple", "container": "bowl on the table"}),
        ("take hold of a cup", "pick", {"object": "cup"}),
        ("grasp the bowl from the table using your RIGHT gripper", "pick",
         {"object": "bowl", "source": "table", "hand": "right"}),
        ("pick the cup  up with left hand", "pick", {"object": "cup", "hand": "left"}),
    ],
)  # fmt: skip
def test_phrases_name_skills(description: str, skill: str, arguments: dict[str, str]) -> None:
    """A description of a plan becomes a skill with its arguments."""
    call = match(description, SKILLS)
    assert call is not None
    assert (call.skill.name, dict(call.arguments)) == (skill, arguments)


@pytest.mark.parametrize("description", ["", "dance", "pick up", "the can", "put the cup", "turn the page"])
def test_what_no_skill_covers_matches_none(description: str) -> None:
    """A description outside the phrases is no primitive, and that is allowed."""
    assert match(description, SKILLS) is None


def test_clauses_split_what_the_compiler_joined() -> None:
    """The clauses of a prompt are the descriptions that it was made of."""
    parts = ["pick up a cup", "put the cup in the sink", "open the tap"]
    assert clauses(", then ".join(parts), SKILLS) == parts
    assert clauses("pick up a cup and then put it down; wait.", SKILLS) == ["pick up a cup", "put the cup down", "wait"]
    assert clauses("  ", SKILLS) == []


@pytest.mark.parametrize(
    ("phrase", "what"),
    [
        ("a {objekt}", "Did you mean 'object'"),
        ("a {hand} {hand}", "twice"),
        ("(a|b", "brackets"),
        ("pick up {object[ with the {hand} hand]", "other half"),
        ("pick up object}", "other half"),
    ],
)
def test_a_bad_phrase_is_refused(phrase: str, what: str) -> None:
    """Unknown slots, slots given twice and open brackets are told apart."""
    with pytest.raises(ValueError, match=what):
        pattern(phrase)


@pytest.mark.parametrize(
    ("line", "what", "near"),
    [
        ("phrases: ['{object}']", 3, "slots alone catch every sentence"),
        ("phrases: ['[pick up ]{object}[ {target}]']", 3, "slots alone catch every sentence"),
        ("phrases: ['pick up {object}']\nshows: the {object} is in the {container}", 4, "no phrase gives 'container'"),
        ("phrases: ['pick up {object}']\nhands: 3", 4, "Known: 0, 1, 2."),
    ],
)
def test_a_skill_that_could_never_work_is_told(line: str, what: int, near: str, tmp_path: Path) -> None:
    """A phrase that names everything, what the judge is never told, and a third hand, each at its place."""
    path = tmp_path / "pick.yaml"
    path.write_text(f"name: pick\nabout: x\n{line}\ntriggers: [{{event: grasp, camera: hand}}]\ntimeout_s: 1\n")
    with pytest.raises(FileProblems) as caught:
        load_skill(path)
    assert [p.line for p in caught.value.problems] == [what]
    assert near in str(caught.value)


def test_a_broken_skill_is_placed(tmp_path: Path) -> None:
    """A wrong trigger, time and phrase are each found."""
    path = tmp_path / "pick.yaml"
    path.write_text(
        "name: pick\nabout: x\nphrases:\n  - a {objekt}\ntriggers:\n  - event: grab\n    camera: hand\ntimeout_s: 0\n"
    )
    with pytest.raises(FileProblems) as caught:
        load_skill(path)
    assert [p.line for p in caught.value.problems] == [4, 6, 8]
    path.write_text(path.read_text().replace("objekt", "object").replace("grab", "grasp").replace("_s: 0", "_s: 1"))
    assert load_skill(path).timeout_s == 1
    with pytest.raises(FileProblems, match="must agree"):
        load_skill(path.rename(tmp_path / "grab.yaml"))
