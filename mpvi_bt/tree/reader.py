"""Data of a tree file -> TreeSpec, with every problem on the way: parameters are filled in, subtrees are read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, StringConstraints, ValidationError, field_validator, model_validator

from mpvi_bt import paths
from mpvi_bt.behaviors import references
from mpvi_bt.behaviors.registry import Call, Key, NodeType, Value, node_types
from mpvi_bt.errors import FileProblems, MpviError, Problem, UnknownName, UserError, shown
from mpvi_bt.marked_yaml import (
    MAX_PROBLEMS,
    Location,
    Marks,
    Record,
    load_marked,
    plain_scalar,
    problems_of,
    validate_data,
)
from mpvi_bt.plan.schema import Phrase
from mpvi_bt.plan.skills import Skill
from mpvi_bt.tree.spec import NodeSpec, ParameterType, Place, TreeParameter, TreeSpec

MAX_NODES = 20_000  # of a tree with its subtrees written out: a few files could ask for millions
MAX_DEPTH = 90  # likewise; a deeper tree is slow to tick, no person reads it, and a trace nests two levels a node
_STAND_INS: Mapping[str, Value] = {"number": 1.0, "integer": 1, "boolean": True}  # of parameters without a value
_TYPES: Mapping[str, type | tuple[type, ...]] = {"text": str, "number": (int, float), "integer": int, "boolean": bool}


class FullParameter(Record):
    """A parameter, written out."""

    type: ParameterType
    default: Value | None = None
    about: Annotated[str, StringConstraints(strip_whitespace=True, max_length=300)] = ""

    @model_validator(mode="after")
    def _default_fits(self) -> FullParameter:
        if self.default is not None and not _fits(self.default, self.type):
            raise ValueError(f"the default of a parameter of type {self.type!r} can't be {shown(self.default)}")
        return self


class TreeFile(Record):
    """The keys at the top of a tree file."""

    tree: Phrase
    about: Annotated[str, StringConstraints(strip_whitespace=True, max_length=300)] = ""
    instruction: Annotated[str, StringConstraints(strip_whitespace=True, max_length=2000)] = ""
    parameters: dict[Key, FullParameter] = {}
    blackboard: dict[Key, Value] = {}
    root: dict[str, Any]

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
class _Source:
    """A tree file: its data, where everything in it stands, and the keys at its top."""

    data: Any
    marks: Marks
    file: TreeFile


@dataclass
class Reading:
    """One tree being read, from one or more files.

    Attributes:
        skills: Those that the tree may name; None: any.
        expanded: Whether subtrees are written out in place, as in a trace.
        problems: Found so far.
        sources: Files of subtrees, by resolved path, so that each is parsed once; None: it has problems.
        blackboard: First values of keys that subtrees declare.
        count: Nodes so far.
        depth: Of the node that is being read, 1 for the root.
    """

    skills: Mapping[str, Skill] | None = None
    expanded: bool = False
    problems: list[Problem] = field(default_factory=list)
    sources: dict[Path, _Source | None] = field(default_factory=dict)
    blackboard: dict[str, Value] = field(default_factory=dict)
    count: int = 0
    depth: int = 0


def read(data: Any, marks: Marks, reading: Reading, arguments: Mapping[str, Value]) -> TreeSpec:
    """The tree of a file's data.

    Args:
        data, marks: Of the file.
        reading: Takes up what is found.
        arguments: Values of its parameters. Text is read as the parameter's type: "3" is a number where one is due.

    Raises:
        UserError: An argument that the tree does not have, or that is of another type.
        FileProblems: Everything that is wrong with the file and those of its subtrees.
    """
    file = _file(data, marks, reading)
    values = _typed(arguments, file)
    path = Path(marks.file)
    above = (path.resolve(),) if path.is_file() else ()
    tree = _tree(_Source(data, marks, file), reading, values, above)
    if reading.problems or tree is None:
        raise FileProblems(list({(p.file, p.line, p.column, p.message): p for p in reading.problems}.values()))
    return tree


def _file(data: Any, marks: Marks, reading: Reading) -> TreeFile:
    """The keys at the top. Problems are noted, and then something that does as well for what comes next is given."""
    try:
        file = validate_data(data, marks, TreeFile)
    except FileProblems as error:
        reading.problems += error.problems
        names = data.get("parameters") if isinstance(data, dict) else None
        known = {str(name): FullParameter(type="text") for name in names} if isinstance(names, dict) else {}
        return TreeFile.model_construct(tree="", parameters=known, blackboard={}, about="", instruction="", root={})
    for name in file.parameters:
        if name in file.blackboard:
            message = f"{name!r} is a parameter of the tree already; name the key otherwise"
            reading.problems.append(marks.problem(("blackboard", name), "shadowed-key", message, key=True))
    return file


def _fits(value: Any, kind: str) -> bool:
    return isinstance(value, _TYPES[kind]) and (kind == "boolean" or not isinstance(value, bool))


def _typed(given: Mapping[str, Value], file: TreeFile) -> dict[str, Value]:
    """Arguments from Python or the command line. Raises UserError."""
    values: dict[str, Value] = {}
    for name, value in given.items():
        if name not in file.parameters:
            raise UnknownName("parameter", name, file.parameters, f"tree {file.tree!r}")
        kind = file.parameters[name].type
        typed = plain_scalar(value) if isinstance(value, str) and kind != "text" else value
        if not _fits(typed, kind):
            raise UserError(f"tree {file.tree!r}: parameter {name!r} is of type {kind!r}, which {value!r:.60} is not.")
        values[name] = typed
    return values


def _tree(
    source: _Source, reading: Reading, arguments: Mapping[str, Value], above: tuple[Path, ...]
) -> TreeSpec | None:
    """The tree of one file with its parameters filled in, or None if anything about its nodes is wrong."""
    file = source.file
    values = {name: p.default for name, p in file.parameters.items() if p.default is not None} | dict(arguments)
    unbound = tuple(name for name in file.parameters if name not in values)
    stand_ins = {name: _STAND_INS.get(file.parameters[name].type, f"${name}") for name in unbound}
    root = source.data.get("root") if isinstance(source.data, dict) else None
    reader = _Reader(source.marks, reading, values | stand_ins, frozenset(unbound), above)
    node = reader.node(root, ("root",), ()) if isinstance(root, dict) else None
    if node is None:
        return None
    parameters = {name: TreeParameter(p.type, p.default, p.about) for name, p in file.parameters.items()}
    blackboard = {**file.blackboard, **{k: v for k, v in reading.blackboard.items() if k not in file.blackboard}}
    return TreeSpec(file.tree, node, file.instruction, file.about, parameters, blackboard, unbound)


class _Reader:
    """Builds the nodes of one file, collecting every problem on the way.

    Args:
        marks: Of the file.
        reading: Of the whole tree.
        values: Of the file's parameters.
        unbound: Those of them that stand-ins fill.
        above: The file and those that called it, outermost first.
    """

    def __init__(
        self,
        marks: Marks,
        reading: Reading,
        values: Mapping[str, Value],
        unbound: frozenset[str],
        above: tuple[Path, ...],
    ) -> None:
        self.marks, self.reading, self.values, self.unbound, self.above = marks, reading, values, unbound, above
        self.problems = reading.problems

    def node(self, data: Any, at: Location, inherited: tuple[int, ...]) -> NodeSpec | None:
        """The node at a location, or None if anything about it is wrong."""
        reading = self.reading
        reading.count += 1
        if reading.count > MAX_NODES:
            self.problem(at, "too-large", f"more than {MAX_NODES} nodes, subtrees written out")
            raise FileProblems(self.problems)
        if reading.depth >= MAX_DEPTH:
            self.problem(at, "too-deep", f"more than {MAX_DEPTH} nodes one below the other, subtrees written out")
            return None
        reading.depth += 1
        node = self._node(data, at, inherited)
        reading.depth -= 1
        return node

    def _node(self, data: Any, at: Location, inherited: tuple[int, ...]) -> NodeSpec | None:
        if not isinstance(data, dict) or not data:
            self.problem(at, "node", f"a node is a mapping such as 'navigate: kitchen', not {shown(data)}")
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
        written = self.written(data, node_type)
        unbound = frozenset(key for key, value in written.items() if self.unbound.intersection(_names(value)))
        place = Place(self.marks.file, *self.marks.at((*at, node_type.kind), key=True))
        return NodeSpec(node_type.kind, parameters, head.name or "", children, segments, place, written, unbound)

    def given(self, data: dict[str, Any], node_type: NodeType) -> dict[str, Any]:
        """The node's parameters as the file writes them; the headline under its own name."""
        other = {"segments", "children", "child", node_type.kind}
        return {node_type.headline: data[node_type.kind]} | {k: v for k, v in data.items() if k not in other}

    def written(self, data: dict[str, Any], node_type: NodeType) -> dict[str, Any]:
        """Those that the tree's parameters change."""
        if not self.values:
            return {}
        given = self.given(data, node_type)
        return {key: value for key, value in given.items() if references.fill(value, self.values) != value}

    def kind(self, data: dict[str, Any], at: Location) -> NodeType | None:
        kinds = [key for key in data if key in node_types()]
        first = next(iter(data))
        if not kinds:
            self.add(self.marks.unknown((*at, first), "node", first, node_types(), key=True))
            return None
        for extra in kinds[1:]:
            message = f"a second node type {extra!r} in a node that is a {kinds[0]!r} already"
            self.problem((*at, extra), "two-nodes", message, key=True)
        if kinds[0] != first:
            message = f"the node type {kinds[0]!r} must be the first key of its node"
            self.problem((*at, kinds[0]), "order", message, key=True)
        return node_types()[kinds[0]]

    def head(self, data: dict[str, Any], at: Location, node_type: NodeType) -> NodeHead:
        keys = {}
        given = {"segments": data["segments"]} if "segments" in data else {}
        if node_type.headline == "name":
            keys["name"] = node_type.kind
            given["name"] = references.fill(data[node_type.kind], self.values)
        try:
            return NodeHead.model_validate(given)
        except ValidationError as error:
            self.problems += problems_of(error, self.marks, NodeHead, at, keys)
            return NodeHead()

    def parameters(self, data: dict[str, Any], at: Location, node_type: NodeType) -> Any:
        """The node's parameters, filled in and checked, or None."""
        raw = {k: v for k, v in self.given(data, node_type).items() if k not in node_types() or k == node_type.headline}
        if node_type.headline == "name":
            del raw["name"]
        elif node_type.headline in data and node_type.headline != node_type.kind:
            message = f"{node_type.headline!r} is already given as {node_type.kind!r}"
            self.problem((*at, node_type.headline), "duplicate-key", message, key=True)
        keys = {node_type.headline: node_type.kind}
        try:
            parameters = node_type.parameters.model_validate(references.fill(raw, self.values))
        except ValidationError as error:
            wrong = {str(item["loc"][0]) for item in error.errors(include_url=False) if item["loc"]}
            unknown = {
                (*at, keys.get(key, key)): name
                for key in wrong
                if (name := references.whole(raw.get(key))) and name not in self.values
            }
            for location, name in unknown.items():
                self.add(self.marks.unknown(location, "parameter", name, self.values))
            told = {self.marks.at(location) for location in unknown}
            found = problems_of(error, self.marks, node_type.parameters, at, keys)
            for problem in found:
                if (problem.line, problem.column) not in told:
                    self.add(problem)
            return None
        skill, skills = getattr(parameters, "skill", None), self.reading.skills
        if (
            skills is not None
            and skill is not None
            and skill not in skills
            and skill != references.whole(raw.get("skill"))
        ):
            self.add(self.marks.unknown((*at, "skill"), "skill", skill, skills))
        return parameters

    def children(
        self, data: dict[str, Any], at: Location, node_type: NodeType, segments: tuple[int, ...]
    ) -> tuple[NodeSpec, ...]:
        called = node_type.kind == "subtree" and not self.reading.expanded
        key = "" if called else {"composite": "children", "decorator": "child", "leaf": ""}[node_type.family]
        for wrong in {"children", "child"} - {key}:
            if wrong in data:
                wanted = f"it takes {key!r}" if key else "it takes none"
                self.problem((*at, wrong), "children", f"{node_type.kind!r} has {wrong!r}; {wanted}", key=True)
        if called:
            return self.called(data, at)
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

    def called(self, data: dict[str, Any], at: Location) -> tuple[NodeSpec, ...]:
        """The root of the tree that a subtree node calls, or () if anything about it is wrong."""
        try:
            call = Call.model_validate(references.fill(self.given(data, node_types()["subtree"]), self.values))
        except ValidationError:
            return ()  # `parameters` says what is wrong
        path = self.find(call.tree, (*at, "subtree"))
        source = self.source(path, (*at, "subtree")) if path else None
        if path is None or source is None or not self.fit(call, source.file, at):
            return ()
        for name, value in source.file.blackboard.items():
            self.reading.blackboard.setdefault(name, value)
        tree = _tree(source, self.reading, call.arguments, (*self.above, path.resolve()))
        return (tree.root,) if tree else ()

    def find(self, name: str, at: Location) -> Path | None:
        """The file that a subtree names: one beside this file, or a tree of a root."""
        folder = Path(self.marks.file).parent
        if "/" in name or Path(name).suffix in (".yaml", ".yml", ".json"):
            if (path := folder / name).is_file():
                return path
            self.problem(at, "unknown-tree", f"there is no file {name!r} in {str(folder)!r}")
            return None
        if (path := folder / f"{name}.yaml").is_file():
            return path
        try:
            return paths.find("trees", name)
        except UnknownName:
            beside = {file.stem for file in folder.glob("*.yaml")} if Path(self.marks.file).is_file() else set()
            self.add(self.marks.unknown(at, "tree", name, beside | set(paths.names("trees"))))
        except MpviError as error:
            self.problem(at, "unknown-tree", str(error))
        return None

    def source(self, path: Path, at: Location) -> _Source | None:
        """A subtree's file, or None if it cannot be used here."""
        own = path.resolve()
        if own in self.above:
            chain = " -> ".join(file.stem for file in (*self.above[self.above.index(own) :], own))
            self.problem(at, "recursion", f"a tree can't contain itself: {chain}")
            return None
        if own not in self.reading.sources:
            self.reading.sources[own] = None
            try:
                data, marks = load_marked(path)
                self.reading.sources[own] = _Source(data, marks, _file(data, marks, self.reading))
            except FileProblems as error:
                self.problems += error.problems
            except UserError as error:
                self.problem(at, "unreadable", str(error))
        return self.reading.sources[own]

    def fit(self, call: Call, file: TreeFile, at: Location) -> bool:
        """Whether the arguments are those that the called tree takes."""
        before = len(self.problems)
        for name, value in call.arguments.items():
            where = (*at, "arguments", name)
            if name not in file.parameters:
                self.add(self.marks.unknown(where, "parameter", name, file.parameters, key=True))
            elif not _fits(value, kind := file.parameters[name].type):
                message = f"parameter {name!r} of {call.tree!r} is of type {kind!r}, which {shown(value)} is not"
                self.problem(where, "parameter-type", message)
        for name, parameter in file.parameters.items():
            if parameter.default is None and name not in call.arguments:
                message = f"tree {call.tree!r} needs the argument {name!r}, of type {parameter.type!r}"
                self.problem((*at, "subtree"), "missing-argument", message, key=True)
        return len(self.problems) == before

    def problem(self, at: Location, code: str, message: str, key: bool = False) -> None:
        self.add(self.marks.problem(at, code, message, key))

    def add(self, problem: Problem) -> None:
        """Note a problem. Raises FileProblems where there are so many that more are no help."""
        self.problems.append(problem)
        if len(self.problems) >= MAX_PROBLEMS:
            raise FileProblems(self.problems)


def _names(value: Any) -> Iterator[str]:
    """The names that the texts of a value refer to."""
    if isinstance(value, str):
        yield from references.names_in(value)
    elif isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _names(inner)
