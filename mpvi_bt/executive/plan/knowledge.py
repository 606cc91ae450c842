"""The knowledge base: where rooms, fixtures and discovered objects are (Paper, Orchestrator)."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Any, Generic, Literal, Protocol, TypeVar

import numpy as np
from pydantic import Field, FiniteFloat, JsonValue

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Record
from mpvi_bt.ground.words.phrases import Vocabulary, read
from mpvi_bt.ground.words.phrases import normalize as normalize
from mpvi_bt.ground.words.phrases import whole as whole

# Our choice: a hand that reaches puts things no nearer to where it took them, and boxes are off by less.
_AT_M = 0.3  # what lies as near to a thing as this, seen from above, is there
LAID_M = 0.3  # what is farther from where a hand took it was laid there; what is nearer slipped,
_FALLEN_M = 0.06  # and what went straight down so low fell
_CONTENTS = re.compile(r"(?P<how>with|containing|holding|without) (?P<what>.+)")
LIKELY = 0.5  # what is less likely than that to be there is not told to those who ask where a thing is

Kind = Literal["room", "fixture", "object"]


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
        laid: Put down by the robot, away from where it had taken it.
        filled: What the robot put into it, as it was called, though nothing known may be `inside` it.
        confidence: Probability that it is there, 0 to 1.
        seen_s: Simulated time at which it was last seen; None if it never was.
        view: (3,) base pose x, y [m] and yaw [rad] that it was last seen from.
        front: (2,) unit vector out of the side that it is opened from, or sat down on, if that is known.
    """

    name: str
    phrases: tuple[str, ...]
    kind: Kind
    lowest: Array
    highest: Array
    room: str | None = None
    source: str = "prior"
    held: bool = False
    inside: str | None = None
    laid: bool = False
    filled: tuple[str, ...] = ()
    confidence: float = 1.0
    seen_s: float | None = None
    view: Array | None = None
    front: Array | None = None

    @property
    def center(self) -> Array:
        """(3,) middle of the bounding box [m]."""
        return (self.lowest + self.highest) / 2


class Named(Protocol):
    """A thing that has a name, and may be inside another one."""

    name: str
    inside: str | None


Thing = TypeVar("Thing", bound=Named)


@dataclass
class NamedThings(Generic[Thing]):
    """Things by name, in the order of discovery. The navigator has one; a policy with cameras has its own."""

    entries: dict[str, Thing] = field(default_factory=dict)

    def put(self, entry: Thing) -> None:
        """Add or replace a thing."""
        self.entries[entry.name] = entry

    def drop(self, name: str) -> None:
        """Forget a thing."""
        del self.entries[name]

    def __iter__(self) -> Iterator[Thing]:
        return iter(self.entries.values())

    def __contains__(self, name: object) -> bool:
        return name in self.entries

    def within(self, name: str) -> list[str]:
        """The names of the things that are inside a thing."""
        return [entry.name for entry in self if entry.inside == name]


