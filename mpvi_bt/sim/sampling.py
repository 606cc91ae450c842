"""Instances: where the objects and the robot of a task begin, drawn so that what :init says can hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.errors import BackendError, UserError
from mpvi_bt.goals.evaluate import UNSIMULATED
from mpvi_bt.goals.formula import Literal
from mpvi_bt.goals.problem import AGENT, Fact, Problem
from mpvi_bt.robot.solids import Array
from mpvi_bt.sim.arranging import Arrangement
from mpvi_bt.sim.boards import Shape
from mpvi_bt.sim.catalogue import Catalogue, Entry
from mpvi_bt.sim.house import House
from mpvi_bt.sim.world import Placement

PLACES = ("ontop", "inside", "under")  # what :init may say of where a thing is,
STATES = ("open", "toggled_on")  # and of how it is
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
    """

    objects: Mapping[str, Placement]
    base_pose: Array
    scene_names: Mapping[str, str]
    openings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    on: tuple[str, ...] = ()


def scene_names(house: House, problem: Problem) -> dict[str, str]:
    """Binds the floors and fixtures of a problem to those of a house, room by room, in the order of their names.

    Raises:
        UserError: The house has no such room, or fewer fixtures of a kind than the problem names.
    """
    bound: dict[str, str] = {}
    taken: set[str] = set()
    for name, room in problem.rooms.items():
        house.room(room)  # names the rooms that there are
        synset = problem.objects[name]
        if synset.startswith("floor.n."):
            bound[name] = f"floor_{room}"
            continue
        free = sorted(f.name for f in house.fixtures_of(synset, room) if f.name not in taken)
        if not free:
            raise UserError(f"{house.name}: {problem.name} needs {name} in the {room}, and no {synset} is left there")
        bound[name] = free[0]
        taken.add(free[0])
    return bound


def sample(
    house: House, catalogue: Catalogue, problem: Problem, bindings: Mapping[str, str], rng: np.random.Generator
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
    names = scene_names(house, problem)
    wanted = _groups(problem, names)
    entries = {n: _bound(problem, catalogue, bindings, n) for things in wanted.values() for n in things}
    openings = _openings(house, problem, names, entries)
    shapes = {name: Shape(entry, openings.get(name, {})) for name, entry in entries.items()}
    ground = problem.agent_support
    if ground is None:
        raise UserError(f"{problem.name}: :init does not say where the robot begins")
    opened = {names.get(name, name): bodies for name, bodies in openings.items()}
    arrangement = Arrangement(house, names, opened, rng)
    for (predicate, place), things in wanted.items():
        try:
            arrangement.add(predicate, place, {name: shapes[name] for name in things})
        except UserError as error:
            raise UserError(f"{problem.name}: {Literal(predicate, (things[0], place))}: {error}") from None
        except BackendError as error:
            raise BackendError(f"{error}, {predicate} {names.get(place, place)}") from None
    base_pose = arrangement.robot(ground)
    return Start(
        objects={name: Placement(put.shape.entry, put.T) for name, put in arrangement.done.items()},
        base_pose=base_pose,
        scene_names=names,
        openings=opened,
        on=tuple(names.get(f.literal.args[0], f.literal.args[0]) for f in _facts(problem, "toggled_on") if f.positive),
    )


def _groups(problem: Problem, names: Mapping[str, str]) -> dict[tuple[str, str], list[str]]:
    """(predicate, place) to the things that :init has there, in the order of the file, carriers before what they carry.

    Floors come last among them: what lies there leaves a way to the rest.

    Raises:
        UserError: It says something of them that cannot be sampled.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for fact in problem.init:
        literal = fact.literal
        if literal.predicate in ("inroom", *STATES, *UNSIMULATED) or problem.objects.get(literal.args[0]) == AGENT:
            continue
        if literal.predicate not in PLACES or not fact.positive:
            known = ", ".join((*PLACES, *STATES))
            raise UserError(f"{problem.name}: a start with {literal} cannot be sampled yet; known: {known}")
        groups.setdefault((literal.predicate, literal.args[1]), []).append(literal.args[0])
    ordered: dict[tuple[str, str], list[str]] = {}
    there = set(names)
    while groups:
        ready = [key for key in groups if key[1] in there]
        if not ready:
            (predicate, place), things = next(iter(groups.items()))
            literal = Literal(predicate, (things[0], place))
            raise UserError(f"{problem.name}: {literal}: :init does not say where {place} is")
        for key in sorted(ready, key=lambda key: names.get(key[1], "").startswith("floor_")):
            ordered[key] = groups.pop(key)
            there.update(ordered[key])
    return ordered


def _facts(problem: Problem, predicate: str) -> list[Fact]:
    return [fact for fact in problem.init if fact.literal.predicate == predicate]


def _bound(problem: Problem, catalogue: Catalogue, bindings: Mapping[str, str], name: str) -> Entry:
    synset = problem.objects[name]
    if synset not in bindings:
        raise UserError(f"{problem.name}: {name} is bound to no catalogue entry; bound: {', '.join(bindings)}")
    return catalogue[bindings[synset]]


def _openings(
    house: House, problem: Problem, names: Mapping[str, str], entries: Mapping[str, Entry]
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
