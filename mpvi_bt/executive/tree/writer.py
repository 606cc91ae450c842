"""A tree as YAML in canonical form, or as plain data with its subtrees written out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import yaml

from mpvi_bt.executive.behaviors.own_nodes import described
from mpvi_bt.executive.behaviors.references import escaped
from mpvi_bt.executive.tree.spec import NodeSpec, TreeParameter, TreeSpec
from mpvi_bt.ground.marked_yaml import plain_scalar


def dump_tree(tree: TreeSpec) -> str:
    """The tree as YAML in canonical form: kind first, then parameters that are not default, segments, children.

    Parameters of the tree stand as the file wrote them; a subtree is the call of its file.
    """
    own = {key: value for key, value in tree.blackboard.items() if key not in tree.inherited}
    return to_yaml({**_head(replace(tree, blackboard=own)), "root": _plain(tree.root, (), expand=False)})


def to_yaml(data: dict[str, Any]) -> str:
    """Data as YAML in our style; only texts of several lines take more than one."""
    return str(yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=10**6))


def expanded(tree: TreeSpec) -> dict[str, Any]:
    """The tree as JSON-able data that needs no other file: parameters filled in, subtrees written out."""
    head = {key: value for key, value in _head(tree).items() if key not in ("parameters", "nodes")}
    if own := {p.spec.kind: described(p.spec.own) for p in tree.nodes if p.spec.own}:
        head["nodes"] = dict(sorted(own.items()))
    return {**head, "root": _plain(tree.root, (), expand=True)}


def _head(tree: TreeSpec) -> dict[str, Any]:
    head = {
        "tree": tree.name,
        "about": tree.about,
        "instruction": tree.instruction,
        "nodes": Flow(tree.own_nodes),
        "parameters": {name: _parameter(p) for name, p in tree.parameters.items()},
        "blackboard": dict(tree.blackboard),
    }
    return {key: value for key, value in head.items() if value}


def _parameter(parameter: TreeParameter) -> str | FlowMapping:
    if parameter.default is None and not parameter.about:
        return parameter.type
    rest = {"default": parameter.default, "about": parameter.about or None}
    return FlowMapping(type=parameter.type, **{key: value for key, value in rest.items() if value is not None})


def _plain(node: NodeSpec, inherited: tuple[int, ...], expand: bool) -> dict[str, Any]:
    written = {} if expand else node.written
    everything = expand and node.own is not None  # where its class is not there, nobody knows what is default
    given = node.parameters.model_dump(exclude_defaults=not everything)
    values = given | {k: v for k, v in written.items() if k != "name"}
    named = node.type.headline == "name"
    first = written.get("name", escaped(node.name)) or None if named else values.pop(node.type.headline, None)
    plain = {node.kind: tidy(first), **{key: tidy(value) for key, value in values.items()}}
    if node.segments != inherited:
        plain["segments"] = Flow(node.segments)
    if node.kind == "subtree" and not expand:
        return plain
    below = [_plain(child, node.segments, expand) for child in node.children]
    if node.type.family == "decorator":
        plain["child"] = below[0]
    elif node.type.family == "composite":
        plain["children"] = below
    return plain


def tidy(value: Any) -> Any:
    """A whole number without its ".0"; a mapping or a list on one line."""
    if isinstance(value, dict):
        return FlowMapping({key: tidy(inner) for key, inner in value.items()})
    if isinstance(value, list | tuple):
        return Flow(map(tidy, value))
    return int(value) if isinstance(value, float) and value.is_integer() else value


class Flow(list[Any]):
    """A list that is written on one line."""


class FlowMapping(dict[str, Any]):
    """A mapping that is written on one line."""


class _Dumper(yaml.SafeDumper):
    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _write_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    """Quoted where our reader would see a number, or YAML 1.1 a boolean, in it; lines as they are."""
    style = "|" if "\n" in text else None if isinstance(plain_scalar(text), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


def _write_flow(dumper: yaml.SafeDumper, items: Flow) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=True)


def _write_flow_mapping(dumper: yaml.SafeDumper, items: FlowMapping) -> yaml.MappingNode:
    return dumper.represent_mapping("tag:yaml.org,2002:map", items, flow_style=True)


def _write_nothing(dumper: yaml.SafeDumper, _: None) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:null", "")


_Dumper.add_representer(str, _write_text)
_Dumper.add_representer(type(None), _write_nothing)
_Dumper.add_representer(Flow, _write_flow)
_Dumper.add_representer(FlowMapping, _write_flow_mapping)
