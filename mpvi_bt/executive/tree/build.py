"""TreeSpec -> py_trees. Needs no backend; those arrive at `Tree.setup`."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Composite
from py_trees.decorators import Decorator

from mpvi_bt.executive.behaviors.context import Context, Failure
from mpvi_bt.executive.behaviors.node import Node, failure_of
from mpvi_bt.executive.tree.reader import MAX_DEPTH, MAX_NODES
from mpvi_bt.executive.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.executive.tree.state import NodeState
from mpvi_bt.ground.errors import MpviError, NodeError, UnknownName, UserError
from mpvi_bt.ground.import_paths import imported

Substitute = Callable[[Placed, Callable[[], Behaviour]], Behaviour]


class Tree:
    """A tree that can be ticked.

    Args:
        spec: What to build.
        substitute: Called for every node with what makes the real one, its children included; what it gives stands
            in that place. None: the real ones.

    Attributes:
        spec: What it was built from; another one after `swap`.
        root: The py_trees root.
        nodes: Every py_trees node by its path, in the order of `spec.nodes`. What is below a node that another stands
            in for is left out.
        ticks: How often it was ticked.
        touched: Nodes whose status or feedback may have changed at the last tick: those reset, then those ticked.
        context: The run's, from `setup` on.

    Raises:
        UserError: A parameter of the tree has no value.
    """

    context: Context

    def __init__(self, spec: TreeSpec, substitute: Substitute | None = None) -> None:
        if spec.unbound:
            names = ", ".join(f"{name} ({spec.parameters[name].type})" for name in spec.unbound)
            raise UserError(f"tree {spec.name!r} needs values for its parameters: {names}.")
        self.spec = spec
        self.ticks = 0
        self.touched: list[Behaviour] = []
        self._substitute = substitute
        self._resets: list[Behaviour] = []
        self._ticked: list[Behaviour] = []
        self._reset_before: list[Behaviour] = []
        self._below: dict[Behaviour, list[Behaviour]] = {}
        self._last: dict[str, NodeState] | None = None
        self.root = self._build(spec.nodes[0], {placed.path: placed for placed in spec.nodes})
        self.nodes = self._by_path()

    def _build(self, placed: Placed, all_placed: dict[str, Placed]) -> Behaviour:
        children: list[Behaviour] = []

        def make() -> Behaviour:
            children.extend(self._build(all_placed[path], all_placed) for path in placed.children)
            node = _make(placed.spec, children)
            self._prepare(node, placed.path)
            return node

        node = self._substitute(placed, make) if self._substitute else make()
        self._prepare(node, placed.path)
        self._below[node] = children
        return node

    def _prepare(self, node: Behaviour, path: str) -> None:
        vars(node).update(path=path, resets=self._resets)

    def _by_path(self) -> dict[str, Behaviour]:
        """Every node by its path in the present spec, where it gets its path from, too."""
        children = {placed.path: placed.children for placed in self.spec.nodes}
        nodes: dict[str, Behaviour] = {}

        def note(path: str, node: Behaviour) -> None:
            vars(node)["path"] = path
            nodes[path] = node
            if below := self._below[node]:
                for child_path, child in zip(children[path], below, strict=True):
                    note(child_path, child)

        note(self.spec.nodes[0].path, self.root)
        return nodes

    def setup(self, context: Context) -> None:
        """Hand every node the run's backends.

        Raises:
            UserError: A node names something that the run does not have.
            NodeError: A node's setup broke.
        """
        self.context = context
        for path, node in self.nodes.items():
            self._set_up(path, node)

    def _set_up(self, path: str, node: Behaviour) -> None:
        try:
            node.setup(context=self.context)
        except MpviError:
            raise
        except Exception as error:
            raise NodeError(path, error) from error

    def tick(self) -> Status:
        """Tick once; the root's status.

        Raises:
            NodeError: A behavior raised; every node has been terminated.
        """
        self._last = None
        self._resets.clear()
        self.ticks += 1
        try:
            ticked = list(self.root.tick())
        except Exception as error:
            path = self._culprit(error)
            self._last = {**self.interrupt(), path: NodeState("FAILURE", f"error: {error!r}")}
            raise NodeError(path, error) from error
        except BaseException:
            self.interrupt()
            raise
        if ticked != self._ticked or self._resets != self._reset_before:  # most ticks touch what the last one touched
            self._ticked, self._reset_before = ticked, self._resets.copy()
            self.touched = list(dict.fromkeys([*self._resets, *ticked]))
        return self.root.status

    def _culprit(self, error: Exception) -> str:
        """Path of the node in which an exception arose.

        py_trees does not say whose it was, but the traceback does: it is the innermost frame's own node.
        """
        while isinstance(error.__cause__, Exception) and _owners(error.__cause__):
            error = error.__cause__  # a generator that raises StopIteration is said to have raised another error
        paths = _owners(error)
        return paths[-1] if paths else self.spec.nodes[0].path

    def interrupt(self) -> dict[str, NodeState]:
        """Terminate every node as interrupted, leaves first, whatever state an exception may have left them in.

        `states` goes on telling how they stood before, so that the last picture shows where it ended.
        """
        self._last = states = self.states()
        for node in reversed(self.nodes.values()):
            try:
                node.stop(Status.INVALID)
            except Exception:  # one that cannot stop must not keep the others, and those above it, from it
                node.status = Status.INVALID
        return states

    def accept(self, path: str, said: str) -> None:
        """After the last tick, mark a failed node, and the parents it failed, as succeeded.

        Args:
            path: Of the node.
            said: Its last words.
        """
        for at, node in self.nodes.items():
            if f"{path}/".startswith(f"{at}/") and node.status is Status.FAILURE:
                node.status, node.feedback_message = Status.SUCCESS, said if at == path else ""
                if isinstance(node, Node):
                    node.failure = None

    @property
    def status(self) -> Status:
        """The root's status."""
        return self.root.status

    @property
    def failure(self) -> Failure | None:
        """Why the root failed, or None if it did not."""
        return failure_of(self.root)

    def states(self) -> dict[str, NodeState]:
        """Status, feedback and time of every node, by path, for drawing."""
        if self._last is not None:
            return self._last
        return {path: self.state_of(node) for path, node in self.nodes.items()}

    def state_of(self, node: Behaviour) -> NodeState:
        """How one of `nodes` stands."""
        interrupted = node.status == Status.INVALID and getattr(node, "interrupted", False)
        own: Failure | None = getattr(node, "failure", None)
        if node.status == Status.INVALID and not interrupted:
            return _reset(getattr(node, "ended", ""), own)
        failure = failure_of(node) if node.status == Status.FAILURE else own if node.status == Status.SUCCESS else None
        return NodeState(
            node.status.value,
            node.feedback_message,
            getattr(node, "elapsed_s", None),
            getattr(node, "limit_s", None),
            node.status == Status.SUCCESS and own is not None,
            interrupted,
            "",
            failure.reason if failure else "",
            failure.evidence if failure else "",
            failure.path if failure else "",
        )

    def swap(self, path: str, new: NodeSpec) -> None:
        """Put another node in the place of the one at `path`, between two ticks. What ran there is interrupted.

        A sequence or selector whose turn it was goes on with the new node; its other children stay as they are.

        Raises:
            UnknownName: There is no node at that path.
            UserError: A node of the new part names something that the run does not have; nothing was changed.
        """
        above = self._above(path)
        first = above.children.index(path) if above else 0
        self._splice(path, above, first, first + 1, [new])

    def swap_rest(self, path: str, new: Sequence[NodeSpec]) -> None:
        """As `swap`, with one or more nodes in the place of the one at `path` and all its later siblings: a new plan.

        Raises:
            UserError: The node is not a child of a sequence, selector or parallel.
        """
        above = self._above_siblings(path)
        if not new:
            raise UserError(f"{path}: nothing was given to put there.")
        self._splice(path, above, above.children.index(path), len(above.children), new)

    def swap_after(self, path: str, new: Sequence[NodeSpec]) -> None:
        """As `swap_rest`, but the node at `path` stays: what follows it is another plan, or nothing any more.

        Raises:
            UserError: The node is not a child of a sequence, selector or parallel; or `new` is empty, and what would be
                taken away runs.
        """
        above = self._above_siblings(path)
        first = above.children.index(path) + 1
        if not new and any(self.nodes[later].status == Status.RUNNING for later in above.children[first:]):
            raise UserError(f"{path}: the nodes behind it already run, and no new nodes were given.")
        self._splice(path, above, first, len(above.children), new)

    def _above(self, path: str) -> Placed | None:
        """The parent of a node, None for the root. Raises UnknownName if there is no such node."""
        if path not in self.nodes:
            raise UnknownName("node", path, self.nodes, f"tree {self.spec.name!r}")
        return next((placed for placed in self.spec.nodes if path in placed.children), None)

    def _above_siblings(self, path: str) -> Placed:
        above = self._above(path)
        if above is None or above.spec.type.family != "composite":
            raise UserError(f"{path} is no child of a sequence, selector or parallel; swap it alone.")
        return above

    def _splice(self, path: str, above: Placed | None, first: int, stop: int, new: Sequence[NodeSpec]) -> None:
        """Put nodes in the place of the children first to stop of a node; above None: of the root itself."""
        if unbound := sorted({name for node in new for name in _unbound(node)}):
            raise UserError(f"{path}: the new nodes have parameters without a value: {', '.join(unbound)}.")
        spec = replace(self.spec, root=_spliced(self.spec, above.path if above else None, first, stop, new))
        _check(spec, above.path if above else spec.nodes[0].path)
        placed = {p.path: p for p in spec.nodes}
        fresh = placed[above.path].children[first : first + len(new)] if above else (spec.nodes[0].path,)
        built = [self._build(placed[p], placed) for p in fresh]
        if hasattr(self, "context"):
            for node in built:
                for inner in self._with_below(node):
                    self._set_up(vars(inner)["path"], inner)
        if above is None:
            self.root.stop(Status.INVALID)
            self.root = built[0]
        else:
            below = self._below[self.nodes[above.path]]
            _put(below, first, stop, built)
            below[first:stop] = built
        self.spec, self._last = spec, None
        self.nodes = self._by_path()
        self._below = {node: self._below[node] for node in self.nodes.values()}  # forget what was swapped out

    def _with_below(self, node: Behaviour) -> Iterator[Behaviour]:
        yield node
        for child in self._below[node]:
            yield from self._with_below(child)

    def statuses(self) -> list[Status]:
        """Status of every node, in the order of `nodes`; cheap enough for every tick."""
        return [node.status for node in self.nodes.values()]


