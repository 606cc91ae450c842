"""Conditions in BehaviorTree.CPP's script ask here what they ask there."""

from __future__ import annotations

from html import escape
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from py_trees.common import Status

from mpvi_bt.executive.btcpp.condition_script import read_condition
from mpvi_bt.executive.btcpp.importing import from_xml
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.test_btcpp import SELECTOR, SEQUENCE, main_tree
from tests.test_btcpp_real import CHECKER, theirs

BOARD = {"cups": 2, "ratio": 0.5, "done": True, "open": False, "place": "hall"}
SET = "cups := 2; ratio := 0.5; done := true; open := false; place := 'hall'"


def xml(code: str) -> str:
    return main_tree(f'<Sequence><Script code="{SET}"/><ScriptCondition code="{escape(code)}"/></Sequence>')


def ours(code: str) -> bool:
    """Whether the condition holds here."""
    tree = Tree(from_xml(xml(code)).main)
    tree.setup(scripted_context(KinematicWorld(), {}, {}, {}))
    return tree.tick() is Status.SUCCESS


@pytest.mark.parametrize(
    ("code", "root"),
    [
        ("cups > 2", "test: cups, at_least: 2, not_equals: 2"),
        ("cups < 2.5", "test: cups, at_most: 2.5, not_equals: 2.5"),
        ("2 >= cups", "test: cups, at_most: 2"),
        ("1 <= cups <= 5", "test: cups, at_least: 1, at_most: 5"),
        ("(cups >= 1) && cups != 3", "test: cups, at_least: 1, not_equals: 3"),
        ("1 < cups < 5", f"{SEQUENCE}: [{{test: cups, at_least: 1, not_equals: 1}}, "
         "{test: cups, at_most: 5, not_equals: 5}]"),
        ("cups == 1 || place == 'hall'", f"{SELECTOR}: [{{test: cups, equals: 1}}, {{test: place, equals: hall}}]"),
        ("cups == 1 && place == 'hall'", f"{SEQUENCE}: [{{test: cups, equals: 1}}, {{test: place, equals: hall}}]"),
        ("!(cups == 1 || cups > 3)", "test: cups, not_equals: 1, at_most: 3"),
        ("!done", "test: done, equals: false"),
        ("cups == 1 && (done || !open)", f"{SEQUENCE}: [{{test: cups, equals: 1}}, {{{SELECTOR}: "
         "[{test: done, equals: true}, {test: open, equals: false}]}]"),
    ],
)  # fmt: skip
def test_a_condition_becomes_tests(code: str, root: str) -> None:
    """Of one key one test, of several a sequence or a selector of tests."""
    expected = parse_tree(f"tree: t\nroot: {{{root}}}")
    assert from_xml(main_tree(f'<ScriptCondition code="{escape(code)}"/>')).main == expected


@pytest.mark.parametrize(
    "code",
    ["", "cups", "cups >", "cups + 1 > 2", "a == 1 ||", "(cups > 1", "cups > 1)", "1 == 1", "'a' < place", "a ? b : c"]
    + ["!cups == 1", "(cups) == 1", "a == 1; b == 2", "n := 1", "!" * 99 + "a", "(" * 99 + "a", "true", "a & b"],
)
def test_what_is_no_condition_of_ours_is_refused(code: str) -> None:
    """Whatever computes, is cut short, or compares what has no key; a key alone must be true."""
    found = read_condition(code)
    assert (found is None) is (code != "cups")


_compared = st.sampled_from(
    ["cups {} 2", "cups {} 1", "3 {} cups", "ratio {} 0.5", "0.25 {} ratio", "1 {} cups {} 2", "-1 {} ratio {} 0.5"]
).flatmap(lambda text: st.tuples(*[st.sampled_from(["==", "!=", ">", "<", ">=", "<="])] * text.count("{}")).map(
    lambda signs: text.format(*signs)
))  # fmt: skip
_alone = st.sampled_from(["done", "open", "place == 'hall'", "place != 'hall'", "done == true", "'sofa' == place"])
_codes = st.recursive(
    _compared | _alone,
    lambda inner: (
        st.tuples(inner, st.sampled_from(["&&", "||"]), inner).map(" ".join)
        | inner.map(lambda code: f"({code})")
        | inner.map(lambda code: f"!({code})")
    ),
    max_leaves=6,
)


@given(_codes)
def test_a_condition_holds_as_it_is_written(code: str) -> None:
    """As Python understands the same comparisons, chains and words."""
    meant = code.replace("&&", " and ").replace("||", " or ").replace("!(", " not (").replace("true", "True")
    assert ours(code) is bool(eval(meant.strip(), {}, dict(BOARD)))


@pytest.mark.skipif(not CHECKER, reason="BTCPP_CHECKER names no program built from tests/btcpp")
@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(_codes)
def test_a_condition_holds_where_btcpp_says_so(tmp_path: Path, code: str) -> None:
    """The real one, from the same file."""
    assert theirs(xml(code), tmp_path, 1)[-1] == ("-> SUCCESS" if ours(code) else "-> FAILURE")


def test_a_key_that_stands_alone_is_told() -> None:
    """As only true is true here, and there every number but 0."""
    told = [p for p in from_xml(xml("done || !open"), "t.xml").warnings if p.code == "btcpp-script"]
    assert ["'done' alone is read as done == true", "'open' alone is read as open == true"] == [p.message for p in told]
    assert {p.line for p in told} == {3}
