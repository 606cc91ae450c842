"""Trees as YAML files that read like an outline.

    tree: hello
    root:
      sequence: hello
      memory: true
      children:
        - navigate: trash can
          room: kitchen
        - timeout: 90
          child:
            navigate: sofa

The first key of a node is its kind and holds its headline parameter, the other keys its other parameters; `children:`
or `child:` come last. `segments:` names the plan's segments that a node came from; where it is left out it is the
parent's. Writing a tree and reading it again gives the same tree.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import Field, StringConstraints, ValidationError

from mpvi_bt.behaviors.registry import NodeType, node_types
from mpvi_bt.errors import FileProblems, Problem, nearest
from mpvi_bt.marked_yaml import (
    Location,
    Marks,
    Record,
    load_marked,
    parse_marked,
    plain_scalar,
    problems_of,
    validate_data,
)
from mpvi_bt.plan.schema import Phrase
from mpvi_bt.plan.skills import Skill
from mpvi_bt.tree.spec import NodeSpec, TreeSpec


class _File(Record):
    """The keys at the top of a tree file."""

    tree: Phrase
    instruction: Annotated[str, StringConstraints(strip_whitespace=True, max_length=2000)] = ""
    root: dict[str, Any]


class _Head(Record):
    """The keys that every node may have."""

    name: Phrase | None = None
    segments: tuple[Annotated[int, Field(ge=0)], ...] | None = None


def load_tree(path: str | Path, skills: Mapping[str, Skill] | None = None) -> TreeSpec:
    """A tree from its file.

    Args:
        path: A YAML file.
        skills: If given, the skills that the tree names must be among them.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return check_tree(*load_marked(path), skills)


def parse_tree(text: str, name: str = "<text>", skills: Mapping[str, Skill] | None = None) -> TreeSpec:
    """As `load_tree`, of a text that `name` stands for in problems."""
    return check_tree(*parse_marked(text, name), skills)


def check_tree(data: Any, marks: Marks, skills: Mapping[str, Skill] | None = None) -> TreeSpec:
    """As `load_tree`, of data that is already loaded."""
    problems: list[Problem] = []
    reader = _Reader(marks, problems, skills)
    root = data.get("root") if isinstance(data, dict) else None
    node = reader.node(root, ("root",), ()) if isinstance(root, dict) else None
    try:
        file = validate_data(data, marks, _File)
    except FileProblems as error:
        raise FileProblems([*error.problems, *problems]) from None
    if problems or node is None:
        raise FileProblems(problems)
    return TreeSpec(file.tree, node, file.instruction)


