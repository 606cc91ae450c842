"""The registry of node kinds, with their typed parameters.

One table for the YAML reader, compiler, renderer, linter, schema and builder. Classes are named as text, so that trees
can be read, checked and drawn without py_trees or numpy.

Other packages add nodes of their own through the entry point group `mpvi_bt.behaviors`: each entry point is a NodeType
or an iterable of them. A tree file may name others, which are known in it alone (`own_nodes.py`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import metadata
from types import MappingProxyType
from typing import Any, Literal

from mpvi_bt.executive.behaviors.parameters import (
    Assignment,
    Back,
    Call,
    Comparison,
    CriterionToCheck,
    Limit,
    MemoryFlag,
    NamedPosture,
    NavigateTo,
    NoParameters,
    OnFailure,
    ParallelSuccess,
    Parameters,
    Pause,
    Prompt,
    Reason,
    SaidText,
    Times,
    Tries,
    Turn,
    Watch,
    as_text,
    duration_text,
)
from mpvi_bt.ground.errors import UnknownName, UserError

ENTRY_POINTS = "mpvi_bt.behaviors"
RESERVED = ("children", "child", "segments")  # keys of every node

Family = Literal["composite", "decorator", "leaf"]


def _headed(node_type: NodeType, name: str, parameters: Any) -> str:
    """The label of a kind that has no own: its word, and its name or headline."""
    word = node_type.kind.replace("_", " ")
    if node_type.headline == "name":
        return f"{word}: {name}" if name and node_type.family == "decorator" else name or word
    value = getattr(parameters, node_type.headline)
    return word if value is None else f"{word} {as_text(value)}"


@dataclass(frozen=True)
class NodeType:
    """A kind of node.

    Attributes:
        kind: Its key in a tree file.
        family: A composite has children, a decorator one child, a leaf none.
        parameters: Model of its parameters.
        headline: The parameter that the kind's key holds; "name" for the node's name.
        factory: "module:Class" or "folder/file.py:Class", called with name, the parameters, and child or children.
        summary: One line.
        label: How it is drawn, from name and parameters; None: the kind, and its name or headline.
        glyph: Before the label, from the parameters; None: what py_trees draws.
        least: Children that a composite must have.
        robot: Whether it needs a robot or another backend; `mpvi run --dry` stands in for such a node.
        reads, writes: Its parameters that hold a blackboard key which it reads or writes. (A `$key` in any text
            parameter is read without being listed here.)
    """

    kind: str
    family: Family
    parameters: type[Parameters]
    headline: str
    factory: str
    summary: str
    label: Callable[[str, Any], str] | None = None
    glyph: Callable[[Any], str] | None = None
    least: int = 1
    robot: bool = False
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()

    @property
    def needs_headline(self) -> bool:
        """Whether the kind's key must hold a parameter."""
        headline = self.parameters.model_fields.get(self.headline)
        return headline is not None and headline.is_required()

    def label_of(self, name: str, parameters: Any) -> str:
        """One line for a person, such as "Navigate(trash can, kitchen)"."""
        return self.label(name, parameters) if self.label else _headed(self, name, parameters)

    def glyph_of(self, parameters: Any) -> str:
        """Such as "-->"."""
        return (
            self.glyph(parameters)
            if self.glyph
            else {"composite": "{-}", "decorator": "-^-", "leaf": "-->"}[self.family]
        )


def _attempt(name: str, parameters: OnFailure) -> str:
    word = "attempt" if parameters.on_failure == "advance" else "attempt or replan"
    return f"{word}: {name}" if name else word


def _call(parameters: Call) -> str:
    arguments = ", ".join(f"{key}={as_text(value)}" for key, value in parameters.arguments.items())
    return f"subtree {parameters.tree}" + (f"({arguments})" if arguments else "")


def _assignment(parameters: Assignment) -> str:
    if parameters.add is not None:
        return f"set {parameters.key} {'-' if parameters.add < 0 else '+'}= {as_text(abs(parameters.add))}"
    return f"set {parameters.key} = {as_text(parameters.value)}"


