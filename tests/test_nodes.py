"""What every node keeps to: py_trees' semantics, a reason for each failure, a path for each exception."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import py_trees
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from mpvi_bt.behaviors.composites import Parallel, Selector, Sequence, UntilComplete
from mpvi_bt.behaviors.context import Failure
from mpvi_bt.behaviors.decorators import Invert, Repeat, Retry, Subtree
from mpvi_bt.behaviors.guards import Condition
from mpvi_bt.behaviors.node import Leaf, failure_of
from mpvi_bt.behaviors.registry import node_types
from mpvi_bt.errors import NodeError
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.bench import Bench

RUNNING, SUCCESS, FAILURE, INVALID = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.INVALID
Script = list[Status]  # of each tick, again from its beginning when it is used up


# ------------------------------------------------------------------------------------------ as py_trees'


class Scripted(Leaf):
    """Its statuses are a script over the ticks of the whole tree."""

    stops_robot = False

    def __init__(self, script: Script, clock: Clock) -> None:
        super().__init__("leaf")
        self.script, self.clock = script, clock
        self.log: list[str] = []

    def initialise(self) -> None:
        super().initialise()
        self.log.append("initialise")

    def update(self) -> Status:
        status = self.script[self.clock.ticks % len(self.script)]
        return self.fail("scripted", "") if status == FAILURE else status

    def terminate(self, new_status: Status) -> None:
        self.log.append(f"terminate {self.status.name} -> {new_status.name}")


class Twin(Behaviour):
    """The same for py_trees."""

    def __init__(self, script: Script, clock: Clock) -> None:
        super().__init__("leaf")
        self.script, self.clock = script, clock
        self.log: list[str] = []

    def initialise(self) -> None:
        self.log.append("initialise")

    def update(self) -> Status:
        return self.script[self.clock.ticks % len(self.script)]

    def terminate(self, new_status: Status) -> None:
        self.log.append(f"terminate {self.status.name} -> {new_status.name}")


class Clock:
    """How often the trees were ticked."""

    ticks = 0


Plan = tuple[Any, ...]  # ("kind", parameters..., children...)
scripts = st.lists(st.sampled_from([RUNNING, SUCCESS, FAILURE]), min_size=1, max_size=6).map(lambda s: ("leaf", s))


def _with_children(plans: st.SearchStrategy[Plan]) -> st.SearchStrategy[Plan]:
    several = st.lists(plans, min_size=1, max_size=4)
    counts = st.integers(1, 3)
    gates = st.lists(st.booleans(), min_size=1, max_size=6)
    return st.one_of(
        st.tuples(st.just("sequence"), st.booleans(), several),
        st.tuples(st.just("selector"), st.booleans(), several),
        st.tuples(st.just("parallel"), st.sampled_from(["success_on_all", "success_on_one"]), several),
        st.tuples(st.just("until_complete"), st.none(), st.lists(plans, min_size=2, max_size=4)),
        st.tuples(st.just("retry"), counts, plans.map(lambda p: [p])),
        st.tuples(st.just("repeat"), counts, plans.map(lambda p: [p])),
        st.tuples(st.just("invert"), st.none(), plans.map(lambda p: [p])),
        st.tuples(st.just("subtree"), st.none(), plans.map(lambda p: [p])),
        st.tuples(st.just("condition"), gates, plans.map(lambda p: [p])),
    )


plans: st.SearchStrategy[Plan] = st.recursive(scripts, _with_children, max_leaves=12)


class Gate(Condition):
    """A condition whose key is looked up in a script."""

    def __init__(self, child: Behaviour, open_at: list[bool], clock: Clock) -> None:
        super().__init__("gate", child, "gate", equals=True)
        self.open_at, self.clock = open_at, clock

    def refusal(self) -> tuple[str, str] | None:
        self.context.blackboard["gate"] = self.open_at[self.clock.ticks % len(self.open_at)]
        return super().refusal()


def ours(plan: Plan, clock: Clock) -> Behaviour:
    """The plan in our nodes."""
    if plan[0] == "leaf":
        return Scripted(plan[1], clock)
    kind, given_, below = plan
    children = [ours(child, clock) for child in below]
    makers: dict[str, Callable[[], Behaviour]] = {
        "sequence": lambda: Sequence("n", children, given_),
        "selector": lambda: Selector("n", children, given_),
        "parallel": lambda: Parallel("n", children, given_),
        "until_complete": lambda: UntilComplete("n", children),
        "retry": lambda: Retry("n", children[0], given_),
        "repeat": lambda: Repeat("n", children[0], given_),
        "invert": lambda: Invert("n", children[0]),
        "subtree": lambda: Subtree("n", children[0]),
        "condition": lambda: Gate(children[0], given_, clock),
    }
    return makers[kind]()


def theirs(plan: Plan, clock: Clock) -> Behaviour:
    """The plan in py_trees' nodes."""
    if plan[0] == "leaf":
        return Twin(plan[1], clock)
    kind, given_, below = plan
    children = [theirs(child, clock) for child in below]
    all_, one = ParallelPolicy.SuccessOnAll(synchronise=True), ParallelPolicy.SuccessOnOne()
    last = ParallelPolicy.SuccessOnSelected(children=children[-1:], synchronise=True)
    decorators = py_trees.decorators
    makers: dict[str, Callable[[], Behaviour]] = {
        "sequence": lambda: py_trees.composites.Sequence("n", given_, children),
        "selector": lambda: py_trees.composites.Selector("n", given_, children),
        "parallel": lambda: py_trees.composites.Parallel("n", all_ if given_ == "success_on_all" else one, children),
        "until_complete": lambda: py_trees.composites.Parallel("n", last, children),
        "retry": lambda: decorators.Retry("n", children[0], given_),
        "repeat": lambda: decorators.Repeat("n", children[0], given_),
        "invert": lambda: decorators.Inverter("n", children[0]),
        "subtree": lambda: decorators.PassThrough("n", children[0]),
        "condition": lambda: decorators.EternalGuard("n", children[0], lambda: given_[clock.ticks % len(given_)]),
    }
    return makers[kind]()


