"""Decorators and guards: when they begin their child again, cut it off, or do not let it begin."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status

from mpvi_bt.executive.behaviors.parameters import Call
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from tests.bench import Bench

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE
DONE = {
    "s": Report(Progress.SUCCEEDED),
    "f": Report(Progress.FAILED, "no_path", "walls"),
    "r": Report(Progress.RUNNING),
}


class Scripted:
    """A navigator whose steps end as a text says: "r" running, "s" succeeded, "f" failed; the last for good."""

    def __init__(self, script: str) -> None:
        self.script = script
        self.starts = self.stops = self.steps = 0

    def start(self, target: str, room: str | None) -> None:
        self.starts += 1

    def step(self) -> Report:
        self.steps += 1
        return DONE[self.script[min(self.steps, len(self.script)) - 1]]

    def stop(self) -> None:
        self.stops += 1


def wrapped(decorator: str, script: str, **blackboard: Any) -> tuple[Bench, Scripted]:
    """A decorator around a leaf that ends as the script says."""
    bench = Bench(f"{decorator}\nchild: {{navigate: cup}}", **blackboard)
    navigator = bench.context.navigator = Scripted(script)
    return bench, navigator


@given(tries=st.integers(1, 5), failures=st.integers(0, 6))
def test_retry_begins_again_at_the_next_tick(tries: int, failures: int) -> None:
    """It succeeds if one of its tries does; each try is one beginning, and takes a tick of its own."""
    bench, navigator = wrapped(f"retry: {tries}", "f" * failures + "s")
    begun = []
    while bench.tick() == RUNNING:
        begun.append(navigator.starts)
        assert bench.node("navigate").status == FAILURE, "shown as failed until it begins again"
    begun.append(navigator.starts)
    assert bench.tree.status == (SUCCESS if failures < tries else FAILURE)
    assert begun == list(range(1, min(failures + 1, tries) + 1))


def test_retry_tells_of_the_last_failure_and_keeps_it() -> None:
    """Out of tries, it has its own reason, the words of the last failure, and that failure as its cause."""
    bench, _ = wrapped("retry: 3", "f")
    feedback = [bench.tree.root.feedback_message for _ in range(2) if bench.tick() == RUNNING]
    assert feedback == ["try 2 of 3, after no_path", "try 3 of 3, after no_path"]
    assert bench.tick() == FAILURE
    failure = bench.failure
    assert (failure.reason, failure.path) == ("out_of_tries", "retry")
    assert failure.evidence == "3 failed, the last with no_path: walls"
    assert failure.cause is not None
    assert (failure.cause.reason, failure.cause.path) == ("no_path", "retry/navigate")
    assert bench.tick() == RUNNING, "a new round has all its tries again"


@given(times=st.integers(1, 5), successes=st.integers(0, 6))
def test_repeat_counts_successes(times: int, successes: int) -> None:
    """It succeeds with the last of so many successes, and fails with the child's failure as soon as one comes first."""
    bench, navigator = wrapped(f"repeat: {times}", "s" * successes + "f")
    status = bench.run()
    assert status == (SUCCESS if successes >= times else FAILURE)
    assert navigator.starts == min(times, successes + 1)
    if status == FAILURE:
        assert (bench.failure.reason, bench.failure.path) == ("no_path", "repeat/navigate")


def test_invert_turns_both_round() -> None:
    """Success fails with a reason of its own, failure succeeds without one, and RUNNING stays."""
    bench, _ = wrapped("invert:", "rs")
    assert (bench.tick(), bench.tick()) == (RUNNING, FAILURE)
    assert (bench.failure.reason, bench.failure.path) == ("inverted", "invert")
    assert bench.failure.evidence == "navigate succeeded"
    bench, _ = wrapped("invert:", "f")
    assert bench.tick() == SUCCESS
    assert not bench.tree.states()["invert"].gave_up


@pytest.mark.parametrize("script", ["s", "f", "rs"])
def test_a_subtree_is_as_its_root(script: str) -> None:
    """The node that stands for another file changes nothing."""
    bench = Bench("navigate: cup")
    bench.tree = Tree(TreeSpec("t", NodeSpec("subtree", Call(tree="other"), children=(bench.tree.spec.root,))))
    bench.context.navigator = Scripted(script)
    for expected in script:
        assert bench.tick() == {"s": SUCCESS, "f": FAILURE, "r": RUNNING}[expected]
    assert (bench.tree.failure and bench.tree.failure.path) == ("subtree/navigate" if script == "f" else None)


def test_a_condition_is_checked_before_every_tick() -> None:
    """Once the key is no longer as it should be, the child is interrupted before it does anything more."""
    bench, navigator = wrapped("condition: door\nequals: open", "r", door="open")
    assert [bench.tick() for _ in range(3)] == [RUNNING] * 3
    bench.context.blackboard["door"] = "shut"
    assert bench.tick() == FAILURE
    assert navigator.steps == 3
    assert navigator.stops == 1
    states = bench.tree.states()
    assert states["condition/navigate"].interrupted
    assert (states["condition"].reason, states["condition"].evidence) == (
        "condition_false",
        'door is "shut", not "open"',
    )
    bench.context.blackboard["door"] = "open"
    assert bench.tick() == RUNNING
    assert navigator.starts == 2
    assert bench.tree.failure is None


def test_a_condition_without_a_value_never_begins() -> None:
    """A key that is not there has no value to compare; the child is left alone."""
    bench, navigator = wrapped("condition: cups\nat_least: 1", "s")
    assert bench.tick() == FAILURE
    assert (bench.failure.reason, navigator.starts) == ("no_value", 0)


