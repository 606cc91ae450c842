"""What calls hand on to subtrees: there by remapping keys of blackboards, here by the parameters of trees.

There each subtree has a blackboard of its own, and a port of its call fills an entry of it: with a text, or with the
entry of another name in the caller's. Here all keys are of the run. So what a call fills becomes a parameter of the
called tree, whose name stands for a text or for a key wherever the tree reads it. It can't be set or tested.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mpvi_bt.executive.behaviors import references
from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.btcpp.file import XmlFile, below, tag_of
from mpvi_bt.executive.btcpp.format import CONDITIONS
from mpvi_bt.executive.btcpp.mapping import KEY, is_pointer, own_kinds, ports_of
from mpvi_bt.executive.btcpp.models import autoremaps
from mpvi_bt.executive.btcpp.script import escaped, keys_of, keys_set
from mpvi_bt.executive.tree.spec import ParameterType
from mpvi_bt.executive.tree.tree_file import fits
from mpvi_bt.ground.errors import shown
from mpvi_bt.ground.marked_xml import Element

_SCRIPTS = CONDITIONS | {"code", "if"}
_KEYS = ("key", "output_key")  # ports that hold the name of a key
_INTEGER = re.compile("-?[0-9]{1,18}")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE][-+]?[0-9]+)?")


@dataclass(frozen=True)
class SubTreeNode:
    """A SubTree node.

    Attributes:
        element: Of the XML.
        caller, callee: IDs of trees.
        ports: What its ports say, by their names: a text, or a reference such as "{goal}".
    """

    element: Element
    caller: str
    callee: str
    ports: Mapping[str, str]


class Calls:
    """The calls of a file, once its trees are such as are read here."""

    def __init__(self, file: XmlFile) -> None:
        self.file = file
        self.calls = _calls(file)
        self._of = {id(call.element): call for call in self.calls}
        own = {name: [_names(element) for element in below(tree)] for name, tree in file.trees.items()}
        self._used = {name: set().union(*found) for name, found in own.items()}
        _settle(self._used, [(c.callee, c.caller, _hidden(c)) for c in self.calls])
        self._given: dict[str, set[str]] = {name: set() for name in file.trees}
        for call in self.calls:
            for port, text in call.ports.items():
                if port not in self._used[call.callee]:
                    message = f"port {port!r} is left out: nothing in tree {call.callee!r} reads it"
                    file.warn(call.element, "subtree-port", message, port)
                elif _key(text) != port:
                    self._given[call.callee].add(port)
        _settle(self._given, [(c.caller, c.callee, self._kept(c)) for c in self.calls])
        self._needed = self._texts()
        self._firsts: dict[str, set[str]] = {name: set() for name in file.trees}
        for name, needs in file.needs.items():
            self._firsts[name] = set(needs.first_values)
        _settle(self._firsts, [(c.callee, c.caller, lambda names: names) for c in self.calls])
        self._parameters: dict[str, dict[str, ParameterType]] = {}

    def parameters(self, tree: str) -> Mapping[str, ParameterType]:
        """Those of a tree, with their types."""
        if tree not in self._parameters:
            names = sorted(self._given[tree] | self._needed[tree])
            self._parameters[tree] = {name: self._type(tree, name) for name in names}
        return self._parameters[tree]

    def first_values(self, tree: str) -> Mapping[str, Value]:
        """First values of keys private to a tree or to one it calls."""
        values = {k: v for needs in self.file.needs.values() for k, v in needs.first_values.items()}
        return {key: values[key] for key in values if key in self._firsts[tree]}

    def arguments(self, element: Element) -> dict[str, Value]:
        """Arguments of a call of a tree; a value without an equal is noted as a problem."""
        call = self._of[id(element)]
        found: dict[str, Value] = {}
        for name, kind in self.parameters(call.callee).items():
            text = call.ports.get(name, f"{{{name}}}")
            key = _key(text)
            value: Value = escaped(text) if key is None else f"${key}"
            if key is None and kind != "text":
                value = int(text) if kind == "integer" else float(text)
            if key is not None and not KEY.fullmatch(key):
                message = f"{name}: {text!r:.40} is no reference here: keys are like 'cup_2'"
                self.file.problem(element, "port-value", message, name)
            elif not KEY.fullmatch(name):
                message = f"{shown(name)} is no name of a parameter here: names are like 'cup_2'"
                self.file.problem(element, "port-value", message, name)
            elif key is None and not fits(value, kind):
                message = f"{name}: a line of text can be handed on, not {shown(text)}"
                self.file.problem(element, "port-value", message, name)
            else:
                found[name] = value
        return found

    def own_keys(self, element: Element) -> str:
        """The keys that a called tree does not share with its caller there, for a person."""
        call = self._of[id(element)]
        names = set() if autoremaps(element) else self._used[call.callee] - call.ports.keys()
        return ", ".join(map(repr, sorted(names)))

    def _texts(self) -> dict[str, set[str]]:
        """Of each tree the keys that whoever runs it must set, as nothing in the file does."""
        set_here = keys_set_in(self.file)
        found: dict[str, set[str]] = {name: set() for name in self.file.trees}
        for name, needs in self.file.needs.items():
            found[name] = set(needs.texts) - set_here
        _settle(found, [(c.callee, c.caller, _outside(c)) for c in self.calls])
        return found

    def _kept(self, call: SubTreeNode) -> Callable[[set[str]], set[str]]:
        """The parameters of a caller that the called tree knows by the same name."""

        def same(names: set[str]) -> set[str]:
            autoremap = autoremaps(call.element)
            kept = {n for n in names if call.ports.get(n, f"{{{n}}}" if autoremap else "") == f"{{{n}}}"}
            return kept & self._used[call.callee]

        return same

    def _type(self, tree: str, name: str) -> ParameterType:
        """Of a parameter: a number if every call gives one and no text is made of it."""
        given = [call.ports.get(name, "{}") for call in self.calls if call.callee == tree]
        if not given or not all(_NUMBER.fullmatch(text) for text in given) or self._hands_on(tree, name):
            return "text"
        if any(_is_text(element, name) for element in below(self.file.trees[tree])):
            return "text"
        return "integer" if all(_INTEGER.fullmatch(text) for text in given) else "number"

    def _hands_on(self, tree: str, name: str) -> bool:
        """Whether a tree hands a parameter on to others."""
        calls = [call for call in self.calls if call.caller == tree]
        return any(
            name in map(_key, call.ports.values()) or name in _hidden(call)(self._used[call.callee]) for call in calls
        )


def keys_set_in(file: XmlFile) -> set[str]:
    """The keys that a file's scripts and its nodes of a known kind set."""
    return {key for tree in file.trees.values() for element in below(tree) for key in _set(element)}


