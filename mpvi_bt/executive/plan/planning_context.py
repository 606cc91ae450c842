"""The grounding of a planner: what it knows of house and robot before the episode."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from mpvi_bt.ground.words.phrases import Vocabulary, normalize

MOST_ROOMS = 60
MOST_FIXTURES = 40  # kinds of them in one room
LONGEST_NAME = 60  # characters


@dataclass(frozen=True, eq=False)
class PlanningContext:
    """The places and the robot's hands, as navigation, detectors and policies know them.

    Attributes:
        rooms: Name of each room, such as "living_room", to what its fixtures are called, one name a fixture.
        names: What can be driven to: rooms, fixtures, and, where a task is known, its things; key to all their names.
        things: Whether the names of things are among them, so that what nothing is called so is worth a word.
        hands: Such as ("left", "right").
    """

    rooms: Mapping[str, tuple[str, ...]]
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    things: bool = False
    hands: tuple[str, ...] = ("left", "right")

    @cached_property
    def vocabulary(self) -> Vocabulary:
        """The names, by the rule that the knowledge base finds things by."""
        return Vocabulary(self.names)

    @cached_property
    def phrases(self) -> list[str]:
        """Every name of what can be driven to, sorted."""
        return sorted({normalize(phrase) for phrases in self.names.values() for phrase in phrases})

    @cached_property
    def room_names(self) -> list[str]:
        """The names of the rooms as people say them, such as "living room", sorted."""
        return sorted(normalize(room) for room in self.rooms)

    def room_called(self, phrase: str) -> str | None:
        """The room that people call so, by its name; None if none is."""
        return next((normalize(name) for name in self.vocabulary.named(phrase) if name in self.rooms), None)

    def fixtures(self) -> dict[str, list[str]]:
        """Room to its fixtures as a planner is told them, such as "base cabinet (3)"; bounded, whatever the house."""
        told = {}
        for room, called in list(self.rooms.items())[:MOST_ROOMS]:
            counts = Counter(map(_plain, called))
            kinds = [name if n == 1 else f"{name} ({n})" for name, n in list(counts.items())[:MOST_FIXTURES]]
            told[_plain(room).replace("_", " ")] = kinds
        return told


def _plain(name: str) -> str:
    """A name on one line, not too long: names come from files, and are data in a prompt."""
    return " ".join("".join(c if c.isprintable() else " " for c in name[: 2 * LONGEST_NAME]).split())[:LONGEST_NAME]
