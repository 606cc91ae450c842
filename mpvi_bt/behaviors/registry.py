"""Every kind of node that a tree may have, with its typed parameters.

One table that the YAML reader, the compiler, the renderer and the builder share. It names the classes as text, so that
a tree is read, checked and drawn without loading py_trees or numpy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import ConfigDict, Field

from mpvi_bt.errors import UnknownName
from mpvi_bt.marked_yaml import Record
from mpvi_bt.plan.schema import Paragraph, Phrase


class Parameters(Record):
    """A node's parameters, strictly typed: "60" is not a number."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class NoParameters(Parameters):
    """Of a node that has none."""


class Memory(Parameters):
    """Of a sequence or selector: whether it resumes at the child that was running. Always said, never assumed."""

    memory: bool


class Limit(Parameters):
    """Of a timeout: simulated seconds."""

    seconds: float = Field(gt=0, le=86400, allow_inf_nan=False)


class NavigateTo(Parameters):
    """Of navigate: what to drive to, and the room to look for it first."""

    target: Phrase
    room: Phrase | None = None


class Prompt(Parameters):
    """Of manipulate: what to tell the policy."""

    prompt: Paragraph


class Criterion(Parameters):
    """Of check_complete: the state that ends the unit, and the skill whose triggers ask about it (none: all)."""

    criterion: Phrase
    skill: str | None = None


Family = Literal["composite", "decorator", "leaf"]


@dataclass(frozen=True)
class NodeType:
    """A kind of node.

    Attributes:
        kind: Its key in a tree file.
        family: A composite has children, a decorator one child, a leaf none.
        parameters: Model of its parameters.
        headline: The parameter that the kind's key holds; "name" for the node's name.
        label: How it is drawn, from name and parameters.
        glyph: Before the label; what py_trees draws.
        factory: "module:Class", called with name, the parameters, and child or children.
        summary: One line.
        least: Children that a composite must have.
    """

    kind: str
    family: Family
    parameters: type[Parameters]
    headline: str
    label: Callable[[str, Any], str]
    glyph: Callable[[Any], str]
    factory: str
    summary: str
    least: int = 1


def _named(word: str) -> Callable[[str, Any], str]:
    return lambda name, _: name or word


NODE_TYPES: dict[str, NodeType] = {
    node.kind: node
    for node in (
        NodeType(
            "sequence",
            "composite",
            Memory,
            "name",
            _named("sequence"),
            lambda p: "{-}" if p.memory else "[-]",
            "mpvi_bt.behaviors.composites:Sequence",
            "Children in order, until one fails.",
        ),
        NodeType(
            "selector",
            "composite",
            Memory,
            "name",
            _named("selector"),
            lambda p: "{o}" if p.memory else "[o]",
            "mpvi_bt.behaviors.composites:Selector",
            "Children in order, until one succeeds.",
        ),
        NodeType(
            "until_complete",
            "composite",
            NoParameters,
            "name",
            _named("until complete"),
            lambda p: "/_/",
            "mpvi_bt.behaviors.composites:UntilComplete",
            "Children side by side, until the last one succeeds.",
            least=2,
        ),
        NodeType(
            "attempt",
            "decorator",
            NoParameters,
            "name",
            lambda name, _: f"attempt: {name}" if name else "attempt",
            lambda p: "-^-",
            "mpvi_bt.behaviors.attempt:Attempt",
            "Records a failure, then lets the plan go on.",
        ),
        NodeType(
            "timeout",
            "decorator",
            Limit,
            "seconds",
            lambda _, p: f"timeout {p.seconds:g} s",
            lambda p: "-^-",
            "mpvi_bt.behaviors.timeout:Timeout",
            "Fails a child that takes too long, in simulated time.",
        ),
        NodeType(
            "navigate",
            "leaf",
            NavigateTo,
            "target",
            lambda _, p: f"Navigate({p.target}, {p.room})" if p.room else f"Navigate({p.target})",
            lambda p: "-->",
            "mpvi_bt.behaviors.navigate:Navigate",
            "Drives the base to a named target.",
        ),
        NodeType(
            "manipulate",
            "leaf",
            Prompt,
            "prompt",
            lambda _, p: f'Manipulate("{p.prompt}")',
            lambda p: "-->",
            "mpvi_bt.behaviors.manipulate:Manipulate",
            "Lets the policy move the arms; never ends by itself.",
        ),
        NodeType(
            "check_complete",
            "leaf",
            Criterion,
            "criterion",
            lambda _, p: f'CheckComplete("{p.criterion}")',
            lambda p: "-->",
            "mpvi_bt.behaviors.check_complete:CheckComplete",
            "Asks the checker about a state when a trigger fires.",
        ),
    )
}


def node_type(kind: str) -> NodeType:
    """The type of a kind. Raises UnknownName."""
    if kind not in NODE_TYPES:
        raise UnknownName("node type", kind, NODE_TYPES)
    return NODE_TYPES[kind]
