"""What skills may be done to in a task: the slots of each effect that a skill's file tells, filled with things."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.runs.symbolic.grounded_actions import ASIDE_COST, FLOOR_COST, HAND_COST, WAIT_COST, GroundedAction
from mpvi_bt.runs.symbolic.possible_spots import PossibleSpots
from mpvi_bt.runs.symbolic.told_facts import Atom

Found = Iterator[GroundedAction]


class Deeds(PossibleSpots):
    """Actions by the effects of skills; hands, what is near and what the skills' files need are not in them yet.

    Passing to the other hand is none of them.
    """

    def deeds(self, skill: Skill) -> Found:
        """Those of a skill that may be of use for what is wanted."""
        for term, told in skill.effects.model_dump(exclude_none=True).items():
            if (found := getattr(self, f"_{term}", None)) is not None:
                yield from found(skill, *((told,) if isinstance(told, str) else told))

    def _held(self, skill: Skill, slot: str) -> Found:
        for thing, spots in self.spots.items():
            ended = {(literal.predicate, *literal.args) for literal in self.pairs if thing in literal.args}
            stays = thing in self.carried and self.carried[thing].at_back
            for relation, place in spots if not stays and self.told.two_hands(thing) == (skill.hands == 2) else ():
                lies: Atom = ("placed", thing, relation, place)
                yield _deed({slot: thing}, (thing, place), {lies}, drops={lies, ("at", thing), *ended})

    def _inside(self, skill: Skill, slot: str, container: str, relation: str = "inside") -> Found:
        for thing, spots in self.spots.items():
            for place in [place for kind, place in spots if kind == relation]:
                floor, laid = self.told.is_floor(place), ("placed", thing, relation, place)
                wide = relation == "ontop" and self.wide(place)
                there: set[Atom] = {("by" if floor else "at", thing)} if wide else set()
                aside = wide and (laid not in self.goal or laid in self.start)
                cost = (FLOOR_COST if floor else HAND_COST) + ASIDE_COST * aside
                yield _deed({slot: thing, container: place}, (thing, place), adds={laid, *there}, cost=cost)

    def _ontop(self, skill: Skill, slot: str, surface: str) -> Found:
        return self._inside(skill, slot, surface, "ontop")

    def _nextto(self, skill: Skill, slot: str, target: str, relation: str = "nextto") -> Found:
        for literal in [pair for pair in self.pairs if pair.predicate == relation]:
            for thing, other in (literal.args, literal.args[::-1])[: 1 if relation == "under" else 2]:
                for place, needs, below in self._stands(other) if not self.told.fixed(thing) else ():
                    under = [(u.predicate, *u.args) for u in self.pairs if u == Literal("under", (thing, below))]
                    adds = {(relation, *literal.args), ("placed", thing, "ontop", place), *under}
                    words = {slot: thing} if below else {slot: thing, target: other}
                    yield _deed(words, (thing, other, place), needs, adds=adds)

    def _under(self, skill: Skill, slot: str, target: str) -> Found:
        return self._nextto(skill, slot, target, "under")

    def _stands(self, thing: str) -> Iterator[tuple[str, set[Atom], str]]:
        """What a thing stands on, what has to be so for that, and what it is reached under, if it is under anything."""
        if self.told.fixed(thing):
            yield self.floor_by(thing), set(), ""
        for place in [place for relation, place in self.spots.get(thing, ()) if relation == "ontop"]:
            lies: Atom = ("placed", thing, "ontop", place)
            yield place, {lies}, ""
            for pair in self.pairs:
                if pair.predicate == "under" and pair.args[0] == thing:
                    yield place, {lies, ("at", pair.args[1]), ("under", *pair.args)}, pair.args[1]

    def _poured(self, skill: Skill, slot: str, container: str) -> Found:
        for vessel in [thing for thing in self.carried if self.told.able(thing, "fillable")]:
            held = {thing: spot for thing, spot in self.placed.items() if spot[1] == vessel}
            kept = [thing for thing, spot in held.items() if {("placed", thing, *spot)} & {*self.goal}]
            spots = [set(self.spots.get(thing, ())) for thing in held]
            for relation, place in sorted(set.intersection(*spots)) if spots and not kept else ():
                if relation == "inside" and not self.told.fixed(place) and place != vessel:
                    out: set[Atom] = {("placed", thing, *spot) for thing, spot in held.items()}
                    there: set[Atom] = {("placed", thing, relation, place) for thing in held}
                    yield _deed({slot: vessel, container: place}, (vessel, place, *held), out, adds=there, drops=out)

    def _pushed(self, skill: Skill, slot: str, target: str) -> Found:
        for literal in [pair for pair in self.pairs if pair.predicate == "nextto"]:
            for thing, other in (literal.args, literal.args[::-1]):
                words, beside = {slot: thing, target: other}, {("nextto", *literal.args)}
                if self.told.fixed(thing):
                    if thing in self.told.entries and self.told.entries[thing].mass_kg is not None:
                        yield _deed(words, (thing, other), self._put_first(), adds=beside)
                elif thing == literal.args[0] and self.told.two_hands(thing) and self._pairs_of(thing) == 1:
                    for place, needs, _ in self._stands(other):
                        yield _deed(words, (thing, other), needs | {("placed", thing, "ontop", place)}, adds=beside)

    def _put_first(self) -> set[Atom]:
        """Where things are wanted: furniture that was pushed stands in the way of that."""
        return {atom for atom in self.goal if atom[0] in ("placed", "nextto", "under") and atom[1] in self.loose}

    def _pairs_of(self, thing: str) -> int:
        return sum(thing in pair.args for pair in self.pairs)

    def _attached(self, skill: Skill, slot: str, target: str) -> Found:
        for thing, other in [a.args for a, so in self.wanted.items() if so and a.predicate == "attached"]:
            yield _deed({slot: thing, target: other}, (thing, other), adds={("attached", thing, other)})

    def _open(self, skill: Skill, slot: str) -> Found:
        for thing in filter(self.openable, self.told.things):
            opened: set[Atom] = {("open", thing)}
            yield _deed({slot: thing}, (thing,), forbids=opened, adds=opened, drops={("toggled_on", thing)})

    def _closed(self, skill: Skill, slot: str) -> Found:
        for thing in filter(self.openable, self.told.things):
            yield _deed({slot: thing}, (thing,), {("open", thing)}, drops={("open", thing)})

    def _on(self, skill: Skill, slot: str) -> Found:
        both = any("state" in phrase.slots for phrase in skill.patterns)
        for thing, entry in self.told.entries.items():
            if any(body.switches for body in entry.description.bodies):
                on: set[Atom] = {("toggled_on", thing)}
                shut: set[Atom] = {("open", thing)} if self.openable(thing) and self.told.fixed(thing) else set()
                yield _deed({slot: thing, "state": "on"}, (thing, "on"), forbids=on | shut, adds=on)
                if both:
                    yield _deed({slot: thing, "state": "off"}, (thing, "off"), on, drops=on)

    def _clean(self, skill: Skill, slot: str) -> Found:
        for atom in sorted(a for a in self.start if a[0] == "covered"):
            _, thing, marks = atom
            kind = self.told.problem.objects[marks]
            brushes = [t for t, entry in self.carried.items() if not (entry.removes or {}).get(kind, ("none",))]
            for words, tool in _with(brushes, skill):
                if marks in self.floor_marks:
                    yield _deed(words, (thing, *tool, marks), {atom, ("at", marks)}, drops={atom})
                else:
                    yield _deed({slot: thing, **words}, (thing, *tool, marks), {atom}, drops={atom})

    def _sprayed(self, skill: Skill, slot: str) -> Found:
        for thing, marks in [a.args for a, so in self.wanted.items() if so and a.predicate == "covered"]:
            kind = self.told.problem.objects[marks]
            sprayers = [t for t, entry in self.carried.items() if entry.sprays and entry.sprays.kind == kind]
            for words, tool in _with(sprayers, skill):
                yield _deed({slot: thing, **words}, (thing, *tool), adds={("covered", thing, marks)})

    def _burning(self, skill: Skill, slot: str) -> Found:
        lighters = [t for t, entry in self.carried.items() if entry.source and entry.source.at_c > 100]
        for thing in [thing for thing in self.loose if self.to_be("on_fire", thing)]:
            for words, tool in _with(lighters, skill):
                yield _deed({slot: thing, **words}, (thing, *tool), adds={("on_fire", thing)})

    def _cut(self, skill: Skill, slot: str) -> Found:
        knives = [t for t in self.carried if self.told.able(t, "slicer")]
        for thing, pieces in [(thing, pieces) for thing, made in self.made.items() for pieces in made if pieces]:
            for board in [place for relation, place in self.spots[thing] if relation == "ontop" and self.board(place)]:
                lies: Atom = ("placed", thing, "ontop", board)
                new: set[Atom] = {("placed", piece, "ontop", board) for piece in pieces}
                new |= {("real", piece) for piece in pieces} | {("gone", thing)}
                for words, tool in _with(knives, skill):
                    args = (thing, board, *tool, *pieces)
                    yield _deed({slot: thing, **words}, args, {lies}, adds=new, drops={lies})

    def _meanwhile(self, skill: Skill, slot: str) -> Found:
        sources = [(t, entry.source) for t, entry in self.told.entries.items() if entry.source and self.told.fixed(t)]
        for thing, heat in [(thing, entry.heat) for thing, entry in self.carried.items() if entry.heat]:
            for state, least in (("cooked", heat.cooked_c), ("hot", heat.heated_c), ("frozen", None)):
                for other, source in sources if self.to_be(state, thing) else ():
                    right = source.at_c < 0 if state == "frozen" else least is not None and source.at_c >= max(least, 0)
                    on: set[Atom] = {("toggled_on", other)} if source.switched else set()
                    shut: set[Atom] = {("open", other)} if source.shut and self.openable(other) else set()
                    for where in self._at_source(thing, other, source.placing == "near") if right else ():
                        yield _deed({}, (thing, other, state), where | on, shut, {(state, thing)}, cost=WAIT_COST)
            for relation, place in self.spots[thing] if heat.ignites_c is not None else ():
                if relation == "ontop" and self.to_be("on_fire", thing):
                    needs: set[Atom] = {("placed", thing, relation, place), ("on_fire", place)}
                    yield _deed({}, (thing, place, "on_fire"), needs, adds={("on_fire", thing)}, cost=WAIT_COST)

    def _at_source(self, thing: str, other: str, carried: bool) -> Iterator[set[Atom]]:
        for relation, place in self.spots[thing]:
            lies: Atom = ("placed", thing, relation, place)
            if place == other and not carried:
                yield {lies}
            yield from (
                {lies, ("placed", place, beyond, far)} for beyond, far in self.spots.get(place, ()) if far == other
            )


def _deed(
    words: Mapping[str, str],
    args: tuple[str, ...],
    needs: Iterable[Atom] = (),
    forbids: Iterable[Atom] = (),
    adds: Iterable[Atom] = (),
    drops: Iterable[Atom] = (),
    cost: int = HAND_COST,
) -> GroundedAction:
    so, ended = frozenset(adds), frozenset(drops)
    return GroundedAction("", args, "", frozenset(needs), frozenset(forbids), so, ended, cost, words)


def _with(tools: list[str], skill: Skill) -> list[tuple[dict[str, str], tuple[str, ...]]]:
    """Words for what a skill needs in a hand; none, once, for a skill that needs nothing there."""
    return [({skill.needs.held[0]: tool}, (tool,)) for tool in tools] if skill.needs.held else [({}, ())]
