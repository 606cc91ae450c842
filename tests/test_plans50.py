"""Laws of the recorded plans: each of BEHAVIOR's fifty tasks has one, and carried out on paper it reaches the goal."""

from __future__ import annotations

import contextlib
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from mpvi_bt.executive.completion import criteria
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.plan_check import plan_problems
from mpvi_bt.executive.plan.schema import Manipulation, Navigation, Plan, load_plan
from mpvi_bt.executive.plan.skills import SkillCall, load_skills
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.executive.tree.lint import check_rooms, lint
from mpvi_bt.executive.tree.yaml_io import dump_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.human import human_stats
from mpvi_bt.ground.words.phrases import Vocabulary, normalize
from mpvi_bt.house.goals.formula import Literal, holds, literals, without
from mpvi_bt.house.goals.problem import AGENT, BddlProblem, Fact, load_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.things.catalogue import load_catalogue
from tests.symbolic_run import SymbolicRun
from tests.symbolic_state import FLOORS, KEPT, CannotBe

SKILLS = load_skills()
TASKS = sorted(human_stats())

# Units of what has no plural: no rule makes them from a synset.
ALSO_CALLED = {
    "bacon.n.01": ("slice of bacon",),
    "firewood.n.01": ("piece of firewood",),
    "plywood.n.01": ("sheet of plywood",),
    "swiss_cheese.n.01": ("piece of swiss cheese",),
}
# Movables with lids; of fixtures the catalogue says it.
LIDS = ("hinged_jar.n.01", "laptop.n.01", "toolbox.n.01")
# What the run on paper keeps no account of: how full a thing is.
NOT_CHECKED = {
    "canning_food": {"filled"},
}
# What is made on the way, of which the problem says nothing.
ON_THE_WAY = {
    "cook_cabbage": ("diced__head_cabbage.n.01", "diced__chili.n.01"),
    "make_pizza": ("diced__vidalia_onion.n.01", "half__mushroom.n.01"),
}
# Its words are those that the README shows: of every can the same is to be seen, however many there are.
UNCOUNTED = {"picking_up_trash"}
# Of two sandals its goal wants the first beside the bed, and nobody can tell which that is: only one order is tried.
WHICH_MATTERS = {"tidying_bedroom"}

every_task = pytest.mark.parametrize("task", TASKS)


house, catalogue = cache(load_house), cache(load_catalogue)


@cache
def call_of(description: str) -> SkillCall | None:
    return match(description, SKILLS)


@cache
def plan_of(task: str) -> Plan:
    return load_plan(paths.shipped() / "tasks" / "plans" / f"{task}.json")


@cache
def problem_of(task: str) -> BddlProblem:
    """The problem, with what is made on the way, and each room with a floor: things can be laid there in any case."""
    problem = load_problem(task)
    made = {f"{synset}_1": synset for synset in ON_THE_WAY.get(task, ())}
    later = tuple(Fact(Literal("future", (name,))) for name in made)
    problem = replace(problem, objects={**problem.objects, **made}, init=(*problem.init, *later))
    floored = {room for thing, room in problem.rooms.items() if problem.objects[thing] in FLOORS}
    bare = sorted(set(problem.rooms.values()) - floored)
    more = {f"floor_{room}": "floor.n.01" for room in bare}
    there = tuple(Fact(Literal("inroom", (f"floor_{room}", room)), True) for room in bare)
    return replace(problem, objects={**problem.objects, **more}, init=(*problem.init, *there))


@cache
def called(task: str) -> dict[str, tuple[str, ...]]:
    """Each thing of a problem to its names: its synset's words, and what the catalogue or our house calls it."""
    problem, names = problem_of(task), {}
    fixtures = house().fixtures.values()
    for thing, synset in problem.objects.items():
        if synset == AGENT:
            continue
        words = synset.split(".")[0].replace("_", " ")
        room = problem.rooms.get(thing)
        if room is None:
            more = [phrase for entry in catalogue() if entry.synset == synset for phrase in entry.phrases]
        else:
            here = [f.entry for f in fixtures if f.room == room and f.entry.synset == synset]
            more = [phrase for entry in here for phrase in entry.phrases]
            more += [f"{normalize(room)} {words}"] if synset in FLOORS else []
        names[thing] = tuple(dict.fromkeys((normalize(words), *more, *ALSO_CALLED.get(synset, ()))))
    return names


def openable() -> set[str]:
    return {*LIDS, *(entry.synset for entry in catalogue() if "openable" in entry.abilities)}


def test_every_task_of_the_challenge_has_a_plan() -> None:
    """There are fifty, each in a file of its task's name, with an instruction."""
    assert len(TASKS) == 50
    assert [plan_of(task).task_name for task in TASKS] == TASKS
    assert all(plan_of(task).instruction for task in TASKS)


@every_task
def test_a_plan_is_of_the_tasks_instruction(task: str) -> None:
    """Word for word: a policy that is told the whole instruction knows by it what to do."""
    assert plan_of(task).instruction == load_task(task).instruction


@every_task
def test_the_check_finds_nothing_in_a_plan(task: str) -> None:
    """Criteria are states, hands are free when they are needed, and nothing comes before the first drive."""
    assert plan_problems(plan_of(task), SKILLS) == []


@every_task
def test_a_plan_compiles(task: str) -> None:
    """Its tree survives its file and has no fault, but that some prompts name no skill: those that the plan has."""
    plan = plan_of(task)
    tree = parse_tree(dump_tree(compile_plan(plan, SKILLS)))
    faults = [*lint(tree, SKILLS), *check_rooms(tree, house().rooms)]
    assert {fault.code for fault in faults} <= {"no-skill"}
    assert len(faults) == sum(call_of(s.description) is None for s in plan.segments if isinstance(s, Manipulation))


