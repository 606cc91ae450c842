"""Warnings about valid trees that probably do not do what their author meant."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import chain, islice
from typing import Any

from mpvi_bt.executive.behaviors.parameters import duration_text, steps_of
from mpvi_bt.executive.behaviors.references import names_in
from mpvi_bt.executive.plan.clauses import nameless
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.tree.outcomes import Outcomes, outcomes
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.ground.errors import Problem, did_you_mean, nearest, shown
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, Location, SourceMarks

CONTROL_HZ = 30  # of robot.protocol, which loads numpy

_ENDS_A_CHILD = {"timeout", "condition", "until_complete", "parallel"}
_PAUSES = ("wait", "look_around")  # which take time whenever they begin
_TAKE_TIME = (*_PAUSES, "navigate", "posture", "manipulate", "check_complete")
_AS_ITS_CHILD = ("attempt", "timeout", "retry", "repeat", "subtree", "condition", "cooldown")
_NO_MARKS = SourceMarks("")


def lint(spec: TreeSpec, skills: Mapping[str, Skill] | None = None, marks: SourceMarks = _NO_MARKS) -> list[Problem]:
    """Blackboard keys, parameters, order, times and prompts that cannot be meant; `MAX_PROBLEMS` at most.

    Args:
        spec: A valid tree, subtrees expanded.
        skills: What prompts may name; None: anything.
        marks: Of the tree's file, for exact places.
    """
    linter = _Linter(spec, skills, marks)
    found = chain(linter.keys(), linter.unused(), linter.node(spec.root, ()))
    return list(islice(found, MAX_PROBLEMS))


def check_rooms(spec: TreeSpec, rooms: Collection[str], marks: SourceMarks = _NO_MARKS) -> list[Problem]:
    """The rooms that nodes name and the house does not have.

    Args:
        spec: A valid tree.
        rooms: Names of the house's rooms, such as "living_room".
        marks: As for `lint`.
    """
    from mpvi_bt.executive.plan.knowledge import normalize  # loads numpy

    known = sorted(normalize(room) for room in rooms)
    linter = _Linter(spec, None, marks)
    found = []
    for node, caller in _callers(spec.root, marks.file):
        room = getattr(node.parameters, "room", None)
        if isinstance(room, str) and not names_in(room) and normalize(room) not in known:
            near = nearest(normalize(room), known)
            message = f"unknown room {shown(room)}{_whence(node, caller)}.{did_you_mean(near, known)}"
            more = {"severity": "error", "nearest": near, "known": tuple(known)}
            where = "room" if caller is node else "arguments"
            found.append(linter.problem(caller, where, "unknown-room", message, **more))
    return found


def check_targets(spec: TreeSpec, phrases: Collection[str], marks: SourceMarks = _NO_MARKS) -> list[Problem]:
    """Warnings of what nodes drive to and nothing in the house is called.

    Args:
        spec: A valid tree.
        phrases: What its rooms, fixtures and things are called, such as "coffee table".
        marks: As for `lint`.
    """
    from mpvi_bt.executive.plan.knowledge import normalize  # loads numpy

    known = sorted({normalize(phrase) for phrase in phrases})
    linter = _Linter(spec, None, marks)
    found = []
    for node, caller in _callers(spec.root, marks.file):
        target = getattr(node.parameters, "target", None) if node.kind == "navigate" else None
        if target is not None and not names_in(target) and normalize(target) not in known:
            near = nearest(normalize(target), known)
            message = f"nothing there is called {shown(target)}{_whence(node, caller)}.{did_you_mean(near, known)}"
            more = {"nearest": near, "known": tuple(known)}
            where = "target" if caller is node else "arguments"
            found.append(linter.problem(caller, where, "unknown-target", message, **more))
    return found


def _callers(node: NodeSpec, file: str, caller: NodeSpec | None = None) -> Iterator[tuple[NodeSpec, NodeSpec]]:
    """Every node with the node to mend in this file: itself, or the call of its subtree."""
    if caller is None or node.place is None or file in ("", node.place.file):
        caller = node
    yield node, caller
    for child in node.children:
        yield from _callers(child, file, caller)


def _whence(node: NodeSpec, caller: NodeSpec) -> str:
    return "" if node is caller else f" (at {node.place})"


class _Linter:
    """Walks one tree.

    Args:
        spec, skills, marks: As for `lint`.
    """

    def __init__(self, spec: TreeSpec, skills: Mapping[str, Skill] | None, marks: SourceMarks) -> None:
        self.spec, self.skills, self.marks = spec, skills, marks
        self.known_ends: dict[int, Outcomes] = {}
        self.known_drivers: dict[int, bool] = {}
        self.locations = {place: at[:-1] for at, place in marks.keys.items()}

    def problem(self, node: NodeSpec, parameter: str, code: str, message: str, **more: Any) -> Problem:
        """A warning, if nothing else is said, about a parameter of a node; "" stands for the node."""
        more = {"severity": "warning", **more}
        place = node.place
        if place is None:
            return Problem(self.spec.name, 0, 0, code, message, **more)
        at = self.locations.get((place.line, place.column)) if place.file == self.marks.file else None
        if at is None:
            return Problem(place.file, place.line, place.column, code, message, **more)
        key = node.kind if parameter in ("", node.type.headline) else parameter
        return self.marks.problem((*at, key), code, message, key=not parameter, **more)

    def head(self, at: Location, code: str, message: str) -> Iterator[Problem]:
        """A warning about a key at the top of the file, unless another file holds it."""
        if at in self.marks.keys:
            yield self.marks.problem(at, code, message, key=True, severity="warning")

    # Blackboard keys and parameters

    def keys(self) -> Iterator[Problem]:
        """Keys that are only read, and keys that are only written."""
        nodes = [placed.spec for placed in self.spec.nodes]
        written: dict[str, NodeSpec] = {}
        for node in nodes:
            for field in node.type.writes:
                written.setdefault(str(getattr(node.parameters, field)), node)
        reads = list(self.references())
        reads += [(n, field, str(getattr(n.parameters, field))) for n in nodes for field in n.type.reads]
        names = sorted({*written, *self.spec.blackboard, *self.spec.parameters})
        for node, parameter, key in reads:
            if key not in written and key not in self.spec.blackboard:
                near = nearest(key, names)
                message = f"nothing writes the blackboard key {shown(key)}.{did_you_mean(near, names)}"
                more = {"severity": "error", "nearest": near, "known": tuple(names)}
                yield self.problem(node, parameter, "unwritten-key", message, **more)
        read = {key for _, _, key in reads}
        for key, node in written.items():
            if key not in read:
                message = f"nothing reads the blackboard key {shown(key)}"
                yield self.problem(node, node.type.writes[0], "unread-key", message)
        for key in self.spec.blackboard:
            if key not in read and key not in written:
                message = f"nothing reads the blackboard key {shown(key)}"
                yield from self.head(("blackboard", key), "unread-key", message)

    def references(self) -> Iterator[tuple[NodeSpec, str, str]]:
        """(node, parameter, name) of each reference to a key.

        What a subtree gets by its arguments is referred to where they stand, and not once more in the other file.
        """
        left = [(self.spec.root, frozenset(self.spec.parameters))]  # nodes, and names that were seen to above them
        while left:
            node, told = left.pop()
            for field, value in _parameters(node).items():
                yield from ((node, field, name) for name in sorted(_names(value)) if name not in told)
            if node.kind == "subtree":
                told = frozenset(_names(_parameters(node)))
            left += [(child, told) for child in reversed(node.children)]

    def unused(self) -> Iterator[Problem]:
        """Parameters of the tree that its file does not refer to."""
        own = [p.spec for p in self.spec.nodes if p.spec.place is None or p.spec.place.file == self.marks.file]
        used = {name for n in own for name in _names([n.name, vars(n.parameters), n.written])}
        for name in self.spec.parameters:
            if name not in used:
                message = f"the parameter {shown(name)} is not used; a reference is written ${name}"
                yield from self.head(("parameters", name), "unused-parameter", message)

    # Order, times and prompts

    def node(self, node: NodeSpec, above: tuple[tuple[NodeSpec, int], ...]) -> Iterator[Problem]:
        """Problems of a node and the nodes below it; `above`: its parents, each with the index of its next child."""
        if node.kind in ("sequence", "selector"):
            yield from self.unreachable(node)
            yield from self.begun_anew(node)
        elif node.kind == "retry" and "failure" not in self.ends(node.children[0]):
            yield self.problem(node, "", "pointless-retry", "its child can't fail, so it never tries again")
        elif node.kind == "repeat" and "success" not in self.ends(node.children[0]):
            yield self.problem(node, "", "pointless-repeat", "its child can't succeed, so it never repeats")
        elif node.kind == "timeout":
            yield from self.timeout(node, above)
        elif vars(node.parameters).get("on_failure") == "replan" and not _has_a_rest(above):
            message = (
                "a new plan takes the place of what follows, here nothing: put it right into a sequence with memory"
            )
            yield self.problem(node, "on_failure", "no-rest", message, severity="error")
        elif node.kind == "manipulate" and not any(_can_end(parent, i) for parent, i in above):
            message = (
                "'manipulate' ends by itself only where the policy gives up, and nothing above it ends it; try "
                "'until_complete' or 'timeout'"
            )
            yield self.problem(node, "", "never-ends", message)
        if node.kind == "manipulate":
            yield from self.prompt(node)
        elif node.kind in ("parallel", "until_complete"):
            yield from self.drivers(node)
        for i, child in enumerate(node.children):
            yield from self.node(child, (*above, (node, i)))

    def ends(self, node: NodeSpec) -> Outcomes:
        return outcomes(node, self.known_ends)

    def unreachable(self, node: NodeSpec) -> Iterator[Problem]:
        goes_on, never = ("success", "succeeds") if node.kind == "sequence" else ("failure", "fails")
        for child, after in zip(node.children, node.children[1:], strict=False):
            ends = self.ends(child)
            if goes_on not in ends:
                how = f"never {never}" if ends else "never ends"
                message = f"never begun: {shown(child.label)} before it {how}"
                yield self.problem(after, "", "unreachable", message)
                return

    def begun_anew(self, node: NodeSpec) -> Iterator[Problem]:
        """A sequence without memory: a child that undoes an earlier child's work at every tick, for ever."""
        if node.kind != "sequence" or getattr(node.parameters, "memory", True):
            return
        for i, child in enumerate(node.children):
            for before in node.children[:i]:
                if (pair := _undone(before, child)) is not None:
                    first, second = (shown(leaf.label) for leaf in pair)
                    message = (
                        f"never ends: without memory {first} begins anew at each tick, and cuts off {second}; "
                        "write 'memory: true'"
                    )
                    yield self.problem(node, "memory", "begun-anew", message)
                    return

    def timeout(self, node: NodeSpec, above: tuple[tuple[NodeSpec, int], ...]) -> Iterator[Problem]:
        for i, (parent, _) in reversed(list(enumerate(above))):
            if parent.kind != "timeout" or "limit" in node.unbound | parent.unbound:
                continue
            inner, outer = _limit(node), _limit(parent)
            if _seconds(inner) >= _seconds(outer):
                # In another file it is the call that can be mended.
                files = [n for n, _ in above[i + 1 :] if n.place and parent.place and n.place.file == parent.place.file]
                same = node.place is None or parent.place is None or node.place.file == parent.place.file
                where, what = (node, "this timeout") if same else (files[-1], f"a timeout at {node.place}")
                message = f"{what} of {duration_text(inner)} can't be reached within {duration_text(outer)} around it"
                yield self.problem(where, node.type.headline if same else "", "timeout-too-long", message)
            return

    def drivers(self, node: NodeSpec) -> Iterator[Problem]:
        """Children side by side of which more than one moves the robot."""
        drivers = [child for child in node.children if self.drives(child)]
        for child in drivers[1:]:
            message = f"{shown(drivers[0].label)} moves the robot, too: the last to act in a tick wins"
            yield self.problem(child, "", "two-drivers", message)

    def drives(self, node: NodeSpec) -> bool:
        """Whether a node, or one below it, moves the robot."""
        if id(node) not in self.known_drivers:
            own = node.type.robot and node.kind != "check_complete"
            self.known_drivers[id(node)] = own or any(map(self.drives, node.children))
        return self.known_drivers[id(node)]

    def prompt(self, node: NodeSpec) -> Iterator[Problem]:
        if self.skills is not None:
            for message, near, known in nameless(node.parameters.prompt, self.skills):  # type: ignore[attr-defined]
                yield self.problem(node, "prompt", "no-skill", message, nearest=near, known=known)


