"""The store of things that pictures have shown and hands have felt, by name.

A detector's masks carry no names, so things are known by phrase and number, such as "can of soda 1".
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.executive.plan.knowledge import NamedThings
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


class ThingStore(NamedThings[SeenThing]):
    """Things by name, and which of them the hands hold. It decides nothing: others add, replace and drop things.

    Attributes:
        hands: What the hands hold. A thing in a hand moves with it.
    """

    def __init__(self, hands: HandTracker[Shape]) -> None:
        """Begin with no thing."""
        super().__init__()
        self.hands = hands
        self._count: dict[str, int] = {}

    def __getitem__(self, name: str) -> SeenThing:
        """A thing. Raises MotionFailure "lost_sight" if it is not where it was seen any more."""
        if name not in self:
            raise MotionFailure("lost_sight")
        return self.entries[name]

    def new_name(self, phrase: str) -> str:
        """A name for another thing of a phrase."""
        self._count[phrase] = self._count.get(phrase, 0) + 1
        return f"{phrase} {self._count[phrase]}"

    def put_into(self, thing: SeenThing, container: str) -> None:
        """Put a thing into a container. Its shape is known where it is now; it moves along with the container."""
        thing.inside = container
        if (hand := self.hands.holder(container)) is not None:
            self.hands.load(hand, thing.name, thing.shape)

    def shape(self, name: str) -> Shape:
        """The shape of a thing, where it is now."""
        thing, carried = self[name], self.hands.carried(name)
        return thing.shape if carried is None else carried

    def is_carried(self, thing: SeenThing) -> bool:
        """Whether a hand holds a thing, or the container that it is in."""
        held = self.hands.names()
        return thing.name in held or thing.inside in held
