"""Trees as XML of BehaviorTree.CPP 4, and back.

With BTCPP_CHECKER set to the program built from tests/btcpp, the real BehaviorTree.CPP reads what is exported and ticks
it beside ours; docs/btcpp.md says how to build it.
"""

from __future__ import annotations

import dataclasses
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt import paths
from mpvi_bt.behaviors.registry import Assignment, Comparison, NavigateTo, node_types
from mpvi_bt.errors import FileProblems
from mpvi_bt.tree import btcpp
from mpvi_bt.tree.btcpp_export import to_xml
from mpvi_bt.tree.btcpp_import import from_xml
from mpvi_bt.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.tree.yaml_io import dump_tree, load_tree, parse_tree
from tests.tree_strategies import _above, leaves, numbers, trees, words

CHECKER = os.environ.get("BTCPP_CHECKER", "")
SHIPPED = sorted((paths.shipped() / "trees").rglob("*.yaml"))
real = pytest.mark.skipif(not CHECKER, reason="BTCPP_CHECKER names no checker built from tests/btcpp")


def exported(tree: TreeSpec) -> str:
    try:
        return to_xml(tree).xml
    except FileProblems as error:
        assert {p.code for p in error.problems} <= {"btcpp-reference", "btcpp-character"}
        assume(False)
        raise


# Keys with a value from the start, of each type, so that scripts are written too.
FIRST: dict[str, Any] = {"cups": 0, "ratio": 0.5, "seen": False, "place": "sofa", "other": "hall"}
_of_type = {
    "cups": st.integers(-99, 99) | st.floats(-9, 9),
    "ratio": st.floats(-9, 9),
    "seen": st.booleans(),
    "place": words | st.just("$other"),
    "other": words | st.just("it's"),
}
_assignments = st.sampled_from(sorted(_of_type)).flatmap(
    lambda key: st.builds(Assignment, key=st.just(key), value=_of_type[key] | st.just(1))
) | st.builds(Assignment, key=st.sampled_from(["cups", "ratio"]), add=numbers)
_comparisons = st.sampled_from(sorted(_of_type)).flatmap(
    lambda key: st.builds(
        Comparison,
        key=st.just(key),
        equals=st.none() | _of_type[key],
        not_equals=st.none() | _of_type[key],
        at_least=st.none() | numbers,
        at_most=st.none() | numbers,
    )
)
_scripted = st.builds(NodeSpec, st.just("set"), _assignments) | st.builds(NodeSpec, st.just("test"), _comparisons)
_guarded = st.builds(NodeSpec, st.just("condition"), _comparisons, children=st.tuples(leaves))
scripted_trees = st.builds(
    TreeSpec, words, st.recursive(leaves | _scripted | _guarded, _above, max_leaves=10), blackboard=st.just(FIRST)
)


@given(trees | scripted_trees)
def test_a_tree_survives_the_way_there_and_back(tree: TreeSpec) -> None:
    """What is exported is imported as the same tree: nodes, parameters and their types, names, segments, first values."""
    assert from_xml(exported(tree)).main == tree


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_trees_that_come_with_the_package_survive_too(path: Path) -> None:
    """Their parameters filled in and their calls without arguments, they come back node for node."""
    tree = load_tree(path)
    back = from_xml(to_xml(tree).xml).main
    assert [(n.depth, n.spec.kind) for n in back.nodes] == [(n.depth, n.spec.kind) for n in tree.nodes]
    for one, other in zip(back.nodes, tree.nodes, strict=True):
        assert one.spec.kind == "subtree" or one.spec.parameters == other.spec.parameters
        assert (one.spec.name, one.spec.segments) == (other.spec.name, other.spec.segments)