class KnowledgeBase(NamedThings[Entry]):
    """What is known of rooms, fixtures and objects; `find` answers phrases."""

    def drop(self, name: str) -> None:
        """Forget an entry; what was inside it is inside nothing known from now on."""
        super().drop(name)
        for inner in self.within(name):
            self.entries[inner].inside, self.entries[inner].held = None, False

    def find(self, phrase: str, room: str | None = None) -> list[Entry]:
        """Likely entries (see `LIKELY`) for `phrase`; those not yet put away come first.

        What is called just so comes before what the words may mean, see `calls`: where there is the one, the other is
        left out. Our choice: what is still to be picked up comes first, by `away`, so that "a can of soda" means such a
        one. Within that the order of entry is kept.
        """
        wanted = normalize(phrase)
        room = room and normalize(room)
        likely = [e for e in self if e.confidence >= LIKELY]
        hits = [e for e in likely if wanted in map(normalize, e.phrases) or wanted == normalize(e.name)]
        hits = hits or [e for e in likely if calls(e.phrases, phrase)]
        if room:
            hits = [e for e in hits if e.room is None or normalize(e.room) == room]
        return sorted(hits, key=self.away)

    def away(self, entry: Entry) -> tuple[bool, bool, bool, bool]:
        """How far a thing is put away, the least first: carried, put into something, laid down, in a container.

        What lies in a container from the start is as much to be picked up as what does not, but where both are known.
        """
        return entry.held, self.put_in(entry), entry.laid, entry.inside is not None

    def put_in(self, entry: Entry) -> bool:
        """Whether the robot put it into furniture, somebody put it into its container, or the robot carries it.

        What is seen in a bin after a shake may be known anew, as something that nobody laid there.
        """
        if entry.inside is None:
            return entry.laid and any(e.kind == "fixture" and _within(entry, e) for e in self)
        return entry.held or any(e.laid for e in self if e.inside == entry.inside)

    def filled_so(
        self, found: list[Entry], phrase: str, within: Callable[[str], Collection[str]] | None = None,
        stands_open: Callable[[str], bool] | None = None,
    ) -> list[Entry]:  # fmt: skip
        """Those that are empty, or with or without contents, as the phrase says; all if none is.

        Args:
            found: What the phrase may mean.
            phrase: Such as "the empty bowl" or "a basket without a candle".
            within: Says what lies in a thing; by default what is `inside` it here.
            stands_open: Says what does: where nothing is known to have in it what the phrase says, what is shut may.
        """
        reading = read(phrase)
        if reading is None or len(found) < 2:
            return found
        inside = within or self.within
        fitting = found
        if ("filling", "empty") in reading.qualities:
            fitting = [e for e in fitting if not inside(e.name) and not e.filled]
        if (said := _CONTENTS.match(reading.place)) is not None:
            named, wanted = {e.name for e in self.find(said["what"])}, said["how"] != "without"

            def has(e: Entry) -> bool:
                return bool(named & set(inside(e.name))) or any(calls((put,), said["what"]) for put in e.filled)

            so = [e for e in fitting if has(e) == wanted]
            if not so and wanted and stands_open is not None:
                so = [e for e in fitting if not stands_open(e.name)]
            fitting = so
        return fitting or found

    def joined(self, places: list[Entry]) -> list[Entry]:
        """Of several places, those that already hold a thing named like the payload; all if there is none.

        Our choice: what is alike is taken to one place, so that "the tree" is the one where the first egg was laid.
        """
        carried = {normalize(phrase) for e in self if e.held for phrase in e.phrases}
        laid = [e for e in self if not e.held and e.inside is None and carried & set(map(normalize, e.phrases))]
        return [p for p in places if any(_at(e.center, p) for e in laid)] or places

    def save(self) -> list[JsonValue]:
        """What was learned, as JSON values: every entry but those known beforehand and never seen since."""
        learned = [e for e in self if e.source != "prior" or e.seen_s is not None]
        return [SavedEntry(**_plain(e)).model_dump(mode="json") for e in learned]

    def restore(self, saved: Iterable[Any]) -> None:
        """Bring a base with the same prior entries to what was saved.

        Raises:
            ValueError: What was saved is not as `save` writes it.
        """
        entries = [SavedEntry.model_validate(given).entry() for given in saved]
        self.entries = {e.name: e for e in self if e.source == "prior"}
        self.entries.update((e.name, e) for e in entries)


def laid_down(taken_at: Array, lowest: Array, highest: Array, by_hand: bool = False) -> bool:
    """Whether what a hand took at a place (3,), its middle, was put elsewhere: aside, or on another level.

    Args:
        taken_at: Where its middle was [m].
        lowest, highest: (3,) corners of the box about it now.
        by_hand: A hand let go of it there. What else lies on a floor below where it was taken fell.
    """
    moved = (lowest + highest) / 2 - taken_at
    aside = float(norm(moved[:2])) > LAID_M
    return aside or bool(abs(moved[2]) > LAID_M and (by_hand or lowest[2] > _FALLEN_M))


def _within(entry: Entry, place: Entry) -> bool:
    """Whether a thing is in the box about a piece of furniture, and not on top: in a cabinet, on a shelf's board."""
    inner = (place.lowest < entry.center) & (entry.center < place.highest)
    return bool(inner.all() and entry.highest[2] < place.highest[2])


def _at(p: Array, place: Entry) -> bool:
    """Whether a point is at a place, seen from above."""
    return bool(((place.lowest - _AT_M < p) & (p < place.highest + _AT_M))[:2].all())


def contents(phrase: str) -> str | None:
    """What is said to be in a thing, or not to be: "leeks" of "the bowl with the leeks"; None of other phrases."""
    reading = read(phrase)
    said = None if reading is None else _CONTENTS.match(reading.place)
    return said["what"] if said is not None else None


@lru_cache(maxsize=10_000)
def calls(phrases: tuple[str, ...], query: str) -> bool:
    """Whether a thing with these names may be what `query` means, by the rule of `mpvi_bt.ground.words.phrases`."""
    return bool(Vocabulary({"": phrases}).named(query))


Place = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class SavedEntry(Record):
    """An `Entry` as JSON has it."""

    name: str
    phrases: tuple[str, ...]
    kind: Kind
    lowest: Place
    highest: Place
    room: str | None
    source: str
    held: bool
    inside: str | None
    laid: bool = False
    filled: tuple[str, ...] = ()
    confidence: Annotated[float, Field(ge=0, le=1)]
    seen_s: FiniteFloat | None
    view: Place | None
    front: tuple[FiniteFloat, FiniteFloat] | None = None

    def entry(self) -> Entry:
        """The entry of this record."""
        view = None if self.view is None else np.array(self.view)
        front = None if self.front is None else np.array(self.front)
        places = {"lowest": np.array(self.lowest), "highest": np.array(self.highest), "view": view, "front": front}
        return Entry(**{**dict(self), **places})


def _plain(entry: Entry) -> dict[str, Any]:
    return {key: tuple(v.tolist()) if isinstance(v, np.ndarray) else v for key, v in vars(entry).items()}
