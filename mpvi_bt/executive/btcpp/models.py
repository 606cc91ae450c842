"""Declarations of a file's nodes and subtrees under <TreeNodesModel>: their ports and defaults.

BehaviorTree.CPP fills the defaults of a subtree's ports in where a call leaves them out, and refuses a call that leaves
out one without a default; with _autoremap it does neither (its `recursivelyCreateSubtree`). Defaults of nodes are those
of their C++ classes there, which the models are written from, so they are filled in likewise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt.executive.btcpp.file import EXPLICIT, XmlFile, below, tag_of
from mpvi_bt.ground.marked_xml import Element

PORTS = ("input_port", "output_port", "inout_port")


@dataclass(frozen=True)
class Model:
    """A node or a subtree as the file describes it.

    Attributes:
        element: That describes it.
        ports: The elements that describe its ports, by the ports' names.
    """

    element: Element
    ports: Mapping[str, Element]


Models = Mapping[tuple[bool, str], Model]  # by whether it is a subtree, and its ID


def models_of(file: XmlFile, root: Element) -> Models:
    """All that a file's <TreeNodesModel> describes."""
    found: dict[tuple[bool, str], Model] = {}
    for i, models in enumerate(child for child in root.children if child.tag == "TreeNodesModel"):
        if i:
            file.problem(models, "duplicate-models", "a second <TreeNodesModel>; BehaviorTree.CPP takes one")
        for element in models.children:
            if element.tag not in EXPLICIT | {"SubTree"}:
                continue
            ports: dict[str, Element] = {}
            for port in element.children:
                if port.tag in PORTS and not port.attributes.get("name"):
                    file.problem(port, "missing-port", f"this <{port.tag}> has no name")
                elif port.tag in PORTS:
                    ports[port.attributes["name"]] = port
            found[element.tag == "SubTree", element.attributes.get("ID", "")] = Model(element, ports)
    return found


def fill_in(file: XmlFile, models: Models) -> None:
    """Give the nodes and calls of all trees the defaults of the ports that they leave out."""
    for tree in file.trees.values():
        for element in below(tree):
            if tag_of(element) == "SubTree":
                _call(file, models, element)
            elif (model := models.get((False, tag_of(element)))) is not None:
                _defaults(element, model)


def autoremaps(call: Element) -> bool:
    """Whether a SubTree has the keys of its caller."""
    return call.attributes.get("_autoremap", "").lower() in ("true", "1")


def _call(file: XmlFile, models: Models, element: Element) -> None:
    name = element.attributes.get("ID", "")
    model = models.get((True, name))
    if model is None or autoremaps(element):
        return
    _defaults(element, model)
    for port in model.ports.keys() - element.attributes.keys():
        message = (
            f"tree {name!r} needs the port {port!r}, which line {model.ports[port].place[0]} declares without a default"
        )
        file.problem(element, "missing-port", message)


def _defaults(element: Element, model: Model) -> None:
    for name, port in model.ports.items():
        default = port.attributes.get("default", "")
        if default and name not in element.attributes:
            element.attributes[name] = default
            element.places[name] = port.places["default"]
