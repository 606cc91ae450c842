"""Payloads in a knowledge base, by touch: they move with the hands, and stay at the place of release."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase, laid_down
from mpvi_bt.finding.scene.hands import HANDS, TOUCH, Carried, Grip, Hand, HandTracker, falls_into
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception

PUT = 0.6  # our choice: what was let go is believed to be where it was, until it is seen: not more than so


@dataclass(frozen=True, eq=False)
class BoxAbout:
    """The box about a thing.

    Attributes:
        corners: (2, 3) lowest and highest corner in the world [m].
    """

    corners: Array

    def moved(self, M: Array) -> BoxAbout:
        """The axis-aligned box about it, carried along by the motion `M` (4, 4)."""
        center, half = self.corners.mean(0), (self.corners[1] - self.corners[0]) / 2
        center, half = matmul(M[:3, :3], center) + M[:3, 3], matmul(np.abs(M[:3, :3]), half)
        return BoxAbout(np.stack([center - half, center + half]))


class Carrying:
    """Follows what is held through a knowledge base, told by proprioception alone."""

    def __init__(self, knowledge: KnowledgeBase) -> None:
        """Hold nothing."""
        self._knowledge = knowledge
        self._hands = HandTracker[BoxAbout]()
        self._took: dict[Hand, Array] = {}  # where (3,) hands took what nobody knows,
        self._left: list[Array] = []  # and where they left it, elsewhere

    def feel(self, body: Proprioception) -> tuple[list[str], list[Array]]:
        """Take in one step of proprioception.

        Returns:
            The names of what was let go, and of what was taken, if that is known, the box (2, 3) about it.
        """
        let_go, taken = list[str](), list[Array]()
        for hand, holds in self._hands.feel(body):
            if not holds:
                let_go += self._release(hand, body)
            elif (name := self._take(hand, self._knowledge)) is not None:
                taken.append(self._hands.grips[hand].loads[name].body.corners)
        self.move(body)
        return let_go, taken

    def move(self, body: Proprioception) -> None:
        """Move the payloads along with the hands."""
        self._hands.be(body)
        for entry in self._knowledge:
            if entry.held and (box := self._hands.carried(entry.name)) is not None:
                entry.lowest, entry.highest = box.corners

    def adopt(self, entries: Iterable[Entry]) -> None:
        """Look for unknown payloads among new things, and mark new things at a place of release as laid down."""
        found = list(entries)
        for hand in [hand for hand, grip in self._hands.grips.items() if grip.name is None]:
            self._take(hand, found)
        for entry in found:
            gaps = [np.abs(p - np.clip(p, entry.lowest, entry.highest))[:2].max() for p in self._left]
            if entry.kind == "object" and not entry.held and min(gaps, default=np.inf) < TOUCH.grasped_m:
                entry.laid = True

    def sort(self) -> None:
        """Find the container of each thing that is not held: the smallest movable thing around its middle."""
        things = [entry for entry in self._knowledge if entry.kind == "object"]
        if not things:
            return
        lows, highs = (np.stack([getattr(e, corner) for e in things]) for corner in ("lowest", "highest"))
        centers, floors = (lows + highs) / 2, np.prod(highs - lows, axis=1, where=[True, True, False])
        within = ((centers[:, None] >= lows) & (centers[:, None] <= highs)).all(-1)
        within &= floors > TOUCH.outer * floors[:, None]
        nearest = np.where(within, floors, np.inf).argmin(1)
        for i, entry in enumerate(things):
            if not entry.held:
                entry.inside = None
                if within[i].any():
                    self._put_in(entry, things[nearest[i]])

    def _put_in(self, entry: Entry, container: Entry) -> None:
        """Know a thing to be in a container, and carried along with it from now on if that is held."""
        entry.inside = container.name
        if (hand := self._hands.holder(container.name)) is not None:
            self._load(hand, entry)

    # ------------------------------------------------------------------------------------------ hands

    def _take(self, hand: Hand, among: Iterable[Entry]) -> str | None:
        """A hand has begun to hold something: the nearest thing, if one is known near it. Returns that one's name."""
        points = self._hands.tcps(hand)[:, :3, 3]
        near = []
        for entry in among:
            if entry.kind == "object":
                gap = float(norm(points - np.clip(points, entry.lowest, entry.highest), axis=1).max())
                if gap < TOUCH.reach_m(hand):  # of things in one another the one whose middle is near, too
                    near.append((gap + float(norm(points.mean(0) - entry.center)) / 2, entry.name))
        name = min(near)[1] if near else None
        self._hands.take(hand, name)
        if name is None:
            self._took.setdefault(hand, points.mean(0))
            return None
        self._took.pop(hand, None)
        self._knowledge.entries[name].inside = None
        for one in self._with_contents(name):
            self._load(hand, one)
        return name

    def _load(self, hand: Hand, entry: Entry) -> None:
        """Know a thing to be carried from now on, with what the hand holds."""
        entry.held = True
        self._hands.load(hand, entry.name, BoxAbout(np.stack([entry.lowest, entry.highest])))

    def _release(self, hand: Hand, body: Proprioception) -> list[str]:
        """Mark a hand as empty after it let go or lost its payload. Returns the names of things no longer held."""
        self.move(body)
        left = self._hands.tcps(hand)[:, :3, 3].mean(0)
        grip = self._hands.release(hand)
        if (took := self._took.pop(hand, None)) is not None:
            self._left += [left] if laid_down(took, left, left, by_hand=True) else []
        if grip.name not in self._knowledge.entries or self._hands.holder(grip.name) is not None:
            return []
        entry = self._knowledge.entries[grip.name]
        carried = self._with_contents(grip.name)
        for one in carried:
            one.held, one.confidence = False, min(one.confidence, PUT)
        taken_at = grip.loads[grip.name].body.corners.mean(0)
        entry.laid = laid_down(taken_at, entry.lowest, entry.highest, by_hand=True)
        self._fall(entry)
        if (into := self._knowledge.entries.get(entry.inside or "")) is not None:
            off = (taken_at < into.lowest) | (taken_at > into.highest)
            entry.laid |= bool(off[:2].any())  # however near: it was not taken out of that
        return [one.name for one in carried]

    def _fall(self, entry: Entry) -> None:
        """Put what was let go over a container into it.

        Our choice: a movable thing that covers more floor and is half as high counts as one. What is let go over its
        rim comes to lie within it; how deep shows when it is seen.
        """
        height = float(np.ptp([entry.lowest[2], entry.highest[2]]))
        containers = [
            c
            for c in self._knowledge
            if c.kind == "object" and c is not entry and c.inside != entry.name
            and _floor(c) > TOUCH.outer * _floor(entry) and c.highest[2] - c.lowest[2] > height / 2
        ]  # fmt: skip
        if (k := falls_into(entry.center, [np.stack([c.lowest, c.highest]) for c in containers])) is None:
            return
        container = containers[k]
        drop = np.array([0.0, 0.0, max(float(entry.highest[2] - container.highest[2]), 0.0)])
        for one in self._with_contents(entry.name):
            one.lowest, one.highest = one.lowest - drop, one.highest - drop
        self._put_in(entry, container)

    def _with_contents(self, name: str) -> list[Entry]:
        """An entry, if it is still known, and what is in it."""
        return [e for e in self._knowledge if name in (e.name, e.inside)]

    # ------------------------------------------------------------------------------------------ saving

    def save(self) -> dict[str, Any]:
        """How the hands are, as JSON values."""
        return {
            "width": dict(self._hands.width),
            "steady": dict(self._hands.steady),
            "took": {hand: place.tolist() for hand, place in self._took.items()},
            "left": [place.tolist() for place in self._left],
            "grips": {
                hand: None if grip.name is None else {
                    "name": grip.name,
                    "loads": {
                        n: {"box": a.body.corners.tolist(), "T": a.T_tcp_world.tolist()} for n, a in grip.loads.items()
                    },
                }
                for hand, grip in self._hands.grips.items()
            },
        }  # fmt: skip

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Bring the hands to what was saved.

        Raises:
            KeyError, TypeError, ValueError: What was saved is not as `save` writes it.
        """
        hands = HandTracker[BoxAbout]()
        for hand, grip in saved["grips"].items():
            if hand not in HANDS:
                raise ValueError(f"there is no hand {hand!r:.40}")
            name, loads = (None, {}) if grip is None else (str(grip["name"]), grip["loads"])
            hands.grips[hand] = Grip(name, {str(n): _carried(load) for n, load in loads.items()})
        hands.width = {side: float(saved["width"][side]) for side in SIDES if side in saved["width"]}
        hands.steady = {side: int(saved["steady"][side]) for side in SIDES if side in saved["steady"]}
        self._took = {cast("Hand", hand): _array(place, (3,)) for hand, place in saved["took"].items()}
        self._left = [_array(place, (3,)) for place in saved["left"]]
        self._hands = hands


def _floor(entry: Entry) -> float:
    """The floor that a thing covers [m^2]."""
    return float(np.prod((entry.highest - entry.lowest)[:2]))


def _carried(given: Mapping[str, Any]) -> Carried[BoxAbout]:
    return Carried(BoxAbout(_array(given["box"], (2, 3))), _array(given["T"], (4, 4)))


def _array(given: Any, shape: tuple[int, ...]) -> Array:
    array = np.array(given, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{shape} finite numbers are due, not {given!r:.60}")
    return array
