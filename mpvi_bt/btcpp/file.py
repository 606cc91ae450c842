"""A file of BehaviorTree.CPP: which trees it holds, and which of them is run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mpvi_bt.btcpp.marked_xml import Element
from mpvi_bt.errors import Problem, shown

_TREE_ID = "letters, digits, '_' and '-'"


@dataclass
class TreeFile:
    """The <BehaviorTree>s of a file, and what was found on the way.

    Attributes:
        name: Of the file, in problems.
        trees: By their IDs.
        problems: What has no equal here.
        warnings: What BehaviorTree.CPP does otherwise, or what was left out.
        count: Nodes of all trees so far, subtrees written out below their calls.
        foreign: Nodes of ROS's Nav2, by their tags, the first of each.
    """

    name: str
    trees: dict[str, Element] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    count: int = 0
    foreign: dict[str, Element] = field(default_factory=dict)

    def problem(self, element: Element, code: str, message: str, attribute: str = "", **more: Any) -> None:
        """Note a problem of an element, or of one of its attributes."""
        self.problems.append(Problem(self.name, *place_of(element, attribute), code, message, **more))

    def warn(self, element: Element, code: str, message: str, attribute: str = "") -> None:
        """Note a difference."""
        self.warnings.append(Problem(self.name, *place_of(element, attribute), f"btcpp-{code}", message, "warning"))

    def unknown(self, element: Element, what: str, given: str, known: list[str], attribute: str = "") -> None:
        """Note a name that is not known."""
        self.problems.append(Problem.unknown(self.name, place_of(element, attribute), what, given, known))

    def trees_of(self, root: Element) -> str | None:
        """Fill in `trees`, and give the ID of the main one."""
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
        main = root.attributes.get("main_tree_to_execute")
        if not self.trees:
            if not self.problems:
                self.problem(root, "main-tree", "there is no <BehaviorTree>")
            return None
        if main is None and len(self.trees) == 1:
            return next(iter(self.trees))
        if main is None:
            self.problem(root, "main-tree", f"{len(self.trees)} trees, and no main_tree_to_execute says which is run")
        elif main not in self.trees:
            self.unknown(root, "tree", main, list(self.trees), "main_tree_to_execute")
        return main

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


def place_of(element: Element, attribute: str = "") -> tuple[int, int]:
    """(line, column) of an attribute, or of the element if it has none of that name."""
    return element.places.get(attribute, element.place)
