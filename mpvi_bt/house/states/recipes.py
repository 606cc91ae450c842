"""Recipes: an oven turns a thing and all its ingredients into another thing, such as dough into a pizza.

Source: OmniGibson, transition_rules.py; the recipes themselves are of the catalogue, after those of BEHAVIOR's tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Set
from typing import Annotated, Protocol

from pydantic import Field

from mpvi_bt.ground.marked_yaml import Record, Synset
from mpvi_bt.house.states.in_world import Coming
from mpvi_bt.house.states.relations import covered, ontop
from mpvi_bt.house.states.world_state import WorldState

_LOOKS_STEPS = 30  # control steps between two looks at what lies on a thing


class Recipe(Record):
    """Ingredients and result of baking in a running oven, at any temperature.

    Attributes:
        into: Name of the catalogue's entry that it becomes.
        covered_by: Synsets of the grains that have to cover it.
        topped_with: How many of each synset have to lie on it.
        on: Synset of what it has to lie on; None: anything.
    """

    into: str
    covered_by: tuple[Synset, ...] = ()
    topped_with: dict[Synset, Annotated[int, Field(ge=1, le=12)]] = {}
    on: Synset | None = None


def baked(recipe: Recipe, covered_by: Set[str], topped_with: Mapping[str, int], on: Set[str]) -> bool:
    """Whether a thing in a running oven fulfills its recipe, by the synsets of the things on it and under it."""
    topped = all(topped_with.get(kind, 0) >= number for kind, number in recipe.topped_with.items())
    return set(recipe.covered_by) <= covered_by and topped and (recipe.on is None or recipe.on in on)


class _BakeKind(Protocol):
    """An entry of the catalogue."""

    @property
    def synset(self) -> str:
        """What it is."""
        ...

    @property
    def bakes(self) -> Recipe | None:
        """What an oven makes of it."""
        ...


class Baking:
    """Baking of things with a recipe."""

    def __init__(
        self,
        presence: Coming,
        entries: Mapping[str, _BakeKind],
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
        """Bake the thing if its recipe is complete. The things that cover and top it are used up."""
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
