"""Data of a tree file -> TreeSpec, with every problem on the way: parameters are filled in, subtrees are read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mpvi_bt.executive.behaviors import references
from mpvi_bt.executive.behaviors.own_nodes import as_described, own_nodes
from mpvi_bt.executive.behaviors.parameters import Call, NoParameters, Value
from mpvi_bt.executive.behaviors.registry import NodeType, node_types
from mpvi_bt.executive.tree.calls import called_file
from mpvi_bt.executive.tree.spec import BrokenNode, NodeSpec, Place, TreeParameter, TreeSpec
from mpvi_bt.executive.tree.synonyms import meant
from mpvi_bt.executive.tree.tree_file import NodeHead, TreeReading, TreeSource, head_of, typed
from mpvi_bt.ground.errors import FileProblems, UserError, did_you_mean, shown, with_article
from mpvi_bt.ground.marked_yaml import Location, SourceMarks, problems_of

MAX_NODES = 20_000  # of a tree with its subtrees written out: a few files could ask for millions
MAX_DEPTH = 90  # likewise; a deeper tree is slow to tick, no person reads it, and a trace nests two levels a node
_STAND_INS: Mapping[str, Value] = {"number": 1.0, "integer": 1, "boolean": True}  # of parameters without a value


def read(data: Any, marks: SourceMarks, reading: TreeReading, arguments: Mapping[str, Value]) -> TreeSpec:
    """The tree of a file's data.

    Args:
        data, marks: Of the file.
        reading: Takes up what is found.
        arguments: Values of its parameters. Text is read as the parameter's type: "3" is a number where one is due.

    Raises:
        UserError: An argument that the tree does not have, or that is of another type.
        FileProblems: Everything that is wrong with the file and those of its subtrees.
    """
    tree = sketch(data, marks, reading, arguments)
    if reading.problems or tree is None:
        raise FileProblems(list({(p.file, p.line, p.column, p.message): p for p in reading.problems}.values()))
    return tree


def sketch(
    data: Any, marks: SourceMarks, reading: TreeReading, arguments: Mapping[str, Value] | None = None
) -> TreeSpec | None:
    """As `read`, for a tree with errors: a node with a problem becomes a `BrokenNode`.

    None if it has no root, or if nodes of its own cannot be read. Raises FileProblems where there are so many problems
    that more are no help.
    """
    if reading.expanded and isinstance(data, dict):
        told = data.get("nodes", {})
        reading.own |= {kind: as_described(kind, node) for kind, node in told.items()}
        data = {key: value for key, value in data.items() if key != "nodes"}
    file = head_of(data, marks, reading)
    values = typed(arguments or {}, file)
    path = Path(marks.file)
    above = (path.resolve(),) if path.is_file() else ()
    return _tree(TreeSource(data, marks, file), reading, values, above)


def _tree(
    source: TreeSource,
    reading: TreeReading,
    arguments: Mapping[str, Value],
    above: tuple[Path, ...],
    keys: frozenset[str] = frozenset(),
) -> TreeSpec | None:
    """The tree of one file with its parameters filled in, or None if it has no root."""
    file = source.file
    for name, value in file.blackboard.items():
        reading.blackboard.setdefault(name, value)
    values = {name: p.default for name, p in file.parameters.items() if p.default is not None} | dict(arguments)
    unbound = tuple(name for name in file.parameters if name not in values)
    stand_ins = {name: _STAND_INS.get(file.parameters[name].type, f"${name}") for name in unbound}
    root = source.data.get("root") if isinstance(source.data, dict) else None
    own = reading.own if reading.expanded else _own_nodes(source, reading)
    if own is None:
        return None  # which of the nodes below are none is not known
    types = {**node_types(), **own}
    below = keys.union(file.blackboard)
    reader = _TreeReader(source.marks, reading, types, values | stand_ins, frozenset(unbound), above, below)
    node = reader.node(root, ("root",), ()) if isinstance(root, dict) else None
    if node is None:
        return None
    parameters = {name: TreeParameter(p.type, p.default, p.about) for name, p in file.parameters.items()}
    blackboard = dict(reading.blackboard)
    inherited = frozenset(blackboard).difference(file.blackboard)
    about = file.instruction, file.about
    return TreeSpec(file.tree, node, *about, parameters, blackboard, unbound, inherited, file.nodes)


def _own_nodes(source: TreeSource, reading: TreeReading) -> dict[str, NodeType] | None:
    """The nodes of a file's `nodes:`, by kind; None if any is wrong (the problem is noted)."""
    found: dict[str, NodeType] = {}
    before = len(reading.problems)
    listed = isinstance(source.data, dict) and isinstance(source.data.get("nodes"), list)
    for i, given in enumerate(source.file.nodes):
        at = ("nodes", i) if listed else ("nodes",)
        try:
            nodes = own_nodes(given, Path(source.marks.file).parent)
        except UserError as error:
            reading.add(source.marks.problem(at, "own-node", str(error)))
            continue
        for node in nodes:
            if (other := reading.own.setdefault(node.kind, node)).factory != node.factory:
                message = f"a node {node.kind!r} is of {other.factory} already; {node.factory} needs another name"
                reading.add(source.marks.problem(at, "own-node", message))
            found[node.kind] = node
    return found if len(reading.problems) == before else None