@every_task
def test_prompts_come_apart_as_they_were_joined(task: str) -> None:
    """The clauses of a plan's joined descriptions are its descriptions."""
    said = [s.description for s in plan_of(task).segments if isinstance(s, Manipulation)]
    assert clauses(", then ".join(said), SKILLS) == said


@every_task
def test_a_plan_names_what_its_problem_has(task: str) -> None:
    """Rooms are those that :init names; targets and what skills are done to, with and at, are its things."""
    plan, problem = plan_of(task), problem_of(task)
    rooms = {normalize(room) for room in problem.rooms.values()}
    vocabulary = Vocabulary(called(task))
    for segment in plan.segments:
        if isinstance(segment, Navigation):
            assert normalize(segment.room or "") in rooms
            assert segment.target in rooms or vocabulary.named(segment.target), segment.target
            assert f" {segment.target}" in segment.description, "it goes elsewhere than its target"
        elif call := call_of(segment.description):
            for slot in ("object", "container", "surface", "target", "source", "tool"):
                if slot in call.arguments:
                    assert vocabulary.named(call.arguments[slot]), f"{segment.description!r}: {slot}"


@every_task
def test_criteria_of_skills_are_those_that_checkers_read(task: str) -> None:
    """What a skill ends in is told in the small language, of things that are called so; what is poured may be dice."""
    for segment in plan_of(task).segments:
        if not isinstance(segment, Manipulation):
            continue
        call = call_of(segment.description)
        if call is None or call.skill.name == "pour":
            continue
        criterion = criteria.parse(segment.completion_criterion)
        assert criterion is not None, segment.completion_criterion
        assert criteria.named(criterion.subject, called(task)), segment.completion_criterion
        assert not criterion.object or criteria.named(criterion.object, called(task)), segment.completion_criterion


def unmet(task: str, plan: Plan, backward: bool = False) -> list[str]:
    """What the goal wants of what is checked and a plan does not bring about. Raises CannotBe."""
    problem = problem_of(task)
    run = SymbolicRun(problem, called(task), openable(), backward)
    run.run(plan, call_of, task in UNCOUNTED)
    unknown = NOT_CHECKED.get(task, set())
    wanted = [part for condition in problem.conditions if (part := without(condition, unknown)) is not None]
    return [str(part) for part in wanted if not holds(part, run.truth)]


@every_task
@pytest.mark.parametrize("backward", [False, True])
def test_a_plan_carried_out_on_paper_reaches_the_goal(task: str, backward: bool) -> None:
    """From :init, with two hands, closed doors and things in reach, and whichever of things that are alike is taken.

    Each criterion is false before its segment and true after it. At the end all holds that the goal wants, but for
    `NOT_CHECKED`.
    """
    assert unmet(task, plan_of(task), backward and task not in WHICH_MATTERS) == []


@pytest.mark.parametrize(
    "task", ["bringing_water", "outfit_a_basic_toolbox", "cleaning_up_plates_and_food", "moving_boxes_to_storage"]
)
def test_nothing_can_be_left_out(task: str) -> None:
    """Without any one of its manipulations a plan cannot be carried out, or misses its goal: paper is not patient."""
    plan = plan_of(task)
    for i, segment in enumerate(plan.segments):
        if isinstance(segment, Manipulation):
            rest = plan.model_copy(update={"segments": plan.segments[:i] + plan.segments[i + 1 :]})
            with contextlib.suppress(CannotBe):
                assert unmet(task, rest), segment.description


@pytest.mark.parametrize(
    ("number", "description", "why"),
    [
        (2, "turn on the fridge", "'the fridge is open' was False"),
        (3, "pick up a bottle from the fridge", "'a bottle is held in the left gripper' was False"),
        (4, "pick up the other bottle from the fridge with the left hand", "no hand is free"),
        (4, "close the fridge", "'a bottle is held in the right gripper' was False"),
        (6, "put the fridge on the coffee table with the left hand", "no 'fridge' is held"),
        (6, "put the bottle in the fridge with the left hand", "no 'fridge' is in reach"),
        (9, "open the fridge", "'the fridge is closed' was False"),
    ],
)
def test_what_cannot_be_is_refused(number: int, description: str, why: str) -> None:
    """The run on paper has two hands, and no arm that is longer than a room."""
    segments = list(plan_of("bringing_water").segments)
    segments[number - 1] = segments[number - 1].model_copy(update={"description": description})
    plan = plan_of("bringing_water").model_copy(update={"segments": tuple(segments)})
    with pytest.raises(CannotBe, match=why):
        unmet("bringing_water", plan)


def test_what_is_not_checked_is_listed() -> None:
    """Of every goal each literal is looked at, but for those predicates, all of which it has."""
    for task in TASKS:
        there = {literal.predicate for literal in literals(problem_of(task).goal)}
        assert there - KEPT.keys() <= NOT_CHECKED.get(task, set()) <= there, task


def test_the_document_tells_what_there_is() -> None:
    """Its table has the segments of every plan, those that name no skill, and what is not checked of its goal."""
    text = (Path(__file__).parent.parent / "docs" / "plans.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \| (\d+) \| (\d*) ?\| ([a-z_, ]*?) ?\|$", text, re.MULTILINE)
    told = {task: (int(drives), int(does), int(other or 0), unknown) for task, drives, does, other, unknown in rows}
    for task in TASKS:
        does = [s.description for s in plan_of(task).segments if isinstance(s, Manipulation)]
        other = sum(call_of(description) is None for description in does)
        drives = len(plan_of(task).segments) - len(does)
        assert told.get(task) == (drives, len(does), other, ", ".join(sorted(NOT_CHECKED.get(task, ())))), task
    assert len(rows) == len(TASKS)
