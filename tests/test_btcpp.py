"""Trees as XML of BehaviorTree.CPP 4, and back; its published rules are checked here in Python."""

from __future__ import annotations

import contextlib
import json
import re
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner
from hypothesis import assume, given
from hypothesis import strategies as st

from mpvi_bt.apps.cli.convert import convert
from mpvi_bt.executive.behaviors.parameters import Assignment, Comparison
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.btcpp.export import to_xml
from mpvi_bt.executive.btcpp.importing import from_xml
from mpvi_bt.executive.tree.reader import MAX_DEPTH
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.executive.tree.yaml_io import dump_tree, load_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UserError
from tests.tree_strategies import above, leaves, numbers, trees, words


def node(kind: str, *children: NodeSpec, **parameters: Any) -> NodeSpec:
    return NodeSpec(kind, node_types()[kind].parameters.model_validate(parameters), children=children)


DEEPEST = 253  # nodes, one below the other, that BehaviorTree.CPP reads
SHIPPED = sorted((paths.shipped() / "trees").rglob("*.yaml"))


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
    TreeSpec, words, st.recursive(leaves | _scripted | _guarded, above, max_leaves=10), blackboard=st.just(FIRST)
)


@given(trees | scripted_trees)
def test_a_tree_survives_the_way_there_and_back(tree: TreeSpec) -> None:
    """What is exported is imported as the same tree: nodes, typed parameters, names, segments, first values."""
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


# Theirs: how many children at least and at most, and the ports, of which "!" marks what must be there.
_ANY = 10**6
_THEIRS: dict[str, tuple[int, int, str]] = {
    "Sequence": (1, _ANY, ""),
    "ReactiveSequence": (1, _ANY, ""),
    "Fallback": (1, _ANY, ""),
    "ReactiveFallback": (1, _ANY, ""),
    "Parallel": (1, _ANY, "success_count failure_count"),
    "Inverter": (1, 1, ""),
    "ForceSuccess": (1, 1, ""),
    "Timeout": (1, 1, "msec!"),
    "RetryUntilSuccessful": (1, 1, "num_attempts!"),
    "Repeat": (1, 1, "num_cycles!"),
    "Sleep": (0, 0, "msec!"),
    "AlwaysSuccess": (0, 0, ""),
    "AlwaysFailure": (0, 0, ""),
    "Script": (0, 0, "code!"),
    "ScriptCondition": (0, 0, "code!"),
    "SetBlackboard": (0, 0, "value! output_key!"),
    "SubTree": (0, 0, ""),
}
_CHILDREN = {"Control": (1, _ANY), "Decorator": (1, 1), "Action": (0, 0), "Condition": (0, 0)}
_MODEL_NAME = re.compile(r"""[^\x00-\x1f\x7f \t\n\r<>&"'/\\:*?|.]+""")


def broken_rules(xml: str) -> set[str]:
    """Which of BehaviorTree.CPP's published rules for a file do not hold.

    Source: its documentation of the XML format and of name validation, and what its `writeTreeXSD` demands.
    """
    root = ElementTree.fromstring(xml)
    trees = root.findall("BehaviorTree")
    ids = [tree.get("ID", "") for tree in trees]
    nodes = dict(_THEIRS)
    for model in root.iterfind("TreeNodesModel/*"):
        ports = [(p.get("name", ""), "" if p.get("default") is not None else "!") for p in model.iter("input_port")]
        nodes[model.get("ID", "")] = (*_CHILDREN[model.tag], " ".join(name + must for name, must in ports))
    rules = {
        "root": root.tag == "root" and root.get("BTCPP_format") == "4",
        "main": root.get("main_tree_to_execute") in ids,
        "order": [e.tag for e in root] == ["BehaviorTree"] * len(trees) + ["TreeNodesModel"],
        "unique": len(ids) == len(set(ids)) and not set(ids) & nodes.keys(),
        "id": all(_MODEL_NAME.fullmatch(name) and name.lower() != "root" for name in [*ids, *nodes]),
        "one child": all(len(tree) == 1 for tree in trees),
    }
    below = [element for tree in trees for element in tree.iterfind(".//*")]
    rules["known"] = all(e.tag in nodes for e in below)
    if rules["known"]:
        rules["children"] = all(nodes[e.tag][0] <= len(e) <= nodes[e.tag][1] for e in below)
        rules["ports"] = all(
            {n for n in e.attrib if n not in ("name", "ID", "_description", "_autoremap")}
            <= {port.rstrip("!") for port in nodes[e.tag][2].split()}
            for e in below
        )
        rules["needed"] = all(p.rstrip("!") in e.attrib for e in below for p in nodes[e.tag][2].split() if p[-1] == "!")
    rules["called"] = all(e.get("ID") in ids for e in root.iter("SubTree"))
    return {name for name, holds in rules.items() if not holds}


