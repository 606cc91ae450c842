"""BDDL problems: ours (tasks/problems/), or else from the installed `bddl` distribution's data files.

Ours restate what the challenge changed after the last release of the distribution. The package itself is never
imported: that is slow, and scoring with it is wrong (qscore.py).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib import metadata
from pathlib import Path

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.marked_yaml import read_text
from mpvi_bt.house.goals.expressions import Expression
from mpvi_bt.house.goals.findings import Findings
from mpvi_bt.house.goals.formula import OF_SUBSTANCE, All, Fact, Formula, Literal, literals
from mpvi_bt.house.goals.grounding import Grounding
from mpvi_bt.house.goals.problem_text import AGENT, read_problem
from mpvi_bt.house.goals.vocabulary import ABSENT, ANY, BddlVocabulary, behavior

__all__ = ["AGENT", "BddlProblem", "Fact", "activities", "load_problem", "parse_problem"]

_ACTIVITY = re.compile(r"bddl/activity_definitions/([^/]+)/problem0\.bddl$")


@dataclass(frozen=True)
class BddlProblem:
    """One BDDL problem.

    Attributes:
        name: Activity name, such as "picking_up_trash".
        objects: Object name to synset, in the order of the file; no wildcards.
        wildcards: Synset to the room in which every further fixture of that kind is meant (`cabinet.n.01_*`).
        init: Facts of the start, without those of the wildcards.
        goal_source: The goal as it is written, its first formula only.
    """

    name: str
    objects: Mapping[str, str]
    wildcards: Mapping[str, str]
    init: tuple[Fact, ...]
    goal_source: Expression

    def expanded(self, counts: Mapping[str, int]) -> BddlProblem:
        """The problem with wildcards written out.

        Args:
            counts: How many things of a wildcard's synset its room has in all, the named ones included. Fewer than are
                named, or a missing synset, adds none.
        """
        objects, init = dict(self.objects), list(self.init)
        for synset, room in self.wildcards.items():
            named = sum(kind == synset for kind in self.objects.values())
            for number in range(named + 1, counts.get(synset, 0) + 1):
                objects[f"{synset}_{number}"] = synset
                init.append(Fact(Literal("inroom", (f"{synset}_{number}", room))))
        return replace(self, objects=objects, wildcards={}, init=tuple(init))

    @cached_property
    def conditions(self) -> tuple[Formula, ...]:
        """The goal's conditions, grounded over `objects`; all must hold."""
        return Grounding(self.objects, self.wildcards, Findings(self.name)).conditions(self.goal_source)

    @property
    def goal(self) -> Formula:
        """The whole goal, grounded over `objects`."""
        return All(self.conditions)

    @cached_property
    def rooms(self) -> dict[str, str]:
        """Fixture or floor to the room that :init says it is in."""
        return {f.literal.args[0]: f.literal.args[1] for f in self.init if f.literal.predicate == "inroom"}

    @property
    def agent_support(self) -> str | None:
        """The floor or lawn that the robot starts on, or None if :init does not say."""
        for fact in self.init:
            if self.objects.get(fact.literal.args[0]) == AGENT and fact.literal.predicate == "ontop":
                return fact.literal.args[1]
        return None

    @property
    def agent_room(self) -> str | None:
        """The room that the robot starts in, or None if :init does not say."""
        return None if self.agent_support is None else self.rooms.get(self.agent_support)

    @property
    def future(self) -> frozenset[str]:
        """Objects that do not exist at the start (they come from slicing, cooking)."""
        return frozenset(f.literal.args[0] for f in self.init if f.literal.predicate == "future")

    @property
    def movables(self) -> tuple[str, ...]:
        """Objects to be placed by an instance: not fixtures, floors, the robot, substances or future things."""
        others = {*self.rooms, *self.future, *self.substances}
        return tuple(o for o, s in self.objects.items() if s != AGENT and o not in others)

    @property
    def poured(self) -> dict[str, str]:
        """Substance to the vessel that :init has filled with it, such as popcorn in a bag."""
        facts = (fact for fact in self.init if fact.positive and fact.literal.predicate == "filled")
        return {fact.literal.args[1]: fact.literal.args[0] for fact in facts}

    @property
    def bound(self) -> tuple[str, ...]:
        """Objects that need a catalogue entry from the task: movables, and substances in vessels."""
        return (*self.movables, *self.poured)

    @cached_property
    def substances(self) -> frozenset[str]:
        """What things are covered by, filled with or a source of, such as dust: no things themselves."""
        stated = (*(fact.literal for fact in self.init), *literals(self.goal))
        return frozenset(literal.args[1] for literal in stated if literal.predicate in OF_SUBSTANCE)


def activities() -> dict[str, Path]:
    """Every activity and its problem file: a root's tasks/problems/*.bddl, or else the `bddl` distribution's.

    Raises:
        UserError: The distribution is not installed; or as `paths.roots`.
    """
    known = dict(distributed())
    for root in reversed(paths.roots()):  # the first root's wins
        known.update((file.stem, file) for file in sorted((root / "tasks" / "problems").glob("*.bddl")))
    return known


@cache
def distributed() -> Mapping[str, Path]:
    """Every activity of the `bddl` distribution and its problem file. Listing all its files takes a tenth of a second.

    Raises:
        UserError: It is not installed.
    """
    try:
        distribution = metadata.distribution("bddl")
    except metadata.PackageNotFoundError:
        raise UserError(ABSENT) from None
    found = ((_ACTIVITY.search(str(file)), file) for file in distribution.files or ())
    return {match[1]: Path(str(distribution.locate_file(file))) for match, file in found if match}


def load_problem(activity: str, known: BddlVocabulary | None = None) -> BddlProblem:
    """Read an activity's problem.

    Args:
        activity: Its name.
        known: The names that it may use; by default BEHAVIOR's predicates, and any synsets and rooms.

    Raises:
        UnknownName: There is no such activity.
        UserError: Its file cannot be read.
        FileProblems: Everything that is wrong with it.
    """
    files = activities()
    if activity not in files:
        raise UnknownName("activity", activity, files)
    known = known or replace(behavior(), synsets=None, rooms=None)
    return parse_problem(read_text(files[activity]), activity, Findings(str(files[activity])), known)


def parse_problem(text: str, name: str, findings: Findings | None = None, known: BddlVocabulary = ANY) -> BddlProblem:
    """The problem of a text.

    Args:
        text: Of its file.
        name: Of the activity.
        findings: Take in what is wrong, warnings and notes too; by default of a text called `name`.
        known: The names that it may use.

    Raises:
        FileProblems: Everything that is wrong with it.
    """
    read = read_problem(text, findings or Findings(name), known)
    return BddlProblem(name, read.objects, read.wildcards, read.init, read.goal)
