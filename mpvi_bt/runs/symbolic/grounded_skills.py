"""The robot's skills as actions on a task's things, by the needs and effects of the skills' files."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product

from mpvi_bt.executive.plan.skill_effects import RELEASING, SkillEffects
from mpvi_bt.executive.plan.skills import Skill, shipped_skills
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.runs.symbolic.deeds import Deeds
from mpvi_bt.runs.symbolic.grounded_actions import (
    ADVERSE_COST,
    DOOR_COST,
    DRIVE_COST,
    HANDS,
    HANGING_COST,
    GroundedAction,
)
from mpvi_bt.runs.symbolic.precautions import had_better_be, had_better_not_be
from mpvi_bt.runs.symbolic.told_facts import Atom, ToldFacts


def planned_with(skills: Mapping[str, Skill]) -> list[Skill]:
    """Of skills that need and bring about the same the first, ours before others."""
    ours = shipped_skills()
    found: dict[object, Skill] = {}
    for skill in sorted(skills.values(), key=lambda skill: (skill.name not in ours, skill.name)):
        found.setdefault((skill.needs, skill.effects, skill.hands), skill)
    return list(found.values())


class Actions(Deeds):
    """Every action that may be of use for what is wanted.

    Args:
        told: What is known.
        wanted: Literals, and whether each is to be true.
        goal: The same as atoms that are to be so.
        skills: By name.
    """

    def __init__(
        self, told: ToldFacts, wanted: dict[Literal, bool], goal: Collection[Atom], skills: Mapping[str, Skill]
    ) -> None:
        super().__init__(told, wanted, goal)
        self._skills = planned_with(skills)

    def all(self) -> list[GroundedAction]:
        """The actions."""
        acts = [*self._drives(), *self._machines()]
        for skill in self._skills:
            for deed in self.deeds(skill):
                acts += self._done(skill, deed)
        return sorted(acts, key=lambda action: self.stops.index(action.args[0]))

    def _drives(self) -> Iterator[GroundedAction]:
        for thing in self.told.things:
            if self.told.fixed(thing):
                yield self._drive(thing)
        for thing, spots in self.spots.items():
            for relation, place in spots:
                if self.seen(relation, place):
                    yield self._drive(thing, place, needs=frozenset({("placed", thing, relation, place)}))
        for marks, floor in self.floor_marks.items():
            yield self._drive(marks, floor, needs=frozenset({("covered", floor, marks)}))

    def _drive(self, target: str, *beside: str, needs: frozenset[Atom] = frozenset()) -> GroundedAction:
        """To a target and what it lies on; the floor there is in reach, too."""
        fixed = next(place for place in (target, *beside) if self.wide(place))
        there = frozenset(("at", place) for place in (target, *beside, self.floor_by(fixed)))
        left = frozenset(("at", place) for place in self.stops) - there | {("by", thing) for thing in self.loose}
        return GroundedAction("go_to", (target,), "", needs, adds=there, drops=left, cost=DRIVE_COST)

    def _machines(self) -> Iterator[GroundedAction]:
        """What washes takes marks off what is in it, while it is on."""
        for atom in sorted(a for a in self.start if a[0] == "covered"):
            _, thing, marks = atom
            for other, entry in self.told.entries.items():
                if not (entry.washes or {}).get(self.told.problem.objects[marks], ("none",)):
                    needs = frozenset({("toggled_on", other), ("placed", thing, "inside", other), atom})
                    yield GroundedAction("", (thing, other), "", needs, drops=frozenset({atom}), cost=0)

    def _done(self, skill: Skill, deed: GroundedAction) -> Iterator[GroundedAction]:
        """A deed with each hand, and from each place from which it can be done."""
        needs, effects, words = skill.needs, skill.effects, deed.words
        payload = next((words[slot] for slot in needs.held if slot in words), None)
        reached = [words[slot] for slot in needs.near if slot in words]
        needed = deed.needs | self._open_atoms(needs.open, words)
        needed |= {("toggled_on", words[slot]) for slot in needs.on if slot in words}
        forbids = deed.forbids | self._open_atoms(needs.closed, words)
        releases = any(getattr(effects, term) for term in RELEASING)
        after, without = had_better_be(self, skill, words), had_better_not_be(self, skill, words)
        for hand, before, frees in self._hands(needs.hands, payload):
            held = {("held", words[effects.held], hand or "both")} if effects.held else frees if releases else set()
            drops = deed.drops | before if effects.held or releases else deed.drops
            others = [other for other in HANDS if hand and other != hand]
            for ways in product(*(self._near(thing, others, deed.needs, effects) for thing in reached)):
                so = needed.union(before, *ways)
                adds = deed.adds | held
                full = {("free", other) for other in others} if effects.open or effects.closed else set[Atom]()
                hanging = not effects.on and any(a[0] == "held" for way in ways for a in way)
                act = replace(
                    deed, skill=skill.name, hand=hand, needs=so, forbids=forbids, adds=adds, drops=drops,
                    cost=deed.cost + HANGING_COST * hanging,
                )  # fmt: skip
                yield replace(act, needs=so | full | after, forbids=forbids | without)
                if full:
                    yield replace(act, cost=act.cost + DOOR_COST)
                if after or without:
                    yield replace(act, cost=act.cost + ADVERSE_COST)

    def _open_atoms(self, slots: Iterable[str], words: Mapping[str, str]) -> frozenset[Atom]:
        return frozenset(("open", words[slot]) for slot in slots if slot in words and self.openable(words[slot]))

    def _hands(self, free: int, payload: str | None) -> Iterator[tuple[str, set[Atom], set[Atom]]]:
        """Each hand that may do it, what has to be so of it, and of what it holds what is so after it lets go."""
        if payload is not None and self.told.two_hands(payload):
            yield "", {("held", payload, "both")}, {("free", hand) for hand in HANDS}
        elif payload is not None:
            for hand, other in (HANDS, HANDS[::-1]):
                yield hand, {("held", payload, hand), *[("free", other)][:free]}, {("free", hand)}
        elif free == 1:
            for hand in HANDS:
                yield hand, {("free", hand)}, set()
        else:
            yield "", {("free", hand) for hand in HANDS if free == 2}, set()

    def _near(
        self, thing: str, others: list[str], so: Collection[Atom], effects: SkillEffects
    ) -> Iterator[frozenset[Atom]]:
        """Each way in which the robot may be at a thing; what the hands hold that are not used is near, too.

        Our choice: what is opened, filled or switched stands where the robot has driven to, or is in the other hand.
        """
        known = [(a[2], a[3]) for a in so if a[:2] == ("placed", thing)]
        if not known or self.seen(*known[0]):
            yield frozenset({("at", thing)})
        if effects.held and known and self.told.is_floor(known[0][1]):
            yield frozenset({("by", thing)})  # it was just set down
        if effects.open or effects.closed:
            return
        if effects.inside or effects.ontop or effects.on:
            yield from (frozenset({("held", thing, other)}) for other in others if not self.told.fixed(thing))
            return
        for relation, place in known or self.spots.get(thing, []):
            if self.near_all(relation, place):
                doors = {("open", place)} if relation == "inside" and self.openable(place) else set[Atom]()
                lies: Atom = ("placed", thing, relation, place)
                yield frozenset({lies, ("at", place), *doors})
                if effects.held and not self.told.fixed(place):
                    yield from (frozenset({lies, ("held", place, other), *doors}) for other in others)
