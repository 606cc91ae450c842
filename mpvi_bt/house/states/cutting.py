"""Cutting: the touch of an active slicer makes halves of whole things, and dice of diceable things.

Source: OmniGibson, object_states/slicer_active.py, transition_rules.py (SlicingRule, DicingRule).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rays import within
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.marked_yaml import Record
from mpvi_bt.house.states.in_world import Coming, FormLike, Touches

REARMED_S = 2.0  # so long after it last touched what can be sliced a slicer is active again
PUSH_N = 1.0  # Our choice: a knife that lies beside a thing does not cut it (OmniGibson's does at a touch)
_BLADE_M = 0.004  # a contact so near to a blade is on it
_CONTACT_M = 0.02  # physics tells contacts from a smaller distance
_TURNED = pose((0.0, 0.0, 0.0), np.pi)

Cut = Literal["halves", "dice"]


@dataclass(frozen=True)
class Slicer:
    """A blade.

    Attributes:
        active: Whether it cuts.
        untouched_s: How long it has touched nothing that can be sliced.
    """

    active: bool = True
    untouched_s: float = 0.0


class Cuttable(Record):
    """What cutting does to a kind of thing: whole vegetables become halves, halves become dice; none does both.

    Attributes:
        half: The catalogue's entry of its two halves, or None.
        diced: The entry of its dice, or None.
        dice: How many dice it becomes.
    """

    half: str | None = None
    diced: str | None = None
    dice: Annotated[int, Field(ge=1, le=12)] = 2


def cut(slicer: Slicer, kind: Cuttable) -> Cut | None:
    """Result of a slicer's touch on a thing now."""
    if not slicer.active:
        return None
    return "halves" if kind.half is not None else "dice" if kind.diced is not None else None


def rearmed(slicer: Slicer, touches_sliceable: bool, dt_s: float) -> Slicer:
    """The slicer a step later: off once it has touched what can be sliced, on again after 2 s without such a touch."""
    if touches_sliceable:
        return Slicer(active=False)
    if slicer.active:
        return slicer
    untouched = slicer.untouched_s + dt_s
    return Slicer(active=untouched >= REARMED_S - 1e-9, untouched_s=untouched)


class _CutKind(Protocol):
    """An entry of the catalogue."""

    @property
    def name(self) -> str:
        """Of the entry."""
        ...

    @property
    def cut(self) -> Cuttable | None:
        """What cutting does to it."""
        ...

    @property
    def description(self) -> FormLike:
        """What it is made of."""
        ...


class Blades:
    """What blades do to the things of a world."""

    def __init__(
        self,
        touches: Touches,
        physics_hz: int,
        presence: Coming,
        entries: Mapping[str, _CutKind],
        became: Callable[[str, str], None],
    ) -> None:
        """Every blade is sharp.

        Args:
            touches: Tells where a blade touches things, and how hard.
            physics_hz: Steps of physics a second.
            presence: What is there.
            entries: Of all movable things, those too that may come to be.
            became: Is told the name of a thing and of what has come of it.
        """
        self._touches, self._hz, self._presence, self._became = touches, physics_hz, presence, became
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
            touched = self._touched(name)
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

    def _touched(self, blade_of: str) -> list[str]:
        """What can be cut and the blade of a tool presses on, by the contacts of the last physics step."""
        there = self._presence.there
        tool = there[blade_of]
        names = [name for name in self._kinds if name in there]
        # What sleeps has pressed before it fell asleep, and physics tells its contacts of then.
        if not names or tool.sleeps:
            return []
        blades = [_grown(blade.moved(tool.T_world_body())) for blade in self._blades[blade_of]]
        origins = np.array([there[name].origin for name in names], float)
        reach = np.array([self._reach_m[name] for name in names]) + _CONTACT_M
        gaps = norm(origins[:, None] - [blade.T[:3, 3] for blade in blades], axis=-1) - [norm(b.half_m) for b in blades]
        near = [names[i] for i in np.flatnonzero(gaps.min(-1) < reach)]
        if not near:
            return []
        found = set[str]()  # a pair of solids has a contact, and a thing may have several
        for other, points in self._touches(blade_of, near):
            on_blade = (impulse for place, impulse in points if any(within(blade, place) for blade in blades))
            push_n = float(norm(sum(on_blade, np.zeros(3)))) * self._hz
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

    def _next(self, kind: str) -> _CutKind:
        return next(entry for entry in self._entries.values() if entry.name == kind)


def entry_size(entry: _CutKind) -> Array:
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
    """(4, 4) frames of dice in the frame of the cut thing: in a row along its longer side, on its underside."""
    along = int(np.argmax(size_m[:2]))
    places = np.zeros((count, 3))
    places[:, along] = (np.arange(count) - (count - 1) / 2) * die_m[along]
    return [pose((float(x), float(y), float(z))) for x, y, z in places]


def _grown(blade: Solid) -> Solid:
    return Solid(blade.kind, blade.half_m + _BLADE_M, blade.T)
