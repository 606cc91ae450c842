"""Places of all things, by the simulator: the answers of the `oracle` detector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase, laid_down
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.layout.prior_map import knowledge, prior_map
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.holding import Holding


class Whereabouts:
    """Rooms and fixtures, as they are known beforehand, and movable things, as they stand now."""

    def __init__(
        self,
        house: House,
        fixtures: Mapping[str, Thing],
        objects: Mapping[str, Thing],
        phrases: Mapping[str, tuple[str, ...]],
        holding: Holding,
    ) -> None:
        """Nothing has been carried yet.

        Args:
            house: Its rooms and fixtures.
            fixtures: Those that stand in the scene, by name.
            objects: Movable things, by name.
            phrases: What each of these is called.
            holding: What is carried, and what is in what.
        """
        self._fixtures, self._objects, self._phrases, self._holding = fixtures, objects, phrases, holding
        self._prior, self._map = knowledge(house), prior_map(house)
        self._told: tuple[int, KnowledgeBase] | None = None
        self._stood: dict[str, Array] = {}  # the middle (3,) of what no hand had, at the last look at it
        self._taken_at: dict[str, Array] = {}  # the same of what a hand took, before it did
        self._had: set[str] = set()  # what a hand has had since
        self.patches: dict[str, Thing] = {}  # of marks on floors, by name

    def forget(self) -> None:
        """Look anew when asked again: something was moved between two steps."""
        self._told = None

    def save(self) -> dict[str, Any]:
        """Last places and pick-up places of things, x, y, z [m], and things that may still be carried."""
        stood, taken = ({name: at.tolist() for name, at in of.items()} for of in (self._stood, self._taken_at))
        return {"stood": stood, "taken_at": taken, "had": sorted(self._had)}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` told."""
        self._stood, self._taken_at = (
            {name: np.array(at) for name, at in saved.get(key, {}).items()} for key in ("stood", "taken_at")
        )
        self._had = set(saved.get("had", ()))
        self.forget()

    def at(self, step: int) -> KnowledgeBase:
        """Places of all things now; `step` is the current control step."""
        if self._told is None or self._told[0] != step:
            self._told = (step, self._look())
        return self._told[1]

    def _look(self) -> KnowledgeBase:
        base = KnowledgeBase({e.name: self._now(e) for e in self._prior})
        containers = {c: set(self._holding.within(c)) for c, thing in self._objects.items() if thing.volumes()}
        hands = (*map(self._holding.in_hand, SIDES), self._holding.between())
        carried = {name for name in hands if name is not None}
        for name, thing in self._objects.items():
            low, high = bounds(thing.solids())
            inside = next((c for c, names in containers.items() if name in names), None)
            if name in carried:
                self._taken_at.setdefault(name, self._stood.get(name, (low + high) / 2))
                self._had.add(name)
            else:
                stood = self._stood.get(name)
                if name in self._had and stood is not None and laid_down(stood, low, high):
                    self._taken_at[name] = stood  # a hand on a jar's lid does not take the jar from where it was laid
                self._had.discard(name)
                self._stood[name] = (low + high) / 2
            taken_at = self._taken_at.get(name)
            laid = taken_at is not None and name not in carried and laid_down(taken_at, low, high)
            if taken_at is not None and inside is not None and name not in carried:
                into = bounds(self._objects[inside].solids())[:, :2]  # however near: it was not taken out of that
                laid |= bool(((taken_at[:2] < into[0]) | (taken_at[:2] > into[1])).any())
            base.put(
                Entry(
                    name=name, phrases=self._phrases[name], kind="object", lowest=low, highest=high,
                    room=self._map.room_at((low + high)[:2] / 2), source="oracle",
                    held=name in carried or inside in carried, inside=inside, laid=laid,
                )
            )  # fmt: skip
        for name, patch in self.patches.items():
            low, high = bounds(patch.solids())
            words = (patch.synset.partition(".")[0],)
            room = self._map.room_at((low + high)[:2] / 2)
            base.put(Entry(name, words, "object", low, high, room, source="oracle"))
        return base

    def _now(self, known: Entry) -> Entry:
        """The entry of a room or fixture, at its current place if it can be moved."""
        if known.name not in self._fixtures or not self._fixtures[known.name].movable:
            return known
        low, high = bounds(self._fixtures[known.name].solids())
        return replace(known, lowest=low, highest=high)
