"""Laws of new plans by the symbolic planner: from what was done, felt and seen, to the same goal."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.executive.plan.history import History, SeenObject, Unit
from mpvi_bt.executive.plan.planners import NoPlan
from mpvi_bt.executive.plan.primitives import units
from mpvi_bt.executive.plan.schema import Navigation, Plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.rehearsal.done_so_far import world_so_far
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.rehearsing import task_start
from mpvi_bt.runs.symbolic.facts_so_far import facts_so_far
from mpvi_bt.runs.symbolic.goal_choice import choose_literals
from mpvi_bt.runs.symbolic.symbolic_planner import SymbolicPlanner, ends
from mpvi_bt.runs.symbolic.told_facts import told_facts
from tests.test_plans50 import plan_of

SKILLS = load_skills()
CAN, TRASH = "can of soda", load_task("picking_up_trash")
TWO_CANS = (
    "go to a can of soda",
    "pick up a can of soda with the right hand",
    "go to a can of soda",
    "pick up a can of soda with the left hand",
    "go to the trash can",
)
PUT = "put the can of soda in the trash can with the right hand"
LEFT_CAN = SeenObject(CAN, "kitchen", held=True)


def history(
    done: Sequence[str], failed: str, seen: Sequence[SeenObject] = (), full: tuple[str, ...] | None = None
) -> History:
    """Units that were done, and one that failed then."""
    return History((*map(Unit, done), Unit(failed, "timeout")), (), tuple(seen), full)


def placed(past: History, task: str = "picking_up_trash") -> dict[str, tuple[str, str]]:
    """Where the facts of a task say that things are then: thing to relation and place, or to "held" and hand."""
    loaded = load_task(task)
    told = facts_so_far(told_facts(loaded), world_so_far(SKILLS, task_start(loaded), past), past.seen)
    lies = {atom[1]: (atom[2], atom[3]) for atom in told.start if atom[0] == "placed"}
    held = {atom[1]: ("held", atom[2]) for atom in told.start if atom[0] == "held"}
    floors = {thing: f"floor of {room or 'no known room'}" for thing, room in told.problem.rooms.items()}
    return {thing: (relation, floors.get(place, place)) for thing, (relation, place) in {**lies, **held}.items()}


def cans(past: History) -> list[tuple[str, str]]:
    return sorted(where for thing, where in placed(past).items() if thing.startswith("can__"))


def planned(past: History) -> Plan:
    pytest.importorskip("unified_planning")
    start = task_start(TRASH)
    planner = SymbolicPlanner(TRASH, so_far=lambda known: world_so_far(SKILLS, start, known))
    return planner.ask("picking_up_trash", "", past).plan


def count(plan: Plan, beginning: str) -> int:
    return sum(segment.description.startswith(beginning) for segment in plan.segments)


def test_what_was_done_is_so_and_what_failed_is_not() -> None:
    """Two cans were taken, and the first could not be put down: both are held still."""
    held = [("held", "left"), ("held", "right"), ("ontop", "floor of living_room")]
    assert cans(history(TWO_CANS, PUT)) == held
    assert cans(history(TWO_CANS, PUT, full=("left", "right"))) == held
    put = history((*TWO_CANS, PUT), "go to a can of soda", full=("left",))
    assert cans(put) == [("held", "left"), ("inside", "ashcan.n.01_1"), ("ontop", "floor of living_room")]


def test_an_empty_hand_has_lost_its_payload() -> None:
    """It may be anywhere, for all that the robot knows."""
    lost = history(TWO_CANS, PUT, full=("left",))
    assert cans(lost) == [("held", "left"), ("ontop", "floor of living_room"), ("ontop", "floor of no known room")]


def test_a_lost_thing_is_where_one_more_such_thing_was_seen() -> None:
    """Not where another one was all the time: that one has a place on paper."""
    known = SeenObject(CAN, "living_room")
    here = history(TWO_CANS, PUT, [LEFT_CAN, SeenObject(CAN, "kitchen"), known], ("left",))
    assert cans(here) == [("held", "left"), ("ontop", "floor of kitchen"), ("ontop", "floor of living_room")]
    nowhere = history(TWO_CANS, PUT, [LEFT_CAN, known], ("left",))
    assert ("ontop", "floor of no known room") in cans(nowhere)
    inside = history(TWO_CANS, PUT, [LEFT_CAN, known, SeenObject(CAN, "kitchen", "trash can")], ("left",))
    assert ("inside", "ashcan.n.01_1") in cans(inside)


def test_each_place_that_was_seen_is_of_one_thing() -> None:
    """Of two cans that no hand holds any more one was put away, though the unit failed for the other."""
    third = ("go to a can of soda", "pick up a can of soda with the right hand", "go to the trash can")
    both = f"{PUT.replace('right', 'left')}, then {PUT}"
    away, fallen = SeenObject(CAN, "kitchen", "trash can"), SeenObject(CAN, "kitchen")
    for seen in ([away, away, fallen], [fallen, away, away]):
        past = history((*TWO_CANS, PUT, *third), both, seen, ())
        assert cans(past) == [*2 * [("inside", "ashcan.n.01_1")], ("ontop", "floor of kitchen")]


def test_a_full_hand_holds_what_is_seen_in_it() -> None:
    """A pick that was given up may have gone well."""
    taken = history(TWO_CANS[:1], TWO_CANS[1], [SeenObject(CAN, "living_room", held=True)], ("right",))
    assert cans(taken) == [("held", "right"), *2 * [("ontop", "floor of living_room")]]


def test_a_hand_that_took_again_had_lost_what_it_held() -> None:
    """The second new plan of an episode knows that the first one went back for the can."""
    units = (*map(Unit, TWO_CANS), Unit(PUT, "timeout"), *map(Unit, (TWO_CANS[0], TWO_CANS[1], TWO_CANS[4], PUT)))
    past = History((*units, Unit("go to a can of soda", "no_path")), (), (LEFT_CAN,), ("left",))
    assert cans(past).count(("inside", "ashcan.n.01_1")) == 1
    assert ("held", "left") in cans(past)


def test_what_was_opened_is_open_and_what_was_made_is_there() -> None:
    """Doors, and pieces of what was cut, which the criterion names."""
    fridge = world_so_far(SKILLS, task_start(load_task("bringing_water")), history(("open the fridge",), "close it"))
    assert [opened.partition(".")[0] for opened in fridge.open] == ["electric_refrigerator"]
    start, plan = task_start(load_task("chop_an_onion")), plan_of("chop_an_onion")
    done = tuple(Unit(s.description, criterion=s.completion_criterion) for s in plan.segments)
    cut = world_so_far(SKILLS, start, History((*done, Unit("wash the knife", "timeout"))))
    assert "vidalia_onion.n.01_1" in cut.gone
    assert {thing.partition(".")[0] for thing in start.later - cut.gone} == {"diced__vidalia_onion"}


@pytest.mark.parametrize("task", ["turning_on_radio", "bringing_water", "putting_shoes_on_rack", "cook_bacon"])
def test_nothing_of_a_plan_that_was_done_is_left_to_do(task: str) -> None:
    """By the facts as told then, each literal of the goal is so, and what was opened or turned on is not any more."""
    loaded, plan = load_task(task), plan_of(task)
    begun, start = told_facts(loaded), task_start(loaded)
    done = [[plan.segments[i] for i in unit] for unit in units(plan)]
    said = (Unit(", then ".join(s.description for s in u), criterion=u[-1].completion_criterion) for u in done)
    past = History((*said, Unit("look around", "timeout")))
    told = facts_so_far(begun, world_so_far(SKILLS, start, past), ())
    wanted = choose_literals(begun.problem.goal, lambda literal, so: 1.0)
    goal, never = ends(told, wanted, begun.start)
    assert sorted(goal - told.start) == sorted(never & told.start) == []


def test_a_new_plan_goes_back_for_a_can_that_was_lost() -> None:
    """It takes the lost can and the third one, puts all three away, and searches where no place is known."""
    plan = planned(history(TWO_CANS, PUT, [LEFT_CAN, SeenObject(CAN, "living_room")], ("left",)))
    assert (count(plan, "pick up a can"), count(plan, "put the can")) == (2, 3)
    assert plan.segments[-1].completion_criterion == "three cans of soda are in the trash can"
    drives = [s for s in plan.segments if isinstance(s, Navigation) and s.target == CAN]
    assert sorted(str(drive.room) for drive in drives) == ["None", "living room"]


def test_a_new_plan_drives_again_where_a_drive_failed() -> None:
    """With the cans in its hands still."""
    plan = planned(history(TWO_CANS[:4], TWO_CANS[4], [LEFT_CAN, LEFT_CAN], ("left", "right")))
    assert plan.segments[0].description == "go to the trash can"
    assert (count(plan, "pick up a can"), count(plan, "put the can")) == (1, 3)


def test_nothing_is_left_where_the_goal_is_met() -> None:
    """The last can could not be put away, but it is seen there."""
    third = ("go to a can of soda", "pick up a can of soda with the right hand", "go to the trash can")
    done = (*TWO_CANS, PUT, PUT.replace("right", "left"), *third)
    with pytest.raises(NoPlan) as error:
        planned(history(done, PUT, 3 * [SeenObject(CAN, "kitchen", "trash can")], ()))
    assert error.value.reason == "nothing_left"


def test_a_run_has_a_new_plan_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`mpvi run TASK --planner symbolic --on-failure replan`: the rest is planned anew, once."""
    pytest.importorskip("unified_planning")
    monkeypatch.chdir(tmp_path)
    Path("rules.yaml").write_text("substitute:\n  - {nodes: '*/4 */check_complete', fail: no_way, after: 1.0}\n")
    words = ["run", "picking_up_trash", "--dry", "--substitute", "rules.yaml", "--no-watch", "--out", "live", "--json"]
    assert run([*words, "--planner", "symbolic", "--on-failure", "replan"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [failure["reason"] for failure in result["failures"]] == ["no_way"]
    (replan,) = result["replans"]
    assert (replan["said"], replan["segments"]) == ("", 9)
