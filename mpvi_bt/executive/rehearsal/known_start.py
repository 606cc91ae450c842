"""What is known of the start of a task, which a rehearsal begins with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

Truth = Callable[[str, tuple[str, ...]], bool]  # predicate and things
Noun = Callable[[str], str]  # what a thing is called, without an article


def _no_conditions(truth: Truth, noun: Noun) -> list[str]:
    return []


@dataclass(frozen=True, eq=False)
class KnownStart:
    """Things and facts. Nothing is known by default: then every phrase of a plan means a thing that may be anywhere.

    Attributes:
        called: Each thing to what people call it.
        rooms: Each fixture and floor to its room.
        floors: Which of them are floors.
        adjoining: Pairs of fixtures so close to each other that the robot may reach one from the other.
        facts: What holds: a predicate of goals and its things, such as ("inside", "bottle.n.01_1", "fridge_1").
        openable: What has a door or a lid. It is closed where no fact says that it is open.
        closed_only: What can be turned on only while it is closed.
        heats: Thing to whether it has to be closed to cook what is in or on it, besides being on.
        cools: What freezes what is in it.
        washes: What cleans what is in it.
        later: What does not exist yet, such as dice.
        room: The room of the robot; "" if nobody knows.
        unmet: Given the truth of facts at the end and the nouns of things, what of the goal does not hold, in words.
        hands: The hands of the robot.
        held: What it holds, in hands that nobody knows.
        partial: Whether there may be more than this: other things, in the hands too.
    """

    called: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    rooms: Mapping[str, str] = field(default_factory=dict)
    floors: frozenset[str] = frozenset()
    adjoining: frozenset[tuple[str, str]] = frozenset()
    facts: tuple[tuple[str, tuple[str, ...]], ...] = ()
    openable: frozenset[str] = frozenset()
    closed_only: frozenset[str] = frozenset()
    heats: Mapping[str, bool] = field(default_factory=dict)
    cools: frozenset[str] = frozenset()
    washes: frozenset[str] = frozenset()
    later: frozenset[str] = frozenset()
    room: str = ""
    unmet: Callable[[Truth, Noun], list[str]] = _no_conditions
    hands: tuple[str, ...] = ("left", "right")
    held: tuple[str, ...] = ()
    partial: bool = False