def walk(node: Behaviour) -> Iterator[Behaviour]:
    """Parents before children."""
    yield node
    for child in node.children:
        yield from walk(child)


def tip(nodes: list[Behaviour]) -> int | None:
    """Which one the root's tip is."""
    found = nodes[0].tip()
    return None if found is None else nodes.index(found)


@settings(max_examples=300)
@given(plan=plans, cuts=st.lists(st.booleans(), min_size=12, max_size=12))
def test_statuses_are_those_of_py_trees(plan: Plan, cuts: list[bool]) -> None:
    """Random trees and their twins, interrupted now and then: every status, every call of a leaf, the order of nodes.

    And the failed ones say why, those that were cut off say so, and every node that changed was ticked or reset.
    """
    clock = Clock()
    one, other = ours(plan, clock), theirs(plan, clock)
    mine, twins = list(walk(one)), list(walk(other))
    resets: list[Behaviour] = []
    context = scripted_context(KinematicWorld(), {}, {}, {})
    for number, node in enumerate(mine):
        node.setup(context=context)
        vars(node).update(path=f"{number}", resets=resets)
    for cut in cuts:
        before = [node.status for node in mine]
        resets.clear()
        if cut:
            one.stop(INVALID)
            other.stop(INVALID)
            ticked = []
        else:
            ticked = list(one.tick())
            assert [mine.index(n) for n in ticked] == [twins.index(n) for n in other.tick()]
        assert [n.status for n in mine] == [n.status for n in twins]
        assert tip(mine) == tip(twins)
        changed = {n for n, was in zip(mine, before, strict=True) if n.status != was}
        assert changed <= {*ticked, *resets}
        for node in mine:
            failure = node.failure  # type: ignore[attr-defined]
            assert node.status != FAILURE or (failure is not None and failure == failure_of(node))
            assert node.status != SUCCESS or failure is None
            assert not (node in ticked and node.status != INVALID and node.interrupted)  # type: ignore[attr-defined]
            if isinstance(node, Scripted):
                calls = [call for call in node.log if call != "terminate INVALID -> INVALID"]
                assert node.interrupted == (calls[-1:] == ["terminate RUNNING -> INVALID"])
        clock.ticks += 1
    logs = [[n.log for n in nodes if isinstance(n, Scripted | Twin)] for nodes in (mine, twins)]
    assert logs[0] == logs[1]


# ------------------------------------------------------------------------------------------ failures