def _parameters(node: NodeSpec) -> dict[str, Any]:
    """Those that may hold references to the blackboard."""
    return {name: value for name, value in vars(node.parameters).items() if name not in node.type.reads}


def _names(value: Any) -> set[str]:
    """The names that the texts of a value refer to, at any depth."""
    if isinstance(value, str):
        return set(names_in(value))
    inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
    return {name for part in inner for name in _names(part)}


def _undone(before: NodeSpec, after: NodeSpec) -> tuple[NodeSpec, NodeSpec] | None:
    """Leaves of two children of a sequence without memory that can't both have ended in one tick; None: none is sure.

    A pause takes its time whenever it begins, and so does a drive to elsewhere; where a drive has arrived, it ends at
    once, so that what the hands do after it is not undone.
    """
    for first in _needed(before):
        for second in _needed(after):
            elsewhere = first.kind == second.kind == "navigate" and first.parameters != second.parameters
            if elsewhere or (first.kind in _PAUSES and second.kind in _TAKE_TIME):
                return first, second
    return None


def _needed(node: NodeSpec) -> Iterator[NodeSpec]:
    """Leaves without whose end in success a node can't succeed."""
    if not node.children:
        yield node
    elif node.kind == "sequence" or getattr(node.parameters, "policy", "") == "success_on_all":
        for child in node.children:
            yield from _needed(child)
    elif node.kind in _AS_ITS_CHILD:
        yield from _needed(node.children[0])
    elif node.kind == "until_complete":
        yield from _needed(node.children[-1])


def _can_end(parent: NodeSpec, child: int) -> bool:
    """Whether a node may cut off its running child of that index."""
    reactive = getattr(parent.parameters, "memory", None) is False
    return parent.kind in _ENDS_A_CHILD or (reactive and child > 0)


def _has_a_rest(above: tuple[tuple[NodeSpec, int], ...]) -> bool:
    """Whether the nodes behind one with parents `above` are the rest of its work."""
    parent = above[-1][0] if above else None
    return parent is not None and parent.kind == "sequence" and bool(getattr(parent.parameters, "memory", False))


def _limit(timeout: NodeSpec) -> float | str:
    limit = timeout.parameters.limit  # type: ignore[attr-defined]
    assert isinstance(limit, float | str)
    return limit


def _seconds(duration: float | str) -> float:
    steps = steps_of(duration)
    return float(duration) if steps is None else steps / CONTROL_HZ
