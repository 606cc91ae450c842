"""A file of BehaviorTree.CPP: its trees, and the one to run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.behaviors.registry import NodeType
from mpvi_bt.ground.errors import Problem, UnknownName, shown
from mpvi_bt.ground.marked_xml import Element

if TYPE_CHECKING:
    from mpvi_bt.executive.btcpp.placeholder import Placeholder

EXPLICIT = frozenset({"Action", "Condition", "Control", "Decorator"})
_TREE_ID = "letters, digits, '_' and '-'"


@dataclass
class Needs:
    """A tree's needs beyond its XML.

    Attributes:
        texts: Keys that whoever calls it sets, such as a goal: they become parameters.
        first_values: Of keys that it keeps for itself.
    """

    texts: dict[str, None] = field(default_factory=dict)
    first_values: dict[str, Value] = field(default_factory=dict)


@dataclass
class XmlFile:
    """The <BehaviorTree>s of a file, and what was found on the way.

    Attributes:
        name: Of the file, in problems.
        trees: By their IDs.
        problems: What has no equal here.
        warnings: What BehaviorTree.CPP does otherwise, or what was left out.
        count: Nodes of all trees so far, subtrees written out below their calls.
        needs: Of those trees that have any.
        placeholders: Stand-ins for leaves that nobody knows here, by their IDs.
        own: Their types, by kind.
        module: Name of the module that they are in.
    """

    name: str
    trees: dict[str, Element] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    count: int = 0
    needs: dict[str, Needs] = field(default_factory=dict)
    placeholders: Mapping[str, Placeholder] = field(default_factory=dict)
    own: Mapping[str, NodeType] = field(default_factory=dict)
    module: str = ""
    _words: set[str] = field(default_factory=set)
    _calls: dict[str, dict[str, None]] = field(default_factory=dict)

    def problem(self, element: Element, code: str, message: str, attribute: str = "", **more: Any) -> None:
        """Note a problem of an element, or of one of its attributes."""
        self.problems.append(Problem(self.name, *place_of(element, attribute), code, message, **more))

    def warn(self, element: Element, code: str, message: str, attribute: str = "") -> None:
        """Note a difference."""
        self.warn_at(place_of(element, attribute), code, message)

    def warn_at(self, place: tuple[int, int], code: str, message: str) -> None:
        """Note what concerns no single element."""
        self.warnings.append(Problem(self.name, *place, f"btcpp-{code}", message, "warning"))

    def unknown(
        self, element: Element, what: str, given: str, known: list[str], attribute: str = "", whose: str = ""
    ) -> None:
        """Note a name that is not known."""
        self.problems.append(Problem.unknown(self.name, place_of(element, attribute), what, given, known, whose))

    def trees_of(self, root: Element, main: str | None = None) -> str | None:
        """Fill in `trees`, and give the ID of the one to run: `main`, or else what the file says, or the only one.

        Raises:
            UnknownName: There is no tree `main`.
        """
        version = root.attributes.get("BTCPP_format")
        if root.tag != "root":
            self.problem(root, "no-btcpp", f"<{root.tag}>: a file of BehaviorTree.CPP begins with <root>")
        elif version is None:
            message = "no BTCPP_format: a file of version 3, which BehaviorTree.CPP's convert_v3_to_v4.py rewrites"
            self.problem(root, "btcpp-version", f'{message}; of version 4 it would be BTCPP_format="4"')
        elif version != "4":
            self.problem(root, "btcpp-version", f"format {version!r:.20}; '4' is read here", "BTCPP_format")
        if self.problems:
            return None
        for element in root.children:
            if element.tag == "BehaviorTree":
                self._tree(element)
            elif element.tag == "include":
                self.problem(element, "include", "includes are not followed; put the trees into one file")
            elif element.tag != "TreeNodesModel":
                self.unknown(element, "element", element.tag, ["BehaviorTree", "TreeNodesModel"])
        if not self.trees and not self.problems:
            self.problem(root, "main-tree", "there is no <BehaviorTree>")
        return self._main(root, main) if self.trees else None

    def _main(self, root: Element, main: str | None) -> str | None:
        """The ID of the tree to run, or None with a problem."""
        told = root.attributes.get("main_tree_to_execute")
        if main is not None and main not in self.trees:
            raise UnknownName("tree", main, self.trees, self.name)
        if main is not None:
            return main
        if told is not None:
            if told not in self.trees:
                self.unknown(root, "tree", told, list(self.trees), "main_tree_to_execute")
            return told
        called = {name for own in self.trees for name in self._called(own) if name != own}
        outermost = [own for own in self.trees if own not in called]
        if len(outermost) == 1:
            if len(self.trees) > 1:
                message = f"no main_tree_to_execute: {outermost[0]!r} is taken, the only tree that no other calls"
                self.warn(root, "main-tree", message)
            return outermost[0]
        which = f"{len(outermost)} that no other calls" if outermost else f"{len(self.trees)}, each called by another"
        names = ", ".join(repr(own) for own in outermost or self.trees)
        message = f"no main_tree_to_execute says which tree is run, and there are {which}: {names}. Give --main-tree"
        self.problem(root, "main-tree", message)
        return None

    def _tree(self, element: Element) -> None:
        name = element.attributes.get("ID", "")
        if not name or not all(c.isalnum() or c in "_-" for c in name):
            self.problem(element, "tree-id", f"a <BehaviorTree> needs an ID of {_TREE_ID}, not {shown(name)}", "ID")
        elif name in self.trees:
            self.problem(element, "duplicate-tree", f"a second <BehaviorTree> {name!r}", "ID")
        elif len(element.children) != 1:
            message = f"a <BehaviorTree> has one child, not {len(element.children)}"
            self.problem(element, "children", message)
        else:
            self.trees[name] = element

    def _called(self, name: str) -> Iterable[str]:
        """The trees that one calls."""
        if name not in self._calls:
            nodes = below(self.trees[name]) if name in self.trees else ()
            self._calls[name] = dict.fromkeys(e.attributes.get("ID", "") for e in nodes if tag_of(e) == "SubTree")
        return self._calls[name]

    def free_key(self, wanted: str) -> str:
        """An unused blackboard key for the file: the wanted one, or it with a number."""
        if not self._words:
            texts = (text for tree in self.trees.values() for e in below(tree) for text in e.attributes.values())
            self._words = {word for text in texts for word in re.findall(r"\w+", text)} | {""}
        names = (wanted if i == 1 else f"{wanted}_{i}" for i in count(1))
        key = next(name for name in names if name not in self._words)
        self._words.add(key)
        return key


def below(element: Element) -> Iterator[Element]:
    """An element, and all below it in the order of the file."""
    left = [element]
    while left:
        found = left.pop()
        yield found
        left += reversed(found.children)


def tag_of(element: Element) -> str:
    """The kind of a node, in the compact form or the explicit one."""
    return element.attributes.get("ID", "") if element.tag in EXPLICIT else element.tag


def made(element: Element, tag: str, **attributes: str) -> Element:
    """Another node in the place of one."""
    return Element(tag, attributes, element.place, {})


def place_of(element: Element, attribute: str = "") -> tuple[int, int]:
    """(line, column) of an attribute, or of the element if it has none of that name."""
    return element.places.get(attribute, element.place)