_OWN = (
    NodeType(
        "sequence",
        "composite",
        MemoryFlag,
        "name",
        "mpvi_bt.executive.behaviors.composites:Sequence",
        "Children in order, until one fails.",
        glyph=lambda p: "{-}" if p.memory else "[-]",
    ),
    NodeType(
        "selector",
        "composite",
        MemoryFlag,
        "name",
        "mpvi_bt.executive.behaviors.composites:Selector",
        "Children in order, until one succeeds.",
        glyph=lambda p: "{o}" if p.memory else "[o]",
    ),
    NodeType(
        "parallel",
        "composite",
        ParallelSuccess,
        "name",
        "mpvi_bt.executive.behaviors.composites:Parallel",
        "Children side by side, until all or one of them succeeds.",
        label=lambda name, p: f"{name or 'parallel'} ({p.policy.removeprefix('success_on_')})",
        glyph=lambda p: "/_/",
    ),
    NodeType(
        "until_complete",
        "composite",
        NoParameters,
        "name",
        "mpvi_bt.executive.behaviors.composites:UntilComplete",
        "Children side by side, until the last one succeeds.",
        glyph=lambda p: "/_/",
        least=2,
    ),
    NodeType(
        "attempt",
        "decorator",
        OnFailure,
        "name",
        "mpvi_bt.executive.behaviors.attempt:Attempt",
        "Records a failure, then lets the plan go on, or has a new one made.",
        label=_attempt,
    ),
    NodeType(
        "timeout",
        "decorator",
        Limit,
        "limit",
        "mpvi_bt.executive.behaviors.timeout:Timeout",
        "Fails a child that takes too long, in simulated time or in steps.",
        label=lambda _, p: f"timeout {duration_text(p.limit)}",
    ),
    NodeType(
        "monitor",
        "decorator",
        Watch,
        "skill",
        "mpvi_bt.executive.behaviors.monitor:Monitor",
        "Fails its child as soon as the policy's signals differ from those of good handoffs.",
        label=lambda _, p: f"monitor {p.skill}" if p.skill else "monitor",
    ),
    NodeType(
        "retry",
        "decorator",
        Tries,
        "tries",
        "mpvi_bt.executive.behaviors.decorators:Retry",
        "Begins its child again at the next tick after a failure, up to a number of tries.",
        label=lambda _, p: f"retry, {p.tries} {'try' if p.tries == 1 else 'tries'}",
    ),
    NodeType(
        "repeat",
        "decorator",
        Times,
        "times",
        "mpvi_bt.executive.behaviors.decorators:Repeat",
        "Begins its child again at the next tick after a success, up to a number of rounds.",
        label=lambda _, p: "repeat once" if p.times == 1 else f"repeat {p.times} times",
    ),
    NodeType(
        "invert",
        "decorator",
        NoParameters,
        "name",
        "mpvi_bt.executive.behaviors.decorators:Invert",
        "Turns success into failure and failure into success.",
    ),
    NodeType(
        "condition",
        "decorator",
        Comparison,
        "key",
        "mpvi_bt.executive.behaviors.guards:Condition",
        "Ticks its child only while a blackboard key is as it should be; fails once it is not.",
        label=lambda _, p: f"while {p.text}",
        reads=("key",),
    ),
    NodeType(
        "cooldown",
        "decorator",
        Limit,
        "limit",
        "mpvi_bt.executive.behaviors.guards:Cooldown",
        "Fails at once if its child ended too short a time ago.",
        label=lambda _, p: f"cooldown {duration_text(p.limit)}",
    ),
    NodeType(
        "subtree",
        "decorator",
        Call,
        "tree",
        "mpvi_bt.executive.behaviors.decorators:Subtree",
        "The tree of another file, with its parameters filled in.",
        label=lambda _, p: _call(p),
    ),
    NodeType(
        "navigate",
        "leaf",
        NavigateTo,
        "target",
        "mpvi_bt.executive.behaviors.navigate:Navigate",
        "Drives the base to a named target.",
        label=lambda _, p: f"Navigate({', '.join((p.target, *filter(None, [p.room]), *['elsewhere'] * p.elsewhere))})",
        robot=True,
    ),
    NodeType(
        "manipulate",
        "leaf",
        Prompt,
        "prompt",
        "mpvi_bt.executive.behaviors.manipulate:Manipulate",
        "Lets the policy move the arms; ends by itself only where the policy gives up.",
        label=lambda _, p: f'Manipulate("{p.prompt}")',
        robot=True,
    ),
    NodeType(
        "check_complete",
        "leaf",
        CriterionToCheck,
        "criterion",
        "mpvi_bt.executive.behaviors.check_complete:CheckComplete",
        "Asks the checker about a state when a trigger fires.",
        label=lambda _, p: f'CheckComplete("{p.criterion}"{", at once" if p.at_once else ""})',
        robot=True,
    ),
    NodeType(
        "back_off",
        "leaf",
        Back,
        "duration",
        "mpvi_bt.executive.behaviors.back_off:BackOff",
        "Moves the arms back along their last path.",
        label=lambda _, p: "back off" if p.duration is None else f"back off {duration_text(p.duration)}",
        robot=True,
    ),
    NodeType(
        "posture",
        "leaf",
        NamedPosture,
        "posture",
        "mpvi_bt.executive.behaviors.motions:Posture",
        "Brings arms and torso into a named posture.",
        robot=True,
    ),
    NodeType(
        "look_around",
        "leaf",
        Turn,
        "degrees",
        "mpvi_bt.executive.behaviors.motions:LookAround",
        "Turns on the spot.",
        label=lambda _, p: f"look around, {360 if p.degrees is None else p.degrees:g} degrees",
        robot=True,
    ),
    NodeType(
        "wait",
        "leaf",
        Pause,
        "duration",
        "mpvi_bt.executive.behaviors.leaves:Wait",
        "Lets time pass, then succeeds.",
        label=lambda _, p: f"wait {duration_text(p.duration)}",
    ),
    NodeType(
        "say",
        "leaf",
        SaidText,
        "text",
        "mpvi_bt.executive.behaviors.leaves:Say",
        "Shows a line of text, and succeeds.",
        label=lambda _, p: f'say "{p.text}"',
    ),
    NodeType(
        "set",
        "leaf",
        Assignment,
        "key",
        "mpvi_bt.executive.behaviors.leaves:Set",
        "Gives a blackboard key a value, or adds to it.",
        label=lambda _, p: _assignment(p),
        writes=("key",),
    ),
    NodeType(
        "test",
        "leaf",
        Comparison,
        "key",
        "mpvi_bt.executive.behaviors.leaves:Test",
        "Succeeds or fails at once, by the value of a blackboard key.",
        label=lambda _, p: f"test {p.text}",
        reads=("key",),
    ),
    NodeType(
        "succeed", "leaf", NoParameters, "name", "mpvi_bt.executive.behaviors.leaves:Succeed", "Succeeds at once."
    ),
    NodeType(
        "fail",
        "leaf",
        Reason,
        "reason",
        "mpvi_bt.executive.behaviors.leaves:Fail",
        "Fails at once, with a reason code.",
        label=lambda _, p: f"fail: {p.reason}" if p.reason else "fail",
    ),
)


