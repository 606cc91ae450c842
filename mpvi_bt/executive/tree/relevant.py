"""The objects that a tree is about: the detector looks for them while it runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mpvi_bt.executive.behaviors.parameters import NavigateTo, Prompt
from mpvi_bt.executive.behaviors.references import names_in, unescaped
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground.words.phrases import normalize

_THINGS = (
    "object",
    "tool",
    "source",
    "target",
    "container",
    "surface",
)  # slots of skills; others name hands and the like


def task_relevant(spec: TreeSpec, skills: Mapping[str, Skill]) -> tuple[str, ...]:
    """Phrases of all targets of a tree and all things in its prompts, each once, in order.

    (Paper, Navigation appendix: all task-relevant objects are detected throughout.) What is known only while the tree
    runs, a reference to the blackboard, is not among them; a target is looked for at the latest when it is driven to.
    """
    return tuple(dict.fromkeys(normalize(unescaped(text)) for text in _said(spec, skills) if not names_in(text)))


def _said(spec: TreeSpec, skills: Mapping[str, Skill]) -> Iterator[str]:
    for placed in spec.nodes:
        parameters = placed.spec.parameters
        if isinstance(parameters, NavigateTo):
            yield parameters.target
        elif isinstance(parameters, Prompt):
            for clause in clauses(parameters.prompt, skills):
                call = match(clause, skills)
                yield from (call.arguments[slot] for slot in _THINGS if call and slot in call.arguments)
