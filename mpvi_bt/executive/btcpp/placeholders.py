"""Stand-ins for a file's unknown leaves: kinds with their ports, for the user to write.

What each does is in C++ there. Here a module of Python is made with a class for each that fails until it is written;
a dry run puts its own stand-in in its place.
"""

from __future__ import annotations

import contextlib
import keyword
import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.behaviors.registry import NodeType, node_types
from mpvi_bt.executive.btcpp import mapping
from mpvi_bt.executive.btcpp.file import Needs, XmlFile, below, tag_of
from mpvi_bt.executive.btcpp.format import is_port
from mpvi_bt.executive.btcpp.models import Models
from mpvi_bt.executive.btcpp.placeholder import Placeholder, PortOf
from mpvi_bt.executive.btcpp.script import escaped
from mpvi_bt.executive.btcpp.subtree_ports import keys_handed_on, keys_set_in
from mpvi_bt.ground.marked_xml import Element

_FIRST: Mapping[str, Value] = {"int": 0, "unsigned int": 0, "double": 0.0, "float": 0.0, "bool": False}
_TAKEN = frozenset({"name", "child", "children", "segments", "self"})


def placeholders_of(file: XmlFile, models: Models) -> dict[str, Placeholder]:
    """Leaves of all trees that are not our nodes, by ID, with everything known of their ports."""
    uses: dict[str, list[tuple[str, Element]]] = {}
    for name, tree in file.trees.items():
        for element in below(tree.children[0]):
            if is_foreign(element):
                uses.setdefault(tag_of(element), []).append((name, element))
    found: dict[str, Placeholder] = {}
    for tag, nodes in uses.items():
        taken = node_types().keys() | _TAKEN | {one.kind for one in found.values()}
        placeholder = Placeholder(tag, _name(tag, taken, "node"), nodes[0][1].place[0])
        model = models.get((False, tag))
        described = dict(model.ports) if model else {}
        names = [*described, *(port for _, element in nodes for port in element.attributes if is_port(port))]
        for port in dict.fromkeys(name for name in names if name not in ("ID", "name")):
            used = {one.parameter for one in placeholder.ports.values()}
            made = PortOf(_name(port, node_types().keys() | _TAKEN | used, "port"))
            if (about := described.get(port)) is not None:
                made.direction, made.type = about.tag, about.attributes.get("type", "")
                if (default := about.attributes.get("default", "")) and made.direction == "input_port":
                    with contextlib.suppress(ValueError):  # told where a node takes it
                        made.default = _value(default, port, made)
            made.must = made.default is None and all(port in element.attributes for _, element in nodes)
            placeholder.ports[port] = made
        found[tag] = placeholder
    _outputs(file, found, uses)
    return found


def is_foreign(element: Element) -> bool:
    """Whether a node is a leaf that nobody knows here."""
    tag = tag_of(element)
    known = tag in mapping.THEIRS or tag in mapping.own_kinds()
    return bool(tag) and not known and not element.children


def node_types_of(module: str, name: str) -> dict[str, NodeType]:
    """The nodes that the text of a module declares, by kind."""
    scope: dict[str, Any] = {"__name__": name}
    exec(compile(module, f"{name}.py", "exec", dont_inherit=True), scope)  # of our own making, in `module_text`
    return {value.kind: value for value in scope.values() if isinstance(value, NodeType)}


def parameters_of(one: Placeholder, file: XmlFile, element: Element) -> dict[str, Any]:
    """Parameters of an element that a placeholder stands for. A port that cannot be read is a problem of the file."""
    found: dict[str, Any] = {}
    for name, port in one.ports.items():
        if name not in element.attributes:
            continue
        text = element.attributes[name]
        try:
            found[port.parameter] = _value(f"{{{name}}}" if text == "{=}" else text, name, port)
        except ValueError as error:
            file.problem(element, "port-value", f"{name}: {error}", name)
            found[port.parameter] = None
    return found


def module_text(found: Iterable[Placeholder], source: str, module: str) -> str:
    """A module with the nodes of a file that have to be written, as Python."""
    nodes = list(found)
    classes = [_class_name(one) for one in nodes]
    parts = [
        f'"""Nodes of {_quoted(source)} that mpvi_bt does not have: write in `update` what each does.\n\n'
        "In an input, `value_of(self.PORT, self.context.blackboard)` is its value now; an output is the key of the\n"
        'blackboard that the node sets: `self.context.blackboard[self.PORT] = ...`.\n"""\n\n'
        "from py_trees.common import Status\n\n"
        "from mpvi_bt.executive.behaviors.node import Leaf\n"
        "from mpvi_bt.executive.behaviors.parameters import Key, Parameters, Value\n"
        "from mpvi_bt.executive.behaviors.registry import NodeType\n"
    ]
    parts += [_node_text(one, name, source, module) for one, name in zip(nodes, classes, strict=True)]
    return "\n\n".join(parts)


def _node_text(one: Placeholder, name: str, source: str, module: str) -> str:
    ports = sorted(one.ports.values(), key=lambda port: not port.must)  # what has a default comes last
    fields = [f"    {port.parameter}: {_annotation(port)}" for port in ports]
    taken = "".join(f", {field.strip()}" for field in fields)
    kept = "".join(f"        self.{port.parameter} = {port.parameter}\n" for port in ports)
    return (
        f"class {name}Ports(Parameters):\n"
        f'    """Ports of {one.kind}."""\n' + ("\n" + "\n".join(fields) + "\n" if fields else "") + "\n\n"
        f"class {name}(Leaf):\n"
        f'    """{_quoted(one.tag)} of {_quoted(source)}, line {one.line}."""\n\n'
        f"    def __init__(self, name: str{taken}) -> None:\n"
        f"        super().__init__(name)\n{kept}\n"
        "    def update(self) -> Status:\n"
        '        """One tick."""\n'
        f'        return self.fail("not_written", "write {name}.update in {module}.py")\n\n\n' + _row(one, name, source)
    )


