"""One tree of an XML file as the data that a YAML file of ours would hold, with the places of the XML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from mpvi_bt.executive.behaviors import references
from mpvi_bt.executive.behaviors.parameters import Comparison, Value
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.btcpp import equivalents, mapping, nav2
from mpvi_bt.executive.btcpp.condition_script import ScriptTest, read_condition
from mpvi_bt.executive.btcpp.file import EXPLICIT, XmlFile, below, place_of, tag_of
from mpvi_bt.executive.btcpp.placeholders import is_foreign, parameters_of
from mpvi_bt.executive.btcpp.script import escaped, read_assignments
from mpvi_bt.executive.btcpp.subtree_ports import Calls
from mpvi_bt.executive.tree.reader import MAX_DEPTH, MAX_NODES, read
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.tree_file import TreeReading
from mpvi_bt.ground.errors import FileProblems, shown
from mpvi_bt.ground.marked_xml import Element
from mpvi_bt.ground.marked_yaml import Location, SourceMarks, parse_marked

_STAND_IN: dict[str, Any] = {"succeed": None}  # for what has no equal, so that the reader goes on
_COUNTS = ("num_attempts", "num_cycles")
_OPTION = "with --placeholders it becomes a stand-in for you to write"
_NEAREST = {**equivalents.NEAREST, **nav2.NEAREST}


class ElementReader:
    """Reads one <BehaviorTree> into a TreeSpec; called trees are written out below their calls."""

    def __init__(self, file: XmlFile, calls: Calls, name: str) -> None:
        self.file, self.calls, self.name = file, calls, name
        self.marks = SourceMarks(file.name)
        self.within = [name]  # the tree, and those that were called on the way down
        self.bound: Mapping[str, Any] = {}  # the arguments of the innermost call

    def read(self, main: bool) -> TreeSpec | None:
        """The tree, or None if anything about it is wrong, which is noted; `main`: it is the one to run."""
        behavior = self.file.trees[self.name]
        told = self._description(behavior)
        data: dict[str, Any] = {"tree": self.name, **{k: v for k, v in told.items() if k != "segments"}}
        self.marks.values[()] = behavior.place
        for key in data:
            self._mark((key,), behavior, "_description" if key in told else "ID")
        root = behavior.children[0]
        if main and (first := self._first_values(root)) is not None:
            data["blackboard"], root = first, root.children[-1]
        if parameters := self.calls.parameters(self.name):
            data["parameters"] = dict(parameters)
        if first_values := self.calls.first_values(self.name):
            data["blackboard"] = {**data.get("blackboard", {}), **first_values}
        data["root"] = self._node(root, ("root",))
        told_places = {(p.line, p.column) for p in self.file.problems}
        try:
            tree = read(data, self.marks, TreeReading(expanded=True, own=dict(self.file.own)), {})
        except FileProblems as error:
            self.file.problems += [p for p in error.problems if (p.line, p.column) not in told_places]
            return None
        has_own = any(tag_of(element) in self.file.placeholders for element in below(behavior))
        return replace(tree, own_nodes=(f"{self.file.module}.py",)) if has_own else tree

    def _first_values(self, element: Element) -> dict[str, Any] | None:
        """First values of keys, if the element is the Sequence that our export writes for them."""
        if element.tag != "Sequence" or element.attributes.get("name") != mapping.FIRST_VALUES:
            return None
        values: dict[str, Any] = {}
        for child in element.children[:-1]:
            given = _constant(child)
            if given is None:
                return None
            values[given[0]] = given[1]
            self._mark(("blackboard", given[0]), child)
        self._mark(("blackboard",), element)
        return values or None

    def _node(self, element: Element, at: Location) -> dict[str, Any]:
        """The data of a node. A node without an equal becomes a stand-in, so that its children are still checked."""
        self.file.count += 1
        if self.file.count > MAX_NODES:
            self.file.problem(element, "too-large", f"more than {MAX_NODES} nodes, subtrees written out")
            raise FileProblems(self.file.problems)
        self.marks.values[at] = element.place
        if sum(part in ("child", "children") for part in at) >= MAX_DEPTH:
            return _STAND_IN  # the reader says that it is too deep
        if "_onHalted" in element.attributes:
            self.file.problem(element, "unmapped-attribute", "_onHalted has no equal here", "_onHalted")
        tag = tag_of(element)
        if tag == "SubTree":
            return self._call(element, at)
        if tag in ("Script", "SetBlackboard"):
            return self._assignments(element, at)
        if tag == "ScriptCondition":
            return self._comparison(element, at)
        if tag == "ReactiveSequence" and (guarded := self._condition(element, at)):
            return guarded
        if (placeholder := self.file.placeholders.get(tag)) is not None and not element.children:
            names = {port.parameter: name for name, port in placeholder.ports.items()}
            return self._data(element, at, placeholder.kind, parameters_of(placeholder, self.file, element), names)
        if tag in mapping.own_kinds():
            return self._own(element, at, mapping.own_kinds()[tag])
        if any(row.tag == tag for row in mapping.BUILTINS):
            return self._builtin(element, at, tag)
        hint = f"; {_OPTION}" if is_foreign(element) else ""
        if tag in mapping.THEIRS | mapping.NAV2:
            near = f"the nearest is {_NEAREST[tag]}" if tag in _NEAREST else "docs/btcpp.md lists what has"
            whose = " of Nav2" if tag in mapping.NAV2 else ""
            self.file.problem(element, "unmapped-node", f"{tag}{whose} has no equal here; {near}{hint}")
        else:
            known = {row.tag for row in mapping.BUILTINS} | set(mapping.own_kinds()) | {"Script", "SetBlackboard"}
            self.file.unknown(element, "node", tag, sorted(known | {"ScriptCondition", "SubTree"}), whose=hint)
        return self._stand_in(element, at)

    def _stand_in(self, element: Element, at: Location) -> dict[str, Any]:
        """A stand-in for a node without an equal here; its children are still checked."""
        for child in element.children:
            self._node(child, at)
        return _STAND_IN

    def _builtin(self, element: Element, at: Location, tag: str) -> dict[str, Any]:
        rows = [row for row in mapping.BUILTINS if row.tag == tag]
        row = rows[0] if tag != "Parallel" else self._parallel(element, rows)
        given: dict[str, Any] = dict(row.fixed)
        attributes = element.attributes
        if row.port in attributes and (row.port != "name" or mapping.KEY.fullmatch(attributes["name"])):
            given[row.parameter] = self._decoded(element, row.port, lambda: _port_value(row.port, attributes[row.port]))
        if row.port in _COUNTS and attributes.get(row.port, "").strip() == "-1":
            most = node_types()[row.kind].parameters.model_json_schema()["properties"][row.parameter]["maximum"]
            message = f"{row.port} -1 is for ever, which has no equal here: write how often, 1 to {most}"
            self.file.problem(element, "out-of-range", message, row.port)
            given[row.parameter] = 1
        if row.differs:
            self.file.warn(element, tag.lower(), f"{tag}: {row.differs}")
        return self._data(element, at, row.kind, given, {row.parameter: row.port})

    def _parallel(self, element: Element, rows: list[mapping.Builtin]) -> mapping.Builtin:
        defaults = {"success_count": "-1", "failure_count": "1"}
        counts = {name: element.attributes.get(name, default).strip() for name, default in defaults.items()}
        whole = {**counts, "success_count": "-1"} if counts["success_count"] == str(len(element.children)) else counts
        for wanted in (counts, whole):
            for row in rows:
                if row.constant == wanted:
                    return row
        message = "of a Parallel, success_count -1 (all) or 1 and failure_count 1 have an equal here, not "
        given = ", ".join(f"{name} {value!r:.20}" for name, value in counts.items())
        attribute = next((name for name in ("success_count", "failure_count") if name in element.attributes), "")
        self.file.problem(element, "unmapped-parallel", message + given, attribute)
        return rows[0]

    def _own(self, element: Element, at: Location, kind: str) -> dict[str, Any]:
        ports = mapping.ports_of(kind)
        allowed = {"name", *ports} | ({"ID"} if element.tag in EXPLICIT else set())
        for name in element.attributes:
            if name not in allowed and not name.startswith("_"):
                self.file.unknown(element, "port", name, sorted({"name", *ports}), name)
        for name in sorted(name for name, port in ports.items() if not port.optional):
            if name not in element.attributes:
                self.file.problem(element, "missing-port", f"{element.tag} needs the port {name!r}")
        given = {}
        keys = (*node_types()[kind].reads, *node_types()[kind].writes)
        for name, port in ports.items():
            if name in element.attributes and not (port.optional and element.attributes[name] == ""):
                text = element.attributes[name]
                given[name] = self._decoded(element, name, lambda t=text, p=port: mapping.from_port(t, p.text))
                if name in keys and mapping.is_pointer(text) and isinstance(given[name], str):
                    given[name] = given[name].removeprefix("$")
        return self._data(element, at, kind, given, {})

    def _call(self, element: Element, at: Location) -> dict[str, Any]:
        name = element.attributes.get("ID", "")
        if element.children:
            self.file.problem(element, "children", "a SubTree has no children here; its tree is a <BehaviorTree>")
        if name in self.file.trees and (keys := self.calls.own_keys(element)):
            message = f"without _autoremap tree {name!r} has keys of its own there, here they are of the run: {keys}"
            self.file.warn(element, "subtree", message)
        given: dict[str, Any] = {"tree": name}
        if name in self.file.trees and (arguments := self.calls.arguments(element)):
            given["arguments"] = arguments
        data = {**self._data(element, at, "subtree", given, {"tree": "ID"}), "child": _STAND_IN}
        if name not in self.file.trees:
            self.file.unknown(element, "tree", name, list(self.file.trees), "ID")
        elif name in self.within:
            chain = " -> ".join([*self.within[self.within.index(name) :], name])
            self.file.problem(element, "recursion", f"a tree can't contain itself: {chain}", "ID")
        else:
            self.within.append(name)
            outer, self.bound = self.bound, data.get("arguments", {})
            data["child"] = {**self._node(self.file.trees[name].children[0], (*at, "child"))}
            data["child"].setdefault("segments", [])  # else it would have the caller's
            self.within.pop()
            self.bound = outer
        return data

    def _assignments(self, element: Element, at: Location) -> dict[str, Any]:
        """A node that sets keys; for a script with several, a sequence of nodes."""
        attributes = element.attributes
        if tag_of(element) == "SetBlackboard":
            text = attributes.get("value", "")
            value = self._decoded(element, "value", lambda: mapping.from_port(text, as_text=True))
            value = escaped(value) if value == text else value
            given = {"key": attributes.get("output_key", ""), "value": value}
            return self._data(element, at, "set", given, {"key": "output_key", "value": "value"})
        found = read_assignments(attributes.get("code", ""))
        if found is None:
            message = f"this script has no equal here: {shown(attributes.get('code', ''))}. One such as "
            self.file.problem(
                element, "unmapped-script", message + "\"cups := 0; cups += 1; room := 'hall'\" has", "code"
            )
            return _STAND_IN
        if len(found) == 1:
            return self._data(element, at, "set", found[0], dict.fromkeys(found[0], "code"))
        data = self._data(element, at, "sequence", {"memory": True}, {})
        data["children"] = [
            self._data(element, (*at, "children", i), "set", one, dict.fromkeys(one, "code"))
            for i, one in enumerate(found)
        ]
        return data

    def _comparison(self, element: Element, at: Location) -> dict[str, Any]:
        """A node that tests keys; of a script with several tests, a sequence or a selector of them."""
        code = element.attributes.get("code", "")
        found = read_condition(code)
        if found is None:
            message = f"this script has no equal here: {shown(code)}. One such as "
            self.file.problem(element, "unmapped-script", message + "\"cups > 3 && room != 'hall'\" has", "code")
            return _STAND_IN
        for key in found.bare:
            self.file.warn(element, "script", f"{key!r} alone is read as {key} == true", "code")
        return self._tests(element, at, found)

    def _tests(self, element: Element, at: Location, asked: ScriptTest) -> dict[str, Any]:
        if asked.test:
            return self._data(element, at, "test", asked.test, dict.fromkeys(asked.test, "code"))
        data = self._data(element, at, "sequence" if asked.every else "selector", {"memory": True}, {})
        inner = replace(element, attributes={"code": element.attributes["code"]})
        data["children"] = [self._tests(inner, (*at, "children", i), part) for i, part in enumerate(asked.parts)]
        return data

    def _condition(self, element: Element, at: Location) -> dict[str, Any] | None:
        """The condition that a ReactiveSequence is, if our export named it so."""
        if len(element.children) != 2 or element.children[0].tag != "ScriptCondition":
            return None
        found = read_condition(element.children[0].attributes.get("code", ""))
        if found is None or not found.test:
            return None
        try:
            label = node_types()["condition"].label_of("", Comparison.model_validate(found.test))
        except ValueError:
            return None
        if element.attributes.get("name") != label:
            return None
        inner = Element(element.tag, {**element.attributes, "name": element.tag}, element.place, element.places)
        inner.children = element.children[1:]
        return self._data(inner, at, "condition", found.test, {})

    def _data(
        self, element: Element, at: Location, kind: str, given: dict[str, Any], ports: Mapping[str, str]
    ) -> dict[str, Any]:
        """A node as a YAML file of ours would hold it, with its places; what is below an element, too.

        Args:
            element: Of the XML.
            at: Where in the data it goes.
            kind, given: Its kind and parameters.
            ports: The attributes that hold them, where they are named otherwise.
        """
        node_type = self.file.own.get(kind) or node_types()[kind]
        filled = {given.get(key) for key in (*node_type.reads, *node_type.writes)}
        for key in filled & self.calls.parameters(self.within[-1]).keys():
            message = (
                f"the key {key!r} is filled in by a call of tree {self.within[-1]!r}, so it can't be set or tested here"
            )
            self.file.problem(element, "subtree-port", message, next(iter(ports.values()), ""))
        given = references.fill(given, self.bound)
        name = element.attributes.get("name") or None
        own = name and name.replace("$", "$$")  # a name here refers to nothing
        headline = own if node_type.headline == "name" else given.get(node_type.headline)
        if name not in (None, element.tag, element.attributes.get("ID"), headline):
            self.file.warn(element, "name", f"{kind!r} has no name here; {name!r:.60} is left out", "name")
        data = {kind: headline, **{key: value for key, value in given.items() if key != node_type.headline}}
        self.marks.values[at] = element.place
        for key in data:
            parameter = node_type.headline if key == kind else key
            self._mark((*at, key), element, ports.get(parameter, parameter))
        self.marks.keys[(*at, kind)] = element.place
        told = self._description(element)
        if "segments" in told:
            data["segments"] = told["segments"]
            self._mark((*at, "segments"), element, "_description")
        if kind != "subtree":
            self._below(element, at, node_type.family, data)
        return data

    def _below(self, element: Element, at: Location, family: str, data: dict[str, Any]) -> None:
        if family == "composite" and tag_of(element) not in ("Script", "ScriptCondition"):
            self._mark((*at, "children"), element)
            data["children"] = [self._node(child, (*at, "children", i)) for i, child in enumerate(element.children)]
        elif family == "decorator" and len(element.children) == 1:
            self._mark((*at, "child"), element)
            data["child"] = self._node(element.children[0], (*at, "child"))
        elif element.children or family == "decorator":
            wanted = "one child" if family == "decorator" else "no children"
            self.file.problem(element, "children", f"<{element.tag}> takes {wanted}, not {len(element.children)}")
            data |= {"child": _STAND_IN} if family == "decorator" else {}

    def _decoded(self, element: Element, port: str, decode: Any) -> Any:
        try:
            return decode()
        except ValueError as error:
            what = "not a text in quotes" if isinstance(error, json.JSONDecodeError) else str(error)
            self.file.problem(element, "port-value", f"{port}: {what}", port)
            return None

    def _description(self, element: Element) -> dict[str, Any]:
        """What our export wrote into a description; of anyone else's, the text as the line about a tree."""
        text = element.attributes.get("_description", "")
        try:
            found = parse_marked(text, self.file.name)[0] if text else {}
        except FileProblems:
            found = text
        if isinstance(found, dict) and found.keys() <= {"tree", "about", "instruction", "segments", "call"}:
            return {key: value for key, value in found.items() if key != "call"}
        if element.tag == "BehaviorTree":
            return {"about": text}
        self.file.warn(element, "description", "the description of a node is left out", "_description")
        return {}

    def _mark(self, at: Location, element: Element, attribute: str = "") -> None:
        self.marks.values[at] = self.marks.keys[at] = place_of(element, attribute)


def _port_value(port: str, text: str) -> Any:
    """The value of a BehaviorTree.CPP port. Raises ValueError if it has none."""
    if port == "name":
        return text
    return mapping.from_msec(text) if port == "msec" else mapping.from_port(text.strip(), as_text=False)


def _constant(element: Element) -> tuple[str, Value] | None:
    """Key and value of a node that gives a key a value, as our export does it; None if it is any other."""
    if element.tag == "SetBlackboard":
        text = element.attributes.get("value", "")
        return None if mapping.is_pointer(text) else (element.attributes.get("output_key", ""), text)
    found = read_assignments(element.attributes.get("code", "")) if element.tag == "Script" else None
    if found is None or len(found) != 1 or isinstance(found[0].get("value", ""), str):
        return None
    return found[0]["key"], found[0]["value"]