def _reset(ended: str, failure: Failure | None) -> NodeState:
    """How a node stands that has not begun, or not since a node above it has reset it."""
    if ended == "SUCCESS":
        return NodeState(feedback="succeeded before", ended="SUCCESS")
    if ended == "FAILURE":
        why = (failure.reason, failure.evidence, failure.path) if failure else ("", "", "")
        feedback = ": ".join(filter(None, ("failed before", *why[:2])))
        return NodeState("INVALID", feedback, None, None, False, False, "FAILURE", *why)
    return NodeState()


def _owners(error: BaseException) -> list[str]:
    """Paths of the nodes whose methods an exception passed through, the innermost last."""
    owners = (frame.f_locals.get("self") for frame, _ in traceback.walk_tb(error.__traceback__))
    return [path for owner in owners if isinstance(owner, Behaviour) and (path := getattr(owner, "path", ""))]


def _make(spec: NodeSpec, children: list[Behaviour]) -> Behaviour:
    arguments: dict[str, Any] = dict(spec.parameters)
    if spec.type.family == "composite":
        arguments["children"] = children
    elif spec.type.family == "decorator":
        arguments["child"] = children[0]
    where = f"{spec.place}: " if spec.place else ""
    factory: Callable[..., Behaviour] = imported(spec.type.factory, f"{where}node {spec.kind!r}")
    try:
        return factory(name=spec.name or spec.kind, **arguments)
    except TypeError as error:
        made = f"{spec.type.factory}(name=..., {', '.join(f'{key}=...' for key in arguments)})"
        raise UserError(f"{where}node {spec.kind!r} cannot be made by {made}: {error}") from error


