"""Leaves that do not need a robot, and the references to the blackboard that every leaf may have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from py_trees.common import Status

from mpvi_bt.behaviors.blackboard import Expectation, NoValue, value_of
from mpvi_bt.behaviors.parameters import Value
from mpvi_bt.behaviors.protocols import TriggerEvent
from mpvi_bt.robot.protocol import CONTROL_HZ
from tests.bench import HELD, Bench
from tests.test_behaviors import Chunks

values = st.booleans() | st.integers(-5, 5) | st.floats(-5, 5, width=16) | st.text("ab3$", max_size=3)
steps = st.integers(1, 200)


@given(count=steps, in_steps=st.booleans(), begun=st.integers(0, 50))
def test_wait_lasts_as_long_as_it_says(count: int, in_steps: bool, begun: int) -> None:
    """So many steps after it began, whenever that was, and whichever unit is used, it succeeds and not before."""
    duration = f"{count} steps" if in_steps else repr(count / CONTROL_HZ)
    bench = Bench(f"wait: {duration}")
    for _ in range(begun):
        bench.world.step(bench.world.robot.action)
    assert bench.run() == Status.SUCCESS
    assert bench.world.steps == begun + count + 1
    state = bench.tree.states()["wait"]
    assert state.elapsed_s == pytest.approx(count / CONTROL_HZ)
    assert state.limit_s == pytest.approx(count / CONTROL_HZ)


def test_set_and_test_share_the_runs_blackboard() -> None:
    """What set leaves is what test sees, in this run and in no other."""
    root = "sequence: s\nmemory: true\nchildren: [{set: cups, value: 2}, {set: cups, add: 1}, {test: cups, equals: 3}]"
    one, other = Bench(root), Bench("test: cups")
    assert one.run() == Status.SUCCESS
    assert one.context.blackboard == {"cups": 3}
    assert type(one.context.blackboard["cups"]) is int
    assert other.run() == Status.FAILURE


@pytest.mark.parametrize(
    ("before", "add", "after"),
    [({}, 2, 2), ({"k": 1}, -1, 0), ({"k": 1}, 0.5, 1.5), ({"k": 0.5}, 1, 1.5)],
)
def test_add_counts(before: Mapping[str, Value], add: float, after: float) -> None:
    """A key without a value counts as 0; whole numbers stay whole."""
    bench = Bench(f"set: k\nadd: {add}", None, **before)
    assert bench.run() == Status.SUCCESS
    assert bench.context.blackboard["k"] == after
    assert type(bench.context.blackboard["k"]) is type(after)


@pytest.mark.parametrize(
    ("parameters", "board", "reason", "evidence"),
    [
        ("at_least: 3", {"cups": 1}, "test_false", "cups is 1, not >= 3"),
        ("at_most: 3", {"cups": 3.5}, "test_false", "cups is 3.5, not <= 3"),
        ("equals: kitchen", {"cups": "sofa"}, "test_false", 'cups is "sofa", not "kitchen"'),
        ("equals: 3", {"cups": "3"}, "test_false", 'cups is "3", not 3'),
        ("equals: true", {"cups": 1}, "test_false", "cups is 1, not true"),
        ("not_equals: 1", {"cups": 1.0}, "test_false", "cups is 1, not != 1"),
        ("equals: $other", {"cups": 1, "other": 2}, "test_false", "cups is 1, not 2"),
        ("at_least: 1\nat_most: 2", {"cups": 3}, "test_false", "cups is 3, not <= 2"),
        ("", {}, "test_false", "cups has no value"),
        ("at_least: 3", {}, "no_value", "cups has no value"),
        ("not_equals: 3", {}, "no_value", "cups has no value"),
        ("equals: $other", {"cups": 1}, "no_value", "the blackboard has no value for 'other'"),
        ("at_least: 3", {"cups": "many"}, "wrong_type", 'cups is "many", not a number that could be >= 3'),
        ("at_most: 3", {"cups": True}, "wrong_type", "cups is true, not a number that could be <= 3"),
    ],
)
def test_a_test_says_why_it_is_false(parameters: str, board: dict[str, Value], reason: str, evidence: str) -> None:
    """The failure tells what the value is and what it should be; nothing that can be compared is no exception."""
    bench = Bench(f"test: cups\n{parameters}", None, **board)
    assert bench.run() == Status.FAILURE
    assert (bench.failure.reason, bench.failure.evidence, bench.failure.path) == (reason, evidence, "test")


@given(value=values, wanted=values, least=st.integers(-5, 5), most=st.integers(-5, 5))
def test_a_comparison_holds_exactly_when_all_of_it_does(value: Value, wanted: Value, least: int, most: int) -> None:
    """Equal and not equal are opposites, bounds hold for numbers within, and what is said together holds together."""
    board = {"k": value}
    numeric = isinstance(value, int | float) and not isinstance(value, bool)

    def holds(**expected: Any) -> bool:
        return Expectation("k", **expected).unmet(board) is None

    if isinstance(wanted, str) and "$" in wanted:
        wanted = "plain"
    assert holds(equals=value) or (isinstance(value, str) and "$" in value)
    assert holds(equals=wanted) != holds(not_equals=wanted)
    assert holds(at_least=least) == (numeric and value >= least)  # type: ignore[operator]
    assert holds(at_most=most) == (numeric and value <= most)  # type: ignore[operator]
    together = holds(equals=wanted) and holds(at_least=least) and holds(at_most=most)
    assert holds(equals=wanted, at_least=least, at_most=most) == together
    assert Expectation("other", not_equals=wanted).unmet(board) is not None


@pytest.mark.parametrize(("value", "shown"), [("many", '"many"'), (True, "true")])
def test_only_numbers_can_be_added_to(value: Value, shown: str) -> None:
    """Text and truth are no numbers; the value stays."""
    bench = Bench("set: k\nadd: 1", k=value)
    assert bench.run() == Status.FAILURE
    assert (bench.failure.reason, bench.failure.evidence) == ("wrong_type", f"k is {shown}, not a number to add to")
    assert bench.context.blackboard["k"] is value


def test_steps_are_counted_and_seconds_are_read() -> None:
    """A clock whose steps take a tenth of a second shows which of the two a duration is."""

    class SlowClock:
        steps = 0

        @property
        def time_s(self) -> float:
            return self.steps / 10

    for duration, last in (("30 steps", 30), ("1.0", 10)):
        bench = Bench(f"wait: {duration}")
        clock = bench.context.clock = SlowClock()
        while bench.tick() == Status.RUNNING:
            clock.steps += 1
        assert clock.steps == last


def test_say_shows_its_text_with_the_values_filled_in() -> None:
    """References are filled in each time it begins; two dollar signs are one."""
    bench = Bench('say: "found $cups of ${all} cups in $place, for $$1: $ok"', cups=1, all=2.5, place="sofa", ok=True)
    assert bench.run() == Status.SUCCESS
    assert bench.node("say").feedback_message == "found 1 of 2.5 cups in sofa, for $1: true"
    bench.context.blackboard["cups"] = 2
    assert bench.run() == Status.SUCCESS
    assert bench.node("say").feedback_message.startswith("found 2 of")


def test_set_copies_a_value_as_it_is() -> None:
    """A text that is nothing but a reference stands for the value; within a text it becomes text."""
    bench = Bench("set: copy\nvalue: $cups", cups=3)
    bench.run()
    assert bench.context.blackboard["copy"] == 3
    assert value_of("${cups}", {"cups": 3}) == 3
    assert value_of("$cups cups", {"cups": 3}) == "3 cups"
    with pytest.raises(NoValue):
        value_of("$cups", {})


def test_navigate_goes_where_the_blackboard_says() -> None:
    """Target and room are filled in when it begins."""
    bench = Bench("navigate: $place\nroom: the $room", place="cup", room="kitchen")
    asked = []
    start = bench.context.navigator.start
    bench.context.navigator.start = lambda target, room: (asked.append((target, room)), start(target, room))[1]  # type: ignore[method-assign, func-returns-value]
    assert bench.run() == Status.SUCCESS
    assert asked == [("cup", "the kitchen")]


def test_manipulate_and_check_complete_are_told_the_values() -> None:
    """Prompt and criterion are filled in when they begin."""
    root = "until_complete:\nchildren: [{manipulate: pick up the $thing}, {check_complete: the $thing is held}]"
    bench = Bench(root, {"the cup is held": (True,)}, thing="cup")
    policy = bench.context.policy = Chunks(100)
    bench.context.triggers.update = lambda: TriggerEvent("grasp", None)  # type: ignore[method-assign]
    assert bench.run() == Status.SUCCESS
    assert policy.prompts == ["pick up the cup"]
    assert bench.context.log.queries[0].criterion == "the cup is held"


@pytest.mark.parametrize(
    "root",
    [
        "navigate: $gone",
        "{navigate: cup, room: $gone}",
        "manipulate: pick up the $gone",
        "check_complete: the $gone is held",
        "say: the $gone",
        "{set: k, value: $gone}",
        "{test: k, equals: $gone}",
        "{condition: k, equals: $gone, child: {succeed: }}",
    ],
)
def test_a_reference_to_nothing_fails_the_node(root: str) -> None:
    """A key without a value is a failure of the node that refers to it, and names the key; the robot holds."""
    bench = Bench(root, k=1)
    assert bench.run() == Status.FAILURE
    assert bench.failure.reason == "no_value"
    assert "'gone'" in bench.failure.evidence
    assert not bench.base.any()


def test_succeed_and_fail_do_so_at_once() -> None:
    """They end at the first tick; fail carries the reason it was given."""
    bench = Bench("fail: not_today")
    assert Bench("succeed:").tick() == Status.SUCCESS
    assert Bench("fail:").tick() == Status.FAILURE
    assert bench.tick() == Status.FAILURE
    assert bench.failure.reason == "not_today"


@pytest.mark.parametrize(
    "root",
    ["wait: 1", "say: hello", "set: k\nvalue: 1", "test: k", "succeed:", "fail:"],
)
def test_leaves_without_a_robot_leave_its_command_alone(root: str) -> None:
    """Beside a leaf that drives, they neither stop it nor move anything, however they end."""
    bench = Bench(root, {HELD: (True,)})
    command = bench.world.robot.action
    command[0] = 0.25
    bench.world.robot.act(command)
    bench.tree.setup(bench.context)
    bench.tree.tick()
    bench.tree.interrupt()
    assert bench.world.robot.action[0] == 0.25


def test_a_number_does_not_grow_beyond_all_numbers() -> None:
    """Adding up to infinity fails instead, and the key keeps its value."""
    bench = Bench("sequence: s\nmemory: true\nchildren: [{set: x, value: 1.0e+308}, {set: x, add: 1.0e+308}]")
    assert bench.run() == Status.FAILURE
    failure = bench.tree.failure
    assert failure is not None
    assert failure.reason == "out_of_range"
    assert bench.context.blackboard == {"x": 1e308}


def test_numbers_in_texts_keep_their_digits() -> None:
    """What is said is what the key holds."""
    bench = Bench("sequence: s\nmemory: true\nchildren: [{set: x, value: 16777217.5}, {say: it is $x}]")
    assert bench.run() == Status.SUCCESS
    assert bench.node("say").feedback_message == "it is 16777217.5"