@given(limit=st.integers(1, 40), in_steps=st.booleans(), work=st.integers(0, 5), cut=st.booleans())
def test_a_cooldown_counts_from_the_end_of_the_child(limit: int, in_steps: bool, work: int, cut: bool) -> None:
    """The first round is free; the next begins at the first tick that is so long after its end, however it ended."""
    text = f"{limit} steps" if in_steps else repr(limit / CONTROL_HZ)
    bench, navigator = wrapped(f"cooldown: {text}", "r" * work + "rs")
    for _ in range(work + 1):
        assert bench.tick() == RUNNING
    if cut:
        bench.tree.root.stop(Status.INVALID)
    else:
        assert bench.tick() == SUCCESS
    ended = bench.world.steps - (0 if cut else 1)
    while bench.tick() == FAILURE:
        assert bench.failure.reason == "cooling_down"
        assert navigator.starts == 1
    assert bench.world.steps - 1 == ended + limit
    assert navigator.starts == 2


def test_refusals_do_not_keep_a_cooldown_from_ending() -> None:
    """Asking too early, and being reset, does not start the rest anew."""
    bench, _ = wrapped("cooldown: 3 steps", "s")
    assert bench.tick() == SUCCESS
    bench.tree.root.stop(Status.INVALID)
    assert [bench.tick() for _ in range(3)] == [FAILURE, FAILURE, SUCCESS]


@given(limit=st.integers(1, 60))
def test_a_timeout_in_steps_is_one_in_seconds(limit: int) -> None:
    """90 steps are 3 seconds, shown as seconds."""
    ends = []
    for text in (f"{limit} steps", repr(limit / CONTROL_HZ)):
        bench, _ = wrapped(f"timeout: {text}", "r")
        assert bench.run() == FAILURE
        state = bench.tree.states()["timeout"]
        assert state.limit_s == pytest.approx(limit / CONTROL_HZ)
        ends.append((bench.world.steps, round(state.elapsed_s or 0, 6)))
    assert ends[0] == ends[1] == (limit + 1, round(limit / CONTROL_HZ, 6))


def test_a_timeout_passes_the_childs_own_failure_on() -> None:
    """A child that fails in time has the word."""
    bench, _ = wrapped("timeout: 3", "rf")
    assert bench.run() == FAILURE
    assert (bench.failure.reason, bench.failure.path) == ("no_path", "timeout/navigate")


ROOTS = [
    "timeout: 20 steps\nchild: {wait: 60 steps}",
    "timeout: 1\nchild: {wait: 60 steps}",
    "sequence: s\nmemory: true\nchildren: [{wait: 7 steps}, {say: a}, {wait: 9 steps}, {fail: late}]",
    "sequence: s\nmemory: false\nchildren: [{wait: 7 steps}, {wait: 9 steps}]",
    "retry: 4\nchild: {sequence: s, memory: true, children: [{wait: 5 steps}, {fail: x}]}",
    "repeat: 3\nchild: {sequence: s, memory: true, children: [{wait: 5 steps}, {set: k, add: 1}]}",
    "retry: 30\nchild: {cooldown: 11 steps, child: {invert: , child: {wait: 3 steps}}}",
    "retry: 30\nchild: {cooldown: 0.3, child: {timeout: 2 steps, child: {wait: 9 steps}}}",
    "selector: s\nmemory: true\nchildren: [{timeout: 3 steps, child: {wait: 9}}, {fail: b}, {wait: 6 steps}]",
    "selector: s\nmemory: true\nchildren: [{fail: a}, {timeout: 4 steps, child: {wait: 9}}]",
    "selector: s\nmemory: false\nchildren: [{fail: a}, {timeout: 4 steps, child: {wait: 9}}]",
    "parallel: p\npolicy: success_on_all\nchildren: [{wait: 4 steps}, {wait: 9 steps}, {attempt: t, child: {fail: x}}]",
    "parallel: p\npolicy: success_on_one\nchildren: [{wait: 14 steps}, {wait: 9 steps}]",
    "until_complete:\nchildren: [{wait: 4 steps}, {wait: 9 steps}]",
    "condition: go\nchild: {sequence: s, memory: true, children: [{wait: 5 steps}, {set: k, add: 1}, {wait: 5 steps}]}",
]


@pytest.mark.parametrize("root", ROOTS)
@settings(max_examples=15)
@given(at=st.integers(0, 30), later=st.integers(0, 100))
def test_a_tree_goes_on_from_its_state_as_if_it_had_not_stopped(root: str, at: int, later: int) -> None:
    """Statuses and declared states, through JSON, into another process whose clock shows another time: the same end."""
    first, second = Bench(root, go=1), Bench(root, go=1)
    first.tree.setup(first.context)
    second.tree.setup(second.context)
    for _ in range(at):
        first.tick()
    for _ in range(later):
        second.world.step()
    saved = json.loads(json.dumps([(n.status.value, n.ended, n.state()) for n in first.tree.nodes.values()]))  # type: ignore[attr-defined]
    for node, (status, ended, state) in zip(second.tree.nodes.values(), saved, strict=True):
        node.status, node.ended = Status(status), ended  # type: ignore[attr-defined]
        node.restore(state)  # type: ignore[attr-defined]
    second.context.blackboard.update(first.context.blackboard)
    for _ in range(40):
        assert [n.status for n in first.tree.nodes.values()] == [n.status for n in second.tree.nodes.values()]
        assert reasons(first) == reasons(second)
        assert first.context.blackboard == second.context.blackboard
        first.tick()
        second.tick()


def reasons(bench: Bench) -> list[tuple[str, str]]:
    """Of every node."""
    return [(state.reason, state.evidence) for state in bench.tree.states().values()]
