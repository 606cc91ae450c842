"""Laws of rehearsal: what cannot be is told with its reason, and what may be is let pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

import mpvi_bt
from mpvi_bt.executive.plan.history import History, SeenObject, Unit
from mpvi_bt.executive.plan.schema import Plan, load_plan
from mpvi_bt.executive.plan.skill_effects import SkillEffects, SkillNeeds, Terms
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.rehearsal.known_start import KnownStart
from mpvi_bt.executive.rehearsal.rehearsal import Rehearsal
from mpvi_bt.ground import paths
from mpvi_bt.ground.human import human_stats
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.rehearsing import make_rehearsal

SKILLS = load_skills()
UNKNOWN = Rehearsal(SKILLS)
# Two bottles in a closed fridge of the kitchen, a table in the living room; the goal wants both bottles on the table
KITCHEN = KnownStart(
    called={"b1": ("bottle",), "b2": ("bottle",), "fridge": ("fridge",), "table": ("table",), "lamp": ("lamp",)},
    rooms={"fridge": "kitchen", "table": "living_room", "lamp": "living_room"},
    facts=(("inside", ("b1", "fridge")), ("inside", ("b2", "fridge"))),
    openable=frozenset({"fridge"}),
    room="kitchen",
    unmet=lambda truth, noun: [f"{b} is on the table" for b in ("b1", "b2") if not truth("ontop", (b, "table"))],
)
FETCH = (
    "go to the fridge",
    "open the fridge",
    "pick up a bottle from the fridge with the left hand",
    "pick up the other bottle from the fridge with the right hand",
    "close the fridge",
    "go to the table",
    "put the bottle on the table with the left hand",
    "put the bottle on the table with the right hand",
)
BOTH = (*FETCH[:4], *FETCH[5:])  # with the fridge left open: no hand is free to close it


def plan_of(*deeds: str) -> Plan:
    """A plan of these descriptions, whose criteria say nothing that is known."""
    segments = []
    for deed in deeds:
        more = {"type": "manipulation", "completion_criterion": "all is well"}
        if deed.startswith("go to the "):
            more = {"type": "navigation", "target": deed.removeprefix("go to the "), "completion_criterion": "there"}
        segments.append({"description": deed, **more})
    return Plan.model_validate({"task_name": "t", "segments": segments})


def found(rehearsal: Rehearsal, *deeds: str, history: History | None = None) -> list[tuple[str, str]]:
    """Codes of the problems, and where they are."""
    return [(p.code, p.pointer) for p in rehearsal.problems(plan_of(*deeds), history=history)]


def message(rehearsal: Rehearsal, *deeds: str) -> str:
    (problem,) = rehearsal.problems(plan_of(*deeds))
    return problem.message


def impossible(segment: int) -> list[tuple[str, str]]:
    return [("impossible", f"/segments/{segment}/description")]


@pytest.mark.parametrize("task", sorted(human_stats()))
def test_plans_on_file_give_no_finding(task: str) -> None:
    """A doable plan is never called impossible: neither with the facts of its task nor without any."""
    plan = load_plan(paths.shipped() / "tasks" / "plans" / f"{task}.json")
    assert make_rehearsal(SKILLS, load_task(task)).problems(plan) == []
    assert UNKNOWN.problems(plan) == []


def test_a_plan_that_works_gives_no_finding() -> None:
    """Two bottles, two hands, an open door and every thing in reach: nothing is to be told."""
    assert found(Rehearsal(SKILLS, KITCHEN), *BOTH) == []


def test_one_hand_holds_one_thing() -> None:
    """Two things cannot be taken in one go, in whatever words, and whatever is known."""
    for rehearsal in (Rehearsal(SKILLS, KITCHEN), UNKNOWN):
        deeds = (*FETCH[:2], "pick up both bottles from the fridge with the right hand")
        assert found(rehearsal, *deeds) == impossible(2)
        assert "one hand holds one thing: 'both bottles'" in message(rehearsal, *deeds)


def test_what_is_in_a_closed_container_cannot_be_taken() -> None:
    """The message names what is closed."""
    deeds = ("go to the fridge", "pick up a bottle from the fridge")
    assert found(Rehearsal(SKILLS, KITCHEN), *deeds) == impossible(1)
    assert "the fridge is closed" in message(Rehearsal(SKILLS, KITCHEN), *deeds)
    assert found(UNKNOWN, *deeds) == [], "nobody knows that it is closed"


def test_what_the_plan_has_closed_is_closed() -> None:
    """Without any facts a plan is held to what it says itself."""
    deeds = ("go to the box", "pick up the cup", "close the box", "put the cup in the box")
    assert found(UNKNOWN, *deeds) == impossible(3)
    assert "the box is closed" in message(UNKNOWN, *deeds)


def test_the_closed_one_is_the_one_that_is_closed() -> None:
    """Of two jars of which one was opened, in whatever word: "closed", "shut"."""
    jars = replace(
        KITCHEN,
        called={"j1": ("jar",), "j2": ("jar",)},
        rooms={},
        facts=(),
        openable=frozenset({"j1", "j2"}),
        unmet=lambda truth, noun: [],
    )
    for word in ("closed", "shut"):
        assert found(Rehearsal(SKILLS, jars), "go to the jar", "open a jar", f"open the {word} jar") == []
    assert found(Rehearsal(SKILLS, jars), "go to the jar", "open a jar", "open the open jar") == [
        ("pointless", "/segments/2/description")
    ]


def test_nothing_is_put_down_that_nothing_holds() -> None:
    """The message tells what is held instead."""
    deeds = ("go to the table", "put the bottle on the table")
    assert found(UNKNOWN, *deeds) == impossible(1)
    assert "nothing is held" in message(UNKNOWN, *deeds)
    other = (*FETCH[:3], "go to the table", "put the bottle on the table with the right hand")
    assert "the left hand holds the bottle" in message(Rehearsal(SKILLS, KITCHEN), *other)


def test_out_of_reach_is_told() -> None:
    """A thing in another room, or beside nothing that was driven to, has to be driven to first."""
    deeds = (*FETCH[:3], "put the bottle on the table")
    assert found(Rehearsal(SKILLS, KITCHEN), *deeds) == impossible(3)
    assert "go there first" in message(Rehearsal(SKILLS, KITCHEN), *deeds)


def test_what_is_on_a_bed_is_not_taken_from_beside_it() -> None:
    """Only the bed is next to the sandal. What is in a box under the bed is under the bed, too."""
    bedroom = KnownStart(
        called={thing: (thing,) for thing in ("bed", "book", "sandal", "box", "toy")},
        rooms={"bed": "bedroom"},
        facts=(
            ("ontop", ("book", "bed")),
            ("nextto", ("sandal", "bed")),
            ("under", ("box", "bed")),
            ("inside", ("toy", "box")),
        ),
        room="bedroom",
    )
    rehearsal = Rehearsal(SKILLS, bedroom)
    assert found(rehearsal, "go to the bed", "pick up the book from the sandal") == impossible(1)
    assert found(rehearsal, "go to the bed", "pick up the sandal from the bed", "pick up the toy from the bed") == []


def test_the_other_one_is_not_the_one_in_the_hand() -> None:
    """Of two that are alike, the second is laid beside the first."""
    lay = "put the bottle under the table"
    deeds = (*FETCH[:4], FETCH[5], f"{lay} with the right hand", f"{lay} beside the other bottle with the left hand")
    assert found(Rehearsal(SKILLS, replace(KITCHEN, unmet=KnownStart().unmet)), *deeds) == []


def test_furniture_nearby_is_in_doubt() -> None:
    """Side by side, one may be in reach from the other: nobody knows where on them the things are."""
    deeds = (*FETCH[:3], "put the bottle on the lamp")
    for adjoining in (frozenset[tuple[str, str]](), frozenset({("fridge", "lamp")})):
        rehearsal = Rehearsal(SKILLS, replace(KITCHEN, adjoining=adjoining, unmet=KnownStart().unmet))
        (problem,) = rehearsal.problems(plan_of(*deeds))
        code = "far" if adjoining else "impossible"
        assert (problem.code, problem.severity, problem.pointer) == (code, "warning", "/segments/3/description")
        assert problem.message.startswith("perhaps ") == (code == "far")


def test_a_drive_to_what_is_in_a_hand_goes_nowhere() -> None:
    """The robot stays where it was."""
    deeds = (*FETCH[:3], "go to the bottle", "put the bottle on the table")
    one = replace(KITCHEN, facts=KITCHEN.facts[:1], called={k: v for k, v in KITCHEN.called.items() if k != "b2"})
    told = [("pointless", "/segments/3/description"), *impossible(4)]
    assert found(Rehearsal(SKILLS, one), *deeds) == told
    assert found(Rehearsal(SKILLS, KITCHEN), *deeds) == impossible(4), "there is another one in the fridge"
    assert found(UNKNOWN, *deeds) == [], "nobody knows that there is no other"


def test_what_changes_nothing_is_pointless() -> None:
    """Opening what is open can be done and is not needed."""
    deeds = (*FETCH[:2], "open the fridge", *BOTH[2:])
    assert found(Rehearsal(SKILLS, KITCHEN), *deeds) == [("pointless", "/segments/2/description")]


def test_unmet_conditions_of_the_goal_are_told() -> None:
    """Each with its own words, and only those that are not so."""
    deeds = (*FETCH[:3], "go to the table", "put the bottle on the table")
    assert found(Rehearsal(SKILLS, KITCHEN), *deeds) == [("goal-unmet", "/segments")]
    told = message(Rehearsal(SKILLS, KITCHEN), *deeds)
    assert ("b1 is on the table" in told) != ("b2 is on the table" in told)


@pytest.mark.parametrize(
    ("deeds", "reason"),
    [
        (["go to the icebox", "pick up the bottle"], "the icebox is closed, and the bottle is in it: open it first"),
        (["pick up the bottle"], "the refrigerator is closed, and the bottle is in it: open it first"),
        (["go to the oven", "turn on the oven"], "the oven is open, and it can be turned on only while it is closed: "
         "close it first"),
        (["go to the table", "put the bottle on the table"], "nothing is held: pick up 'bottle' first"),
        (["go to the oven", "put the cup in the oven"], "no hand holds 'cup': the left hand holds the pan"),
        (["go to the oven", "put the cup in the oven with the right hand"], "the right hand does not hold 'cup': the "
         "left hand holds the pan"),
        (["go to the oven", "lift the cup with both hands"], "both hands have to be free, and the left one holds the "
         "pan"),
        (["open the oven"], "no 'oven' is in reach, and the robot is in the kitchen: go there first"),
        (["go to the table", "open the oven"], "no 'oven' is in reach, and the robot is at the table: go there first"),
        (["go to the table", "open the table"], "no 'table' has a door or a lid"),
    ],
)  # fmt: skip
def test_reasons_are_in_the_words_of_the_plan(deeds: Sequence[str], reason: str) -> None:
    """A thing is called what the plan called it last; before that, what its entry calls it first."""
    start = KnownStart(
        called={"b": ("bottle",), "f": ("refrigerator", "icebox"), "o": ("oven",), "t": ("table",), "cup": ("cup",)},
        rooms={"f": "kitchen", "o": "kitchen", "t": "hall"},
        facts=(("inside", ("b", "f")), ("open", ("o",))),
        openable=frozenset({"f", "o"}),
        closed_only=frozenset({"o"}),
        room="kitchen",
    )
    if "holds the pan" in reason:
        start = replace(start, called={**start.called, "pan": ("pan",)}, held=("pan",))
    assert message(Rehearsal(SKILLS, start), *deeds).endswith(f" cannot be done: {reason}")


def test_a_criterion_that_fails_right_after_its_segment_is_impossible() -> None:
    """The place is that of the criterion."""
    plan = plan_of(*BOTH)
    wrong = plan.segments[1].model_copy(update={"completion_criterion": "the fridge is closed"})
    plan = plan.model_copy(update={"segments": (plan.segments[0], wrong, *plan.segments[2:])})
    (problem,) = Rehearsal(SKILLS, KITCHEN).problems(plan)
    assert (problem.code, problem.pointer) == ("impossible", "/segments/1/completion_criterion")


def test_unknown_words_pass() -> None:
    """A thing that nothing is called may be anywhere."""
    assert found(Rehearsal(SKILLS, KITCHEN), *BOTH, "go to the gizmo", "pick up the gizmo") == []


def test_unknown_deeds_pass_with_a_remark() -> None:
    """Nobody knows how things are after a deed that no skill does: the rest is not rehearsed, and no warning."""
    deeds = ("go to the fridge", "juggle the bottles", "put the bottle on the table")
    problems = Rehearsal(SKILLS, KITCHEN).problems(plan_of(*deeds))
    assert [(p.code, p.severity, p.pointer) for p in problems] == [("not-rehearsed", "note", "/segments/1/description")]


def test_words_that_no_skill_reads_are_noted_with_the_nearest_verb() -> None:
    """Their criterion says what comes of them, and the rest is rehearsed; whose hands are ours is told of the slip."""
    plan = plan_of("go to the fridge", "putt the bottle on the table")
    slip = plan.segments[1].model_copy(update={"completion_criterion": "the bottle is on the table"})
    (note,) = Rehearsal(SKILLS, replace(KITCHEN, unmet=lambda truth, noun: [])).problems(
        plan.model_copy(update={"segments": (plan.segments[0], slip)})
    )
    assert (note.code, note.severity, note.pointer) == ("no-skill", "note", "/segments/1/description")
    assert "Did you mean 'put" in note.message


def test_a_skill_without_effects_ends_the_rehearsal() -> None:
    """What it does nobody knows; its criterion is not called impossible."""
    silent = SKILLS | {"press": SKILLS["press"].model_copy(update={"effects": SkillEffects()})}
    deeds = ("go to the lamp", "turn on the lamp", "put the bottle on the table")
    assert found(Rehearsal(silent, KITCHEN), *deeds) == [("not-rehearsed", "/segments/1/description")]


@pytest.mark.parametrize("first", ["b1", "b2"])
def test_whichever_of_like_things_is_meant(first: str) -> None:
    """Where only one order of things that are alike reaches the goal, the plan may have meant that one."""
    one = KnownStart(
        called=KITCHEN.called,
        rooms=KITCHEN.rooms,
        facts=(("ontop", ("b1", "table")), ("ontop", ("b2", "table"))),
        unmet=lambda truth, noun: [] if truth("nextto", (first, "lamp")) else ["it is beside the lamp"],
    )
    assert found(Rehearsal(SKILLS, one), "go to the table", "pick up a bottle", "go to the lamp",
                 "put the bottle next to the lamp") == []  # fmt: skip


@pytest.mark.parametrize(
    ("deeds", "fails"),
    [
        (["pick up the cup with the left hand", "pick up the can with the right hand"], None),
        (["pick up the cup with the left hand", "pick up the can with the left hand"], 2),
        (["pick up the cup with the left hand", "pick up the can"], None),
        (["pick up the cup", "pick up the can", "pick up the bowl"], 3),
        (["pick up the cup", "pick up the can", "put the cup on the table", "pick up the bowl"], None),
        (["pick up the cup", "put the cup on the table", "lift the box with both hands"], None),
        (["pick up the cup", "lift the box with both hands"], 2),
        (["lift the box with both hands", "pick up the cup"], 2),
        (["lift the box with both hands", "put the box on the table", "pick up the cup"], None),
        (["pick up the cup", "dance", "lift the box with both hands"], None),
        (["pick up the cup", "put the mug on the table", "lift the box with both hands"], None),
        (["pick up the cup with the left hand", "hand the cup over to the right hand", "open the box with the left "
          "hand"], None),
        (["pick up a candle with the left hand", "pick up a candle with the right hand", "put a candle on the table "
          "with the left hand", "pick up the cup with the right hand"], 4),
        (["pick up the cup", "pick up the can", "open the box"], 3),
    ],
)  # fmt: skip
def test_hands_that_cannot_be_free_are_told(deeds: Sequence[str], fails: int | None) -> None:
    """What is certain of the hands is told without any facts."""
    told = [p for p in UNKNOWN.problems(plan_of("go to the sofa", *deeds)) if p.severity == "warning"]
    assert [(p.code, p.pointer) for p in told] == (impossible(fails) if fails else [])


def test_a_robot_of_one_hand_has_one() -> None:
    """The hands come from the robot."""
    lame = Rehearsal(SKILLS, KnownStart(hands=("right",)))
    assert found(lame, "go to the sofa", "pick up the cup", "pick up the can") == impossible(2)


def test_amid_an_episode_only_payloads_are_certain() -> None:
    """A plan for the rest is held to what the hands hold, and else to what it says itself."""
    rehearsal = UNKNOWN
    full = History((Unit("x", "no_path"),), (), (SeenObject("cup", held=True), SeenObject("can", held=True)))
    half = History((Unit("x", "no_path"),), (), (SeenObject("cup", held=True), SeenObject("bottle")))
    deeds = ("go to the fridge", "pick up a bottle from the fridge")
    assert found(rehearsal, *deeds, history=full) == impossible(1)
    assert found(rehearsal, *deeds, history=half) == []
    for side in ("left", "right"):
        assert found(rehearsal, "go to the table", f"put the can on the table with the {side} hand", history=full) == []
        assert found(rehearsal, "go to the table", f"put the jar on the table with the {side} hand", history=half) == []
    one_hand = [f"pick up a {thing} with the left hand" for thing in ("bottle", "jar")]
    assert found(rehearsal, "go to the fridge", *one_hand, history=half) == impossible(2)


@pytest.mark.parametrize(
    ("terms", "told", "why"),
    [
        (SkillEffects, {"open": "object", "closed": "object"}, "closed and open at once"),
        (SkillEffects, {"held": "object", "inside": ("object", "container")}, "held and inside at once"),
        (SkillEffects, {"inside": ("object", "container"), "ontop": ("object", "surface")}, "inside and ontop at once"),
        (SkillEffects, {"clean": "target", "sprayed": "target"}, "clean and sprayed at once"),
        (SkillEffects, {"ontop": ("object", "object")}, "cannot be its own place"),
        (SkillNeeds, {"open": ("object",), "closed": ("object",)}, "open and closed at once"),
        (SkillNeeds, {"hands": 2, "held": ("object",)}, "both hands have to be free"),
    ],
)
def test_terms_that_exclude_each_other_are_an_error(terms: type[Terms], told: dict[str, object], why: str) -> None:
    """Of one thing; or of both hands."""
    with pytest.raises(ValidationError, match=why):
        terms.model_validate(told)


@pytest.mark.parametrize(
    ("needs", "effects", "why"),
    [
        ("{open: [object]}", "{open: object}", "is open before"),
        ("{held: [object]}", "{held: object}", "is held before"),
        ("{near: [surface]}", "{ontop: [object, surface]}", "lets go of 'object'"),
    ],
)
def test_effects_that_contradict_the_needs_are_an_error(tmp_path: Path, needs: str, effects: str, why: str) -> None:
    """The check says so at their place in the file."""
    text = "name: shove\nabout: Shove.\nphrases: ['shove {object} onto {surface}']\ntimeout_s: 9\n"
    text += f"triggers: [{{event: rest, camera: head}}]\nneeds: {needs}\neffects: {effects}\n"
    (tmp_path / "shove.yaml").write_text(text)
    (problem,) = mpvi_bt.check(tmp_path / "shove.yaml")
    assert (problem.severity, problem.line) == ("error", 7)
    assert why in problem.message


def test_amid_an_episode_the_rest_is_in_doubt() -> None:
    """With the task's facts: by what was done, and what failed to be."""
    rehearsal = Rehearsal(SKILLS, KITCHEN)
    opened = History((*map(Unit, FETCH[:3]), Unit(FETCH[3], "no_grasp")), full=("left",))
    shut = History((Unit(FETCH[0]), Unit(FETCH[1], "no_handle")), full=())
    assert found(rehearsal, *BOTH[3:], history=opened) == []
    assert found(rehearsal, *BOTH[4:6], history=opened) == [("doubtful", "/segments")], "one bottle is left"
    assert found(rehearsal, *BOTH[1:], history=shut) == []
    (problem,) = rehearsal.problems(plan_of(*BOTH[2:]), history=shut)
    assert (problem.code, problem.severity, problem.pointer) == ("doubtful", "warning", "/segments/0/description")
    assert problem.message.startswith("perhaps ")
    assert "the fridge is closed" in problem.message
