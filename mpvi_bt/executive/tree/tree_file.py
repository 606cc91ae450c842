"""A tree file before its nodes are read: top-level keys, types of parameters, and problems so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, StringConstraints, WithJsonSchema, field_validator, model_validator

from mpvi_bt.executive.behaviors.parameters import Key, Value
from mpvi_bt.executive.behaviors.registry import NodeType
from mpvi_bt.executive.plan.schema import Phrase
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.tree.spec import ParameterType
from mpvi_bt.ground.errors import FileProblems, Problem, UnknownName, UserError, shown, with_article
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, Record, SourceMarks, plain_scalar, validate_data

_TYPES: Mapping[str, type | tuple[type, ...]] = {"text": str, "number": (int, float), "integer": int, "boolean": bool}
_WORDS = {
    "text": "a line of text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
}


class FullParameter(Record):
    """A parameter, written out."""

    type: ParameterType
    default: Value | None = None
    about: Annotated[str, StringConstraints(strip_whitespace=True, max_length=300)] = ""

    @model_validator(mode="after")
    def _default_fits(self) -> FullParameter:
        if self.default is not None and not fits(self.default, self.type):
            raise ValueError(
                f"the default of {with_article(repr(self.type))} must be {due(self.type)}, not {shown(self.default)}"
            )
        return self


_Item = Annotated[str, StringConstraints(min_length=1, max_length=300)]
_ITEM = {"type": "string", "minLength": 1, "maxLength": 300}
OwnNodes = Annotated[tuple[_Item, ...], WithJsonSchema({"anyOf": [_ITEM, {"type": "array", "items": _ITEM}]})]


class TreeFile(Record):
    """The keys at the top of a tree file."""

    tree: Phrase
    about: Annotated[str, StringConstraints(strip_whitespace=True, max_length=300)] = ""
    instruction: Annotated[str, StringConstraints(strip_whitespace=True, max_length=2000)] = ""
    nodes: OwnNodes = ()
    parameters: dict[Key, FullParameter] = {}
    blackboard: dict[Key, Value] = {}
    root: dict[str, Any]

    @field_validator("nodes", mode="before")
    @classmethod
    def _one_item(cls, given: Any) -> Any:
        """`nodes: my_nodes.py` is short for `nodes: [my_nodes.py]`."""
        return (given,) if isinstance(given, str) else given

    @field_validator("parameters", mode="before")
    @classmethod
    def _short_form(cls, given: Any) -> Any:
        """`object: text` is short for `object: {type: text}`."""
        if not isinstance(given, dict):
            return given
        return {name: {"type": value} if isinstance(value, str) else value for name, value in given.items()}


class NodeHead(Record):
    """The keys that every node may have."""

    name: Phrase | None = None
    segments: tuple[Annotated[int, Field(ge=0)], ...] | None = None


@dataclass
class TreeSource:
    """A tree file: its data, where everything in it stands, and the keys at its top."""

    data: Any
    marks: SourceMarks
    file: TreeFile


@dataclass
class TreeReading:
    """One tree being read, from one or more files.

    Attributes:
        skills: Those that the tree may name; None: any.
        expanded: Whether subtrees are written out in place, as in a trace.
        problems: Found so far.
        sources: Files of subtrees, by resolved path, so that each is parsed once; None: it has problems.
        own: Nodes of the files' own so far, by kind.
        blackboard: First values of keys that subtrees declare.
        told: Of those, the ids of the ones that a node has been marked with.
        count: Nodes so far.
        depth: Of the node that is being read, 1 for the root.
    """

    skills: Mapping[str, Skill] | None = None
    expanded: bool = False
    problems: list[Problem] = field(default_factory=list)
    sources: dict[Path, TreeSource | None] = field(default_factory=dict)
    own: dict[str, NodeType] = field(default_factory=dict)
    blackboard: dict[str, Value] = field(default_factory=dict)
    told: set[int] = field(default_factory=set)
    count: int = 0
    depth: int = 0

    def add(self, problem: Problem) -> None:
        """Note a problem. Raises FileProblems if there are too many to be of help."""
        self.problems.append(problem)
        if len(self.problems) >= MAX_PROBLEMS:
            raise FileProblems(self.problems)

    def untold(self, since: int) -> tuple[Problem, ...]:
        """Those problems behind the first `since` that no node has been marked with."""
        return tuple(problem for problem in self.problems[since:] if id(problem) not in self.told)


def head_of(data: Any, marks: SourceMarks, reading: TreeReading) -> TreeFile:
    """The keys at the top. After problems, a substitute is given, so that reading can go on."""
    try:
        file = validate_data(data, marks, TreeFile)
    except FileProblems as error:
        reading.problems += error.problems
        names = data.get("parameters") if isinstance(data, dict) else None
        known = {str(name): FullParameter(type="text") for name in names} if isinstance(names, dict) else {}
        empty: dict[str, Any] = {"tree": "", "about": "", "instruction": "", "nodes": (), "blackboard": {}, "root": {}}
        return TreeFile.model_construct(parameters=known, **empty)
    for name in file.parameters:
        if name in file.blackboard:
            message = f"{name!r} already is a parameter of the tree; give the key another name"
            reading.problems.append(marks.problem(("blackboard", name), "shadowed-key", message, key=True))
    return file


def fits(value: Any, kind: str) -> bool:
    """Whether a parameter of that type may have the value."""
    if isinstance(value, str):
        return kind == "text" and bool(value.strip()) and value.isprintable()
    return isinstance(value, _TYPES[kind]) and (kind == "boolean" or not isinstance(value, bool))


def due(kind: str) -> str:
    """The form of a parameter type, in words."""
    return _WORDS[kind]


def typed(given: Mapping[str, Value], file: TreeFile) -> dict[str, Value]:
    """Arguments from Python or the command line. Raises UserError."""
    values: dict[str, Value] = {}
    for name, value in given.items():
        if name not in file.parameters:
            raise UnknownName("parameter", name, file.parameters, f"tree {file.tree!r}")
        kind = file.parameters[name].type
        meant = plain_scalar(value) if isinstance(value, str) and kind != "text" else value
        if not fits(meant, kind):
            raise UserError(f"tree {file.tree!r}: parameter {name!r} must be {due(kind)}, not {shown(value)}.")
        values[name] = meant
    return values
