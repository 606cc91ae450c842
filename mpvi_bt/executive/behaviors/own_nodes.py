"""Nodes of a user's own, of classes in a file beside a tree or at an import path, without a package.

A class of nodes says by itself what the registry has to know: its name in snake case is the node's key, the parameters
of its constructor are those of the node, the first of them the headline, and its docstring begins with the summary.
Whoever wants more, such as limits of a number or a label, writes a `NodeType` beside the class.
"""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union

from pydantic import ConfigDict, create_model

from mpvi_bt.executive.behaviors.parameters import Line, Number, Parameters
from mpvi_bt.executive.behaviors.registry import RESERVED, Family, NodeType, node_types
from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.ground.import_paths import IMPORT_PATH, found_at, module_in

_TYPES: Mapping[Any, Any] = {str: Line, int: int, float: Number, bool: bool}
_KIND = re.compile(r"[a-z][a-z0-9_]{0,59}")
_GIVEN = ("self", "name", "child", "children")  # what a constructor is given that is no parameter of the node


class _AsRecorded(Parameters):
    """Parameters of a node from a trace: its file is not read again, so any are accepted."""

    model_config = ConfigDict(extra="allow")


def own_nodes(given: str, folder: Path) -> list[NodeType]:
    """The nodes that an item under `nodes:` names.

    Args:
        given: A file, "my_nodes.py", or an import path, "my_robot.nodes:Blink".
        folder: Of the tree, which the file is beside, or below.

    Raises:
        UserError: It is neither, cannot be imported, or holds no node.
    """
    if given.endswith(".py"):
        if Path(given).is_absolute() or ".." in Path(given).parts:
            raise UserError(f"{given}: lies elsewhere; a file of nodes is in the folder of its tree, or below it.")
        file = (folder / given).resolve()
        return _in_module(vars(module_in(file, given)), f"{file}", given)
    if not IMPORT_PATH.fullmatch(given):
        raise UserError(f"{shown(given)} is no file such as my_nodes.py and no import path such as my_nodes:Blink.")
    found = found_at(given, given)
    if inspect.isclass(found) or isinstance(found, NodeType):
        return [_node_type(found, given.partition(":")[0], given)]
    if isinstance(found, Iterable):
        return [_node_type(one, given.partition(":")[0], given) for one in found]
    raise UserError(f"{given}: is neither a class of nodes nor a NodeType, but {type(found).__name__}.")


def described(node: NodeType) -> dict[str, Any]:
    """A node of one's own as JSON values, for traces: all that is needed to read and draw it without its code."""
    return {
        "family": node.family,
        "headline": node.headline,
        "factory": node.factory,
        "summary": node.summary,
        "robot": node.robot,
    }


def as_described(kind: str, told: Mapping[str, Any]) -> NodeType:
    """A node as described in a trace. Its code is imported only to resume a run."""
    return NodeType(
        kind, told["family"], _AsRecorded, told["headline"], told["factory"], told["summary"], robot=told["robot"]
    )


def _in_module(names: Mapping[str, Any], place: str, said: str) -> list[NodeType]:
    """The nodes defined in a module; a class with its own `NodeType` counts once, as that."""
    from py_trees.behaviour import Behaviour

    public = {name: value for name, value in names.items() if not name.startswith("_")}
    explicit = [value for value in public.values() if isinstance(value, NodeType)]
    made = {node.factory for node in explicit}
    classes = [
        value
        for name, value in public.items()
        if inspect.isclass(value)
        and issubclass(value, Behaviour)
        and value.__module__ == names["__name__"]
        and name not in made
    ]
    if not (found := [*explicit, *classes]):
        raise UserError(f"{said}: holds no node: neither a subclass of Leaf, Decorator or Branch, nor a NodeType.")
    return [_node_type(one, place, said) for one in found]


def _node_type(found: Any, place: str, said: str) -> NodeType:
    """The registry's row for a class or a `NodeType`; `place`: module or file of its factory."""
    if isinstance(found, NodeType):
        node = found if ":" in found.factory else replace(found, factory=f"{place}:{found.factory}")
    elif inspect.isclass(found):
        node = _of_class(found, place, said)  # type: ignore[arg-type] # mypy takes the hash of its instances
    else:
        raise UserError(f"{said}: {shown(found)} is neither a class of nodes nor a NodeType.")
    if node.kind in node_types() or node.kind in RESERVED or not _KIND.fullmatch(node.kind):
        why = "is no name of a node" if not _KIND.fullmatch(node.kind) else "is there already"
        raise UserError(f"{said}: a node {node.kind!r} {why}; name it otherwise.")
    return node


@lru_cache(maxsize=1024)  # two readings of a tree give equal trees: models of parameters are equal only by class
def _of_class(made: type, place: str, said: str) -> NodeType:
    from py_trees.behaviour import Behaviour

    if not issubclass(made, Behaviour):
        raise UserError(f"{said}: class {made.__name__} is no node; make it a Leaf, Decorator or Branch of ours.")
    fields = _fields(made, said)
    parameters = create_model(f"{made.__name__}Parameters", __base__=Parameters, **fields)
    return NodeType(
        re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", made.__name__).lower(),
        _family(made),
        parameters,
        next(iter(fields), "name"),
        f"{place}:{made.__name__}",
        ((vars(made).get("__doc__") or "").strip().splitlines() or [f"A node of {said}."])[0],
        robot=bool(getattr(made, "needs_robot", False)),
    )


def _family(made: type) -> Family:
    from py_trees.composites import Composite
    from py_trees.decorators import Decorator

    return "composite" if issubclass(made, Composite) else "decorator" if issubclass(made, Decorator) else "leaf"


def _fields(made: type, said: str) -> dict[str, Any]:
    """The fields of a model of its parameters, by what its constructor takes."""
    of = f"{said}: parameter {{!r}} of {made.__name__}"
    try:
        types = typing.get_type_hints(made.__init__)  # type: ignore[misc]
    except Exception as error:
        raise UserError(f"{said}: the types of the parameters of {made.__name__}: {error}") from None
    fields: dict[str, Any] = {}
    for one in inspect.signature(made).parameters.values():
        if one.name in _GIVEN or one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD):
            continue
        if one.kind is one.POSITIONAL_ONLY or not _KIND.fullmatch(one.name) or one.name in RESERVED:
            raise UserError(f"{of.format(one.name)} cannot be a key of a node.")
        if one.name not in types:
            raise UserError(f"{of.format(one.name)} has no type; write `{one.name}: str`, int, float or bool.")
        try:
            type_ = _field_type(types[one.name])
        except KeyError:
            known = "str, int, float, bool, a Literal, or one of these or None; a NodeType takes others"
            raise UserError(f"{of.format(one.name)} is {types[one.name]}; known: {known}.") from None
        fields[one.name] = (type_, ... if one.default is one.empty else one.default)
    return fields


def _field_type(given: Any) -> Any:
    """The type of a node's parameter from a constructor's. Raises KeyError if there is none."""
    if typing.get_origin(given) is Literal:
        return given
    if typing.get_origin(given) in (Union, UnionType):
        inner = [one for one in typing.get_args(given) if one is not NoneType]
        if len(inner) != 1:
            raise KeyError(given)
        return _field_type(inner[0]) | None
    return _TYPES[given]
