"""The world on paper in the middle of an episode: what was done has had its effects, what failed has had none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpvi_bt.executive.completion import criteria
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.history import History, SeenObject
from mpvi_bt.executive.plan.schema import Navigation
from mpvi_bt.executive.plan.skills import Skill, SkillCall
from mpvi_bt.executive.rehearsal.known_start import KnownStart
from mpvi_bt.executive.rehearsal.paper_drive import drive
from mpvi_bt.executive.rehearsal.paper_hands import PaperHands
from mpvi_bt.executive.rehearsal.paper_world import CannotBe
from mpvi_bt.ground.words.phrases import normalize


def world_so_far(
    skills: Mapping[str, Skill], start: KnownStart, history: History, backward: bool = False
) -> PaperHands:
    """How things are, as far as the robot can know.

    The units that were done are carried out on paper, in their order. Then the hands are corrected by what they feel.
    A thing that a hand has lost is nowhere; `places_seen` may tell of it.

    Args:
        skills: By name.
        start: What was known of the start.
        history: Of the episode.
        backward: Of things that are alike, take the last first.
    """
    world = PaperHands(start, backward)
    for unit in history.units:
        for said in () if unit.reason else clauses(unit.said, skills):
            _carry_out(world, said, match(said, skills), criteria.parse(unit.criterion) if unit.criterion else None)
    if history.full is not None:
        _feel(world, history.full, history.seen)
    return world


def places_seen(world: PaperHands, lost: Sequence[str], seen: Sequence[SeenObject]) -> dict[str, SeenObject]:
    """Where the robot has seen things that are nowhere on paper, as far as it has.

    A seen thing is taken for one that is there on paper, and only else for a lost one; each for one thing.
    """
    left, places = [one for one in seen if not one.held], dict[str, SeenObject]()
    known = [t for t in world.called if t not in {*lost, *world.start.rooms, *world.gone, *world.held.values()}]
    for thing in (*known, *lost):
        alike = (one for one in left if thing in world.named(one.name))
        found = next((one for one in alike if thing in lost or _is_there(world, thing, one)), None)
        if found is not None:
            left.remove(found)
            places |= {thing: found} if thing in lost else {}
    return places


def _is_there(world: PaperHands, thing: str, seen: SeenObject) -> bool:
    if seen.inside is not None:
        return any(world.inside(thing, container) for container in world.named(seen.inside))
    relation, support = world.at.get(thing, ("", ""))
    loose = relation == "inside" and support not in world.start.rooms
    return not loose and normalize(world.room_of(thing)) == normalize(seen.room or "")


def _carry_out(world: PaperHands, said: str, call: SkillCall | None, criterion: criteria.Criterion | None) -> None:
    """Do what was done. It was possible: the hands were as it needs them, or the robot was not where paper says."""
    if call is None:
        world.bring_about(criterion)
        return
    for mend in (_let_hands, _stand_anywhere, None):
        try:
            if call.skill.effects.at is not None:
                target = call.arguments[call.skill.effects.at]
                drive(world, Navigation(type="navigation", description=said, completion_criterion=said, target=target))
            else:
                world.do(call, criterion)
            return
        except CannotBe:
            if mend is not None:
                mend(world, call)


def _stand_anywhere(world: PaperHands, call: SkillCall) -> None:
    """Nobody knows where the robot is, so that everything is in reach."""
    world.place, world.spot = "", {""}


def _let_hands(world: PaperHands, call: SkillCall) -> None:
    """Make the hands so that a skill can be carried out."""
    hand = call.arguments.get("hand")
    sides = [hand] if hand in world.held else list(world.held)
    if sum(world.held[side] is None for side in sides) < call.skill.needs.hands:
        for side in sides:
            world.lose(side)
    for phrase in (call.arguments.get(slot, "") for slot in call.skill.needs.held):
        if not any(world.held[side] in world.named(phrase) for side in sides):
            _take_up(world, sides[0], phrase)


def _take_up(world: PaperHands, side: str, phrase: str) -> bool:
    """Let a hand hold something that is called so; of several what was put down the least."""
    found = [
        t for t in world.named(phrase) if t not in world.start.rooms and t not in {*world.gone, *world.held.values()}
    ]
    if found:
        world.grip(side, min(found, key=lambda thing: world.moved[thing]))
    return bool(found)


def _feel(world: PaperHands, full: tuple[str, ...], seen: tuple[SeenObject, ...]) -> None:
    """Correct what the hands hold by what they feel, and by what is seen in them."""
    carried = [one.name for one in seen if one.held and one.inside is None]
    for side, thing in list(world.held.items()):
        if thing is None:
            continue
        mine = next((name for name in carried if thing in world.named(name)), None)
        both = all(held == thing for held in world.held.values())  # pressed between the hands: no finger feels it
        if (both and mine is None) or (not both and side not in full):
            world.lose(side)
        elif mine is not None and (not both or side == list(world.held)[-1]):
            carried.remove(mine)
    for side in full:
        if side in world.held and world.held[side] is None:
            taken = next((name for name in carried if _take_up(world, side, name)), None)
            if taken is not None:
                carried.remove(taken)
