"""What a classical planner is told of a task: its things, where they begin, and what the catalogue says of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from mpvi_bt.ground.words.phrases import normalize
from mpvi_bt.house.goals.formula import Fact, Literal
from mpvi_bt.house.goals.problem import AGENT, BddlProblem, load_problem
from mpvi_bt.house.instances.tasks import Task
from mpvi_bt.house.layout.boards import MovableForm
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry, load_catalogue

Atom = tuple[str, ...]
FLOORS = ("floor.n.01", "lawn.n.01", "driveway.n.01")
_PLACED = {"inside": "inside", "ontop": "ontop", "filled": "inside", "contains": "inside"}


@dataclass(frozen=True, eq=False)
class ToldFacts:
    """A task's own facts: no simulator's truth, and no place but what the task's problem says.

    Attributes:
        problem: With floors for rooms that have none.
        entries: Thing to its entry of the catalogue; floors have none.
        house: Where it is.
        catalogue: What cutting makes of things.
    """

    problem: BddlProblem
    entries: Mapping[str, CatalogueEntry]
    house: House
    catalogue: Catalogue

    @cached_property
    def start(self) -> frozenset[Atom]:
        """What is so at the start, as atoms."""
        atoms: set[Atom] = set()
        for fact in self.problem.init:
            predicate, args = fact.literal.predicate, fact.literal.args
            if not fact.positive or self.problem.objects.get(args[0]) == AGENT:
                continue
            if predicate in _PLACED:
                thing, place = args if predicate in ("inside", "ontop") else args[::-1]
                atoms.add(("placed", thing, _PLACED[predicate], place))
            elif predicate not in ("inroom", "future", "insource"):
                atoms.add((predicate, *args))
        return frozenset(atoms)

    @cached_property
    def things(self) -> list[str]:
        """What has a name and is there, or comes to be: not the robot, and no marks."""
        marks = {f.literal.args[1] for f in self.problem.init if f.literal.predicate in ("covered", "insource")}
        return [t for t, synset in self.problem.objects.items() if synset != AGENT and t not in marks]

    def able(self, thing: str, ability: str) -> bool:
        """Whether the catalogue says that the thing has an ability, such as "openable"."""
        return thing in self.entries and ability in self.entries[thing].abilities

    def is_floor(self, thing: str) -> bool:
        """Whether it is a floor, or a lawn."""
        return self.problem.objects[thing] in FLOORS

    def fixed(self, thing: str) -> bool:
        """Whether it stands in a room from the start: furniture, or a floor."""
        return thing in self.problem.rooms

    def two_hands(self, thing: str) -> bool:
        """Whether it takes two hands to carry."""
        entry = self.entries.get(thing)
        return entry is not None and entry.mass_kg is not None and MovableForm(entry).two_hands

    def cut_into(self, thing: str) -> list[tuple[str, int]]:
        """Synsets of what cutting it makes, and how many: of halves that the problem does not name, their dice."""
        made, future = [], {self.problem.objects[t] for t in self.problem.future}
        todo = list(self.entries[thing].cut_into) if thing in self.entries else []
        while todo:
            name, number = todo.pop()
            entry = self.catalogue[name]
            if entry.synset in future:
                made.append((entry.synset, number))
            else:
                todo += entry.cut_into
        return made

    def room_of(self, thing: str) -> str:
        """The room in which it is at the start; "" of what comes to be."""
        seen = thing
        places = {atom[1]: atom[3] for atom in self.start if atom[0] == "placed"}
        while seen not in self.problem.rooms and seen in places:
            seen = places[seen]
        return self.problem.rooms.get(seen, "")

    def name(self, thing: str) -> str:
        """What the plan calls it."""
        if thing in self.problem.rooms and self.is_floor(thing):
            kind = self.problem.objects[thing].partition(".")[0]
            return f"{normalize(self.problem.rooms[thing])} {kind}"
        if thing in self.entries:
            words = self.problem.objects[thing].partition(".")[0].replace("_", " ").strip()
            phrases = self.entries[thing].phrases
            return phrases[0] if phrases else normalize(words)
        return normalize(self.problem.objects[thing].partition(".")[0].replace("_", " "))


def told_facts(task: Task) -> ToldFacts:
    """What a task tells. Raises UserError, FileProblems as its files are read."""
    problem, house, catalogue = _with_floors(load_problem(task.problem)), load_house(task.house), load_catalogue()
    entries: dict[str, CatalogueEntry] = {}
    for thing, synset in problem.objects.items():
        room = problem.rooms.get(thing)
        here = [f.entry for f in house.fixtures.values() if f.room == room and f.entry.synset == synset]
        if room is not None and here:
            entries[thing] = here[0]
        elif synset in task.bindings:
            entries[thing] = catalogue[task.bindings[synset]]
        elif thing in problem.future:
            made = [entry for entry in catalogue if entry.synset == synset]
            entries.update({thing: made[0]} if made else {})
    return ToldFacts(problem, entries, house, catalogue)


def _with_floors(problem: BddlProblem) -> BddlProblem:
    """A problem with a floor in each of its rooms: things can be set down there in any case."""
    with_one = {room for thing, room in problem.rooms.items() if problem.objects[thing] in FLOORS}
    floors = {f"floor_{room}": room for room in sorted({*problem.rooms.values()} - with_one)}
    objects = {**problem.objects, **dict.fromkeys(floors, FLOORS[0])}
    stand = (Fact(Literal("inroom", floor)) for floor in floors.items())
    return replace(problem, objects=objects, init=(*problem.init, *stand))
