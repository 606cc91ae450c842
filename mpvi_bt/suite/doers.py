"""Which policies know how to do a skill: our scripted ones those of their repertoire, a server's who knows which."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpvi_bt.behaviors.parameters import Prompt
from mpvi_bt.errors import Problem, nearest
from mpvi_bt.manipulation.repertoire import REPERTOIRE
from mpvi_bt.marked_yaml import Marks
from mpvi_bt.plan.clauses import clauses, match
from mpvi_bt.plan.skills import Skill
from mpvi_bt.suite.backends import BACKENDS, split
from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.tree.spec import TreeSpec

SCRIPTED = tuple(name for name, backend in BACKENDS["policy"].items() if not backend.address)
_SERVERS = tuple(name for name, backend in BACKENDS["policy"].items() if backend.address)


def lint_skill(data: Any, marks: Marks) -> list[Problem]:
    """The warning of a skill that none of our policies knows how to do, of a file without errors."""
    if (name := data["name"]) in REPERTOIRE:
        return []
    message = (
        f"none of our policies ({', '.join(SCRIPTED)}) knows how to do {name!r}, only perhaps that of a server "
        f"({', '.join(_SERVERS)})"
    )
    more: dict[str, Any] = {"nearest": nearest(name, REPERTOIRE), "known": tuple(sorted(REPERTOIRE))}
    return [marks.problem(("name",), "no-doer", message, severity="warning", **more)]


def doubt(config: EpisodeConfig, spec: TreeSpec, skills: Mapping[str, Skill]) -> str:
    """One line for a person if a tree asks for skills that the policy does not know how to do, or ""."""
    name = split(config.policy)[0]
    if name not in SCRIPTED:
        return ""
    asked = {
        call.skill.name: placed.path
        for placed in spec.nodes
        if isinstance(prompt := placed.spec.parameters, Prompt)
        for clause in clauses(prompt.prompt, skills)
        if (call := match(clause, skills)) is not None and call.skill.name not in REPERTOIRE
    }
    what = ", ".join(f"{skill!r} ({path})" for skill, path in asked.items())
    return f"policy {name} does not know how to do {what}: these units will fail" if asked else ""