BROKEN = [
    ('BTCPP_format="4"', 'BTCPP_format="3"', "root"),
    ('execute="hello"', 'execute="hallo"', "main"),
    ("<Say text=", "<Shout text=", "known"),
    ("<Say text=", "<Say loud=", "ports"),
    (' text="hello, world"', "", "needed"),
    ('<Say text="hello, world" />', "<Inverter />", "children"),
    ('<Say text="hello, world" />', "", "one child"),
    ('<Say text="hello, world" />', '<SubTree ID="other" />', "called"),
    ('BehaviorTree ID="hello"', 'BehaviorTree ID="Say"', "unique"),
    ('BehaviorTree ID="hello"', 'BehaviorTree ID="hel.lo"', "id"),
]


@given(trees | scripted_trees)
def test_what_is_exported_keeps_the_published_rules(tree: TreeSpec) -> None:
    """Names, children, ports and models are as BehaviorTree.CPP's documentation demands."""
    assert broken_rules(exported(tree)) == set()


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_trees_that_come_with_the_package_keep_the_published_rules(path: Path) -> None:
    """Those with subtrees, too."""
    assert broken_rules(to_xml(load_tree(path)).xml) == set()


@pytest.mark.parametrize(("before", "after", "rule"), BROKEN)
def test_the_rules_notice_what_breaks_them(before: str, after: str, rule: str) -> None:
    """A file that was good and is broken in one place breaks that rule."""
    good = to_xml(load_tree(paths.shipped() / "trees/hello.yaml")).xml
    assert before in good
    assert rule in broken_rules(good.replace(before, after))


def main_tree(nodes: str) -> str:
    return f'<root BTCPP_format="4">\n<BehaviorTree ID="t">\n{nodes}\n</BehaviorTree>\n</root>'


SEQUENCE, SELECTOR = "sequence: ~, memory: true, children", "selector: ~, memory: true, children"


