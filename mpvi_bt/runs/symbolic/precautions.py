"""What had better be so, and not be so, before a skill is done: it can be done otherwise, and goes wrong often then."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.runs.symbolic.possible_spots import PossibleSpots
from mpvi_bt.runs.symbolic.told_facts import Atom


def had_better_be(spots: PossibleSpots, skill: Skill, words: Mapping[str, str]) -> set[Atom]:
    """Before both hands lift a thing, what is wanted elsewhere and lies on the floor of its room is away from there."""
    told, moved = spots.told, _moved(skill, words)
    if skill.hands != 2 or not skill.effects.held:
        return set()
    floors = {place for place in told.things if told.is_floor(place) and told.room_of(place) == told.room_of(moved)}
    on_floor = {thing for thing, (_, place) in spots.placed.items() if place in floors and thing != moved}
    return {atom for atom in spots.goal if atom[0] in ("placed", "nextto") and atom[1] in on_floor}


def had_better_not_be(spots: PossibleSpots, skill: Skill, words: Mapping[str, str]) -> set[Atom]:
    """What would fall, spill, burn, be in the way, or be taken for another thing."""
    effects, moved = skill.effects, _moved(skill, words)
    inside = _lying(spots, "inside", moved)
    found = _lying(spots, "ontop", moved) | {lies for lies in inside if spots.placed.get(lies[1]) != lies[2:]}
    if spots.to_be("on_fire", moved):
        found.add(("on_fire", moved))
    for first, other in [sorted(pair.args, key=spots.told.things.index) for pair in spots.pairs if moved in pair.args]:
        if moved == other and first in spots.placed and spots.told.name(first) == spots.told.name(other):
            found.add(("placed", first, *spots.placed[first]))  # no words tell them apart: they are taken in order
    if effects.ontop is not None and not spots.wide(surface := words[effects.ontop[1]]):  # it has little room
        whole = {lies for lies in _lying(spots, "ontop", surface) if lies[1] in spots.placed}
        found |= whole - {*spots.goal, ("placed", words[effects.ontop[0]], "ontop", surface)}
    target = words.get((effects.inside or effects.poured or ("", ""))[1], "")
    found |= {("placed", target, *spot) for spot in spots.spots.get(target, ()) if spot[0] == "inside"}
    return found


def _moved(skill: Skill, words: Mapping[str, str]) -> str:
    """What is taken or pushed, if anything is."""
    return words.get(skill.effects.held or (skill.effects.pushed or ("",))[0], "")


def _lying(spots: PossibleSpots, relation: str, place: str) -> set[Atom]:
    return {("placed", thing, relation, place) for thing, found in spots.spots.items() if (relation, place) in found}
