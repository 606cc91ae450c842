"""Grains in the hot vessels of a world: popcorn that pops in its bag, diced food that cooks in a pan."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.house.goals.predicates import hot
from mpvi_bt.house.goals.world_state import WorldState
from mpvi_bt.house.sim.holding import distance
from mpvi_bt.house.sim.presence import Presence
from mpvi_bt.house.things.catalogue import SUBSTANCE, CatalogueEntry

_LOOKS_STEPS = 5  # control steps between two looks, as of temperatures
_NEAR_M = 0.4  # from a vessel's origin to whatever is in it, at the most


class Cooking:
    """What hot vessels do to the grains in them: these are cooked at once, whatever their own temperature.

    A kernel itself would have to come to 93 degrees, which a microwave never does (OmniGibson, transition_rules.py).
    """

    def __init__(
        self, presence: Presence, entries: Mapping[str, CatalogueEntry], became: Callable[[str, str], None]
    ) -> None:
        """Nothing is cooked yet.

        Args:
            presence: What is there.
            entries: Of all movable things, those too that may come to be.
            became: Is told the name of a thing and of what has come of it.
        """
        self._presence, self._became = presence, became
        self._raw = {n: e.cooks_to for n, e in entries.items() if e.cooks_to is not None and SUBSTANCE in e.abilities}
        heated = {n: e for n, e in entries.items() if e.heat is not None and self._raw}
        self._vessels = [n for n, e in heated.items() if e.description.root.volumes]
        self._looked = 0

    def step(self, state: WorldState) -> None:
        """One control step later."""
        self._looked = (self._looked + 1) % _LOOKS_STEPS
        if self._looked or not self._raw:
            return
        for vessel in self._vessels:
            if state.exists(vessel) and hot(state, vessel):
                for grain in self._within(vessel):
                    self._cook(grain)

    def _within(self, vessel: str) -> list[str]:
        """Raw grains whose middle is in a vessel."""
        there = self._presence.there
        at, volumes = there[vessel].T_world_body()[:3, 3], there[vessel].volumes()
        found = []
        for name in self._raw:
            if name in there and norm(there[name].T_world_body()[:3, 3] - at) < _NEAR_M:
                solid = there[name].solids()[0]
                if any(distance(volume, solid.T[:3, 3]) <= 0 for volume in volumes):
                    found.append(name)
        return found

    def _cook(self, name: str) -> None:
        """Have a grain be replaced by a cooked one that stands and moves like it."""
        into, thing = self._raw[name], self._presence.there[name]
        if not self._presence.waits(into):
            return
        T, motion = thing.T_world_body(), thing.motion()
        self._presence.vanish(name)
        if (made := self._presence.appear(into, T, motion)) is not None:
            self._became(name, made)