@pytest.mark.parametrize(
    ("xml", "root"),
    [
        ("<AlwaysSuccess/>", "succeed: ~"),
        ('<AlwaysSuccess name=""/>', "succeed: ~"),
        ('<AlwaysFailure name="no_cup"/>', "fail: no_cup"),
        ('<Sleep msec="1500"/>', "wait: 1.5"),
        ('<Action ID="Navigate" target="{place}"/>', "navigate: $place"),
        ("<Parallel><AlwaysSuccess/></Parallel>", "{parallel: ~, policy: success_on_all, children: [succeed: ~]}"),
        (
            '<Parallel success_count="2" failure_count="1"><AlwaysSuccess/><AlwaysSuccess/></Parallel>',
            "{parallel: ~, policy: success_on_all, children: [succeed: ~, succeed: ~]}",
        ),
        ('<SetBlackboard output_key="room" value="the $hall"/>', "{set: room, value: the $$hall}"),
        (
            "<Script code=\"a := 'b'; n -= 2\"/>",
            "{sequence: ~, memory: true, children: [{set: a, value: b}, {set: n, add: -2}]}",
        ),
        ('<ScriptCondition code=" n>=2&amp;&amp;n != m "/>', "{test: n, at_least: 2, not_equals: $m}"),
        ('<Test key="n" equals="&quot;3&quot;"/>', "{test: n, equals: '3'}"),
        ('<Delay delay_msec="500"><AlwaysSuccess/></Delay>', f"{{{SEQUENCE}: [wait: 0.5, succeed: ~]}}"),
        (
            "<ForceFailure><AlwaysSuccess/></ForceFailure>",
            f"{{{SEQUENCE}: [{{attempt: ~, child: {{succeed: ~}}}}, fail: forced]}}",
        ),
        (
            '<Switch2 variable="{n}" case_1="1" case_2="hall"><Say text="a"/><Say text="b"/><Say text="c"/></Switch2>',
            "{selector: ~, memory: false, children: [{condition: n, equals: 1, child: {say: a}}, "
            "{condition: n, equals: hall, child: {say: b}}, {condition: n, not_equals: hall, child: "
            "{condition: n, not_equals: 1, child: {say: c}}}]}",
        ),
        (
            '<Say text="a" _failureIf="n >= 2" _onSuccess="n := 0"/>',
            f"{{{SEQUENCE}: [{{{SEQUENCE}: [{{invert: ~, child: {{test: n, at_least: 2}}}}, say: a]}}, "
            "{set: n, value: 0}]}",
        ),
        ('<Say text="a" _successIf="n == 2"/>', f"{{{SELECTOR}: [{{test: n, equals: 2}}, say: a]}}"),
        (
            '<Say text="a" _onFailure="n += 1"/>',
            f"{{{SELECTOR}: [say: a, {{{SEQUENCE}: [{{set: n, add: 1}}, fail: ~]}}]}}",
        ),
        (
            '<Sequence><Say text="a" _skipIf="n == 2"/></Sequence>',
            f"{{{SEQUENCE}: [{{{SELECTOR}: [{{test: n, equals: 2}}, say: a]}}]}}",
        ),
        (
            '<Fallback><Say text="a" _while="n == 2"/></Fallback>',
            f"{{{SELECTOR}: [{{sequence: ~, memory: false, children: [{{test: n, equals: 2}}, say: a]}}]}}",
        ),
    ],
)
def test_what_others_wrote_becomes_what_it_means_here(xml: str, root: str) -> None:
    """Explicit tags, defaults of ports, scripts, references, and nodes that several of ours make up."""
    expected = parse_tree(f"tree: t\nroot: {root if root[0] == '{' else '{' + root + '}'}")
    assert from_xml(main_tree(xml)).main == expected


