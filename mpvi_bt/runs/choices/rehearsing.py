"""The rehearsal of plans for a task: what is known of its start, and its goal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.rehearsal.known_start import KnownStart, Noun, Truth
from mpvi_bt.executive.rehearsal.paper_world import KEPT
from mpvi_bt.executive.rehearsal.rehearsal import Rehearsal
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.ground.words.phrases import normalize

if TYPE_CHECKING:
    from mpvi_bt.house.goals.problem import BddlProblem
    from mpvi_bt.house.instances.tasks import Task
    from mpvi_bt.house.layout.house import House
    from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry

FLOORS = frozenset({"floor.n.01", "lawn.n.01", "driveway.n.01"})
_REACH_M = 1.0  # Our choice: fixtures with a gap of this or less are within reach of each other
_HOT_C = 40.0  # what is warmer than this heats


def make_rehearsal(skills: Mapping[str, Skill], task: Task | None = None, hands: tuple[str, ...] = SIDES) -> Rehearsal:
    """The rehearsal for a task and a robot with these hands; without a task nothing is known of the start.

    Raises:
        UserError: Its problem or house is not there.
        FileProblems: Everything that is wrong with them.
    """
    return Rehearsal(skills, KnownStart(hands=hands) if task is None else task_start(task, hands))


def task_start(task: Task, hands: tuple[str, ...] = SIDES) -> KnownStart:
    """What is known of a task's start, for a robot with these hands. Raises as `make_rehearsal`."""
    from mpvi_bt.house.goals.problem import load_problem
    from mpvi_bt.house.layout.house import load_house
    from mpvi_bt.house.things.catalogue import load_catalogue

    catalogue = load_catalogue()
    bound = {synset: catalogue.entries[name] for synset, name in task.bindings.items()}
    return known_start(load_problem(task.problem), load_house(task.house), catalogue, bound, hands)


def known_start(
    problem: BddlProblem,
    house: House,
    catalogue: Catalogue,
    bound: Mapping[str, CatalogueEntry],
    hands: tuple[str, ...] = SIDES,
) -> KnownStart:
    """What a problem's `:init` and its house tell.

    Fixtures that the problem names stand for all of their kind in that room; the others are those of the house.

    Args:
        problem: The problem, with its goal.
        house: Where it is.
        catalogue: Of all kinds of things.
        bound: Synset of every movable thing to its entry; of others, all entries of the synset count.
        hands: Those of the robot.
    """
    from mpvi_bt.house.goals.problem import AGENT
    from mpvi_bt.house.sim.future import future

    kinds = {thing: synset for thing, synset in problem.objects.items() if synset != AGENT}
    rooms = dict(problem.rooms)
    for room in sorted(set(rooms.values()) - {rooms[t] for t, s in kinds.items() if s in FLOORS and t in rooms}):
        kinds[f"floor_{room}"], rooms[f"floor_{room}"] = "floor.n.01", room  # things can be laid there in any case
    named = {(kinds[thing], room) for thing, room in rooms.items() if thing in kinds}
    own = {name: f for name, f in house.fixtures.items() if (f.entry.synset, f.room) not in named}
    kinds |= {name: fixture.entry.synset for name, fixture in own.items()}
    rooms |= {name: fixture.room for name, fixture in own.items()}
    entries: dict[str, list[CatalogueEntry]] = {}
    for thing, synset in kinds.items():
        here = [f.entry for f in house.fixtures.values() if (f.entry.synset, f.room) == (synset, rooms.get(thing))]
        mine = [bound[synset]] if synset in bound else [e for e in catalogue if e.synset == synset]
        entries[thing] = here or mine
    made = future(catalogue, {thing: found[0] for thing, found in entries.items() if found})
    told = {kinds[thing] for thing in problem.future}
    later = {thing for thing, entry in made.items() if entry.synset not in told}
    kinds |= {thing: made[thing].synset for thing in later}
    entries |= {thing: [made[thing]] for thing in later}
    stated = [(fact.literal.predicate, fact.literal.args) for fact in problem.init if fact.positive]
    return KnownStart(
        called={thing: _names(synset, rooms.get(thing), entries[thing]) for thing, synset in kinds.items()},
        rooms=rooms,
        floors=frozenset(thing for thing, synset in kinds.items() if synset in FLOORS),
        adjoining=_adjoining(house, kinds, rooms),
        facts=tuple(fact for fact in stated if fact[1][0] in kinds),
        openable=_those(entries, lambda e: "openable" in e.abilities),
        closed_only=_those(entries, lambda e: any(s.closed_only for b in e.description.bodies for s in b.switches)),
        heats={
            thing: e.source.shut
            for thing, found in entries.items()
            for e in found[:1]
            if e.source is not None and e.source.at_c > _HOT_C
        },
        cools=_those(entries, lambda e: e.source is not None and e.source.at_c < 0),
        washes=_those(entries, lambda e: e.washes is not None),
        later=problem.future | later,
        room=problem.agent_room or "",
        unmet=lambda truth, noun: _unmet(problem, truth, noun),
        hands=tuple(hands),
    )


def _those(entries: Mapping[str, Sequence[CatalogueEntry]], are: Callable[[CatalogueEntry], bool]) -> frozenset[str]:
    """Things that are something, by the first of their entries."""
    return frozenset(thing for thing, found in entries.items() if found and are(found[0]))


def _names(synset: str, room: str | None, entries: Iterable[CatalogueEntry]) -> tuple[str, ...]:
    """What people call a thing, what its entry calls it first."""
    words = normalize(synset.split(".")[0])
    floor = [f"{normalize(room)} {words}"] if synset in FLOORS and room is not None else []
    phrases = [phrase for entry in entries for phrase in entry.phrases]
    return tuple(dict.fromkeys((*phrases, words, *floor)))


def _adjoining(house: House, kinds: Mapping[str, str], rooms: Mapping[str, str]) -> frozenset[tuple[str, str]]:
    """Pairs of fixtures that may be within reach of each other: any of a kind in a room that it can be."""
    here: dict[tuple[str, str], list[Array]] = {}
    for fixture in house.fixtures.values():
        here.setdefault((fixture.entry.synset, fixture.room), []).append(fixture.extent()[:, :2])
    found = []
    for a, b in product(rooms, rooms):
        if a != b and rooms[a] == rooms[b] and a in kinds and b in kinds:
            pairs = product(here.get((kinds[a], rooms[a]), ()), here.get((kinds[b], rooms[b]), ()))
            if any(_gap_m(one, other) <= _REACH_M for one, other in pairs):
                found.append((a, b))
    return frozenset(found)


def _gap_m(a: Array, b: Array) -> float:
    """The distance of two boxes (2, 2), seen from above."""
    return float(norm(np.maximum(0.0, np.maximum(a[0] - b[1], b[0] - a[1]))))


def _unmet(problem: BddlProblem, truth: Truth, noun: Noun) -> list[str]:
    """What of a goal does not hold, as far as it is known on paper."""
    from mpvi_bt.house.goals.formula import literals, without
    from mpvi_bt.house.goals.unmet_words import UnmetWords

    unknown = {literal.predicate for literal in literals(problem.goal)} - KEPT.keys()
    known = [kept for condition in problem.conditions if (kept := without(condition, unknown)) is not None]
    return UnmetWords(lambda literal: truth(literal.predicate, literal.args), noun, problem.objects).sentences(known)