FAILING = {  # an instance of each kind that fails in the end
    "sequence": "{sequence: , memory: true, children: [{succeed: }, {fail: x}]}",
    "selector": "{selector: , memory: false, children: [{fail: x}, {navigate: moon}]}",
    "parallel": "{parallel: , policy: success_on_all, children: [{wait: 9}, {fail: x}]}",
    "until_complete": "{until_complete: , children: [{fail: x}, {wait: 9}]}",
    "timeout": "{timeout: 1, child: {wait: 9}}",
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
NEVER = {"attempt", "wait", "succeed"}
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
    ("make", "reason"),
    [
        (lambda leaf: Sequence("n", [leaf], False), "failed"),
        (lambda leaf: Selector("n", [leaf, py_trees.behaviours.Failure("two")], True), "all_failed"),
        (lambda leaf: Retry("n", leaf, 1), "out_of_tries"),
        (lambda leaf: Subtree("n", py_trees.composites.Sequence("m", True, [leaf])), "failed"),
    ],
)
def test_nodes_of_others_fail_with_a_reason_too(make: Callable[[Behaviour], Any], reason: str) -> None:
    """A node of plain py_trees gives no reason; it gets one, and its feedback is the evidence."""
    leaf = py_trees.behaviours.Failure("one")
    node = make(leaf)
    node.setup(context=scripted_context(KinematicWorld(), {}, {}, {}))
    node.tick_once()
    assert node.failure.reason == reason
    assert leaf.feedback_message in (failure_of(leaf) or node.failure).evidence
    assert node.failure.path or reason != "failed"


# ------------------------------------------------------------------------------------------ exceptions

AROUND = {
    "sequence": "{{sequence: , memory: true, children: [{{wait: 1 steps}}, {0}]}}",
    "selector": "{{selector: , memory: false, children: [{{fail: }}, {0}]}}",
    "parallel": "{{parallel: , policy: success_on_one, children: [{{navigate: cup}}, {0}]}}",
    "until_complete": "{{until_complete: , children: [{{navigate: cup}}, {0}]}}",
    "attempt": "{{attempt: , child: {0}}}",
    "timeout": "{{timeout: 9, child: {0}}}",
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
        with pytest.raises(NodeError, match=r"s/succeed: TypeError: update\(\) of Succeed returned None, not a Status"):
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
    assert leaf == "fail" or bench.tree.root.failure is None  # type: ignore[attr-defined]


def test_a_failure_survives_json_with_what_caused_it() -> None:
    """A saved failure is the same one when it is read, causes included."""
    failure = Failure(
        "out_of_tries", "2 failed", "a", 1.5, Failure("all_failed", "", "a/b", 1.0, Failure("x", "y", "z", 0))
    )
    assert Failure.of(json.loads(json.dumps(dataclasses.asdict(failure)))) == failure


# ------------------------------------------------------------------------------------------ speed


@pytest.fixture(scope="module")
def ticking() -> ModuleType:
    """The benchmark."""
    path = Path(__file__).parents[1] / "benchmarks" / "ticking.py"
    spec = importlib.util.spec_from_file_location("ticking", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_tick_takes_no_longer_than_py_trees_own(ticking: ModuleType) -> None:
    """300 reactive nodes beside the least that one could write for py_trees, with room for a busy machine."""
    root = ticking.reactive(23)
    tree, twin = ticking.ours(root), ticking.twin(root, ticking.LeastCheck)
    assert len(tree.nodes) == 300
    mine, theirs = ticking.alternating([tree.tick, twin.tick_once], rounds=15, ticks=4)
    assert ticking.ratio(mine, theirs) <= 1.15
    twins = list(walk(twin))
    assert [n.status for n in tree.nodes.values()] == [n.status for n in twins]


def test_tracing_adds_little_to_a_tick(ticking: ModuleType, tmp_path: Path) -> None:
    """What the recorder looks at where nothing changes is a few hundredths of a tick, with room for a busy machine."""
    root = ticking.reactive(23)
    plain, traced = ticking.ticker(root, 0), ticking.ticker(root, 0, trace=tmp_path / "trace.jsonl")
    bare, written = ticking.alternating([plain, traced], rounds=15, ticks=4)
    assert ticking.ratio(written, bare) <= 1.15
    assert (tmp_path / "trace.jsonl").stat().st_size > 0
