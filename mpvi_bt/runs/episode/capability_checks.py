"""Checks that the policy has the skills, and the robot the hands, for a task."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from mpvi_bt.executive.behaviors.parameters import Prompt
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.pattern import pattern
from mpvi_bt.executive.plan.skill_effects import SkillEffects
from mpvi_bt.executive.plan.skills import Skill, SkillCall, load_skills, shipped_skills
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground.errors import Problem, UserError, nearest, shown
from mpvi_bt.ground.marked_yaml import SourceMarks
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.ground.robot.robots import sides_of
from mpvi_bt.runs.choices.backends import BACKENDS, choose
from mpvi_bt.runs.choices.config import EpisodeConfig

SCRIPTED = tuple(name for name, backend in BACKENDS["policy"].items() if not backend.address)
_SERVERS = tuple(name for name, backend in BACKENDS["policy"].items() if backend.address)


def lint_skill(data: Any, marks: SourceMarks) -> list[Problem]:
    """Warnings of a file without errors: a skill that none of our policies can do, or one without effects."""
    return [*_undone(data, marks), *_idle(data, marks)]


def _idle(data: Any, marks: SourceMarks) -> Iterator[Problem]:
    """The warning of a skill without effects, of its own or of the skill that it is `like`."""
    if (like := data.get("like")) is not None and like not in load_skills():
        return  # told by `_unlike`
    model = load_skills().get(like or data["name"])
    effects = SkillEffects(**data["effects"]) if data.get("effects") else model.effects if model else SkillEffects()
    if effects.slots:
        return
    message = "the skill tells no effects: plans that use it are not rehearsed from there on"
    yield marks.problem(("name",), "no-effects", message, severity="warning")


def _undone(data: Any, marks: SourceMarks) -> list[Problem]:
    """The warning of a skill that none of our policies knows how to do."""
    if (like := data.get("like")) is not None:
        return list(_unlike(data, like, marks))
    if data.get("motion") is not None or (name := data["name"]) in shipped_skills():
        return []
    message = (
        f"none of our policies ({', '.join(SCRIPTED)}) knows how to do {name!r}, only perhaps that of a server "
        f"({', '.join(_SERVERS)}); where one of theirs does it as well, say which by `like`, or name yours by `motion`"
    )
    more: dict[str, Any] = {"nearest": nearest(name, shipped_skills()), "known": shipped_skills()}
    return [marks.problem(("name",), "no-doer", message, severity="warning", **more)]


def _unlike(data: Any, like: str, marks: SourceMarks) -> Iterator[Problem]:
    """Problems of a skill that is done like another: no such motion, or other slots in its phrases."""
    if like not in shipped_skills():
        yield marks.unknown(("like",), "skill", like, shipped_skills())
    elif (known := load_skills().get(like)) is not None:
        theirs = list(dict.fromkeys(slot for phrase in known.patterns for slot in phrase.slots))
        for i, phrase in enumerate(data["phrases"]):
            for slot in pattern(phrase).slots:
                if slot not in theirs:
                    place = ("phrases", i)
                    yield marks.unknown(place, "slot", slot, theirs, whose=f" of {like!r}")


def doubt(config: EpisodeConfig, spec: TreeSpec, skills: Mapping[str, Skill]) -> str:
    """One line for a person if a tree asks for skills that the policy does not know how to do, or ""."""
    name = choose("policy", config.policy).name
    if name not in SCRIPTED:
        return ""
    asked = {
        call.skill.name: path
        for path, _, call in _calls(spec, skills)
        if not call.skill.motion and call.motion not in shipped_skills()
    }
    what = ", ".join(f"{skill!r} ({path})" for skill, path in asked.items())
    return f"policy {name} does not know how to do {what}: these units will fail" if asked else ""


def check_hands(robot: str, spec: TreeSpec, skills: Mapping[str, Skill]) -> None:
    """Refuse a tree that is for other hands than the robot of a name has.

    Raises:
        UserError: The first prompt that asks for more hands than there are, or for a hand that is not there.
    """
    sides = sides_of(robot)
    for path, clause, call in _calls(spec, skills):
        if call.skill.hands > len(sides):
            takes, has = "two hands" if call.skill.hands > 1 else "a hand", "one" if sides else "none"
            raise UserError(f"{path}: {shown(clause)} takes {takes} (skill {call.skill.name}); {robot} has {has}.")
        hand = call.arguments.get("hand")
        if hand in SIDES and hand not in sides:
            raise UserError(f"{path}: {shown(clause)} is for the {hand} hand; {robot} has the {sides[0]} one.")


def _calls(spec: TreeSpec, skills: Mapping[str, Skill]) -> Iterator[tuple[str, str, SkillCall]]:
    """Every skill call of a tree's prompts: path of the node, the words, and what they ask for."""
    for placed in spec.nodes:
        if isinstance(prompt := placed.spec.parameters, Prompt):
            for clause in clauses(prompt.prompt, skills):
                if (call := match(clause, skills)) is not None:
                    yield placed.path, clause, call