def keys_handed_on(file: XmlFile) -> set[str]:
    """The keys that calls fill, and the keys that the file's user must set."""
    filled = {port for call in _calls(file) for port, text in call.ports.items() if _key(text) != port}
    return filled.union(*(needs.texts for needs in file.needs.values()))


def _calls(file: XmlFile) -> list[SubTreeNode]:
    found = [
        SubTreeNode(element, name, element.attributes.get("ID", ""), _ports(element))
        for name, tree in file.trees.items()
        for element in below(tree)
        if tag_of(element) == "SubTree"
    ]
    return [call for call in found if call.callee in file.trees]


def _ports(element: Element) -> dict[str, str]:
    """What a call hands on; "{=}" is the key of the port's name."""
    given = {k: v for k, v in element.attributes.items() if k not in ("ID", "name") and not k.startswith("_")}
    return {name: f"{{{name}}}" if text == "{=}" else text for name, text in given.items()}


def _key(text: str) -> str | None:
    """The key that a port's text refers to, or None if it is a text."""
    return text.strip(" ")[1:-1] if is_pointer(text) else None


def _names(element: Element) -> set[str]:
    """The keys that a node names."""
    found: set[str] = set()
    for attribute, text in element.attributes.items():
        if attribute in _SCRIPTS:
            found |= keys_of(text)
        elif attribute in ("ID", "name") or attribute.startswith("_"):
            continue
        elif (key := _key(text)) is not None:
            found.add(attribute if key == "=" else key)
        else:
            found.update([text] if attribute in _KEYS else references.names_in(text))
    return found


def _set(element: Element) -> set[str]:
    """The keys that a node sets."""
    found = set().union(*(keys_set(text) for name, text in element.attributes.items() if name in _SCRIPTS))
    if tag_of(element) == "SetBlackboard":
        found.add(element.attributes.get("output_key", ""))
    if tag_of(element) == "Set":
        found.add(element.attributes.get("key", ""))
    return found


def _is_text(element: Element, name: str) -> bool:
    """Whether a node takes the value of a key for a text."""
    kind = own_kinds().get(tag_of(element), "")
    ports = ports_of(kind) if kind else {}
    return any(_key(text) == name and port in ports and ports[port].text for port, text in element.attributes.items())


def _hidden(call: SubTreeNode) -> Callable[[set[str]], set[str]]:
    """The keys of a called tree that are its caller's, too, without being named by the call."""
    return lambda names: names - call.ports.keys() if autoremaps(call.element) else set()


def _outside(call: SubTreeNode) -> Callable[[set[str]], set[str]]:
    """Translates the needed keys of a called tree into the caller's keys; keys filled with a text drop out."""

    def renamed(names: set[str]) -> set[str]:
        return {key for name in names if (key := _key(call.ports.get(name, f"{{{name}}}"))) is not None}

    return renamed


def _settle(found: dict[str, set[str]], links: list[tuple[str, str, Callable[[set[str]], set[str]]]]) -> None:
    """Add to the names of each tree those that its links bring, until nothing changes.

    Args:
        found: Names of each tree.
        links: From a tree, to another, and what becomes of the names on the way.
    """
    onwards: dict[str, list[tuple[str, Callable[[set[str]], set[str]]]]] = {}
    for one, other, change in links:
        onwards.setdefault(one, []).append((other, change))
    left = list(found)
    while left:
        one = left.pop()
        for other, change in onwards.get(one, ()):
            new = change(found[one]) - found[other]
            if new:
                found[other] |= new
                left.append(other)
