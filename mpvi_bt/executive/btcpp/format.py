"""The elements and attributes of BehaviorTree.CPP 4's XML, and a check that a file has no others.

Source: of version 4.10.0 the parser and the schema that it writes (src/xml_parsing.cpp), and `providedPorts` of each
node; what Groot2 adds on saving. BehaviorTree.CPP passes over much that it does not know; here that is told.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from mpvi_bt.executive.btcpp.file import EXPLICIT, XmlFile, below, tag_of
from mpvi_bt.ground.errors import did_you_mean, nearest, shown
from mpvi_bt.ground.marked_xml import Element

PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")  # in the order in which they are looked at
POSTCONDITIONS = ("_onSuccess", "_onFailure", "_onHalted", "_post")
CONDITIONS = frozenset({*PRECONDITIONS, *POSTCONDITIONS})

_NODES = """
    Action      AlwaysFailure
    Action      AlwaysSuccess
    Control     AsyncFallback
    Control     AsyncSequence
    Decorator   Delay                    delay_msec!
    Control     Fallback
    Decorator   ForceFailure
    Decorator   ForceSuccess
    Control     IfThenElse
    Decorator   Inverter
    Decorator   KeepRunningUntilFailure
    Decorator   LoopBool                 queue! if_empty value
    Decorator   LoopDouble               queue! if_empty value
    Decorator   LoopInt                  queue! if_empty value
    Decorator   LoopString               queue! if_empty value
    Control     Parallel                 success_count failure_count
    Control     ParallelAll              max_failures
    Decorator   Precondition             if! else
    Control     ReactiveFallback
    Control     ReactiveSequence
    Decorator   Repeat                   num_cycles!
    Decorator   RetryUntilSuccessful     num_attempts!
    Decorator   RunOnce                  then_skip
    Action      Script                   code!
    Condition   ScriptCondition          code!
    Control     Sequence
    Control     SequenceWithMemory
    Action      SetBlackboard            value! output_key!
    Decorator   SkipUnlessUpdated        entry!
    Action      Sleep                    msec!
    Control     Switch2                  variable! case_1! case_2!
    Control     Switch3                  variable! case_1! case_2! case_3!
    Control     Switch4                  variable! case_1! case_2! case_3! case_4!
    Control     Switch5                  variable! case_1! case_2! case_3! case_4! case_5!
    Control     Switch6                  variable! case_1! case_2! case_3! case_4! case_5! case_6!
    Decorator   Timeout                  msec!
    Control     TryCatch                 catch_on_halt
    Action      UnsetBlackboard          key!
    Decorator   WaitValueUpdate          entry!
    Condition   WasEntryUpdated          entry!
    Control     WhileDoElse
