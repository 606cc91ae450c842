"""Blades in a world: what one presses on falls into halves, and halves into dice, where they stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import sapien

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rays import within
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.house.rules.cutting import Slicer, cut, rearmed
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.presence import Presence
from mpvi_bt.house.sim.shaders import PHYSICS_HZ
from mpvi_bt.house.things.catalogue import CatalogueEntry

PUSH_N = 1.0  # Our choice: a knife that lies beside a thing does not cut it (OmniGibson's does at a touch)
_BLADE_M = 0.004  # a contact so near to a blade is on it
_CONTACT_M = 0.02  # physics tells contacts from a smaller distance
_TURNED = pose((0.0, 0.0, 0.0), np.pi)


class Blades:
    """What blades do to the things of a world."""

    def __init__(
        self,
        scene: sapien.Scene,
        presence: Presence,
        entries: Mapping[str, CatalogueEntry],
        became: Callable[[str, str], None],
    ) -> None:
        """Every blade is sharp.

        Args:
            scene: Whose contacts are looked at.
            presence: What is there.
            entries: Of all movable things, those too that may come to be.
            became: Is told the name of a thing and of what has come of it.
        """
        self._scene, self._presence, self._became = scene, presence, became
        self._entries = entries
        self._kinds = {name: entry.cut for name, entry in entries.items() if entry.cut is not None}
        self._blades = {
            name: blades for name, entry in entries.items() if (blades := entry.description.root.blades) and self._kinds
        }
        self._slicers = {name: Slicer() for name in self._blades}
        boxes = {name: np.abs(entries[name].description.extent()).max(0) for name in self._kinds}
        self._reach_m = {name: float(norm(corner)) for name, corner in boxes.items()}  # from its origin

    def step(self, dt_s: float) -> None:
        """One control step later."""
        there = self._presence.there
        for name in self._blades:
            if name not in there:
                continue
            touched = self._touched(there[name])
            slicer = self._slicers[name]
            for other in touched:
                self._cut(other, cut(slicer, self._kinds[other]))
            sliceable = any(self._kinds[other].half is not None for other in touched)
            self._slicers[name] = rearmed(slicer, sliceable, dt_s)

    def save(self) -> dict[str, Any]:
        """As JSON values; empty where nothing cuts."""
        return {name: [slicer.active, slicer.untouched_s] for name, slicer in self._slicers.items()}

    def restore(self, saved: Mapping[str, Sequence[Any]]) -> None:
        """Have every blade be as sharp as it was."""
        self._slicers = {name: Slicer(*saved[name]) if name in saved else Slicer() for name in self._blades}

    def _touched(self, tool: Thing) -> list[str]:
        """What can be cut and the blade of a tool presses on, by the contacts of the last physics step."""
        there = self._presence.there
        names = [name for name in self._kinds if name in there]
        # What sleeps has pressed before it fell asleep, and physics tells its contacts of then.
        if not names or tool.root_body.is_sleeping:
            return []
        blades = [_grown(blade.moved(tool.T_world_body())) for blade in self._blades[tool.name]]
        origins = np.array([there[name].entity.pose.p for name in names], float)
        reach = np.array([self._reach_m[name] for name in names]) + _CONTACT_M
        gaps = norm(origins[:, None] - [blade.T[:3, 3] for blade in blades], axis=-1) - [norm(b.half_m) for b in blades]
        near = {there[names[i]].entity: names[i] for i in np.flatnonzero(gaps.min(-1) < reach)}
        if not near:
            return []
        found, own = set[str](), tool.entity  # a pair of solids has a contact, and a thing may have several
        for contact in self._scene.get_contacts():
            a, b = (body.entity for body in contact.bodies)
            other = near.get(b if a == own else a) if own in (a, b) else None
            if other is None:
                continue
            on_blade = [p for p in contact.points if any(within(blade, np.asarray(p.position)) for blade in blades)]
            impulse = sum((np.asarray(p.impulse, float) for p in on_blade), np.zeros(3))  # of one step of physics [Ns]
            push_n = float(norm(impulse)) * PHYSICS_HZ
            if push_n > PUSH_N:
                found.add(other)
        return sorted(found)

    def _cut(self, name: str, how: str | None) -> None:
        """Replace a thing by its halves or dice, which move like it."""
        kind, entry, thing = self._kinds[name], self._entries[name], self._presence.there[name]
        into = kind.half if how == "halves" else kind.diced if how == "dice" else None
        if into is None or not self._presence.waits(into):
            return
        T, motion = thing.T_world_body(), thing.motion()
        size = entry_size(self._next(into))
        self._presence.vanish(name)
        for place in halves(size) if how == "halves" else dice(entry_size(entry), size, kind.dice):
            if (made := self._presence.appear(into, matmul(T, place), motion)) is not None:
                self._became(name, made)

    def _next(self, kind: str) -> CatalogueEntry:
        return next(entry for entry in self._entries.values() if entry.name == kind)


def entry_size(entry: CatalogueEntry) -> Array:
    """(3,) what a thing measures along its axes [m]."""
    low, high = entry.description.extent()
    return np.asarray(high - low)


def halves(half_m: Array) -> list[Array]:
    """(4, 4) the frames of two halves in that of the whole, cut through its middle across y.

    The catalogue has the half that lies on the side of positive y, its cut facing the other one.
    """
    aside = pose((0.0, float(half_m[1]) / 2, 0.0))
    return [aside, matmul(_TURNED, aside)]


def dice(size_m: Array, die_m: Array, count: int) -> list[Array]:
    """(4, 4) the frames of dice in that of what they are of: in a row along its longer side, on its underside."""
    along = int(np.argmax(size_m[:2]))
    places = np.zeros((count, 3))
    places[:, along] = (np.arange(count) - (count - 1) / 2) * die_m[along]
    return [pose((float(x), float(y), float(z))) for x, y, z in places]


def _grown(blade: Solid) -> Solid:
    return Solid(blade.kind, blade.half_m + _BLADE_M, blade.T)