@pytest.mark.parametrize(
    ("xml", "line", "column", "code", "nearest"),
    [
        ("<Navigat target='x'/>", 3, 1, "unknown-node", "Navigate"),
        ("<RunOnce><AlwaysSuccess/></RunOnce>", 3, 1, "unmapped-node", None),
        ("<Delay delay_msec='soon'><AlwaysSuccess/></Delay>", 3, 1, "invalid-value", None),
        ("<Switch2 variable='{n}' case_1='1' case_2='2'><AlwaysSuccess/></Switch2>", 3, 1, "children", None),
        ("<Switch2 variable='n'/>", 3, 10, "port-value", None),
        ("<Navigate\n  traget='x' target='y'/>", 4, 3, "unknown-port", "target"),
        ("<Navigate room='hall'/>", 3, 1, "missing-port", None),
        ("<Navigate target='{Place}'/>", 3, 11, "port-value", None),
        ("<RetryUntilSuccessful num_attempts='-1'><Fail/></RetryUntilSuccessful>", 3, 23, "out-of-range", None),
        ("<Repeat num_cycles='{n}'><AlwaysSuccess/></Repeat>", 3, 9, "unknown-parameter", None),
        ("<Timeout msec='soon'><AlwaysSuccess/></Timeout>", 3, 10, "invalid-value", None),
        ("<Sequence _skipIf='a == 1'><AlwaysSuccess/></Sequence>", 3, 11, "unmapped-attribute", None),
        ("<Parallel success_count='2'><A/><B/><C/></Parallel>", 3, 11, "unmapped-parallel", None),
        ("<Script code='a := b + 1'/>", 3, 9, "unmapped-script", None),
        ("<ScriptCondition code='a + 1 == b'/>", 3, 18, "unmapped-script", None),
        ("<SubTree ID='u'/>", 3, 10, "unknown-tree", None),
        ("<SubTree ID='t' _autoremap='true'/>", 3, 10, "recursion", None),
        ("<Say text='a' _onHalted='n := 1'/>", 3, 15, "unmapped-attribute", None),
        ("<Say text='a' _failureIf='a * b'/>", 3, 15, "unmapped-script", None),
        ("<Say text='a' _failureIf='a == 1' _skipIf='a == 2'/>", 3, 35, "unmapped-attribute", None),
        ("<Inverter><Say text='a' _skipIf='a == 2'/></Inverter>", 3, 25, "unmapped-attribute", None),
        ("<Inverter/>", 3, 1, "children", None),
        ("<Fallback/>", 3, 1, "children", None),
        ("<Say text='a'><Say text='b'/></Say>", 3, 1, "children", None),
        ("<Say text='a'>", 4, 3, "syntax", None),
    ],
)  # fmt: skip
def test_what_has_no_equal_is_refused_at_its_place(
    xml: str, line: int, column: int, code: str, nearest: str | None
) -> None:
    """Each with line, column, a stable code and the nearest name."""
    with pytest.raises(FileProblems) as caught:
        from_xml(main_tree(xml), "t.xml")
    found = [(p.file, p.line, p.column, p.code, p.nearest) for p in caught.value.problems]
    assert ("t.xml", line, column, code, nearest) in found


def test_what_is_known_is_listed_once() -> None:
    """Of several nodes that nobody knows the first tells the known ones, the others what they may be."""
    with pytest.raises(FileProblems) as caught:
        from_xml(main_tree("<Sequence><Foo/><Quux/><Navigat/><Foo/></Sequence>"))
    told = [p.message for p in caught.value.problems if p.code == "unknown-node"]
    assert [" Known: " in message for message in told] == [True, False, False, False]
    assert "Did you mean 'Navigate'?" in told[2]


@pytest.mark.parametrize(
    ("xml", "places", "words"),
    [
        ("<ScriptCondition code='a>1 && b<2'/>", [(3, 28), (3, 32)], "a raw '&&': write '&amp;&amp;'"),
        ("<ScriptCondition code='a &lt; 2 &&\n b <= 2'/>", [(3, 33), (4, 4)], "a raw '<=': write '&lt;='"),
        ("<AlwaysSuccess name='a & b'/>", [(3, 24)], "a raw '&': write '&amp;'"),
        ("<AlwaysSuccess name='&nbsp;'/>", [(3, 22)], "'&nbsp;' is no entity of XML"),
        ("<!-- a -- b -- c --><AlwaysSuccess/>", [(3, 8), (3, 13)], "'--' within a comment: write '- -'"),
        ("<!-- a ---><AlwaysSuccess/>", [(3, 8)], "'--' within a comment"),
        ("<!-- a && b < c --><AlwaysSuccess name='&'/>", [(3, 41)], "a raw '&'"),
        ("<AlwaysSuccess name=x/>", [(3, 21)], "the value of 'name' needs quotes"),
        ("<AlwaysSuccess name/>", [(3, 20)], "'name' has no value"),
        ("<AlwaysSuccess name='a'b='c'/>", [(3, 24)], "a space is missing"),
        ("<AlwaysSuccess name='x/>", [(4, 1)], "is the quote of line 3 closed?"),
        ("<Fail name='x/>\n<Fail name='y'/>", [(4, 1)], "is the quote of line 3 closed?"),
        ("<Fail name='x/>\n<Say text='y' name='/>", [(3, 12)], "this quote is not closed"),
        ("<AlwaysSuccess name='\x01'/>", [(3, 22)], "U+0001 cannot stand in XML"),
        ("<Inverter><AlwaysSuccess></Inverter>", [(3, 28)], "'</Inverter>' where '</AlwaysSuccess>' is due"),
        ("<!-- <AlwaysSuccess/>", [(3, 1)], "what begins here is not closed"),
    ],
)  # fmt: skip
def test_what_is_no_xml_is_told_by_its_cause(xml: str, places: list[tuple[int, int]], words: str) -> None:
    """All of it that is spelt wrong, each at its place, with the right spelling."""
    with pytest.raises(FileProblems) as caught:
        from_xml(main_tree(xml), "t.xml")
    assert [(p.line, p.column) for p in caught.value.problems] == places
    assert {p.code for p in caught.value.problems} == {"syntax"}
    assert any(words in p.message for p in caught.value.problems), str(caught.value)


