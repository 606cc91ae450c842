"""Instances: start places of objects and robot, drawn so that :init can hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.house.goals.problem import BddlProblem, Fact
from mpvi_bt.house.layout.arranging import Arrangement
from mpvi_bt.house.layout.boards import MovableForm
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.layout.start_facts import asked_for, scene_names
from mpvi_bt.house.sim.future import future
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.states.grains import FILLED, space_m3
from mpvi_bt.house.states.relations import kind_of
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry

__all__ = ["OPEN", "Start", "sample", "scene_names"]

OPEN = 0.9  # of its range, of what :init has open: about as far as hands open it, so that they can close it, too


@dataclass(frozen=True, eq=False)
class Start:
    """Where an instance begins.

    Attributes:
        objects: Movable things by their BDDL name.
        base_pose: (3,) the robot's x, y [m], yaw [rad].
        scene_names: BDDL name of every fixture and floor to its name in the house.
        openings: Name in the world of each thing that is not closed to how far its joints are open, 0 to 1, by body.
        on: Names in the world of the things that are turned on.
        marks: Names in the world of what is marked, each with a kind of marks, such as "dust.n.01".
        future: What may come to be of the objects, by its name in the world.
    """

    objects: Mapping[str, Placement]
    base_pose: Array
    scene_names: Mapping[str, str]
    openings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    on: tuple[str, ...] = ()
    marks: tuple[tuple[str, str], ...] = ()
    future: Mapping[str, CatalogueEntry] = field(default_factory=dict)


def marks_of(problem: BddlProblem, names: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Covered things of :init by their names in the world, each with its substance."""
    facts = (fact.literal.args for fact in _facts(problem, "covered") if fact.positive)
    return tuple((names.get(thing, thing), problem.objects[kind]) for thing, kind in facts)


def sample(
    house: House, catalogue: Catalogue, problem: BddlProblem, bindings: Mapping[str, str], rng: np.random.Generator
) -> Start:
    """Draw one start.

    Things lie on floors, on flat ground such as a lawn, on and in fixtures, under them, and on and in other movable
    things, carriers being placed before what they carry; doors and lids are closed but for what :init has open. Whether
    all of :init then holds is for physics to say, so a caller settles the world and checks.

    Args:
        house: Where.
        catalogue: What the bindings name.
        problem: Whose :init is to hold.
        bindings: Synset of a movable thing to its catalogue entry.
        rng: Source of the draw.

    Raises:
        UserError: :init asks for a place or a state that cannot be sampled.
        BackendError: No room was found for something.
    """
    names, wanted = asked_for(house, problem)
    entries = {n: _bound(problem, catalogue, bindings, n) for things in wanted.values() for n in things}
    for substance, vessel in problem.poured.items():
        grains = _grains(substance, entries[substance], entries[vessel])
        wanted["inside", vessel] += grains[1:]
        entries |= dict.fromkeys(grains, entries[substance])
    openings = _openings(house, problem, names, entries)
    shapes = {name: MovableForm(entry, openings.get(name, {})) for name, entry in entries.items()}
    opened = {names.get(name, name): bodies for name, bodies in openings.items()}
    arrangement = Arrangement(house, names, opened, rng)
    for (predicate, place), things in wanted.items():
        try:
            arrangement.add(predicate, place, {name: shapes[name] for name in things})
        except UserError as error:
            raise UserError(f"{problem.name}: {Literal(predicate, (things[0], place))}: {error}") from None
        except BackendError as error:
            raise BackendError(f"{error}, {predicate} {names.get(place, place)}") from None
    base_pose = arrangement.robot(str(problem.agent_support))
    return Start(
        objects={name: Placement(put.shape.entry, put.T) for name, put in arrangement.done.items()},
        base_pose=base_pose,
        scene_names=names,
        openings=opened,
        on=tuple(names.get(f.literal.args[0], f.literal.args[0]) for f in _facts(problem, "toggled_on") if f.positive),
        marks=marks_of(problem, names),
        future=future(catalogue, {name: put.shape.entry for name, put in arrangement.done.items()}),
    )


def _grains(substance: str, entry: CatalogueEntry, vessel: CatalogueEntry) -> list[str]:
    """Names of as many grains of a substance, whose first one has its name, as fill a vessel."""
    each = space_m3(entry.description.solids())
    enough = int(FILLED * space_m3(vessel.description.root.volumes) / each) + 1
    return [f"{kind_of(substance)}_{number}" for number in range(1, enough + 1)]


def _facts(problem: BddlProblem, predicate: str) -> list[Fact]:
    return [fact for fact in problem.init if fact.literal.predicate == predicate]


def _bound(problem: BddlProblem, catalogue: Catalogue, bindings: Mapping[str, str], name: str) -> CatalogueEntry:
    synset = problem.objects[name]
    if synset not in bindings:
        raise UserError(f"{problem.name}: {name} is bound to no catalogue entry; bound: {', '.join(bindings)}")
    return catalogue[bindings[synset]]


def _openings(
    house: House, problem: BddlProblem, names: Mapping[str, str], entries: Mapping[str, CatalogueEntry]
) -> dict[str, dict[str, float]]:
    """What :init has open, by BDDL name: its first joint is."""
    openings = {}
    for fact in _facts(problem, "open"):
        (name,) = fact.literal.args
        entry = entries[name] if name in entries else house.fixtures[names[name]].entry
        moving = [body.name for body in entry.description.bodies if body.joint is not None]
        if not moving:
            raise UserError(f"{problem.name}: {fact.literal}: {entry.name} has nothing that opens")
        if fact.positive:
            openings[name] = {moving[0]: OPEN}
    return openings
