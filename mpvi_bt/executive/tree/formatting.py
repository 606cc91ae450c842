"""Tree files in canonical form, with their comments: what `mpvi fmt` does.

The order of keys and the style of values are those of `dump_tree`. What the file says is kept as it says it:
references, calls of subtrees and values that are the default stay.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpvi_bt.executive.behaviors.registry import NodeType, node_types
from mpvi_bt.executive.tree.comments import comments_of, texts_of, with_comments
from mpvi_bt.executive.tree.writer import FlowMapping, tidy, to_yaml
from mpvi_bt.executive.tree.yaml_io import check_tree
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.ground.marked_yaml import parse_marked

_HEAD = ("tree", "about", "instruction", "nodes", "parameters", "blackboard")


def formatted(text: str, name: str) -> str:
    """The canonical form of a tree file's text.

    Args:
        text: Of the file.
        name: Of the file; subtrees are looked for beside it.

    Raises:
        FileProblems: Everything that is wrong with it.
    """
    data, marks = parse_marked(text, name)
    types = {**node_types(), **{placed.spec.kind: placed.spec.type for placed in check_tree(data, marks).nodes}}
    plain = to_yaml(_canonical(data, types))
    result = with_comments(plain, parse_marked(plain, name)[1], comments_of(text, marks))
    if not _same(data, text, result, name, types):
        raise MpviError(f"{name}: its formatted text would have another meaning; please report this with the file")
    return result


def _same(data: Any, text: str, result: str, name: str, types: Mapping[str, NodeType]) -> bool:
    """Whether a formatted text holds the same data and comments."""
    again = parse_marked(result, name)[0]
    same = _canonical(again, types) == _canonical(data, types)
    return same and sorted(texts_of(result)) == sorted(texts_of(text))


def _canonical(data: dict[str, Any], types: Mapping[str, NodeType]) -> dict[str, Any]:
    """The data of a valid tree file in the order and style of `dump_tree`."""
    head = {key: data[key] for key in _HEAD if key in data}
    for key in ("about", "instruction"):
        if key in head:
            head[key] = head[key].strip()
    if "nodes" in head:
        head["nodes"] = tidy(head["nodes"])
    if "parameters" in head:
        head["parameters"] = {name: _parameter(given) for name, given in head["parameters"].items()}
    return {**{key: value for key, value in head.items() if value}, "root": _node(data["root"], types)}


def _parameter(given: str | dict[str, Any]) -> str | FlowMapping:
    if isinstance(given, str):
        return given
    if given.keys() == {"type"}:
        return str(given["type"])
    return FlowMapping({key: given[key] for key in ("type", "default", "about") if key in given})


def _node(data: dict[str, Any], types: Mapping[str, NodeType]) -> dict[str, Any]:
    kind = next(iter(data))
    keys = [key for key in types[kind].parameters.model_fields if key in data and key != kind]
    plain = {kind: tidy(data[kind]), **{key: tidy(data[key]) for key in keys}}
    if "segments" in data:
        plain["segments"] = tidy(data["segments"])
    if "child" in data:
        plain["child"] = _node(data["child"], types)
    if "children" in data:
        plain["children"] = [_node(child, types) for child in data["children"]]
    return plain
