"""A tree as XML of BehaviorTree.CPP 4, which Groot2 opens."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

from mpvi_bt.executive.behaviors.parameters import Call
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.btcpp import mapping
from mpvi_bt.executive.btcpp.script import KeyValues, assignment, comparison_code, first_value
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.marked_xml import MAX_DEPTH

_NOT_PLAIN = re.compile("[^\t\n\r\x20-\x7e\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # nor in YAML


@dataclass(frozen=True)
class Exported:
    """What came of a tree.

    Attributes:
        xml: The file's text.
        warnings: What BehaviorTree.CPP does otherwise, each with the node's place.
    """

    xml: str
    warnings: tuple[Problem, ...]


def to_xml(tree: TreeSpec) -> Exported:
    """The tree as one file: its own <BehaviorTree>, one for each different call of a subtree, and our nodes' models.

    Parameters of trees are filled in. One of type text that has no value becomes an entry of the blackboard, which
    the program sets.

    Raises:
        FileProblems: What cannot be said in BehaviorTree.CPP's words.
    """
    return _Exporter(tree).export()


class _Exporter:
    def __init__(self, tree: TreeSpec) -> None:
        self.tree = tree
        self.board = KeyValues(tree)
        self.problems: list[Problem] = []
        self.warnings: list[Problem] = []
        self.ids: set[str] = set()
        self.subtrees: list[tuple[str, str, NodeSpec]] = []  # (ID, name of the tree, its root), one for each ID
        self.used: set[str] = set()

    def export(self) -> Exported:
        self._parameters()
        main = self._new_id(self.tree.name)
        root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute=main)
        told = {"tree": "" if self.tree.name == main else self.tree.name}
        told |= {"about": self.tree.about, "instruction": self.tree.instruction}
        behavior = ElementTree.SubElement(root, "BehaviorTree", ID=main)
        self._describe(behavior, told)
        self._node(self._with_first_values(behavior), self.tree.root, (), 1)
        done = 0
        while done < len(self.subtrees):  # a subtree may call others
            name, _, spec = self.subtrees[done]
            self._node(ElementTree.SubElement(root, "BehaviorTree", ID=name), spec, (), 1)
            done += 1
        self._models(ElementTree.SubElement(root, "TreeNodesModel"))
        if self.problems:
            raise FileProblems(self.problems)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode")
        return Exported(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', tuple(self.warnings))

    def _parameters(self) -> None:
        for name, parameter in self.tree.parameters.items():
            if name not in self.tree.unbound:
                message = f"parameter {name!r} is filled in: its value stands in its place"
            elif parameter.type == "text":
                message = f"parameter {name!r} becomes an entry of the blackboard, which the program must set"
            else:
                message = f"parameter {name!r} has no value, and a reference can stand for text only; give it a default"
                self._note(self.tree.root, "unbound-parameter", message, "error")
                continue
            self._note(self.tree.root, "parameter", message)

    def _with_first_values(self, behavior: ElementTree.Element) -> ElementTree.Element:
        """The element for the tree's root, below nodes that set the first values of keys."""
        if not self.tree.blackboard:
            return behavior
        sequence = ElementTree.SubElement(behavior, "Sequence", name=mapping.FIRST_VALUES)
        for key, value in self.tree.blackboard.items():
            made = first_value(key, value, self.board.types.get(key))
            if made is None:
                message = f"blackboard key {key!r}: BehaviorTree.CPP takes {value!r:.40} for a reference"
                self._note(self.tree.root, "reference", message, "error")
                continue
            element = ElementTree.SubElement(sequence, made[0])
            self._set(element, self.tree.root, made[1])
        return sequence

    def _node(self, above: ElementTree.Element, spec: NodeSpec, inherited: tuple[int, ...], depth: int) -> None:
        if depth >= MAX_DEPTH - 2:
            self._note(spec, "too-deep", f"BehaviorTree.CPP reads nodes nested up to {MAX_DEPTH} deep", "error")
            return
        element = self._builtin(above, spec)
        if element is None:
            element = self._own(above, spec)
        call = spec.label if isinstance(spec.parameters, Call) and spec.parameters.arguments else ""
        segments = {} if spec.segments == inherited else {"segments": spec.segments}
        self._describe(element, {**segments, "call": call})
        if spec.kind != "subtree":
            for child in spec.children:
                self._node(element, child, spec.segments, depth + 1)

    def _builtin(self, above: ElementTree.Element, spec: NodeSpec) -> ElementTree.Element | None:
        """The node as one of theirs, or None if none does the same."""
        made: tuple[str, dict[str, str]] | None
        if spec.kind == "subtree":
            made = "SubTree", {"ID": self._subtree(spec), "_autoremap": "true"}
        elif spec.kind == "set":
            made = assignment(spec.parameters, self.board)  # type: ignore[arg-type]
        elif spec.kind in ("test", "condition"):
            return self._comparison(above, spec)
        else:
            made = self._by_table(spec)
        if made is None:
            return None
        element = ElementTree.SubElement(above, made[0])
        named = {"name": spec.name} if spec.type.headline == "name" and spec.name else {}
        self._set(element, spec, named | made[1])
        return element

    def _by_table(self, spec: NodeSpec) -> tuple[str, dict[str, str]] | None:
        for row in mapping.BUILTINS:
            if row.kind != spec.kind or any(getattr(spec.parameters, k) != v for k, v in row.fixed.items()):
                continue
            value = getattr(spec.parameters, row.parameter) if row.parameter else None
            text = None if value is None else mapping.to_msec(value) if row.port == "msec" else str(value)
            if text is None and row.port not in ("", "name"):
                return None
            if row.differs:
                self._note(spec, row.tag, f"{row.tag}: {row.differs}")
            return row.tag, {**row.constant, **({} if text is None else {row.port: text})}
        return None

    def _comparison(self, above: ElementTree.Element, spec: NodeSpec) -> ElementTree.Element | None:
        """A test as a script; a condition as a ReactiveSequence that runs the script before each tick of its child."""
        code = comparison_code(spec.parameters, self.board)  # type: ignore[arg-type]
        if code is None:
            return None
        if spec.kind == "condition":
            above = ElementTree.SubElement(above, "ReactiveSequence")
            self._set(above, spec, {"name": spec.label})
        element = ElementTree.SubElement(above, "ScriptCondition")
        self._set(element, spec, {"code": code})
        return element if spec.kind == "test" else above

    def _own(self, above: ElementTree.Element, spec: NodeSpec) -> ElementTree.Element:
        """The node as one of ours."""
        self.used.add(spec.kind)
        element = ElementTree.SubElement(above, mapping.own_id(spec.kind))
        attributes = {"name": spec.name} if spec.type.headline == "name" and spec.name else {}
        for name, port in mapping.ports_of_type(spec.type).items():
            value = getattr(spec.parameters, name)
            if value is None or (value is False and type(spec.parameters).model_fields[name].default is False):
                continue
            try:
                attributes[name] = mapping.to_port(value, port.text)
            except ValueError as error:
                self._note(spec, "reference", f"{name}: {error}", "error")
        self._set(element, spec, attributes)
        return element

    def _subtree(self, spec: NodeSpec) -> str:
        """The ID of the <BehaviorTree> that a call stands for: one for each different root."""
        assert isinstance(spec.parameters, Call)
        name = Path(spec.parameters.tree).stem
        for known, tree, root in self.subtrees:
            if tree == name and root == spec.children[0]:
                return known
        self.subtrees.append((self._new_id(name), name, spec.children[0]))
        return self.subtrees[-1][0]

    def _new_id(self, name: str) -> str:
        """One that is valid, and neither a node's nor another tree's."""
        wanted = re.sub(r"[^A-Za-z0-9_-]", "_", name)
        taken = self.ids | mapping.THEIRS | mapping.KEPT | set(mapping.own_kinds())
        number = 2
        found = wanted
        while found in taken:
            found, number = f"{wanted}_{number}", number + 1
        self.ids.add(found)
        return found

    def _models(self, above: ElementTree.Element) -> None:
        """Models of our nodes: the used ones, and all without an equal in BehaviorTree.CPP."""
        theirs = {row.kind for row in mapping.BUILTINS} | {"subtree", "set", "test", "condition"}
        types = {**node_types(), **{placed.spec.kind: placed.spec.type for placed in self.tree.nodes}}
        for kind, node_type in sorted(types.items(), key=lambda item: mapping.own_id(item[0])):
            if kind in theirs - self.used:
                continue
            model = ElementTree.SubElement(above, mapping.model_of(node_type), ID=mapping.own_id(kind))
            for name, port in mapping.ports_of_type(node_type).items():
                made = ElementTree.SubElement(model, "input_port", name=name, type=port.type)
                if port.optional:
                    made.set("default", "")
            ElementTree.SubElement(model, "description").text = node_type.summary

    def _set(self, element: ElementTree.Element, spec: NodeSpec, attributes: Mapping[str, str]) -> None:
        for name, value in attributes.items():
            if bad := _NOT_PLAIN.search(value):
                self._note(spec, "character", f"{name}: the character {bad.group()!r} cannot stand in XML", "error")
            element.set(name, value)

    def _describe(self, element: ElementTree.Element, told: Mapping[str, Any]) -> None:
        """Write data without a place in BehaviorTree.CPP into the description, which Groot2 shows."""
        kept = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in told.items() if value != ""]
        if kept:
            element.set("_description", _NOT_PLAIN.sub(lambda c: f"\\U{ord(c.group()):08x}", "\n".join(kept)))

    def _note(self, spec: NodeSpec, code: str, message: str, severity: Literal["warning", "error"] = "warning") -> None:
        place = spec.place
        where = (place.file, place.line, place.column) if place else (self.tree.name, 0, 0)
        notes = self.warnings if severity == "warning" else self.problems
        notes.append(Problem(*where, f"btcpp-{code.lower()}", message, severity))
