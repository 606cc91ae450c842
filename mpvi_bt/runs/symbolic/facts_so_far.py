"""A task's facts in the middle of an episode, by what the robot has done, feels and has seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from mpvi_bt.executive.plan.history import SeenObject
from mpvi_bt.executive.rehearsal.done_so_far import places_seen
from mpvi_bt.executive.rehearsal.paper_hands import PaperHands
from mpvi_bt.ground.words.phrases import normalize
from mpvi_bt.house.goals.formula import Fact, Literal
from mpvi_bt.house.goals.problem import AGENT
from mpvi_bt.runs.symbolic.told_facts import FLOORS, ToldFacts

_FOLLOWED = ("inside", "ontop", "filled", "contains", "nextto", "under", "open", "toggled_on", "covered", "future")
_NOWHERE = SeenObject("")


def facts_so_far(told: ToldFacts, world: PaperHands, seen: tuple[SeenObject, ...]) -> ToldFacts:
    """What a task would be told if it began now.

    A thing that nobody knows the place of is told to lie on a floor of the room that it was seen in, or of no room: the
    drive to it searches.

    Args:
        told: What was told at the start.
        world: How things are on paper by now.
        seen: Things that the robot has seen.
    """
    return _Retold(told, world, seen).told()


class _Retold:
    def __init__(self, told: ToldFacts, world: PaperHands, seen: tuple[SeenObject, ...]) -> None:
        self._told, self._world, self._seen = told, world, seen
        self._objects, self._entries = dict(told.problem.objects), dict(told.entries)
        self._init = [fact for fact in told.problem.init if self._stays(fact)]

    def told(self) -> ToldFacts:
        now = dict.fromkeys([*self._placed(), *self._states()])
        self._init = [fact for fact in self._init if fact.literal not in now] + [Fact(literal) for literal in now]
        problem = replace(self._told.problem, objects=self._objects, init=tuple(self._init))
        return replace(self._told, problem=problem, entries=self._entries)

    def _stays(self, fact: Fact) -> bool:
        """Whether a fact of the start is no concern of the world on paper, or is so still."""
        predicate, args = fact.literal.predicate, fact.literal.args
        if not fact.positive or predicate not in _FOLLOWED or self._objects.get(args[0]) == AGENT:
            return True
        if predicate == "future":
            return args[0] in self._world.gone
        return predicate == "filled" and self._world.at.get(args[1]) == ("inside", args[0])  # it is poured still

    def _placed(self) -> Iterator[Literal]:
        """Where everything is that can be carried."""
        begun = {atom[1] for atom in self._told.start if atom[0] == "placed"} | self._told.problem.future
        lost = []
        for thing in self._told.things:
            if thing in self._world.gone or self._told.fixed(thing):
                continue
            relation, support = self._world.at.get(thing, ("", ""))
            sides = [side for side, held in self._world.held.items() if held == thing]
            if sides:
                yield Literal("held", (thing, sides[0] if len(sides) == 1 else "both"))
            elif relation == "room":
                yield Literal("ontop", (thing, self._floor(support)))
            elif relation and (place := self._place(support)) in self._objects:
                yield Literal(relation, (thing, place))
            elif thing in begun or relation:
                lost.append(thing)
        seen = places_seen(self._world, lost, self._seen)
        yield from (self._found(thing, seen.get(thing, _NOWHERE)) for thing in lost)

    def _found(self, thing: str, seen: SeenObject) -> Literal:
        inside = self._world.named(seen.inside) if seen.inside is not None else []
        container = next((place for place in inside if place in self._objects), None)
        if container is not None:
            return Literal("inside", (thing, container))
        return Literal("ontop", (thing, self._floor(seen.room or "")))

    def _states(self) -> Iterator[Literal]:
        world = self._world
        for relation, thing, other in sorted(world.pairs):
            yield Literal(relation, (thing, other))
            if relation == "nextto":
                yield Literal(relation, (other, thing))
        for predicate, pairs in (("covered", world.covered), ("attached", world.attached)):
            yield from (Literal(predicate, pair) for pair in sorted(pairs))
        for predicate, things in (
            ("open", world.open), ("toggled_on", world.on), ("cooked", world.cooked), ("frozen", world.frozen),
            ("on_fire", world.burning), ("gone", world.gone - world.start.later),
            ("real", self._told.problem.future - world.gone),
        ):  # fmt: skip
            yield from (Literal(predicate, (thing,)) for thing in sorted(things) if thing in self._objects)
        for fact in self._told.problem.init:  # marks are no things, though they are gone
            if fact.literal.predicate == "covered" and fact.literal.args not in world.covered:
                self._init.append(Fact(fact.literal, positive=False))

    def _place(self, place: str) -> str:
        """A fixture, which is told of if the problem does not name it."""
        if place in self._world.start.floors:
            return self._floor(self._world.start.rooms[place])
        if place not in self._objects and place in self._told.house.fixtures:
            fixture = self._told.house.fixtures[place]
            self._add(place, fixture.entry.synset, fixture.room)
            self._entries[place] = fixture.entry
        return place

    def _floor(self, room: str) -> str:
        """A floor of a room; "" is no room that anybody knows."""
        rooms = {f.literal.args[0]: f.literal.args[1] for f in self._init if f.literal.predicate == "inroom"}
        for thing, its in rooms.items():
            if self._objects.get(thing) in FLOORS and normalize(its) == normalize(room):
                return thing
        self._add(f"floor_{room}", FLOORS[0], room)
        return f"floor_{room}"

    def _add(self, place: str, synset: str, room: str) -> None:
        self._objects[place] = synset
        self._init.append(Fact(Literal("inroom", (place, room))))
