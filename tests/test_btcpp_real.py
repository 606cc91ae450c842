"""The real BehaviorTree.CPP reads what is exported, and ticks it beside ours.

BTCPP_CHECKER names the program built from tests/btcpp; docs/btcpp.md says how. Without it these tests are skipped.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.parameters import NavigateTo
from mpvi_bt.executive.btcpp import mapping
from mpvi_bt.executive.btcpp.export import to_xml
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.test_btcpp import BROKEN, DEEPEST, SHIPPED, exported, node, scripted_trees
from tests.tree_strategies import trees

CHECKER = os.environ.get("BTCPP_CHECKER", "")
pytestmark = pytest.mark.skipif(not CHECKER, reason="BTCPP_CHECKER names no program built from tests/btcpp")


class Scripted(Behaviour):
    """A leaf that plays what its text says, as the stubs of tests/btcpp/parse.cpp do, and logs it as they do."""

    def __init__(self, text: str, log: list[str]) -> None:
        self.label, _, letters = text.partition(":")
        super().__init__(self.label)
        self.rounds, self.log = letters.split("|"), log
        self.round = self.at = 0

    def initialise(self) -> None:
        self.round, self.at = self.round + 1, 0

    def update(self) -> Status:
        letters = self.rounds[min(self.round, len(self.rounds)) - 1]
        letter = letters[min(self.at, len(letters) - 1)]
        self.at += 1
        self.log.append(f"  {self.label} {letter}")
        return {"S": Status.SUCCESS, "F": Status.FAILURE, "R": Status.RUNNING}[letter]

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self.status is Status.RUNNING:
            self.log.append(f"  {self.label} halted")


def ours(spec: TreeSpec, ticks: int) -> list[str]:
    """What every leaf did and the root returned, tick by tick."""
    log: list[str] = []

    def scripted(placed: Placed, make: Callable[[], Behaviour]) -> Behaviour:
        parameters = placed.spec.parameters
        return Scripted(parameters.target, log) if isinstance(parameters, NavigateTo) else make()

    context = scripted_context(KinematicWorld(), {}, {}, {})
    context.blackboard.update(spec.blackboard)
    tree = Tree(spec, scripted)
    tree.setup(context)
    for number in range(1, ticks + 1):
        log.append(f"tick {number}")
        log.append(f"-> {tree.tick().name}")
    return log


def theirs(xml: str, tmp_path: Path, ticks: int) -> list[str]:
    """The same of BehaviorTree.CPP."""
    (tmp_path / "tree.xml").write_text(xml, encoding="utf-8")
    done = subprocess.run(
        [CHECKER, str(tmp_path / "tree.xml"), "--ticks", str(ticks)], capture_output=True, text=True, check=False
    )
    return [*done.stdout.partition("end\n")[0].splitlines(), *done.stderr.splitlines()]


def first_round(log: list[str]) -> list[str]:
    """Up to where the root ends, with what happens within a tick in a fixed order."""
    ticks: list[list[str]] = []
    for line in log:
        if line.startswith("tick"):
            ticks.append([])
        ticks[-1].append(line)
    ended = next((i for i, lines in enumerate(ticks) if lines[-1] != "-> RUNNING"), len(ticks))
    return [line for lines in ticks[: ended + 1] for line in [*lines[:1], *sorted(lines[1:-1]), lines[-1]]]


def numbered(spec: NodeSpec, count: Iterator[int]) -> NodeSpec:
    """The same with leaves told apart."""
    parameters = spec.parameters
    if isinstance(parameters, NavigateTo):
        parameters = NavigateTo(target=f"leaf{next(count)}:{parameters.target}")
    children = tuple(numbered(child, count) for child in spec.children)
    return dataclasses.replace(spec, parameters=parameters, children=children)


_letters = st.text("SFR", min_size=1, max_size=3)
_leaf = st.lists(_letters, min_size=1, max_size=2).map("|".join).map(lambda t: node("navigate", target=t))
_written = st.integers(0, 2).map(lambda n: node("set", key="cups", value=n)) | st.just(node("set", key="cups", add=1.0))
_asked: st.SearchStrategy[dict[str, Any]] = st.integers(0, 2).flatmap(
    lambda n: st.sampled_from(
        [{"equals": n}, {"not_equals": n}, {"at_least": float(n)}, {"at_most": float(n)}, {"at_least": n - 0.5}]
    )
)


def _grown(inner: st.SearchStrategy[NodeSpec]) -> st.SearchStrategy[NodeSpec]:
    many = st.lists(inner, min_size=1, max_size=3).map(tuple)
    kinds = st.sampled_from([("sequence", True), ("sequence", False), ("selector", True), ("selector", False)])
    return st.one_of(
        st.builds(lambda kind, below: node(kind[0], *below, memory=kind[1]), kinds, many),
        st.builds(node, st.sampled_from(["invert", "attempt"]), inner),
        st.builds(lambda asked, below: node("condition", below, key="cups", **asked), _asked, inner),
    )


_ticked = st.recursive(
    _leaf | _written | _asked.map(lambda asked: node("test", key="cups", **asked)) | st.just(node("succeed")),
    _grown,
    max_leaves=8,
)


@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(_ticked)
def test_btcpp_ticks_a_tree_as_we_do(tmp_path: Path, root: NodeSpec) -> None:
    """Tick by tick the same leaves are ticked, halted and answer the same, and so does the root, until it ends.

    Sequences and selectors with and without memory, invert, attempt, condition, test, set, succeed.
    """
    spec = TreeSpec("t", numbered(root, itertools.count()), blackboard={"cups": 0})
    xml = to_xml(spec).xml
    assert not set(mapping.own_kinds()).intersection(e.tag for e in ElementTree.fromstring(xml).iter()) - {"Navigate"}
    assert first_round(theirs(xml, tmp_path, 8)) == first_round(ours(spec, 8))


DIFFERENT = {
    "a child that ran begins again at once, there": (
        node("retry", node("navigate", target="a:RF|S"), tries=2),
        ["a R", "-> RUNNING", "a F", "a S", "-> SUCCESS"],
        ["a R", "-> RUNNING", "a F", "-> RUNNING", "a S", "-> SUCCESS"],
    ),
    "one that did not, at the next tick": (
        node("retry", node("navigate", target="a:F|S"), tries=2),
        ["a F", "-> RUNNING", "a S", "-> SUCCESS"],
        ["a F", "-> RUNNING", "a S", "-> SUCCESS"],
    ),
    "of repeat the same": (
        node("repeat", node("navigate", target="a:RS"), times=2),
        ["a R", "-> RUNNING", "a S", "a R", "-> RUNNING", "a S", "-> SUCCESS"],
        ["a R", "-> RUNNING", "a S", "-> RUNNING", "a R", "-> RUNNING", "a S", "-> SUCCESS"],
    ),
    "after a failure the others are not ticked": (
        node("parallel", *(node("navigate", target=t) for t in ("a:F", "b:S")), policy="success_on_all"),
        ["a F", "-> FAILURE"],
        ["a F", "b S", "-> FAILURE"],
    ),
    "all must succeed": (
        node("parallel", *(node("navigate", target=t) for t in ("a:RS", "b:S")), policy="success_on_all"),
        ["a R", "b S", "-> RUNNING", "a S", "-> SUCCESS"],
        ["a R", "b S", "-> RUNNING", "a S", "-> SUCCESS"],
    ),
    "the first to end settles it, there": (
        node("parallel", *(node("navigate", target=t) for t in ("a:S", "b:F")), policy="success_on_one"),
        ["a S", "-> SUCCESS"],
        ["a S", "b F", "-> FAILURE"],
    ),
}


@pytest.mark.parametrize("case", DIFFERENT)
def test_where_btcpp_differs_it_does_as_the_warnings_say(case: str, tmp_path: Path) -> None:
    """What a tick of retry, repeat and parallel does there and here."""
    root, there, here = DIFFERENT[case]
    spec = TreeSpec("t", root)
    for log, expected in ((theirs(to_xml(spec).xml, tmp_path, 4), there), (ours(spec, 4), here)):
        lines = [line.strip() for line in log if not line.startswith("tick")]
        assert lines[: len(expected)] == expected


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_btcpp_reads_every_tree_that_comes_with_the_package(path: Path, tmp_path: Path) -> None:
    """The real parser takes it, and sees as many nodes as the file holds with its subtrees written out."""
    file = tmp_path / "tree.xml"
    file.write_text(to_xml(load_tree(path)).xml, encoding="utf-8")
    trees = {tree.get("ID"): tree[0] for tree in ElementTree.parse(file).iter("BehaviorTree")}

    def size(element: ElementTree.Element) -> int:
        below = [trees[element.get("ID")]] if element.tag == "SubTree" else list(element)
        return 1 + sum(map(size, below))

    done = subprocess.run([CHECKER, str(file)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) - 2 == size(trees[path.stem])


@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(trees | scripted_trees)
def test_btcpp_reads_any_tree(tmp_path: Path, tree: TreeSpec) -> None:
    """The real parser takes whatever is exported, and the rules that these tests check without it agree."""
    (tmp_path / "tree.xml").write_text(exported(tree), encoding="utf-8")
    done = subprocess.run([CHECKER, str(tmp_path / "tree.xml")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(trees | scripted_trees)
def test_what_is_exported_fits_the_schema_that_btcpp_writes(tmp_path: Path, tree: TreeSpec) -> None:
    """It is valid by the XSD of their nodes and ours, descriptions aside, which that schema forgets."""
    etree = pytest.importorskip("lxml.etree")
    file = tmp_path / "tree.xml"
    file.write_text(exported(tree), encoding="utf-8")
    schema = subprocess.run([CHECKER, str(file), "--xsd"], capture_output=True, check=True).stdout
    document = etree.fromstring(file.read_bytes())
    for element in document.iter():
        element.attrib.pop("_description", None)
    etree.XMLSchema(etree.fromstring(schema)).assertValid(document)


@pytest.mark.parametrize(("before", "after", "rule"), BROKEN)
def test_btcpp_refuses_what_breaks_its_rules(before: str, after: str, rule: str, tmp_path: Path) -> None:
    """All but a format of 3 and a port without a value, which it passes over until that is read."""
    good = to_xml(load_tree(next(path for path in SHIPPED if path.stem == "hello"))).xml
    refused = bool(theirs(good.replace(before, after), tmp_path, 0))
    assert refused is (rule not in ("root", "needed"))


def test_btcpp_reads_the_deepest_tree_that_is_exported(tmp_path: Path) -> None:
    """It, too, bounds the depth; first values around the tree stay within that."""
    root = node("succeed")
    for _ in range(DEEPEST - 1):
        root = node("invert", root)
    xml = to_xml(TreeSpec("t", root, blackboard={"cups": 0})).xml
    assert theirs(xml, tmp_path, 0) == []
