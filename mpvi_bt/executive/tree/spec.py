"""A behavior tree as data: read from files or made by the compiler, then drawn, checked and built."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from mpvi_bt.executive.behaviors.parameters import NoParameters, Parameters, Value
from mpvi_bt.executive.behaviors.registry import NodeType, node_types
from mpvi_bt.ground.errors import Problem

ParameterType = Literal["text", "number", "integer", "boolean"]
Drawer = Callable[["TreeSpec"], str]
_DRAWERS: dict[str, Drawer] = {}  # "text" and "html"


@dataclass(frozen=True)
class Place:
    """Where a node stands in a file, 1-based."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True)
class NodeSpec:
    """A node.

    Attributes:
        kind: Such as "timeout"; a key of `behaviors.registry.node_types()`, or that of a node of the file's own.
        parameters: Of the model that the kind prescribes.
        name: "" unless the kind is headed by its name.
        children: In order. Of a subtree: the root of the other file's tree, its parameters filled in.
        segments: Indices of the plan's segments that it came from; () if it was written by hand.
        place: Where it was read from, or None. Two nodes are equal wherever they were read.
        written: Parameters as the file writes them where that is not their value: "$object", or
            "the $object" for "the cup". Equality looks at values.
        unbound: Those of `written` that stand-ins fill, because a parameter of the tree has no value.
        own: Its type, where it is a node of the file's own.
    """

    kind: str
    parameters: Parameters
    name: str = ""
    children: tuple[NodeSpec, ...] = ()
    segments: tuple[int, ...] = ()
    place: Place | None = field(default=None, compare=False)
    written: Mapping[str, Any] = field(default_factory=dict, compare=False)
    unbound: frozenset[str] = field(default=frozenset(), compare=False)
    own: NodeType | None = field(default=None, compare=False, repr=False)

    @property
    def type(self) -> NodeType:
        """Its row of the registry, or its own."""
        return self.own or node_types()[self.kind]

    @property
    def label(self) -> str:
        """One line for a person, such as "Navigate(trash can, kitchen)"."""
        values = self.parameters
        if unfilled := {key: value for key, value in self.written.items() if key in self.unbound}:
            values = values.model_construct(**{**dict(values), **unfilled})
        return self.type.label_of(self.name, values)

    @property
    def glyph(self) -> str:
        """What is drawn before the label, such as "-->"."""
        return self.type.glyph_of(self.parameters)


@dataclass(frozen=True)
class BrokenNode(NodeSpec):
    """A node with errors in its file, read as far as possible: drawn, never built.

    Its `kind` may be one that there is not, and it has no `parameters`.

    Attributes:
        says: Its first key with what stands there.
        problems: What is wrong with the node itself; those below it have their own.
    """

    says: str = ""
    problems: tuple[Problem, ...] = ()

    @property
    def type(self) -> NodeType:
        """The type of its kind, or a placeholder for an unknown kind."""
        return self.own or node_types().get(self.kind) or _NO_TYPE

    @property
    def label(self) -> str:
        """What the file says."""
        return self.says

    @property
    def glyph(self) -> str:
        """None: what is drawn depends on parameters."""
        return ""


_NO_TYPE = NodeType("", "leaf", NoParameters, "name", "", "No such kind of node.")


@dataclass(frozen=True)
class Placed:
    """A node with its place in the tree.

    Attributes:
        path: Names (or kinds) from the root, joined by "/", such as "tidy/2 pick up the cup/timeout/until_complete".
            Siblings of one name are told apart as "navigate", "navigate#2".
        depth: 0 for the root.
        spec: The node.
        children: Paths of its children.
    """

    path: str
    depth: int
    spec: NodeSpec
    children: tuple[str, ...]


@dataclass(frozen=True)
class TreeParameter:
    """A parameter of a tree.

    Attributes:
        type: "text", "number", "integer" or "boolean".
        default: Its value where the caller gives none; None: the caller must.
        about: One line for a person.
    """

    type: ParameterType
    default: Value | None = None
    about: str = ""


@dataclass(frozen=True)
class TreeSpec:
    """A tree.

    Attributes:
        name: Such as "picking_up_trash".
        root: Its first node, its parameters filled in.
        instruction: What it carries out, or "".
        about: One line for a person, or "".
        parameters: That the file declares, by name.
        blackboard: Keys that exist from the start, with their first values; those of subtrees, too.
        inherited: Those of them that only subtrees declare.
        own_nodes: Where the file's own nodes are, as it says under `nodes:`.
        unbound: Names of parameters that have no value: such a tree can be checked and drawn, but not run.
    """

    name: str
    root: NodeSpec
    instruction: str = ""
    about: str = ""
    parameters: Mapping[str, TreeParameter] = field(default_factory=dict)
    blackboard: Mapping[str, Value] = field(default_factory=dict)
    unbound: tuple[str, ...] = ()
    inherited: frozenset[str] = field(default=frozenset(), compare=False)
    own_nodes: tuple[str, ...] = field(default=(), compare=False)

    @cached_property
    def nodes(self) -> tuple[Placed, ...]:
        """Every node, parents before children, in the order of drawing."""
        placed: list[Placed] = []
        _place(self.root, _own_name(self.root), 0, placed)
        return tuple(placed)

    def __str__(self) -> str:
        """Its drawing, where one is loaded."""
        return _DRAWERS["text"](self) if _DRAWERS else repr(self)

    def _repr_html_(self) -> str | None:
        """What notebooks show."""
        return _DRAWERS["html"](self) if _DRAWERS else None


def draw_by(text: Drawer, html: Drawer) -> None:
    """Have trees shown so, by `print` and in notebooks: drawings stand above trees, and `drawing.shown` calls this."""
    _DRAWERS.update(text=text, html=html)


def _own_name(node: NodeSpec) -> str:
    return (node.name or node.kind).replace("/", "|")


def _place(node: NodeSpec, path: str, depth: int, placed: list[Placed]) -> None:
    """Add a node and those below it: to a list, as generators in one another take time by the square of the depth."""
    paths: dict[str, None] = {}  # in order
    again: Counter[str] = Counter()
    for child in node.children:
        found = own = f"{path}/{_own_name(child)}"
        while found in paths:
            again[own] += 1
            found = f"{own}#{again[own] + 1}"
        paths[found] = None
    placed.append(Placed(path, depth, node, tuple(paths)))
    for child, below in zip(node.children, paths, strict=True):
        _place(child, below, depth + 1, placed)
