"""The knowledge base: where rooms, fixtures and discovered objects are (Paper, Orchestrator)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from mpvi_bt.perception.phrases import normalize as normalize
from mpvi_bt.perception.phrases import whole as whole
from mpvi_bt.robot.solids import Array


@dataclass
class Entry:
    """One thing that is known.

    Attributes:
        name: Unique, such as "can__of__soda.n.01_1" or "kitchen".
        phrases: What people call it, lower case, such as ("can of soda", "soda can").
        kind: A room, a fixture of the house, or a movable object.
        lowest, highest: (3,) corners of its axis-aligned bounding box in the world [m].
        room: The room that it is in.
        source: Who said so: "prior", "oracle", a detector's name.
        held: Carried by the robot now, or inside something that is.
        inside: Name of the movable container that it is in, or None.
    """

    name: str
    phrases: tuple[str, ...]
    kind: Literal["room", "fixture", "object"]
    lowest: Array
    highest: Array
    room: str | None = None
    source: str = "prior"
    held: bool = False
    inside: str | None = None

    @property
    def center(self) -> Array:
        """(3,) middle of the bounding box [m]."""
        return (self.lowest + self.highest) / 2


@dataclass
class KnowledgeBase:
    """Entries by name; `find` answers phrases."""

    entries: dict[str, Entry] = field(default_factory=dict)

    def put(self, entry: Entry) -> None:
        """Add or replace an entry."""
        self.entries[entry.name] = entry

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries.values())

    def find(self, phrase: str, room: str | None = None) -> list[Entry]:
        """Entries that `phrase` names, what is not yet put away first.

        Our choice: things that are neither carried nor in a movable container come before those that are, so that
        "a can of soda" means one that is still to be picked up. Within that the order of entry is kept. A part stands
        for its thing where nothing is called like the part, see `whole`.
        """
        wanted = normalize(phrase)
        room = room and normalize(room)
        hits = [e for e in self if wanted in map(normalize, e.phrases) or wanted == normalize(e.name)]
        if not hits and (thing := whole(phrase)) is not None:
            return self.find(thing, room)
        if room:
            hits = [e for e in hits if e.room is None or normalize(e.room) == room]
        return sorted(hits, key=lambda e: (e.held, e.inside is not None))
