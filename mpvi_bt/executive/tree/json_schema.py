"""The JSON Schema of tree files, from the registry of nodes: editors use it to complete names and underline mistakes.

Draft 7, which most editors support. It covers one file by itself; `mpvi check` covers the rest, such as names of
skills, arguments of subtrees and keys that nothing writes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel

from mpvi_bt.executive.behaviors.registry import NodeType, node_types
from mpvi_bt.executive.tree.spec import ParameterType
from mpvi_bt.executive.tree.substitute import RulesFile
from mpvi_bt.executive.tree.tree_file import NodeHead, TreeFile

_REF = "#/definitions/{model}"
_REFERENCE = {
    "type": "string",
    "pattern": r"^\$(?:[a-z][a-z0-9_]*|\{[a-z][a-z0-9_]*\})$",
    "description": "A parameter of the tree, such as $object.",
}
_ABOUT = {
    "tree": "The tree's name, which is that of its file.",
    "about": "One line for a person.",
    "instruction": "What the tree carries out, as one would tell the robot.",
    "nodes": "Where the tree's own nodes are: files beside it, such as my_nodes.py, or import paths.",
    "parameters": "What a caller can set: name to type, or to {type, default, about}. Written $name where it is used.",
    "blackboard": "Keys that exist from the start, with their first values.",
    "root": "The first node.",
    "segments": "Segments of the plan that the node came from; the parent's if nothing is said.",
    "child": "The one node below.",
    "children": "The nodes below, in order.",
}


def tree_schema(own: Iterable[NodeType] = ()) -> dict[str, Any]:
    """The schema of a tree file, with the nodes of every installed package and these. Raises as `node_types` does."""
    definitions: dict[str, Any] = {"reference": _REFERENCE}
    types = {**node_types(), **{node.kind: node for node in own}}
    nodes = {kind: _node(node, definitions) for kind, node in types.items()}
    definitions |= {"node": _any_node(nodes), **{f"node-{kind}": node for kind, node in nodes.items()}}
    top = _plain(TreeFile, definitions)
    top["properties"]["root"] = _ref("node")
    names = top["properties"]["parameters"]["patternProperties"]
    names |= {pattern: {"anyOf": [{"enum": _types()}, written_out]} for pattern, written_out in names.items()}
    for key in ("parameters", "blackboard"):
        top["properties"][key]["additionalProperties"] = False
    top["properties"] = {key: _about(schema, _ABOUT[key]) for key, schema in top["properties"].items()}
    head = {"$schema": "http://json-schema.org/draft-07/schema#", "title": "A behavior tree of mpvi_bt"}
    return {**head, **top, "definitions": definitions}


def rules_schema() -> dict[str, Any]:
    """The schema of a file of substitution rules."""
    definitions: dict[str, Any] = {}
    top = _plain(RulesFile, definitions)
    head = {"$schema": "http://json-schema.org/draft-07/schema#", "title": "Rules of mpvi run --substitute"}
    return {**head, **top, "definitions": definitions}


def schema_text(what: str = "tree", own: Iterable[NodeType] = ()) -> str:
    """The schema of "tree", with nodes of one's own, or of "rules" as the text of a file."""
    schema = rules_schema() if what == "rules" else tree_schema(own)
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _types() -> list[str]:
    return list(ParameterType.__args__)  # type: ignore[attr-defined]


def _any_node(nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """A mapping with the key of exactly one kind, and otherwise the keys of that kind."""
    return {
        "type": "object",
        "description": "A node: its kind is the first key.",
        "properties": {kind: {"description": node["description"]} for kind, node in nodes.items()},
        "propertyNames": {"enum": sorted({key for node in nodes.values() for key in node["properties"]})},
        "anyOf": [{"required": [kind]} for kind in nodes],
        "allOf": [{"if": {"required": [kind]}, "then": _ref(f"node-{kind}")} for kind in nodes],
    }


def _node(node: NodeType, definitions: dict[str, Any]) -> dict[str, Any]:
    """The schema of one kind; what its parameters need goes into `definitions`."""
    given = _plain(node.parameters, definitions)
    help_ = _help(node.parameters)
    properties = {key: _or_reference(value) for key, value in given["properties"].items()}
    head = _plain(NodeHead, definitions)["properties"]
    required = [key for key in given.get("required", ()) if key != node.headline]
    first = head["name"] if node.headline == "name" else properties.pop(node.headline)
    if not node.needs_headline and node.headline != "name" and "null" not in json.dumps(first):
        first = {"anyOf": [*first.get("anyOf", [first]), {"type": "null"}]}
    below = "" if node.kind == "subtree" else {"composite": "children", "decorator": "child", "leaf": ""}[node.family]
    summary = node.summary if node.headline == "name" else f"{node.summary} {help_}"
    properties = {node.kind: {**first, "description": summary}, **{k: _about(v, help_) for k, v in properties.items()}}
    properties["segments"] = _about(head["segments"], _ABOUT["segments"])
    if below == "child":
        properties["child"] = _about(_ref("node"), _ABOUT["child"])
    elif below == "children":
        nodes = {"type": "array", "items": _ref("node"), "minItems": node.least}
        properties["children"] = _about(nodes, _ABOUT["children"])
    return {
        "type": "object",
        "description": node.summary,
        "properties": properties,
        "required": [node.kind, *required, *([below] if below else [])],
        "additionalProperties": False,
    }


def _help(model: type[BaseModel]) -> str:
    """A model's docstring, without the kinds that it begins with ("Of navigate: ...")."""
    text = " ".join((model.__doc__ or "").split())
    before, _, after = text.partition(": ")
    return after[:1].upper() + after[1:] if before.startswith("Of ") and after else text


def _plain(model: type[BaseModel], definitions: dict[str, Any]) -> dict[str, Any]:
    """A model's schema without titles, docstrings and defaults of nothing; models within it go into `definitions`."""
    schema = model.model_json_schema(ref_template=_REF)
    definitions |= {name: _untitled(inner) for name, inner in schema.pop("$defs", {}).items()}
    schema.setdefault("properties", {})
    schema.pop("description", None)
    return dict(_untitled(schema))


def _untitled(schema: Any) -> Any:
    if isinstance(schema, dict):
        kept = {
            k: v for k, v in schema.items() if not (k == "title" and isinstance(v, str)) and (k, v) != ("default", None)
        }
        return {k: _untitled(v) for k, v in kept.items()}
    return [_untitled(inner) for inner in schema] if isinstance(schema, list) else schema


def _or_reference(schema: dict[str, Any]) -> dict[str, Any]:
    """A parameter that is one value may be written as a reference; a text is any text anyhow."""
    kind = schema.get("type")
    if kind in ("object", "array") or (kind == "string" and not schema.keys() & {"pattern", "enum", "const"}):
        return schema
    return {"anyOf": [*schema.get("anyOf", [schema]), _ref("reference")]}


def _about(schema: dict[str, Any], text: str) -> dict[str, Any]:
    """With a description; in draft 7 what stands beside a "$ref" is not read."""
    schema = {"allOf": [schema]} if "$ref" in schema else schema
    return schema if "description" in schema or not text else {**schema, "description": text}


def _ref(name: str) -> dict[str, str]:
    return {"$ref": _REF.format(model=name)}
