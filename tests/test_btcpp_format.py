"""Nothing of BehaviorTree.CPP's format is dropped or changed silently: it is read, told in a warning, or refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.btcpp.export import to_xml
from mpvi_bt.executive.btcpp.format import ATTRIBUTES, NODES, kind_below
from mpvi_bt.executive.btcpp.importing import ImportedTrees, from_xml
from mpvi_bt.executive.btcpp.models import PORTS
from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.marked_xml import Element, parse_xml
from tests.btcpp_constructs import CONSTRUCTS, outcome, table, xml_of

PAGE = Path(__file__).parents[1] / "docs" / "btcpp_constructs.md"
WHOLE = """<root BTCPP_format="4" main_tree_to_execute="t">
<BehaviorTree ID="t">
<Sequence name="all">
<Say text="a"/>
<Inverter>
<AlwaysSuccess/>
</Inverter>
<Timeout msec="1500">
<SubTree ID="go" to="cup"/>
</Timeout>
<Action ID="Navigate" target="hall"/>
</Sequence>
</BehaviorTree>
<BehaviorTree ID="go">
<Navigate target="{to}"/>
</BehaviorTree>
<TreeNodesModel>
<Action ID="Say" editable="true">
<input_port name="text">what</input_port>
<output_port name="said"/>
<description>Says it.</description>
<MetadataFields>
<Metadata owner="lab"/>
</MetadataFields>
</Action>
<SubTree ID="go">
<inout_port name="to" default="sofa"/>
</SubTree>
</TreeNodesModel>
</root>"""  # one element a line


def test_the_page_has_the_table() -> None:
    """Of every construct, as it is converted now; `python -m tests.btcpp_constructs` prints it."""
    told = PAGE.read_text(encoding="utf-8")
    begin, end = "<!-- constructs -->\n", "\n<!-- end of constructs -->"
    assert told[told.index(begin) + len(begin) : told.index(end)] == table()


def kinds(element: Element, kind: str = "root") -> Iterator[tuple[str, Element]]:
    """An element and all below it, with the kinds that our table of attributes gives them."""
    yield kind, element
    for child in element.children:
        if kind in ("BehaviorTree", "node"):
            below = "node"
        else:
            below = child.tag if kind == "root" else kind_below(kind, child.tag)
        yield from kinds(child, below)


def test_the_table_has_every_element_and_attribute() -> None:
    """Each node with each port, each kind of element with each attribute."""
    found = set()
    for construct in CONSTRUCTS:
        for kind, element in kinds(parse_xml(xml_of(construct), construct)):
            of_its_own = "SubTree" if element.tag == "SubTree" and kind == "node" else ""
            found |= {(k, name) for name in ("", *element.attributes) for k in (kind, element.tag, of_its_own)}
    known = {(tag, port) for tag, node in NODES.items() for port in ("", *node.ports)}
    known |= {(kind, name) for kind, a in ATTRIBUTES.items() for name in ("", *a.read, *a.idle)}
    known |= {(tag, "") for tag in ("Action", "Condition", "Control", "Decorator", *PORTS)}
    assert known - found == set()


@pytest.mark.parametrize("construct", CONSTRUCTS)
def test_what_is_told_of_a_construct_has_its_place(construct: str) -> None:
    """Every problem and warning is within the file."""
    xml = xml_of(construct)
    try:
        told: list[Problem] = list(from_xml(xml, "t.xml").warnings)
    except FileProblems as error:
        told = error.problems
    lines = xml.split("\n")
    assert all(1 <= p.line <= len(lines) and 1 <= p.column <= len(lines[p.line - 1]) for p in told)
    assert bool(told) == (outcome(construct)[0] != "read")


@pytest.mark.parametrize("construct", [name for name in CONSTRUCTS if outcome(name)[0] != "refused"])
def test_what_is_read_survives_the_way_there_and_back(construct: str) -> None:
    """Node for node; of calls, which have no arguments any more, what they do."""
    main = from_xml(xml_of(construct)).main
    back = from_xml(to_xml(main).xml).main
    assert [(n.path, n.spec.kind) for n in back.nodes] == [(n.path, n.spec.kind) for n in main.nodes]
    for one, other in zip(main.nodes, back.nodes, strict=True):
        assert one.spec.kind == "subtree" or one.spec.parameters == other.spec.parameters


def trees_of(imported: ImportedTrees) -> tuple[object, ...]:
    return imported.main, imported.subtrees


BASE = from_xml(WHOLE, "t.xml")
LINES = [i for i, line in enumerate(WHOLE.split("\n")) if line[1:2].isalpha()]
KINDS = dict(zip(LINES, (kind for kind, _ in kinds(parse_xml(WHOLE, "t.xml"))), strict=True))
NAMES = sorted(
    {name for a in ATTRIBUTES.values() for name in (*a.read, *a.idle)}
    | {port for node in NODES.values() for port in node.ports}
    | {
        "_skipif",
        "_onSucces",
        "_autoRemap",
        "Name",
        "id",
        "main_tree_to_exec",
        "_owner",
        "speed",
        "x.y",
        "xsi:type",
        "to",
    }
)


OTHERS = st.from_regex("[A-Za-z_][a-z_.0-9]{0,8}", fullmatch=True)
WITHOUT_EFFECT = {("port", "default"), ("node", "_autoremap")}  # of a port that each call gives


@given(st.sampled_from(LINES), st.sampled_from(NAMES) | OTHERS, st.data())
def test_no_attribute_is_dropped_silently(line: int, name: str, data: st.DataObject) -> None:
    """Wherever one is added, it changes the trees, is told or refused at its place, or our table knows it as a note."""
    lines = WHOLE.split("\n")
    kind, before = KINDS[line], lines[line]
    value = data.draw(st.sampled_from(["n == 1", "n := 1", "{=}", "x", "1", "3", "true", "go"]))
    if f" {name}=" in before:
        return  # a second one is no XML
    at = len(before.split("/>")[0].split(">")[0])
    lines[line] = f"{before[:at]} {name}='{value}'{before[at:]}"
    known = ATTRIBUTES[kind]
    try:
        imported = from_xml("\n".join(lines), "t.xml")
    except FileProblems as error:
        assert {(p.line, p.column) for p in error.problems} & {(line + 1, at + 2), (line + 1, 1)}
        return
    told = {(p.line, p.column) for p in imported.warnings} - {(p.line, p.column) for p in BASE.warnings}
    note = name in known.idle or known.more or (kind, name) in WITHOUT_EFFECT
    assert note or (line + 1, at + 2) in told or trees_of(imported) != trees_of(BASE)


ASIDES = [
    "<!-- a comment -->",
    "a text",
    "<![CDATA[a text]]>",
    "<Metadat a='1'/>",
    "<include path='x.xml'/>",
    "<Say text='b'/>",
]


@given(st.sampled_from(LINES), st.sampled_from(ASIDES))
def test_nothing_between_elements_is_dropped_silently(line: int, aside: str) -> None:
    """Comments, texts and elements are told, refused or read, wherever they stand."""
    lines = WHOLE.split("\n")
    lines.insert(line, aside)
    try:
        imported = from_xml("\n".join(lines), "t.xml")
    except FileProblems as error:
        assert all(p.line and p.column for p in error.problems)
        return
    told = {(p.code, p.line, p.column) for p in imported.warnings} - {(p.code, p.line, p.column) for p in BASE.warnings}
    assert any(place[1] == line + 1 for place in told) or trees_of(imported) != trees_of(BASE)
