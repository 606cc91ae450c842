"""Our nodes beside py_trees' own: the same statuses, calls and order, in no more time."""

from __future__ import annotations

import importlib.util
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

from mpvi_bt.executive.behaviors.composites import Parallel, Selector, Sequence, UntilComplete
from mpvi_bt.executive.behaviors.decorators import Invert, Repeat, Retry, Subtree
from mpvi_bt.executive.behaviors.guards import Condition
from mpvi_bt.executive.behaviors.node import Leaf, failure_of
from mpvi_bt.testing import KinematicWorld, scripted_context

RUNNING, SUCCESS, FAILURE, INVALID = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.INVALID
Script = list[Status]  # of each tick, again from its beginning when it is used up


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
                assert node.interrupted == (node.log[-1:] == ["terminate RUNNING -> INVALID"])
        clock.ticks += 1
    # Ours is terminated once a round: not again when one that has ended, or never began, is reset.
    again = {f"terminate {ended.name} -> INVALID" for ended in (SUCCESS, FAILURE, INVALID)}
    logs = [[n.log for n in nodes if isinstance(n, Scripted | Twin)] for nodes in (mine, twins)]
    assert logs[0] == [[call for call in log if call not in again] for log in logs[1]]


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
    mine, theirs = ticking.alternating([tree.tick, twin.tick_once], rounds=75, ticks=4)
    assert ticking.ratio(mine, theirs) <= 1.15
    twins = list(walk(twin))
    assert [n.status for n in tree.nodes.values()] == [n.status for n in twins]


def test_tracing_adds_little_to_a_tick(ticking: ModuleType, tmp_path: Path) -> None:
    """What the recorder looks at where nothing changes is a few hundredths of a tick, with room for a busy machine."""
    root = ticking.reactive(23)
    plain, traced = ticking.ticker(root, 0), ticking.ticker(root, 0, trace=tmp_path / "trace.jsonl")
    bare, written = ticking.alternating([plain, traced], rounds=75, ticks=4)
    assert ticking.ratio(written, bare) <= 1.15
    assert (tmp_path / "trace.jsonl").stat().st_size > 0
