"""Grains: diced food, popcorn or the like, many small bodies that vessels hold; hot vessels cook them.

Source: OmniGibson, object_states/contains.py, filled.py, transition_rules.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.rays import distance
from mpvi_bt.ground.geometry.solids import Solid
from mpvi_bt.house.states.heat import heated
from mpvi_bt.house.states.in_world import Coming, FormLike
from mpvi_bt.house.states.temperature import Thermal
from mpvi_bt.house.states.world_state import WorldState

SUBSTANCE = "macroPhysicalSubstance"  # the ability of what is grains: diced food, popcorn
FILLED = 0.2  # of a vessel's volume
_LOOKS_STEPS = 5  # control steps between two looks, as of temperatures
_NEAR_M = 0.4  # from a vessel's origin to whatever is in it, at the most


def contains(grains: int) -> bool:
    """Whether a vessel holds any of a kind: one of so many grains is enough."""
    return grains > 0


def filled(grains_m3: float, volume_m3: float) -> bool:
    """Whether a vessel of a volume is filled with a kind; each grain counts as the cube about it."""
    return grains_m3 > FILLED * volume_m3


def space_m3(solids: Iterable[Solid]) -> float:
    """What solids take up [m^3], such as those of a grain or the volumes of a vessel; a sphere as the cube about it."""
    return sum(float(np.prod(2 * s.half_m)) * (np.pi / 4 if s.kind == "cylinder" else 1.0) for s in solids)


class _CookKind(Protocol):
    """An entry of the catalogue."""

    @property
    def abilities(self) -> tuple[str, ...]:
        """Such as that of a substance."""
        ...

    @property
    def heat(self) -> Thermal | None:
        """What heat does to it."""
        ...

    @property
    def cooks_to(self) -> str | None:
        """The entry that it becomes in a hot vessel."""
        ...

    @property
    def description(self) -> FormLike:
        """What it is made of."""
        ...


class Cooking:
    """What hot vessels do to the grains in them: these are cooked at once, whatever their own temperature.

    A kernel itself would have to come to 93 degrees, which a microwave never does (OmniGibson, transition_rules.py).
    """

    def __init__(self, presence: Coming, entries: Mapping[str, _CookKind], became: Callable[[str, str], None]) -> None:
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
            if state.exists(vessel) and heated(*state.heat(vessel)):
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