def _row(one: Placeholder, name: str, source: str) -> str:
    reads = [port.parameter for port in one.ports.values() if port.direction == "inout_port"]
    writes = [port.parameter for port in one.ports.values() if port.direction != "input_port"]
    told = f'"{_quoted(one.tag)} of {_quoted(source)}."'
    lines = [f'"{one.kind}"', '"leaf"', f"{name}Ports", '"name"', f'"{name}"', told, "robot=True"]
    lines += [f"{key}={_tuple(names)}" for key, names in (("reads", reads), ("writes", writes)) if names]
    return f"{one.kind.upper()} = NodeType(\n" + "".join(f"    {line},\n" for line in lines) + ")\n"


def _annotation(port: PortOf) -> str:
    kind = "Value" if port.direction == "input_port" else "Key"
    if port.default is not None:
        return f"{kind} = {port.default!r}"
    return kind if port.must else f"{kind} | None = None"


def _outputs(file: XmlFile, found: Mapping[str, Placeholder], uses: Mapping[str, list[tuple[str, Element]]]) -> None:
    """Find outputs that the file does not declare, and give them first values for dry runs.

    A key that nothing else sets is an output of the first node that names it (Our choice: else no tree without models
    could be checked). A warning says so. A port that takes a text somewhere, or a key that a call fills, is no output:
    what it names is for the file's user to set, and becomes a parameter.
    """
    set_here, filled = keys_set_in(file), keys_handed_on(file)
    known = set_here | filled
    for _, _, port, key in _references(found, uses):
        if port.direction != "input_port":
            known.add(key)
    reading = _reading(found, uses, filled - set_here)
    for tree, element, port, key in _references(found, uses):
        name = next(n for n, p in found[tag_of(element)].ports.items() if p is port)
        if port.direction == "input_port" and key not in known and not port.type and id(port) in reading:
            file.needs.setdefault(tree, Needs()).texts.setdefault(key)
        elif port.direction == "input_port" and key not in known and not port.type:
            port.direction = "output_port"
            message = f"port {name!r} of {tag_of(element)} is taken for an output, as nothing else sets {key!r}"
            file.warn(element, "output", message, name)
        if port.direction != "input_port":
            known.add(key)
            file.needs.setdefault(tree, Needs()).first_values.setdefault(key, _FIRST.get(port.type, key))


def _reading(
    found: Mapping[str, Placeholder], uses: Mapping[str, list[tuple[str, Element]]], filled: Collection[str]
) -> set[int]:
    """The id of each port that can be no output, as it has a text somewhere, or the name of one of `filled`."""
    return {
        id(port)
        for tag, nodes in uses.items()
        for name, port in found[tag].ports.items()
        for _, element in nodes
        if name in element.attributes and ((key := _key(element.attributes[name], name)) is None or key in filled)
    }


def _references(
    found: Mapping[str, Placeholder], uses: Mapping[str, list[tuple[str, Element]]]
) -> list[tuple[str, Element, PortOf, str]]:
    """(tree, node, port, key) of each port that names a key, in the order of the file."""
    nodes = sorted((use for nodes in uses.values() for use in nodes), key=lambda use: use[1].place)
    return [
        (tree, element, port, key)
        for tree, element in nodes
        for name, port in found[tag_of(element)].ports.items()
        if (key := _key(element.attributes.get(name, ""), name)) is not None
    ]


def _key(text: str, port: str) -> str | None:
    """The key that a port's text refers to, or None if it is none of ours."""
    key = text.strip(" ")[1:-1] if mapping.is_pointer(text) else ""
    key = port if key == "=" else key
    return key if mapping.KEY.fullmatch(key) else None


def _value(text: str, name: str, port: PortOf) -> Any:
    if port.direction != "input_port":
        if (key := _key(text, name)) is None:
            raise ValueError(f"an output is a key such as '{{cup_2}}', not {text!r:.40}")
        return key
    value = mapping.from_port(text, as_text=port.type == "std::string")
    return escaped(value) if value == text else value


def _name(given: str, taken: Iterable[str], what: str) -> str:
    """A name of ours for one of theirs: "open_gripper" for "OpenGripper"."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", given)
    name = re.sub("[^a-z0-9_]+", "_", words.lower()).strip("_") or what
    name = name if name[0].isalpha() else f"{what}_{name}"
    squashed = {one.replace("_", "") for one in taken}  # so that classes are told apart, too
    found, number = (f"{name}_{what}" if name in squashed or keyword.iskeyword(name) else name), 2
    while found.replace("_", "") in squashed:
        found, number = f"{name}_{what}_{number}", number + 1
    return found


def _class_name(one: Placeholder) -> str:
    return mapping.own_id(one.kind).removesuffix("Node") + "Node"  # no name that the module imports ends so


def _quoted(text: str) -> str:
    """A text that can stand within quotes of Python."""
    return "".join(c if c.isprintable() and c not in '"\\' else "_" for c in text)


def _tuple(names: list[str]) -> str:
    return f"({', '.join(map(repr, names))},)".replace("'", '"')
