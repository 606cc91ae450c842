"""What pictures show of single things: their solids, doors, switches and contents."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.perception.detector import switch_of
from mpvi_bt.finding.scene.contents import contents
from mpvi_bt.finding.scene.frames import SEEN_PX, Frame, Pictures
from mpvi_bt.finding.scene.several_views import View
from mpvi_bt.finding.scene.thing_store import SeenThing, ThingStore
from mpvi_bt.finding.shapes.box_lids import lid
from mpvi_bt.finding.shapes.fronts import fronts, switch
from mpvi_bt.finding.shapes.layers import layers
from mpvi_bt.finding.shapes.moving_parts import Door
from mpvi_bt.finding.shapes.open_leaves import leaf, with_leaf, within_drawer
from mpvi_bt.finding.shapes.shape import SeenBar, Shape
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Surroundings

_IN = "what is in "  # the name of a vessel follows: all else that is seen in the vessel, as one thing


@dataclass(frozen=True)
class PartParameters:
    """Which points belong to a part of a thing.

    Our choice: fits are off by some centimeters, and odometry after a drive by as much again.
    """

    near_m: float = 0.12  # a switch this close to a thing belongs to it [m]
    face_px: int = 30  # things with fewer pixels are not searched for doors
    button_m: float = 0.02  # radius around a switch of what is touched with it [m]
    ajar: float = 0.5  # a door open by more than this is remembered [ratio of its limit]
    hinge_m: float = 0.1  # largest distance of two hinges of one door [m]
    most: float = 0.8  # least height and width of a door that replaces it [ratio]
    beyond_m: float = 0.1  # a view this far behind the remembered door ends it, too [m]


_PART = PartParameters()


class SeenParts:
    """Answers about single things, as `mpvi_bt.finding.scene.scene.Scene` defines them.

    It changes no thing. Costly answers are kept until other pictures show the thing.
    """

    def __init__(self, things: ThingStore, pictures: Pictures) -> None:
        """Answer from `things` and the `pictures` that show them."""
        self._things, self._pictures = things, pictures
        self._doors: dict[str, tuple[list[Frame], list[Door]]] = {}
        self._ajar: dict[str, list[tuple[Frame, Door]]] = {}  # doors that were seen to stand open
        self._bodies: dict[str, tuple[tuple[list[Frame], float], list[Solid]]] = {}
        self._others: dict[str, tuple[list[Frame | Shape], list[Solid]]] = {}  # in vessels

    def pose(self, name: str) -> Array:
        """T_world_thing (4, 4)."""
        return self._things.shape(name).T

    def solids(self, name: str) -> Sequence[Solid]:
        """The solids of a thing, of furniture the faces."""
        if name.startswith(_IN):
            return self._contents(name.removeprefix(_IN))
        return self._things.shape(name).solids

    def body(self, name: str) -> Sequence[Solid]:
        """The solids of a thing; of furniture from all views, with the trunk below a crown and the side of a bed."""
        thing = self._things[name]
        views = [(f, m) for f, m in self.head_views(thing) if f.of(m).size]
        if thing.shape.kind != "furniture" or not views:
            return self.solids(name)
        seen, known = ([f for f, _ in views], thing.lowest_m), self._bodies.get(name)
        if known is None or known[0] != seen:
            self._bodies[name] = known = (seen, layers(np.concatenate([f.of(m) for f, m in views]), thing.lowest_m))
        return known[1] or self.solids(name)

    def head_views(self, thing: SeenThing) -> list[View]:
        """The head's views of a thing and of the room inside it."""
        before = [(f, m) for f, m in thing.inner if all(f is not g for g, _ in thing.views)]
        return [(f, m) for f, m in (*before, *thing.views) if f.image.camera == "head"]

    def gap(self, name: str, p_world: Array) -> float:
        """Distance of a point (3,) to a thing [m]: to its shape, or to its points where the shape misses a part."""
        views = [v for v in self._things[name].views if v[0].stand == self._pictures.stand]
        seen = [norm(frame.of(mask) - p_world, axis=1) for frame, mask in views]
        shape = float(Surroundings(self._things.shape(name).solids).distance(p_world[None])[0])
        return min([shape, *(float(gaps.min()) for gaps in seen if len(gaps) >= SEEN_PX)])

    def handles(self, name: str) -> Sequence[SeenBar]:
        """Bars to carry it by."""
        return self._things.shape(name).bars

    # ------------------------------------------------------------------------------------------ what is in it

    def volumes(self, name: str) -> Sequence[Solid]:
        """Container volumes. That of an open drawer follows from its face, as the face hides the inside."""
        own = self._things.shape(name).volumes
        if self._things[name].shape.kind != "furniture":
            return own
        return [*own, *(inner for door in self.doors(name) if (inner := within_drawer(door)) is not None)]

    def others(self, name: str) -> Sequence[str]:
        """The unknown contents of a vessel, as one thing."""
        vessel = name in self._things and self._things[name].shape.kind == "vessel"
        return [_IN + name] if vessel and name not in self._things.hands.names() else []

    def _contents(self, name: str) -> list[Solid]:
        """The unknown contents as solids, from the newest pictures of the head; none of a vessel in a hand."""
        if not self.others(name):
            return []
        frames, inside = self._pictures.here(), [self._things.shape(n) for n in self._things.within(name)]
        key: list[Frame | Shape] = [*frames, self._things[name].shape, *inside]
        if (known := self._others.get(name)) is None or known[0] != key:
            shape = self._things.shape(name)
            points = np.concatenate([np.empty((0, 3)), *(f.points[f.measured] for f in frames)])
            own = [s for one in (shape, *inside) for s in one.solids]
            self._others[name] = known = (key, [c for room in shape.volumes for c in contents(points, room, own)])
        return known[1]

    # ------------------------------------------------------------------------------------------ what moves on it

    def doors(self, name: str) -> Sequence[Door]:
        """Open doors, and fronts with bars, by the head's views from the newest place."""
        views = [(f, m) for f, m in self._things[name].views if f.image.camera == "head"]
        if not views:
            return ()
        newest = [(f, m) for f, m in views if f.stand == views[-1][0].stand]
        frames, known = [f for f, _ in newest], self._doors.get(name)
        if known is None or known[0] != frames:
            points, eye = np.concatenate([f.of(m) for f, m in newest]), newest[-1][0].eye
            small = self._things[name].shape.kind != "furniture"
            found = _opening(points, eye, small) if len(points) >= _PART.face_px else []
            self._doors[name] = known = frames, found
        return known[1]

    def leaves(self, name: str) -> list[Solid]:
        """The solids of a thing's doors. A door that stood open and is out of view now stands there still."""
        doors, known = self.doors(name), self._doors.get(name)
        now = [(known[0][-1], d) for d in doors if known is not None and d.position > _PART.ajar * d.limit]
        before = [(f, d) for f, d in self._ajar.get(name, []) if not self._gone(d, f) and not _again(d, now)]
        self._ajar[name] = [*before, *now]
        return [s for door in (*(d for _, d in before), *doors) for s in door.solids]

    def _gone(self, door: Door, since: Frame) -> bool:
        """Whether a later picture of the head shows what is behind the middle of a door's panel."""
        middle, frames = door.solids[0].T[:3, 3], self._pictures.frames
        later = frames[frames.index(since) + 1 :] if since in frames else frames
        seen = [d for f in later if f.image.camera == "head" and (d := f.depth_at(middle)) is not None]
        return bool(seen) and seen[-1][1] > seen[-1][0] + _PART.beyond_m

    def switches(self, name: str) -> Sequence[Array]:
        """T_world_switch (4, 4) of the switch that was seen last."""
        for frame, mask in self._switch_seen(name):
            own = [m for f, m in self._things[name].views if f is frame]
            around = frame.of(own[0]) if own else np.empty((0, 3))
            if (T := switch(frame.of(mask), around, frame.eye)) is not None:
                return [T]
        return ()

    def is_on(self, name: str) -> bool | None:
        """Whether a thing is on, by the light of its switch, green for on, in the picture that showed it last."""
        for frame, mask in self._switch_seen(name):
            red, green, _ = frame.image.rgb[mask].astype(float).mean(0)
            return bool(green > red)
        return None

    def _switch_seen(self, name: str) -> Iterator[tuple[Frame, NDArray[np.bool_]]]:
        """Where pictures show the switch of a thing, the newest first, in each the nearest one first."""
        low, high = self._things.shape(name).box()
        phrase = switch_of(self._things[name].phrase)
        for frame in reversed(self._pictures.frames):
            near = []
            for d in frame.detections:
                if d.phrase == phrase and len(points := frame.of(d.mask)):
                    at = np.median(points, axis=0)
                    gap = self.gap(name, at)
                    # of a lamp only the shade may be known, of a screen its foot: the pole is below, the rest is seen
                    if gap < _PART.near_m or ((at > low - _PART.near_m) & (at < high + _PART.near_m))[:2].all():
                        near.append((gap, d))
            yield from ((frame, d.mask) for _, d in sorted(near, key=lambda n: n[0]))

    def whole(self, name: str) -> list[Solid]:
        """The solids of a thing, its doors and its switches; none if the thing is unknown."""
        if name.startswith(_IN):
            return list(self.solids(name))
        if name not in self._things:
            return []
        buttons = [Solid("sphere", np.full(3, _PART.button_m), T) for T in self.switches(name)]
        return [*self.solids(name), *self.leaves(name), *buttons]


def _opening(points: Array, eye: Array, small: bool) -> list[Door]:
    """Opening parts of a thing with points (n, 3): the lid of a small thing, or else doors and drawers."""
    if small and (on_top := lid(points, eye)) is not None:
        return [on_top]
    return with_leaf(fronts(points, eye), leaf(points, eye))


def _again(door: Door, seen: Sequence[tuple[Frame, Door]]) -> bool:
    """Whether a door is seen again now, and not only a smaller part of it."""
    return any(
        norm((door.origin - other.origin)[:2]) < _PART.hinge_m
        and (other.solids[0].half_m > _PART.most * door.solids[0].half_m).sum() >= 2
        for _, other in seen
    )
