"""Pizza in a world: dough with all that belongs on it becomes one in an oven that is on."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpvi_bt.goals.predicates import covered, ontop
from mpvi_bt.goals.world_state import WorldState
from mpvi_bt.rules.recipes import DICED_ONION, GRATED_CHEESE, Pizza, baked
from mpvi_bt.sim.presence import Presence
from mpvi_bt.things.catalogue import Entry

_LOOKS_STEPS = 30  # control steps between two looks at what lies on the dough
_PEPPERONI, _HALF_MUSHROOM, _SHEET = "pepperoni.n.01", "half__mushroom.n.01", "cookie_sheet.n.01"


class Baking:
    """What an oven makes of dough."""

    def __init__(
        self,
        presence: Presence,
        entries: Mapping[str, Entry],
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
        self._dough = {name: entry.bakes_to for name, entry in entries.items() if entry.bakes_to is not None}
        self._kinds: dict[str, list[str]] = {}
        for name, entry in entries.items() if self._dough else ():
            self._kinds.setdefault(entry.synset, []).append(name)
        self._looked = 0

    def step(self, state: WorldState) -> None:
        """One control step later."""
        self._looked = (self._looked + 1) % _LOOKS_STEPS
        if self._looked:
            return
        for name, into in self._dough.items():
            if state.exists(name) and self._in_oven(name) and self._presence.waits(into):
                on_it = {kind: self._on(state, kind, name) for kind in (_PEPPERONI, _HALF_MUSHROOM)}
                grains = [kind for kind in (GRATED_CHEESE, DICED_ONION) if covered(state, name, f"{kind}_1")]
                sheet = any(state.exists(sheet) and ontop(state, name, sheet) for sheet in self._kinds.get(_SHEET, ()))
                pizza = Pizza(
                    frozenset(grains), len(on_it[_PEPPERONI]), len(on_it[_HALF_MUSHROOM]), sheet, oven_on=True
                )
                if baked(pizza):
                    toppings = [grain for kind in grains for grain in state.grains(kind) if state.touching(name, grain)]
                    self._bake(name, into, [*toppings, *on_it[_PEPPERONI], *on_it[_HALF_MUSHROOM]])

    def _on(self, state: WorldState, kind: str, name: str) -> list[str]:
        return [thing for thing in self._kinds.get(kind, ()) if state.exists(thing) and ontop(state, thing, name)]

    def _bake(self, name: str, into: str, toppings: list[str]) -> None:
        thing = self._presence.there[name]
        T, motion = thing.T_world_body(), thing.motion()
        for used in (name, *toppings):
            self._presence.vanish(used)
        if (made := self._presence.appear(into, T, motion)) is not None:
            self._became(name, made)
