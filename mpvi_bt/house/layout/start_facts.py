"""Requirements of a problem's :init for a house: the fixture of each name, and the places of things."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.ground.errors import UserError
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.house.goals.predicates import OF_HEAT
from mpvi_bt.house.goals.problem import AGENT, BddlProblem
from mpvi_bt.house.layout.house import House

PLACES = ("ontop", "inside", "under")  # what :init may say of where a thing is,
STATES = ("open", "toggled_on", "covered", "insource")  # and of how it is, and what comes out of it
Groups = dict[tuple[str, str], list[str]]


def with_all(problem: BddlProblem, house: House) -> BddlProblem:
    """A problem with its wildcards written out for a house."""
    return problem.expanded({s: len(house.fixtures_of(s, room)) for s, room in problem.wildcards.items()})


def asked_for(house: House, problem: BddlProblem) -> tuple[dict[str, str], Groups]:
    """BDDL name of every fixture and floor to its name in the house; and (predicate, place) to the things there.

    Carriers come before what they carry.

    Raises:
        UserError: The house lacks a room or a fixture, or :init asks for what cannot be sampled.
    """
    names = scene_names(house, problem)
    groups = _groups(problem, names)
    if (ground := problem.agent_support) is None:
        raise UserError(f"{problem.name}: :init does not say where the robot begins")
    if ground not in names:
        raise UserError(f"{problem.name}: the robot begins on {ground}, which is in no room")
    return names, groups


def scene_names(house: House, problem: BddlProblem) -> dict[str, str]:
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


def _groups(problem: BddlProblem, names: Mapping[str, str]) -> Groups:
    """The things at each (predicate, place) of :init, in the file's order, carriers before their loads.

    Floors come last among them: what lies there leaves a way to the rest.

    Raises:
        UserError: It says something of them that cannot be sampled.
    """
    groups: Groups = {}
    for fact in problem.init:
        literal = fact.literal
        if (
            literal.predicate in ("inroom", "future", *STATES, *OF_HEAT)
            or problem.objects.get(literal.args[0]) == AGENT
        ):
            continue
        if literal.predicate == "filled" and fact.positive:
            literal = Literal("inside", (literal.args[1], literal.args[0]))
        if literal.predicate not in PLACES or not fact.positive:
            known = ", ".join((*PLACES, "filled", *STATES))
            raise UserError(f"{problem.name}: a start with {literal} cannot be sampled yet; known: {known}")
        groups.setdefault((literal.predicate, literal.args[1]), []).append(literal.args[0])
    ordered: Groups = {}
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
