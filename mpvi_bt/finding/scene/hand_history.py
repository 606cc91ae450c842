"""History of the hands across prompts: their payloads, and the places of things put down."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.hands import Hand
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class PlaceParameters:
    """When a place is one where something was put. Our choice, as odometry drifts from one place to the next."""

    floor_m: float = 0.03  # a thing that begins no higher lies on the floor [m]
    there_m: float = 0.1  # distance between two sightings of one place of a released thing or a filled vessel [m]


_PLACES = PlaceParameters()


@dataclass(eq=False)
class HandHistory:
    """Memory across prompts. Things known only from pictures get new numbers each time. Places are in the world [m].

    Attributes:
        taken: What each hand took under an earlier prompt and holds still: as it is called, and its shape in the frame
            of the tcp.
        laden: What was put into the vessel that a hand holds.
    """

    taken: dict[Hand, tuple[str, Shape]] = field(default_factory=dict)
    laden: dict[Hand, list[str]] = field(default_factory=dict)
    _laid: list[tuple[str, Array]] = field(default_factory=list)  # what was put down, and the box (2, 3) about it
    _filled: list[tuple[str, Array]] = field(default_factory=list)  # likewise into a vessel, and that one's place (2,)

    def empty(self, hand: Hand) -> None:
        """A hand holds nothing any more."""
        self.taken.pop(hand, None)
        self.laden.pop(hand, None)

    def pass_on(self, giver: Hand, taker: Hand) -> None:
        """Pass a payload on from one hand to another, with its contents."""
        if giver in self.laden:
            self.laden[taker] = self.laden.pop(giver)

    def take(self, hand: Hand, phrase: str, middle: Array, vessel: bool) -> None:
        """A hand has taken what had its middle (3,) there."""
        self.take_up(phrase, middle)
        if vessel and (put := self.put_into(middle)):
            self.laden[hand] = put
            self._filled = [(what, at) for what, at in self._filled if not _there(at, middle[:2])]

    def take_up(self, phrase: str, middle: Array) -> None:
        """Forget the thing laid down with its middle (3,) there: it was taken up."""
        self._laid = [laid for laid in self._laid if laid[0] != phrase or not _there(laid[1].mean(0), middle)]

    def put_down(self, hand: Hand, phrase: str, box: Array, dropped: bool) -> None:
        """A hand has let go of a thing that is in a box (2, 3) now; `dropped`: it was to hold it still."""
        self._filled += [(what, box.mean(0)[:2]) for what in self.laden.get(hand, ())]
        if not dropped:
            self._laid.append((phrase, box))

    def fill(self, phrase: str, middle: Array, holder: Hand | None) -> None:
        """Something was put into a vessel with its middle (3,) there, which a hand may hold."""
        if holder is not None:
            self.laden.setdefault(holder, []).append(phrase)
        self._filled.append((phrase, middle[:2]))

    def is_laid(self, phrase: str, middle: Array) -> bool:
        """Whether a thing with this name and its middle (3,) there was put there."""
        return any(called == phrase and _there(box.mean(0), middle) for called, box in self._laid)

    def covered(self, places: Array, radius_m: float) -> NDArray[np.bool_]:
        """(n,) bool: whether discs about places (n, 2) of the floor meet what was put down on it."""
        out = np.zeros(len(places), bool)
        for low, high in (box[:, :2] for _, box in self._laid if box[0, 2] < _PLACES.floor_m):
            off = np.maximum(np.maximum(low - places, places - high), 0)
            out |= norm(off, axis=1) < radius_m
        return out

    def put_into(self, middle: Array) -> list[str]:
        """Things put into the vessel with its middle (3,) there."""
        return [what for what, at in self._filled if _there(at, middle[:2])]


def _there(at: Array, place: Array) -> bool:
    return float(norm(at - place)) < _PLACES.there_m