@functools.cache
def node_types() -> Mapping[str, NodeType]:
    """Every kind of node by name: ours, then those of installed packages.

    Raises:
        UserError: A package's entry point does not load, or names a kind that is there already.
    """
    table = {node.kind: node for node in _OWN}
    for point in sorted(metadata.entry_points(group=ENTRY_POINTS), key=lambda p: p.name):
        try:
            loaded = point.load()
            added = [loaded] if isinstance(loaded, NodeType) else list(loaded)
        except Exception as error:
            whose = f" in package {dist.name!r}" if (dist := getattr(point, "dist", None)) else ""
            message = f"entry point {point.name!r} of {ENTRY_POINTS}{whose}: {type(error).__name__}: {error}"
            raise UserError(message) from error
        _add(table, added, f"entry point {point.name!r} ({point.value})")
    return MappingProxyType(table)


def _add(table: dict[str, NodeType], added: Iterable[object], whose: str) -> None:
    for node in added:
        if not isinstance(node, NodeType):
            raise UserError(f"{whose}: {node!r:.60} is not a NodeType")
        if node.kind in table or node.kind in RESERVED:
            raise UserError(f"{whose}: there is already a node type {node.kind!r}")
        table[node.kind] = node


def node_type(kind: str) -> NodeType:
    """The type of a kind. Raises UnknownName."""
    if kind not in node_types():
        raise UnknownName("node type", kind, node_types())
    return node_types()[kind]
