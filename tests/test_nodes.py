"""What every node keeps to: a reason for each failure, and a path for each exception."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import py_trees
import pytest
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors import registry
from mpvi_bt.executive.behaviors.composites import Selector, Sequence
from mpvi_bt.executive.behaviors.context import Failure
from mpvi_bt.executive.behaviors.decorators import Retry, Subtree
from mpvi_bt.executive.behaviors.node import failure_of
from mpvi_bt.executive.behaviors.registry import NodeType, node_type, node_types
from mpvi_bt.executive.tree import reader, spec
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import NodeError, UserError
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.bench import Bench

RUNNING, SUCCESS, FAILURE, INVALID = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.INVALID


# ------------------------------------------------------------------------------------------ failures

FAILING = {  # an instance of each kind that fails in the end
    "sequence": "{sequence: , memory: true, children: [{succeed: }, {fail: x}]}",
    "selector": "{selector: , memory: false, children: [{fail: x}, {navigate: moon}]}",
    "parallel": "{parallel: , policy: success_on_all, children: [{wait: 9}, {fail: x}]}",
    "until_complete": "{until_complete: , children: [{fail: x}, {wait: 9}]}",
    "timeout": "{timeout: 1, child: {wait: 9}}",
    "monitor": "{monitor: pick, child: {fail: x}}",
    "retry": "{retry: 2, child: {fail: x}}",
    "repeat": "{repeat: 2, child: {fail: x}}",
    "invert": "{invert: , child: {succeed: }}",
    "condition": "{condition: gone, child: {succeed: }}",
    "cooldown": "{cooldown: 9, child: {fail: x}}",
    "navigate": "{navigate: moon}",
    "manipulate": "{manipulate: pick up the $gone}",
    "check_complete": "{check_complete: the $gone is held}",
    "posture": "{posture: travel}",
    "look_around": "{look_around: 90}",
    "say": "{say: the $gone}",
    "set": "{set: place, add: 1}",
    "test": "{test: gone}",
    "fail": "{fail: }",
}
NEVER = {"attempt", "wait", "succeed", "back_off"}
ELSEWHERE = {"subtree"}  # needs a second file: test_decorators


def test_every_kind_is_here() -> None:
    """A kind that is added to the registry has to keep these laws, too."""
    assert {*FAILING, *NEVER, *ELSEWHERE} == set(node_types())


@pytest.mark.parametrize("kind", FAILING)
def test_every_failure_has_a_reason_and_a_path(kind: str) -> None:
    """Whatever fails says why with a code, and whose failure it is; what stands above it passes that on."""
    for root in (FAILING[kind], f"{{sequence: , memory: false, children: [{FAILING[kind]}]}}"):
        bench = Bench(root, place="sofa")
        bench.world.robot.advance = lambda action: None  # type: ignore[method-assign]
        assert bench.run() == FAILURE
        for path, state in bench.tree.states().items():
            if state.status == "FAILURE":
                assert state.reason.isidentifier()
                assert state.origin.startswith(path)
        assert bench.failure.path in bench.tree.nodes
    assert bench.failure == bench.tree.nodes[bench.tree.spec.nodes[1].path].failure  # type: ignore[attr-defined]


def test_a_selector_tells_what_became_of_each_child() -> None:
    """All of them failed, and each for a reason of its own, those too that memory has passed over long ago."""
    slow = "[{navigate: moon}, {timeout: 3 steps, child: {wait: 9}}, {timeout: 2 steps, child: {wait: 9}}]"
    fast = "[{navigate: moon}, {test: gone}, {fail: x}]"
    for root, reasons in (
        (
            f"{{selector: s, memory: true, children: {slow}}}",
            "navigate: unknown_target, timeout: timeout, timeout#2: timeout",
        ),
        (f"{{selector: s, memory: false, children: {fast}}}", "navigate: unknown_target, test: test_false, fail: x"),
    ):
        bench = Bench(root)
        assert bench.run() == FAILURE
        assert (bench.failure.reason, bench.failure.path) == ("all_failed", "s")
        assert bench.failure.evidence == reasons
        assert bench.failure.cause == bench.node(bench.tree.spec.nodes[0].children[-1]).failure  # type: ignore[attr-defined]
    only = Bench("{selector: s, memory: true, children: [{fail: x}]}")
    assert only.run() == FAILURE
    assert (only.failure.reason, only.failure.path) == ("x", "s/fail")


@pytest.mark.parametrize(
    ("make", "reason", "evidence", "path"),
    [
        (lambda leaf: Sequence("n", [leaf], False), "failed", "no luck", "one"),
        (
            lambda leaf: Selector("n", [leaf, py_trees.behaviours.Failure("two")], True),
            "all_failed",
            "one: failed, two: failed",
            "here",
        ),
        (lambda leaf: Retry("n", leaf, 1), "out_of_tries", "1 failed, the last with failed: no luck", "here"),
        (lambda leaf: Subtree("n", py_trees.composites.Sequence("m", True, [leaf])), "failed", "no luck", "one"),
    ],
)
def test_nodes_of_others_fail_with_a_reason_too(
    make: Callable[[Behaviour], Any], reason: str, evidence: str, path: str
) -> None:
    """A node of plain py_trees gives no reason; it gets one, and its feedback is the evidence."""

    class Unlucky(Behaviour):
        def update(self) -> Status:
            self.feedback_message = "no luck"
            return FAILURE

    leaf = Unlucky("one")
    node = make(leaf)
    node.path = "here"
    node.setup(context=scripted_context(KinematicWorld(), {}, {}, {}))
    node.tick_once()
    assert node.failure == failure_of(node)
    assert (node.failure.reason, node.failure.evidence, node.failure.path) == (reason, evidence, path)
    assert failure_of(leaf) == Failure("failed", "no luck", "one", 0.0)


# ------------------------------------------------------------------------------------------ exceptions

AROUND = {
    "sequence": "{{sequence: , memory: true, children: [{{wait: 1 steps}}, {0}]}}",
    "selector": "{{selector: , memory: false, children: [{{fail: }}, {0}]}}",
    "parallel": "{{parallel: , policy: success_on_one, children: [{{navigate: cup}}, {0}]}}",
    "until_complete": "{{until_complete: , children: [{{navigate: cup}}, {0}]}}",
    "attempt": "{{attempt: , child: {0}}}",
    "timeout": "{{timeout: 9, child: {0}}}",
    "monitor": "{{monitor: pick, child: {0}}}",
    "retry": "{{retry: 2, child: {0}}}",
    "repeat": "{{repeat: 2, child: {0}}}",
    "invert": "{{invert: , child: {0}}}",
    "condition": "{{condition: place, child: {0}}}",
    "cooldown": "{{cooldown: 9, child: {0}}}",
}
LEAVES = {
    "navigate": "{navigate: cup}",
    "manipulate": "{manipulate: pick up the cup}",
    "check_complete": "{check_complete: the cup is held}",
    "back_off": "{back_off: }",
    "posture": "{posture: travel}",
    "look_around": "{look_around: }",
    "wait": "{wait: 1}",
    "say": "{say: hello}",
    "set": "{set: k, value: 1}",
    "test": "{test: place}",
    "succeed": "{succeed: }",
    "fail": "{fail: }",
}


def test_every_kind_is_here_as_well() -> None:
    """No composite, decorator or leaf is left out of the law of exceptions."""
    by_family = {family: {k for k, t in node_types().items() if t.family == family} for family in ("leaf",)}
    assert set(LEAVES) == by_family["leaf"]
    assert set(AROUND) == set(node_types()) - set(LEAVES) - ELSEWHERE


@pytest.mark.parametrize("leaf", LEAVES)
@pytest.mark.parametrize("around", AROUND)
def test_an_exception_in_any_leaf_names_it_and_stops_everything(around: str, leaf: str) -> None:
    """Wherever a leaf stands, what it raises comes out with its path; every node stops, and the robot holds."""
    bench = Bench(AROUND[around].format(LEAVES[leaf]), place="sofa")
    bench.tree.setup(bench.context)
    path, node = list(bench.tree.nodes.items())[-1]
    told: list[Status] = []
    terminate = node.terminate

    def ends(new_status: Status) -> None:
        told.append(new_status)
        terminate(new_status)

    def broken() -> Status:
        bench.world.robot.act(bench.world.robot.action + 0.1)
        raise ZeroDivisionError("broken")

    node.update = broken  # type: ignore[method-assign]
    node.terminate = ends  # type: ignore[method-assign]
    with pytest.raises(NodeError, match="ZeroDivisionError: broken") as caught:
        bench.run(10)
    assert caught.value.path == path
    assert all(n.status == INVALID for n in bench.tree.nodes.values())
    assert INVALID in told
    assert bench.tree.states()[path].feedback == "error: ZeroDivisionError('broken')"
    if getattr(node, "stops_robot", False):
        assert not bench.base.any()


def test_an_update_that_returns_nothing_is_an_error_of_its_node() -> None:
    """py_trees would go on with INVALID; here the node is named."""
    for root in ("{sequence: s, memory: true, children: [{succeed: }]}", "{invert: s, child: {succeed: }}"):
        bench = Bench(root)
        bench.node("succeed").update = lambda: None  # type: ignore[method-assign, assignment, return-value]
        with pytest.raises(
            NodeError,
            match=r"s/succeed: TypeError: update\(\) of Succeed returned None, not SUCCESS, FAILURE or RUNNING",
        ):
            bench.run()


@pytest.mark.parametrize("leaf", LEAVES)
def test_a_leaf_that_begins_again_forgets_the_last_round(leaf: str) -> None:
    """That it was cut off is told until it begins again; a failure likewise."""
    bench = Bench(LEAVES[leaf], place="sofa")
    ran = bench.tick() == RUNNING
    bench.tree.root.stop(INVALID)
    assert bench.tree.states()[leaf].interrupted == ran
    bench.tree.root.failure = Failure("old", "", "", 0.0)  # type: ignore[attr-defined]
    bench.tick()
    assert not bench.tree.root.interrupted  # type: ignore[attr-defined]
    failure = bench.tree.root.failure  # type: ignore[attr-defined]
    assert (failure and failure.path) == ("fail" if leaf == "fail" else None)


def test_a_failure_survives_json_with_what_caused_it() -> None:
    """A saved failure is the same one when it is read, causes included."""
    failure = Failure(
        "out_of_tries", "2 failed", "a", 1.5, Failure("all_failed", "", "a/b", 1.0, Failure("x", "y", "z", 0))
    )
    assert Failure.of(json.loads(json.dumps(dataclasses.asdict(failure)))) == failure


@pytest.mark.parametrize(
    ("factory", "said"),
    [
        ("no_such_module:Wave", "there is no module 'no_such_module'"),
        ("mpvi_bt.executive.behaviors.leaves:Wavin", "has no 'Wavin'. Did you mean 'Wait'?"),
        ("mpvi_bt.executive.behaviors.leaves:Succeed", "unexpected keyword argument 'text'"),
    ],
)
def test_a_class_that_does_not_fit_its_row_is_named(factory: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kind whose class is missing, or takes other parameters, is a user's error with the place in the tree."""
    wave = NodeType("wave", "leaf", node_type("say").parameters, "text", factory, "Waves.")
    monkeypatch.setattr(registry, "node_types", lambda: {"wave": wave})
    monkeypatch.setattr(spec, "node_types", registry.node_types)
    monkeypatch.setattr(reader, "node_types", registry.node_types)
    with pytest.raises(UserError) as caught:
        Tree(parse_tree("tree: t\nroot:\n  wave: at her\n", "t.yaml"))
    assert str(caught.value).startswith("t.yaml:3:3: node 'wave'")
    assert said in str(caught.value)


def test_stop_iteration_is_blamed_on_the_node_that_raised_it() -> None:
    """Python turns it into another error on the way up through the generators; the path is still the right one."""
    bench = Bench("sequence: s\nmemory: true\nchildren: [{timeout: 9, child: {say: hi}}]")
    bench.node("say").update = lambda: next(iter(()))  # type: ignore[method-assign]
    with pytest.raises(NodeError) as caught:
        bench.run()
    assert caught.value.path == "s/timeout/say"


def test_one_that_cannot_stop_does_not_keep_those_above_it_from_it() -> None:
    """After an interruption every node is INVALID, also above a leaf whose terminate always raises."""
    bench = Bench("sequence: s\nmemory: true\nchildren: [{timeout: 9, child: {wait: 5}}]")
    bench.run(2)

    def broken(new_status: Status) -> None:
        raise RuntimeError

    bench.node("wait").terminate = broken  # type: ignore[method-assign]
    bench.tree.interrupt()
    assert set(bench.tree.statuses()) == {INVALID}