@pytest.mark.parametrize(("xml", "port"), [("RetryUntilSuccessful", "num_attempts"), ("Repeat", "num_cycles")])
def test_for_ever_has_no_equal(xml: str, port: str) -> None:
    """Whoever means it is told what would be valid."""
    with pytest.raises(FileProblems, match=f"{port} -1 is for ever, which has no equal here: write how often, 1 to 1"):
        from_xml(main_tree(f"<{xml} {port}='-1'><AlwaysSuccess/></{xml}>"))


@pytest.mark.parametrize("text", ["<!--", "<a '", '<a b="', "<a ", "&&", "<a x='&&'>", "<!-- -- -->", "< "])
def test_what_is_no_xml_is_told_in_time(text: str) -> None:
    """However much of it there is."""
    began = time.process_time()
    with pytest.raises(FileProblems):
        from_xml(text * (2**20 // len(text)))
    assert time.process_time() - began < 5


@pytest.mark.parametrize(
    ("xml", "code"),
    [
        ("", "syntax"),
        ("<tree/>", "no-btcpp"),
        ('<root main_tree_to_execute="t"/>', "btcpp-version"),
        ('<root BTCPP_format="5"/>', "btcpp-version"),
        ('<root BTCPP_format="4"/>', "main-tree"),
        ('<root BTCPP_format="4"><include path="x.xml"/></root>', "include"),
        ('<root BTCPP_format="4"><BehaviorTree ID="a b"><AlwaysSuccess/></BehaviorTree></root>', "tree-id"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><root BTCPP_format="4"/>', "doctype"),
        ("<a>" * 300, "too-deep"),
        ("<a>" + "<b/>" * 70_000, "too-large"),
        # Each tree calls the one before it ten times: ten million nodes.
        (
            '<root BTCPP_format="4" main_tree_to_execute="t7"><BehaviorTree ID="t0"><AlwaysSuccess/></BehaviorTree>'
            + "".join(
                f'<BehaviorTree ID="t{i}"><Sequence>' + f'<SubTree ID="t{i - 1}"/>' * 10 + "</Sequence></BehaviorTree>"
                for i in range(1, 8)
            )
            + "</root>",
            "too-large",
        ),
    ],
    ids=lambda value: value if len(value) < 20 else "",
)
def test_a_file_that_is_no_tree_or_a_bomb_is_refused(xml: str, code: str) -> None:
    """What it is instead is told by a stable code."""
    with pytest.raises(FileProblems) as caught:
        from_xml(xml, "t.xml")
    assert code in [p.code for p in caught.value.problems]


@given(st.text(st.sampled_from("<>/=\"' aID{}&;!-[]?")) | st.text())
def test_no_text_is_a_traceback(text: str) -> None:
    """Whatever stands in a file, or in a tree of one, it is read or its problems are told."""
    for xml in (text, main_tree(text)):
        with contextlib.suppress(FileProblems):
            from_xml(xml)


def test_a_text_that_btcpp_would_take_for_a_reference_is_refused() -> None:
    """Nothing is changed in silence: such a node is named with its place."""
    tree = parse_tree("tree: t\nroot:\n  navigate: '{cup}'\n", "t.yaml")
    with pytest.raises(FileProblems) as caught:
        to_xml(tree)
    assert [(p.line, p.column, p.code) for p in caught.value.problems] == [(3, 3, "btcpp-reference")]


def test_what_is_told_about_a_tree_comes_back_whatever_it_is() -> None:
    """Names that are no IDs, and texts with any character, stand in the description."""
    for name, told in (("Sequence", "a: b"), ("to go", "segments: x\n\x7f\x01\x85 \N{RIGHT-TO-LEFT MARK}'\"<&")):
        tree = TreeSpec(name, node("succeed"), told, "tree: y", blackboard={"k": " x\n$y "})
        assert from_xml(to_xml(tree).xml).main == tree


def test_depth_is_bounded_both_ways() -> None:
    """What BehaviorTree.CPP could not read for its depth is not written; what our trees may not be is not read."""

    def inverted(depth: int) -> TreeSpec:
        root = node("succeed")
        for _ in range(depth - 1):
            root = node("invert", root)
        return TreeSpec("t", root)

    assert from_xml(to_xml(inverted(MAX_DEPTH)).xml).main == inverted(MAX_DEPTH)
    with pytest.raises(FileProblems, match="too-deep"):
        from_xml(to_xml(inverted(MAX_DEPTH + 1)).xml)
    assert to_xml(inverted(DEEPEST)).xml.count("<Inverter>") == DEEPEST - 1
    with pytest.raises(FileProblems, match="btcpp-too-deep"):
        to_xml(inverted(DEEPEST + 1))


def test_parameters_are_filled_in_or_become_entries_of_the_blackboard() -> None:
    """A default is filled in; a text without one is a reference; anything else must have a value. All is told."""
    head = "tree: t\nparameters: {object: text, room: {type: text, default: hall}%s}\n"
    root = "root:\n  retry: %s\n  child: {navigate: $object, room: $room}\n"
    made = to_xml(parse_tree(head % "" + root % 2, "t.yaml"))
    assert '<Navigate target="{object}" room="hall" />' in made.xml
    assert [p.code for p in made.warnings][:2] == ["btcpp-parameter"] * 2
    with pytest.raises(FileProblems, match="'tries' has no value"):
        to_xml(parse_tree(head % ", tries: integer" + root % "$tries", "t.yaml"))


def test_every_difference_is_a_warning_with_its_place() -> None:
    """Each node that does otherwise there is told, on the way there and back."""
    tree = parse_tree("tree: t\nroot:\n  timeout: 2\n  child:\n    attempt:\n    child: {wait: 1}\n", "t.yaml")
    made = to_xml(tree)
    told = [(str(p).split(": ")[0], p.code, p.severity) for p in made.warnings]
    assert told == [
        ("t.yaml:3:3", "btcpp-timeout", "warning"),
        ("t.yaml:5:5", "btcpp-forcesuccess", "warning"),
        ("t.yaml:6:13", "btcpp-sleep", "warning"),
    ]
    assert [p.message for p in from_xml(made.xml).warnings] == [p.message for p in made.warnings]


def test_each_different_call_of_a_subtree_is_a_tree_of_its_own(tmp_path: Path) -> None:
    """Arguments are filled in; the same call twice is one tree."""
    (tmp_path / "go.yaml").write_text("tree: go\nparameters: {to: text}\nroot: {navigate: $to}\n")
    calls = "".join(f"    - subtree: go\n      arguments: {{to: {to}}}\n" for to in ("hall", "sofa", "hall"))
    (tmp_path / "main.yaml").write_text(f"tree: main\nroot:\n  sequence:\n  memory: true\n  children:\n{calls}")
    tree = load_tree(tmp_path / "main.yaml")
    imported = from_xml(to_xml(tree).xml)
    assert [child.parameters.model_dump()["tree"] for child in imported.main.root.children] == ["go", "go_2", "go"]
    assert {name: spec.root.label for name, spec in imported.subtrees.items()} == {
        "go": "Navigate(hall)",
        "go_2": "Navigate(sofa)",
    }


def test_convert_goes_by_the_suffixes(tmp_path: Path) -> None:
    """There, and back into files that check finds nothing wrong with; a file that nobody named is not written over."""
    run = CliRunner()
    there, back = str(tmp_path / "fetch.xml"), str(tmp_path / "fetch.yaml")
    assert run.invoke(convert, ["fetch", there]).stdout == ""
    assert run.invoke(convert, ["fetch", "--to", "xml"]).stdout == Path(there).read_text()
    assert run.invoke(convert, [there, back]).stdout == ""
    assert {"fetch.yaml", "go_to.yaml", "go_to_2.yaml"} <= {file.name for file in tmp_path.iterdir()}
    again, tree = load_tree(back), load_tree(paths.shipped() / "trees/fetch.yaml")
    assert [n.spec.kind for n in again.nodes] == [n.spec.kind for n in tree.nodes]
    assert run.invoke(convert, [there, back]).exit_code == 0  # the same once more
    (tmp_path / "go_to.yaml").write_text("mine")
    assert isinstance(run.invoke(convert, [there, back]).exception, UserError)
    assert (tmp_path / "go_to.yaml").read_text() == "mine"


def test_what_was_edited_is_written_over_only_by_force(tmp_path: Path) -> None:
    """The file that was named too; and each file that was not named is told."""
    run = CliRunner()
    there, back = str(tmp_path / "fetch.xml"), str(tmp_path / "fetch.yaml")
    for named in (["fetch", there], [there, back]):
        run.invoke(convert, named)
        before = Path(named[1]).read_text()
        Path(named[1]).write_text("edited")
        refused = str(run.invoke(convert, named).exception)
        assert refused == f"{named[1]}: is there already with another text. Write elsewhere, or give --force."
        assert Path(named[1]).read_text() == "edited"
        forced = run.invoke(convert, [*named, "--force", "--json"])
        assert Path(named[1]).read_text() == before
        assert named[1] == json.loads(forced.stdout)["files"][0]
    assert f"wrote {tmp_path / 'go_to.yaml'} too" in run.invoke(convert, [there, back]).stderr


def test_convert_for_programs(tmp_path: Path) -> None:
    """The JSON holds the text, those of the subtrees, and the warnings."""
    run = CliRunner()
    told = json.loads(run.invoke(convert, ["picking_up_trash", "--json"]).stdout)
    (tmp_path / "t.xml").write_text(told["xml"])
    assert {p["code"] for p in told["warnings"]} == {"btcpp-timeout", "btcpp-forcesuccess"}
    back = json.loads(run.invoke(convert, [str(tmp_path / "t.xml"), "--json"]).stdout)
    assert back["yaml"] == dump_tree(load_tree(paths.shipped() / "trees/picking_up_trash.yaml"))
    assert back["subtrees"] == {}


@pytest.mark.parametrize(
    "words",
    [["hello", "x.txt"], ["hello", "x.yaml"], ["hello", "--to", "yaml"], ["x.xml", "--to", "xml"], ["x.xml"], ["helo"]],
)
def test_convert_refuses_what_it_cannot_do(words: list[str]) -> None:
    """A user's mistake is told as one."""
    assert isinstance(CliRunner().invoke(convert, words).exception, UserError)
