"""What failed is done once more at the end, with all that it needs, and nothing twice over."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.plan.history import History, Unit
from mpvi_bt.executive.plan.later import LaterPlanner
from mpvi_bt.executive.plan.planners import NoPlan, RecordedPlanner
from mpvi_bt.executive.plan.primitives import units
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context
from mpvi_bt.executive.ticking.loop import Outcome, run_episode
from mpvi_bt.executive.ticking.replanning import Replanner
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_plan, prompts_of
from mpvi_bt.executive.tree.substitute import check_rules, stand_ins
from mpvi_bt.ground.marked_yaml import parse_marked
from tests.test_replan import plan

SKILLS = load_skills()
PLANS = RecordedPlanner().all()


CHORES = (
    ("go to the fridge", "open the fridge"),
    ("go to the cup", "pick up the cup", "go to the fridge", "put the cup in the fridge"),
    ("go to the pan", "pick up the pan", "pick up the lid", "go to the bin", "put the pan in the bin",
     "put the lid in the bin"),
    ("go to the fridge", "close the fridge"),
    ("go to the book", "lift the book with both hands", "go to the shelf", "put the book on the shelf"),
)  # fmt: skip
TIDY = plan(*(said for chore in CHORES for said in chore))


def said_again(*failed: str) -> list[str]:
    """What is done once more after units that begin so have failed."""
    prompts = prompts_of(TIDY)
    numbers = [number for number, prompt in enumerate(prompts) if prompt.startswith(failed)]
    return [prompts[number] for number in LaterPlanner(TIDY, SKILLS).again(numbers)]


def test_a_dropped_thing_is_taken_again() -> None:
    """What was to be put somewhere is picked up first, and so is what was picked up along with it."""
    assert said_again("lift the book") == said_again("put the book") == said_again("go to the shelf") == list(CHORES[4])
    assert "pick up the pan, then pick up the lid" in said_again("put the cup", "put the pan")


def test_what_is_done_with_a_bin_in_hand_takes_the_bin_anew() -> None:
    """But not the other cans, which are in it."""
    bin_ = plan(
        "go to the bin", "pick up the bin with the left hand", "go to the can", "pick up the can",
        "put the can in the bin", "go to the egg", "pick up the egg", "put the egg in the bin",
    )  # fmt: skip
    assert LaterPlanner(bin_, SKILLS).again([5]) == [0, 1, 4, 5]


def test_what_was_open_meanwhile_is_opened_and_closed_again() -> None:
    """And what is opened anew is closed anew, once, whatever failed between."""
    for failed in (["put the cup"], ["put the cup", "go to the cup"], ["open the fridge", "put the cup"]):
        assert said_again(*failed) == [*CHORES[0], *CHORES[1], *CHORES[3]]
    assert said_again("open the fridge") == [*CHORES[0], *CHORES[3]]


@given(st.data())
def test_any_failures_of_any_plan_leave_a_plan(data: st.DataObject) -> None:
    """Each failed unit is in it, each unit once, in order; whatever follows what is left out begins with a drive."""
    whole = data.draw(st.sampled_from(PLANS))
    parts = list(units(whole))
    failed = data.draw(st.sets(st.integers(0, len(parts) - 1)))
    again = LaterPlanner(whole, SKILLS).again(failed)
    assert failed <= set(again)
    assert again == sorted(set(again))
    for before, unit in zip([-2, *again], again, strict=False):
        assert unit == before + 1 or whole.segments[parts[unit][0]].type == "navigation"


def test_what_is_to_come_comes_first() -> None:
    """The rest of the plan as it was, and what failed before stays put off when something else fails."""
    planner, prompts = LaterPlanner(TIDY, SKILLS), prompts_of(TIDY)
    done = [Unit(said) for said in prompts]
    cup, book = prompts.index("put the cup in the fridge"), prompts.index("put the book on the shelf")
    done[cup] = Unit(prompts[cup], "timeout")
    first = planner.ask("tidy", "", History(tuple(done[: cup + 1]))).plan
    assert prompts_of(first) == [*prompts[cup + 1 :], *CHORES[0], *CHORES[1], *CHORES[3]]
    done[book] = Unit(prompts[book], "timeout")
    both = planner.ask("tidy", "", History(tuple(done))).plan
    assert prompts_of(both) == [*CHORES[0], *CHORES[1], *CHORES[3], *CHORES[4]]
    with pytest.raises(NoPlan, match="it has been tried again"):
        planner.ask("tidy", "", History((*done, Unit("go to the fridge", "timeout"))))


def episode(*failing: str) -> tuple[Tree, Outcome]:
    """Run the plan; nodes that `failing` fit fail."""
    text = "substitute:\n" + "".join(f"  - {{nodes: '{glob}', fail: no_way, after: 1.0}}\n" for glob in failing)
    rules = check_rules(*parse_marked(text, "rules.yaml")) if failing else None
    tree = Tree(compile_plan(TIDY, SKILLS, "replan"), stand_ins(rules, dry=True))
    world = EmptyWorld()
    context = dry_context(world, tree, SKILLS)
    context.replanning = Replanner(LaterPlanner(TIDY, SKILLS), tree, context)
    return tree, run_episode(tree, world, context, [], 600.0)


def test_what_fails_again_is_given_up() -> None:
    """All else is done once; five things that fail are as good as one, as no model is asked."""
    tree, outcome = episode()
    assert (len(tree.spec.root.children), outcome.log.replans) == (len(prompts_of(TIDY)), [])
    tree, outcome = episode("*cup in the fridge/timeout/*")
    assert outcome.ending == "success"
    assert [failure.path.split("/")[1] for failure in outcome.log.failures] == [
        "6 put the cup in the fridge", "22 put the cup in the fridge",
    ]  # fmt: skip
    assert [(replan.segments, replan.said) for replan in outcome.log.replans] == [
        (20, ""), (None, "it has been tried again"),
    ]  # fmt: skip
    tree, outcome = episode("*put*/timeout/*", "*open*/timeout/*", "*lift*/timeout/*")
    assert outcome.ending == "success"
    assert len(tree.spec.root.children) == 2 * len(prompts_of(TIDY))