class _TreeReader:
    """Builds the nodes of one file, collecting every problem on the way.

    Args:
        marks: Of the file.
        reading: Of the whole tree.
        types: Those of nodes that the file may have, by kind.
        values: Of the file's parameters.
        unbound: Those of them that stand-ins fill.
        above: The file and those that called it, outermost first.
        keys: Of the blackboard that those declare: their first value is that of the outermost.
    """

    def __init__(
        self,
        marks: SourceMarks,
        reading: TreeReading,
        types: Mapping[str, NodeType],
        values: Mapping[str, Value],
        unbound: frozenset[str],
        above: tuple[Path, ...],
        keys: frozenset[str],
    ) -> None:
        self.marks, self.reading, self.values, self.unbound, self.above = marks, reading, values, unbound, above
        self.types, self.keys = types, keys
        self.problems = reading.problems

    def node(self, data: Any, at: Location, inherited: tuple[int, ...]) -> NodeSpec:
        """The node at a location; a `BrokenNode` if anything about it is wrong."""
        reading = self.reading
        reading.count += 1
        if reading.count > MAX_NODES:
            self.problem(at, "too-large", f"more than {MAX_NODES} nodes, subtrees written out")
            raise FileProblems(self.problems)
        before = len(self.problems)
        if reading.depth >= MAX_DEPTH:
            self.problem(at, "too-deep", f"more than {MAX_DEPTH} nodes one below the other, subtrees written out")
            return self.broken(data, at, (), before)
        reading.depth += 1
        node = self._node(data, at, inherited, before)
        reading.depth -= 1
        return node

    def _node(self, data: Any, at: Location, inherited: tuple[int, ...], before: int) -> NodeSpec:
        if not isinstance(data, dict) or not data:
            self.problem(at, "node", f"a node is a mapping such as 'navigate: kitchen', not {shown(data)}")
            return self.broken(data, at, (), before)
        node_type = self.kind(data, at)
        below = self.misplaced(data, at, node_type) if node_type is not None else ()
        if node_type is None or below is not None:
            found = [self.below(data.get(key), (*at, key), inherited) for key in ("children", "child")]
            return self.broken(data, at, (*(below or ()), *found[0], *found[1]), before)
        head = self.head(data, at, node_type)
        segments = inherited if head.segments is None else head.segments
        children = self.children(data, at, node_type, segments)
        parameters = self.parameters(data, at, node_type)
        if parameters is None or self.reading.untold(before):
            return self.broken(data, at, children, before)
        written = self.written(data, node_type)
        unbound = frozenset(key for key, value in written.items() if self.unbound.intersection(_names(value)))
        place = Place(self.marks.file, *self.marks.at((*at, node_type.kind), key=True))
        own = None if node_type.kind in node_types() else node_type
        return NodeSpec(node_type.kind, parameters, head.name or "", children, segments, place, written, unbound, own)

    def broken(self, data: Any, at: Location, children: tuple[NodeSpec, ...], before: int) -> BrokenNode:
        """A node that problems behind the first `before` are about, as far as it can be read."""
        kind, value = next(iter(data.items())) if isinstance(data, dict) and data else ("", data)
        text = "" if value is None or (kind and isinstance(value, list | dict)) else shown(value).strip("'\"")
        place = Place(self.marks.file, *self.marks.at((*at, kind) if kind else at, key=bool(kind)))
        says = f"{kind}: {text}" if kind and text else kind or text
        told = self.reading.untold(before)
        self.reading.told.update(map(id, told))
        own = None if kind in node_types() else self.types.get(kind)
        return BrokenNode(kind, NoParameters(), "", children, place=place, own=own, says=says, problems=told)

    def given(self, data: dict[str, Any], node_type: NodeType) -> dict[str, Any]:
        """The node's parameters as the file writes them; the headline under its own name."""
        other = {"segments", "children", "child", node_type.kind}
        return {node_type.headline: data[node_type.kind]} | {k: v for k, v in data.items() if k not in other}

    def written(self, data: dict[str, Any], node_type: NodeType) -> dict[str, Any]:
        """Those that the tree's parameters change, and a name with a dollar sign."""
        given = self.given(data, node_type)
        changed = {key for key, value in given.items() if references.fill(value, self.values) != value}
        if node_type.headline == "name" and "$" in str(given["name"]):
            changed.add("name")
        return {key: value for key, value in given.items() if key in changed}

    def kind(self, data: dict[str, Any], at: Location) -> NodeType | None:
        kinds = [key for key in data if key in self.types]
        first = next(iter(data))
        if not kinds:
            kinds = list(self.types)  # composites first
            near = meant(first, kinds)
            message = f"unknown node {shown(first)}.{did_you_mean(near, kinds, 99)}"
            more = {"nearest": near, "known": tuple(kinds)}
            self.reading.add(self.marks.problem((*at, first), "unknown-node", message, key=True, **more))
            return None
        for extra in kinds[1:]:
            message = f"a second node type {extra!r} in a node that already is {with_article(repr(kinds[0]))}"
            self.problem((*at, extra), "two-nodes", message, key=True)
        if kinds[0] != first:
            message = f"the node type {kinds[0]!r} must be the first key of its node"
            self.problem((*at, kinds[0]), "order", message, key=True)
        return self.types[kinds[0]]

    def misplaced(self, data: dict[str, Any], at: Location, node_type: NodeType) -> tuple[NodeSpec, ...] | None:
        """Children that stand right behind the node's kind; the mistake is noted. None if there are none."""
        key = self.key_below(node_type)
        below = data[node_type.kind]
        if not key or key in data or not isinstance(below, list | dict):
            return None
        what = "a list of children stands" if key == "children" else "a child stands"
        message = f"{what} under '{key}:', not under '{node_type.kind}:' itself"
        self.problem((*at, node_type.kind), "children", message, key=True)
        return self.below(below, (*at, node_type.kind), ())

    def key_below(self, node_type: NodeType) -> str:
        """The key of a node's children or child; "" if it has none."""
        called = node_type.kind == "subtree" and not self.reading.expanded
        return "" if called else {"composite": "children", "decorator": "child", "leaf": ""}[node_type.family]

    def head(self, data: dict[str, Any], at: Location, node_type: NodeType) -> NodeHead:
        keys = {}
        given = {"segments": data["segments"]} if "segments" in data else {}
        if node_type.headline == "name":
            keys["name"] = node_type.kind
            raw = data[node_type.kind]
            for name in references.names_in(raw) if isinstance(raw, str) else ():
                if name not in self.values:  # a name never comes from the blackboard
                    self.reading.add(self.marks.unknown((*at, node_type.kind), "parameter", name, self.values))
            filled = references.fill(raw, self.values)
            given["name"] = references.unescaped(filled) if isinstance(filled, str) else filled
        try:
            return NodeHead.model_validate(given)
        except ValidationError as error:
            self.problems += problems_of(error, self.marks, NodeHead, at, keys)
            return NodeHead()

    def parameters(self, data: dict[str, Any], at: Location, node_type: NodeType) -> Any:
        """The node's parameters, filled in and checked, or None."""
        raw = {k: v for k, v in self.given(data, node_type).items() if k not in self.types or k == node_type.headline}
        if node_type.headline == "name":
            del raw["name"]
        elif node_type.headline in data and node_type.headline != node_type.kind:
            message = f"{node_type.headline!r} is already given as {node_type.kind!r}"
            self.problem((*at, node_type.headline), "duplicate-key", message, key=True)
        elif raw[node_type.headline] is None and not node_type.needs_headline:
            del raw[node_type.headline]  # `blink:` alone is as its class has it
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
                self.reading.add(self.marks.unknown(location, "parameter", name, self.values))
            told = {self.marks.at(location) for location in unknown}
            found = problems_of(error, self.marks, node_type.parameters, at, keys)
            for problem in found:
                if (problem.line, problem.column) not in told:
                    self.reading.add(problem)
            return None
        skill, skills = vars(parameters).get("skill"), self.reading.skills
        if skills is not None and skill is not None and skill not in skills and not self._is_open(skill, raw):
            self.reading.add(self.marks.unknown((*at, "skill"), "skill", skill, skills))
        return parameters

    def _is_open(self, skill: str, raw: Mapping[str, Any]) -> bool:
        """Whether the skill is a parameter without a value, of this tree or of its caller."""
        name = references.whole(skill)
        return name is not None and (name in self.unbound or references.whole(raw.get("skill")) in self.values)

    def children(
        self, data: dict[str, Any], at: Location, node_type: NodeType, segments: tuple[int, ...]
    ) -> tuple[NodeSpec, ...]:
        key = self.key_below(node_type)
        for wrong in {"children", "child"} - {key}:
            if wrong in data:
                wanted = f"it takes {key!r}" if key else "it takes none"
                self.problem((*at, wrong), "children", f"{node_type.kind!r} has {wrong!r}; {wanted}", key=True)
        if not key:
            return self.called(data, at) if node_type.kind == "subtree" else ()
        nodes = self.below(data.get(key), (*at, key), segments)
        if key not in data:
            self.problem((*at, node_type.kind), "children", f"{node_type.kind!r} needs {key!r}", key=True)
        elif key == "child" and data[key] is None:
            self.problem((*at, key), "children", f"{node_type.kind!r} needs a node under 'child:'", key=True)
        elif key == "child" and isinstance(data[key], list):
            self.problem((*at, key), "children", f"{node_type.kind!r} takes one child, not a list")
        elif key == "children" and not isinstance(data[key], list):
            self.problem((*at, key), "children", "children must be a list")
        elif key == "children" and len(data[key]) < node_type.least:
            least = "a child" if node_type.least == 1 else f"{node_type.least} children"
            message = f"{node_type.kind!r} needs {least} or more, not {len(data[key]) or 'none'}"
            self.problem((*at, key), "children", message)
        return nodes

    def below(self, data: Any, at: Location, segments: tuple[int, ...]) -> tuple[NodeSpec, ...]:
        """The nodes of a list of children or of a single child."""
        if isinstance(data, list):
            return tuple(self.node(item, (*at, i), segments) for i, item in enumerate(data))
        return () if data is None else (self.node(data, at, segments),)

    def called(self, data: dict[str, Any], at: Location) -> tuple[NodeSpec, ...]:
        """The root of the tree that a subtree node calls, or () if anything about it is wrong."""
        try:
            call = Call.model_validate(references.fill(self.given(data, node_types()["subtree"]), self.values))
        except ValidationError:
            return ()  # `parameters` says what is wrong
        found = called_file(call, (*at, "subtree"), self.marks, self.reading, self.above)
        if found is None:
            return ()
        path, source = found
        for name, value in source.file.blackboard.items():
            first = self.reading.blackboard.get(name, value)
            if first != value and name not in self.keys:
                message = f"the key {name!r} begins as {shown(value)} in {path}, and as {shown(first)} in a tree before"
                self.problem((*at, "subtree"), "clashing-key", f"{message}; declare it under 'blackboard:' here")
        tree = _tree(source, self.reading, call.arguments, (*self.above, path.resolve()), self.keys)
        return (tree.root,) if tree else ()

    def problem(self, at: Location, code: str, message: str, key: bool = False) -> None:
        self.reading.add(self.marks.problem(at, code, message, key))


def _names(value: Any) -> Iterator[str]:
    """The names that the texts of a value refer to."""
    if isinstance(value, str):
        yield from references.names_in(value)
    elif isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _names(inner)
