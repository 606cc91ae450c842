"""A drive on paper: where the robot is after a navigation segment."""

from __future__ import annotations

import re

from mpvi_bt.executive.plan.schema import Navigation
from mpvi_bt.executive.rehearsal.paper_world import CannotBe, PaperWorld
from mpvi_bt.ground.words.phrases import normalize

_DRIVE = re.compile(r"(?:go|drive|navigate|walk|travel|move|head|return)(?: back| over| up)? (?:to|towards?) ", re.I)


def drive(world: PaperWorld, segment: Navigation) -> str | None:
    """Drive to what a segment names, in its room first, and then anywhere: robots search. Returns why that is idle."""
    room = normalize(segment.room or "")
    rooms = {normalize(r): r for r in world.start.rooms.values()}
    phrase = _DRIVE.sub("", segment.description, count=1)
    phrase = phrase if normalize(segment.target) in normalize(phrase) else segment.target
    named = world.meant(phrase) or world.meant(segment.target)
    meant = [t for t in named if t not in world.held.values()]
    if not meant and (there := rooms.get(normalize(segment.target))) is not None:
        world.room = world.place = there
        world.spot = {there}
        return None
    if named and not meant and not world.guessed & {*named} and not world.start.partial:
        return f"{world.name(named[0])} is in a hand"
    if not meant:
        world.place = world.guess(segment.target)
        world.spot = {world.place}
        return None
    there_too = [t for t in meant if not room or normalize(world.room_of(t)) == room] or meant
    seen = [t for t in there_too if world.shut_in(t) is None]
    if not seen:
        raise CannotBe(world.hidden(there_too[0]))
    movable = [t for t in there_too if t not in world.start.rooms]
    if movable:
        world.place = min(movable, key=lambda t: world.moved[t])
    else:
        world.place = next((t for t in reversed(world.used) if t in there_too), there_too[0])
    world.room = world.room_of(world.place)
    world.spot = {world.place}
    return None