def _spliced(spec: TreeSpec, parent: str | None, first: int, stop: int, new: Sequence[NodeSpec]) -> NodeSpec:
    """The root with `new` in the place of the children first to stop of the node at path `parent`."""

    def copy(placed: Placed) -> NodeSpec:
        children = [
            copy(at[path]) if parent is not None and parent.startswith(path) else at[path].spec
            for path in placed.children
        ]
        if placed.path == parent:
            children[first:stop] = new
        return replace(placed.spec, children=tuple(children))

    at = {placed.path: placed for placed in spec.nodes}
    return new[0] if parent is None else copy(spec.nodes[0])


def _unbound(node: NodeSpec) -> Iterator[str]:
    """Parameters of nodes that stand-ins fill."""
    yield from node.unbound
    for child in node.children:
        yield from _unbound(child)


def _check(spec: TreeSpec, changed: str) -> None:
    """Raises UserError if a tree is not one that could be read back from a file."""
    placed = next(p for p in spec.nodes if p.path == changed)
    if placed.spec.type.family == "composite" and len(placed.children) < placed.spec.type.least:
        raise UserError(f"{changed}: {placed.spec.kind!r} needs {placed.spec.type.least} children, not fewer.")
    if len(spec.nodes) > MAX_NODES or max(p.depth for p in spec.nodes) >= MAX_DEPTH:
        raise UserError(f"{changed}: at most {MAX_NODES} nodes in a tree, {MAX_DEPTH} one below the other.")


def _put(siblings: list[Behaviour], first: int, stop: int, new: list[Behaviour]) -> None:
    """Replace some siblings, which are stopped, by nodes; a cursor on one of them goes to the first."""
    parent, old = siblings[0].parent, siblings[first:stop]
    for node in old:
        if node.status != Status.INVALID:
            node.stop(Status.INVALID)
    if isinstance(parent, Decorator):
        parent.decorated, parent.children = new[0], list(new)
    else:
        assert isinstance(parent, Composite)
        if parent.current_child in old:
            parent.current_child = new[0]
        parent.children[first:stop] = new
        if selected := getattr(getattr(parent, "policy", None), "children", None):  # what `until_complete` waits for
            selected[:] = [parent.children[-1]]
    for node in old:
        node.parent = None
    for node in new:
        node.parent = parent