class _Reader:
    """Builds nodes, collecting every problem on the way."""

    def __init__(self, marks: Marks, problems: list[Problem], skills: Mapping[str, Skill] | None) -> None:
        self.marks, self.problems, self.skills = marks, problems, skills

    def node(self, data: Any, at: Location, inherited: tuple[int, ...]) -> NodeSpec | None:
        """The node at a location, or None if anything about it is wrong."""
        if not isinstance(data, dict) or not data:
            self.problem(at, "node", f"a node is a mapping such as 'navigate: kitchen', not {data!r:.40}")
            return None
        node_type = self.kind(data, at)
        if node_type is None:
            for key in ("children", "child"):  # what is below may be wrong too
                self.below(data.get(key), (*at, key), inherited)
            return None
        before = len(self.problems)
        head = self.head(data, at, node_type)
        segments = inherited if head.segments is None else head.segments
        children = self.children(data, at, node_type, segments)
        parameters = self.parameters(data, at, node_type)
        if parameters is None or len(self.problems) > before:
            return None
        return NodeSpec(node_type.kind, parameters, head.name or "", children, segments)

    def kind(self, data: dict[str, Any], at: Location) -> NodeType | None:
        kinds = [key for key in data if key in node_types()]
        first = next(iter(data))
        if not kinds:
            near = nearest(first, node_types())
            hint = f" Did you mean {near!r}?" if near else ""
            message = f"unknown node type {first!r}.{hint} Known: {', '.join(sorted(node_types()))}."
            self.problem((*at, first), "unknown-node", message, key=True)
            return None
        for extra in kinds[1:]:
            message = f"a second node type {extra!r} in a node that is a {kinds[0]!r} already"
            self.problem((*at, extra), "two-nodes", message, key=True)
        if kinds[0] != first:
            message = f"the node type {kinds[0]!r} must be the first key of its node"
            self.problem((*at, kinds[0]), "order", message, key=True)
        return node_types()[kinds[0]]

    def head(self, data: dict[str, Any], at: Location, node_type: NodeType) -> _Head:
        keys = {}
        given = {"segments": data["segments"]} if "segments" in data else {}
        if node_type.headline == "name":
            keys["name"] = node_type.kind
            given["name"] = data[node_type.kind]
        try:
            return _Head.model_validate(given)
        except ValidationError as error:
            self.problems += problems_of(error, self.marks, _Head, at, keys)
            return _Head()

    def parameters(self, data: dict[str, Any], at: Location, node_type: NodeType) -> Any:
        known = {"segments", "children", "child", *node_types()}
        given = {key: value for key, value in data.items() if key not in known}
        keys = {}
        if node_type.headline != "name":
            given[node_type.headline] = data[node_type.kind]
            keys[node_type.headline] = node_type.kind
            if node_type.headline in data:
                message = f"{node_type.headline!r} is already given as {node_type.kind!r}"
                self.problem((*at, node_type.headline), "duplicate-key", message, key=True)
        try:
            parameters = node_type.parameters.model_validate(given)
        except ValidationError as error:
            self.problems += problems_of(error, self.marks, node_type.parameters, at, keys)
            return None
        skill = getattr(parameters, "skill", None)
        if self.skills is not None and skill is not None and skill not in self.skills:
            near = nearest(skill, self.skills)
            hint = f" Did you mean {near!r}?" if near else ""
            message = f"unknown skill {skill!r}.{hint} Known: {', '.join(sorted(self.skills)) or 'none'}."
            self.problem((*at, "skill"), "unknown-skill", message)
        return parameters

    def children(
        self, data: dict[str, Any], at: Location, node_type: NodeType, segments: tuple[int, ...]
    ) -> tuple[NodeSpec, ...]:
        key = {"composite": "children", "decorator": "child", "leaf": ""}[node_type.family]
        for wrong in {"children", "child"} - {key}:
            if wrong in data:
                wanted = f"it takes {key!r}" if key else "it takes none"
                self.problem((*at, wrong), "children", f"{node_type.kind!r} has {wrong!r}; {wanted}", key=True)
        if not key:
            return ()
        nodes = self.below(data.get(key), (*at, key), segments)
        if key not in data:
            self.problem((*at, node_type.kind), "children", f"{node_type.kind!r} needs {key!r}", key=True)
        elif key == "child" and isinstance(data[key], list):
            self.problem((*at, key), "children", f"{node_type.kind!r} takes one child, not a list")
        elif key == "children" and not isinstance(data[key], list):
            self.problem((*at, key), "children", "children must be a list")
        elif key == "children" and len(data[key]) < node_type.least:
            message = f"{node_type.kind!r} needs {node_type.least} children or more, not {len(data[key])}"
            self.problem((*at, key), "children", message)
        return nodes

    def below(self, data: Any, at: Location, segments: tuple[int, ...]) -> tuple[NodeSpec, ...]:
        """The nodes of a list of children or of a single child, without those that are wrong."""
        if isinstance(data, dict):
            found = [self.node(data, at, segments)]
        elif isinstance(data, list):
            found = [self.node(item, (*at, i), segments) for i, item in enumerate(data)]
        else:
            if data is not None:
                self.node(data, at, segments)
            found = []
        return tuple(node for node in found if node is not None)

    def problem(self, at: Location, code: str, message: str, key: bool = False) -> None:
        self.problems.append(self.marks.problem(at, code, message, key))


def dump_tree(tree: TreeSpec) -> str:
    """The tree as YAML in canonical form: kind first, then parameters that are not default, segments, children."""
    head = {"tree": tree.name, **({"instruction": tree.instruction} if tree.instruction else {})}
    text = yaml.dump(
        {**head, "root": _plain(tree.root, ())}, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=10**6
    )
    return str(text)


class _Flow(list[int]):
    """A list that is written on one line."""


class _Dumper(yaml.SafeDumper):
    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _write_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    """Quoted where our reader would see a number, or YAML 1.1 a boolean, in it."""
    quoted = not isinstance(plain_scalar(text), str)
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="'" if quoted else None)


def _write_flow(dumper: yaml.SafeDumper, items: _Flow) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=True)


def _write_nothing(dumper: yaml.SafeDumper, _: None) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:null", "")


_Dumper.add_representer(str, _write_text)
_Dumper.add_representer(type(None), _write_nothing)
_Dumper.add_representer(_Flow, _write_flow)


def _plain(node: NodeSpec, inherited: tuple[int, ...]) -> dict[str, Any]:
    values = node.parameters.model_dump(exclude_defaults=True)
    headline = node.type.headline
    plain = {node.kind: (node.name or None) if headline == "name" else _tidy(values.pop(headline)), **values}
    if node.segments != inherited:
        plain["segments"] = _Flow(node.segments)
    below = [_plain(child, node.segments) for child in node.children]
    if node.type.family == "decorator":
        plain["child"] = below[0]
    elif node.type.family == "composite":
        plain["children"] = below
    return plain


def _tidy(value: Any) -> Any:
    """A whole number without its ".0"."""
    return int(value) if isinstance(value, float) and value.is_integer() else value
