"""The store of things: what pictures have shown and hands have felt, by name.

A detector's masks carry no names, so things are known by phrase and number, such as "can of soda 1".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.finding.scene.hands import HandTracker
from mpvi_bt.finding.scene.several_views import View
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.robot.motion import MotionFailure


@dataclass(eq=False)
class SeenThing:
    """One thing that was seen.

    Attributes:
        name, phrase: "can of soda 1", "can of soda".
        shape: What it is taken to be, where it was seen or put last.
        views: Frames that show it, with its mask, newest last.
        inner: Those that showed the room in it last: from elsewhere only a door of furniture, or a side, is in view.
        inside: The container that it is in.
        stands: It was set down in there, and did not fall.
        lowest_m: How far down furniture was ever seen: from near its foot is out of view.
    """

    name: str
    phrase: str
    shape: Shape
    views: list[View] = field(default_factory=list)
    inner: list[View] = field(default_factory=list)
    inside: str | None = None
    stands: bool = False
    lowest_m: float = np.inf


class ThingStore:
    """Things by name, and which of them the hands hold. It decides nothing: others add, replace and drop things.

    Attributes:
        hands: What the hands hold. A thing in a hand moves with it.
    """

    def __init__(self, hands: HandTracker[Shape]) -> None:
        """Begin with no thing."""
        self.hands = hands
        self._things: dict[str, SeenThing] = {}
        self._count: dict[str, int] = {}

    def __iter__(self) -> Iterator[SeenThing]:
        """The things, those that were found first in front."""
        return iter(self._things.values())

    def __contains__(self, name: object) -> bool:
        return name in self._things

    def __getitem__(self, name: str) -> SeenThing:
        """A thing. Raises MotionFailure "lost_sight" if it is not where it was seen any more."""
        if name not in self._things:
            raise MotionFailure("lost_sight")
        return self._things[name]

    def new_name(self, phrase: str) -> str:
        """A name for another thing of a phrase."""
        self._count[phrase] = self._count.get(phrase, 0) + 1
        return f"{phrase} {self._count[phrase]}"

    def put(self, thing: SeenThing) -> None:
        """Add or replace a thing."""
        self._things[thing.name] = thing

    def drop(self, name: str) -> None:
        """Forget a thing."""
        del self._things[name]

    def put_into(self, thing: SeenThing, container: str) -> None:
        """A thing, whose shape is known where it is now, is in a container, and goes along with it from now on."""
        thing.inside = container
        if (hand := self.hands.holder(container)) is not None:
            self.hands.load(hand, thing.name, thing.shape)

    def shape(self, name: str) -> Shape:
        """The shape of a thing, where it is now."""
        thing, carried = self[name], self.hands.carried(name)
        return thing.shape if carried is None else carried

    def within(self, name: str) -> list[str]:
        """The things that are in a container: they were let go of over it, or are seen in it."""
        return [thing.name for thing in self if thing.inside == name]

    def is_carried(self, thing: SeenThing) -> bool:
        """Whether a hand holds a thing, or the container that it is in."""
        held = self.hands.names()
        return thing.name in held or thing.inside in held
