"""Recipes in a world: what has all on it that belongs there becomes another thing in an oven that is on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from mpvi_bt.house.goals.predicates import covered, ontop
from mpvi_bt.house.goals.world_state import WorldState
from mpvi_bt.house.rules.recipes import Recipe, baked
from mpvi_bt.house.sim.presence import Presence
from mpvi_bt.house.things.catalogue import CatalogueEntry

_LOOKS_STEPS = 30  # control steps between two looks at what lies on a thing


class Baking:
    """What an oven makes of things that have a recipe."""

    def __init__(
        self,
        presence: Presence,
        entries: Mapping[str, CatalogueEntry],
        in_oven: Callable[[str], bool],
        became: Callable[[str, str], None],
    ) -> None:
        """Nothing is baked yet.

        Args:
            presence: What is there.
            entries: Of all movable things, those too that may come to be.
            in_oven: Whether an oven that is on acts on a thing.
            became: Is told the name of a thing and of what has come of it.
        """
        self._presence, self._in_oven, self._became = presence, in_oven, became
        self._recipes = {name: entry.bakes for name, entry in entries.items() if entry.bakes is not None}
        self._kinds: dict[str, list[str]] = {}
        for name, entry in entries.items() if self._recipes else ():
            self._kinds.setdefault(entry.synset, []).append(name)
        self._looked = 0

    def step(self, state: WorldState) -> None:
        """One control step later."""
        self._looked = (self._looked + 1) % _LOOKS_STEPS
        if self._looked:
            return
        for name, recipe in self._recipes.items():
            if state.exists(name) and self._in_oven(name) and self._presence.waits(recipe.into):
                self._look(state, name, recipe)

    def _look(self, state: WorldState, name: str, recipe: Recipe) -> None:
        """Bake what is complete; what covers and tops it is used up."""
        grains = {kind for kind in recipe.covered_by if covered(state, name, f"{kind}_1")}
        toppings = {
            kind: [one for one in self._there(state, kind) if ontop(state, one, name)] for kind in recipe.topped_with
        }
        below = (recipe.on,) if recipe.on is not None else ()
        on = {kind for kind in below if any(ontop(state, name, one) for one in self._there(state, kind))}
        if baked(recipe, grains, {kind: len(there) for kind, there in toppings.items()}, on):
            used = [one for kind in recipe.covered_by for one in state.grains(kind) if state.touching(name, one)]
            used += [one for there in toppings.values() for one in there]
            self._bake(name, recipe.into, used)

    def _there(self, state: WorldState, kind: str) -> list[str]:
        return [name for name in self._kinds.get(kind, ()) if state.exists(name)]

    def _bake(self, name: str, into: str, used: Iterable[str]) -> None:
        thing = self._presence.there[name]
        T, motion = thing.T_world_body(), thing.motion()
        for one in (name, *used):
            self._presence.vanish(one)
        if (made := self._presence.appear(into, T, motion)) is not None:
            self._became(name, made)