"""


@dataclass(frozen=True)
class NodeModel:
    """A node that BehaviorTree.CPP registers by itself.

    Attributes:
        category: "Control", "Decorator", "Action" or "Condition".
        ports: Whether each of its ports must be given, by name.
    """

    category: str
    ports: Mapping[str, bool]


def _nodes() -> Iterable[tuple[str, NodeModel]]:
    for line in _NODES.split("\n")[1:-1]:
        category, name, *ports = line.split()
        yield name, NodeModel(category, {port.rstrip("!"): port.endswith("!") for port in ports})


NODES: Mapping[str, NodeModel] = MappingProxyType(dict(_nodes()))


@dataclass(frozen=True)
class Attributes:
    """Of a kind of element.

    Attributes:
        read: Those that mean something here, or are refused where they do not.
        idle: Those that mean nothing there either: notes of editors and of schemas.
        more: Whether any others are notes, too.
    """

    read: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()
    more: bool = False


_PORTS = ("input_port", "output_port", "inout_port")
ATTRIBUTES: Mapping[str, Attributes] = MappingProxyType(  # nodes have their ports, too, and SubTrees any
    {
        "root": Attributes(
            ("BTCPP_format", "main_tree_to_execute"), ("project_name", "xmlns:xsi", "xsi:noNamespaceSchemaLocation")
        ),
        "include": Attributes(("path", "ros_pkg")),
        "BehaviorTree": Attributes(("ID", "_description"), ("_fullpath", "_uid")),
        "node": Attributes(
            ("ID", "name", "_description", *PRECONDITIONS, *POSTCONDITIONS), ("_collapsed", "_fullpath", "_uid")
        ),
        "SubTree": Attributes(("_autoremap",)),  # and those of a node
        "TreeNodesModel": Attributes(),
        "model": Attributes(("ID",), ("editable",)),
        "port": Attributes(("name", "default"), ("type", "description")),
        "description": Attributes(),
        "MetadataFields": Attributes(),
        "Metadata": Attributes(more=True),
    }
)
_WITHIN: Mapping[str, tuple[str, ...]] = {
    "TreeNodesModel": ("Action", "Condition", "Control", "Decorator", "SubTree"),
    "model": (*_PORTS, "description", "MetadataFields"),
    "MetadataFields": ("Metadata",),
}
_WITH_TEXT = frozenset({*_PORTS, "description", "Metadata"})


def check(file: XmlFile, root: Element) -> None:
    """Note things unknown to BehaviorTree.CPP: an unknown port is a problem, an ignored one a warning."""
    _attributes(file, root, ATTRIBUTES["root"])
    for element in root.children:
        if element.tag == "BehaviorTree":
            _attributes(file, element, ATTRIBUTES["BehaviorTree"])
            for node in (inner for child in element.children for inner in below(child)):
                _node(file, node)
        elif element.tag == "TreeNodesModel":
            _described(file, element, "TreeNodesModel")
    _asides(file, root)


def _node(file: XmlFile, element: Element) -> None:
    tag = tag_of(element)
    known = ATTRIBUTES["node"]
    if tag == "SubTree":
        known = replace(known, read=known.read + ATTRIBUTES["SubTree"].read)
    node = NODES.get(tag)
    _left_out(file, element, [name for name in element.attributes if not is_port(name)], known)
    if node is None:
        return
    allowed = {"name", *node.ports} | ({"ID"} if element.tag in EXPLICIT else set())
    for name in element.attributes:
        if is_port(name) and name not in allowed:
            file.unknown(element, "port", name, sorted({"name", *node.ports}), name)
    for name, must in node.ports.items():
        if must and name not in element.attributes:
            file.problem(element, "missing-port", f"{tag} needs the port {name!r}")
    wanted = {"Control": "", "Decorator": "one child"}.get(node.category, "no children")
    if wanted and len(element.children) != (node.category == "Decorator"):
        file.problem(element, "children", f"<{element.tag}> takes {wanted}, not {len(element.children)}")


def _described(file: XmlFile, element: Element, kind: str) -> None:
    """What stands under <TreeNodesModel>, and below."""
    _attributes(file, element, ATTRIBUTES[kind])
    known = _WITHIN.get(kind, ())
    for child in element.children:
        if child.tag in known:
            _described(file, child, kind_below(kind, child.tag))
        else:
            near = nearest(child.tag, known)
            message = f"<{child.tag}> is unknown here to BehaviorTree.CPP and left out.{did_you_mean(near, known)}"
            file.warn(child, "element", message)


def kind_below(kind: str, tag: str) -> str:
    """The kind of an element below one of another kind, as `ATTRIBUTES` calls it; here only under <TreeNodesModel>."""
    if kind == "TreeNodesModel":
        return "model"
    return "port" if tag in _PORTS else tag


def _attributes(file: XmlFile, element: Element, known: Attributes) -> None:
    if not known.more:
        _left_out(file, element, element.attributes, known)


def _left_out(file: XmlFile, element: Element, names: Iterable[str], known: Attributes) -> None:
    for name in names:
        if name in (*known.read, *known.idle):
            continue
        near = nearest(name, known.read)
        message = f"the attribute {shown(name)} is unknown here to BehaviorTree.CPP and left out."
        file.warn(element, "attribute", message + did_you_mean(near, known.read), name)


def is_port(name: str) -> bool:
    """Whether an attribute of a node may be a port: others are for editors and for programs of one's own."""
    return name[0].isalpha() and ":" not in name and "." not in name


def _asides(file: XmlFile, root: Element) -> None:
    """Comments, and texts between elements: once each."""
    elements = list(below(root))
    for what, found in (
        ("comment", [place for element in elements for place in element.comments]),
        ("text between elements", [p for e in elements if e.tag not in _WITH_TEXT for p in e.texts]),
    ):
        if found:
            many = f", and {len(found) - 1} more" if found[1:] else ""
            file.warn_at(min(found), what.partition(" ")[0], f"a {what} is left out{many}")
