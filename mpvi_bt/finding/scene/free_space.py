"""Where pictures leave room: for arms, for the base, and on level faces for payloads."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.scene.faces import room
from mpvi_bt.finding.scene.field import Field, FineField, View
from mpvi_bt.finding.scene.frames import FLOOR_M, Frame, Pictures
from mpvi_bt.finding.scene.remembered import Remembered
from mpvi_bt.finding.scene.seen_parts import SeenParts
from mpvi_bt.finding.scene.thing_store import SeenThing, ThingStore
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.collision import Obstacles, Surroundings, Together

# Whether something stands at the crossings of three ranges of coordinates [m], as `Occupancy.standing`.
Standing = Callable[[Array, Array, Array], NDArray[np.bool_]]


@dataclass(frozen=True)
class SpaceParameters:
    """Which points are a thing's own, and how fine obstacles are.

    Our choice: fits are off by some centimeters, and odometry after a drive by as much again.
    """

    explained_m: float = 0.025  # points this close to a thing's solids are its own [m]
    roughly_m: float = 0.1  # the same for a thing remembered from before it was asked for [m]; shapes leave parts out
    fine_m: float = 0.6  # width of the finer field around the work place [m]
    fine_cell_m: float = 0.01  # cell of that field [m]
    foot_m: float = 0.1  # parts of furniture that begin this close to the lowest one are its foot [m]
    trusted_m: float = 0.04  # thickness of surfaces when hidden space is trusted [m]


_SPACE = SpaceParameters()
_KEPT = 2  # our choice: fields of obstacles that are kept, 7 MB each


class FreeSpace:
    """Obstacles and free places, by pictures, the shapes of things, and remembered surfaces.

    Attributes:
        focus: (3,) the place of work: obstacles are seen more finely around it. None until there is one.
    """

    def __init__(
        self, things: ThingStore, pictures: Pictures, parts: SeenParts, remembered: Remembered,
        standing: Standing | None,
    ) -> None:  # fmt: skip
        """`standing` tells of obstacles outside the `pictures`; None: nobody knows them."""
        self._things, self._pictures, self._parts = things, pictures, parts
        self._remembered, self._standing = remembered, standing
        self._trusting, self._remembering = False, True
        self._fields: dict[object, Obstacles] = {}  # the last two: those with and without what is beside alternate
        self.focus: Array | None = None

    @contextlib.contextmanager
    def trusting(self, remembering: bool = False) -> Iterator[None]:
        """While this lasts, hidden space well behind surfaces is free; `remembering` as `Scene` says."""
        self._trusting, self._remembering = True, remembering
        try:
            yield
        finally:
            self._trusting, self._remembering = False, True

    # ------------------------------------------------------------------------------------------ obstacles

    def obstacles(
        self, xy: Array, radius_m: float, without: Collection[str] = (), beside: str | None = None
    ) -> Obstacles:
        """As `Scene` says: what the pictures from this place do not show to be free, and known things out of view."""
        if beside is not None:
            without = {*without, beside}
        self._look_closely(xy, without, beside)
        focus = None if self.focus is None else tuple(np.round(self.focus, 2))
        how = (self._pictures.changes, self._trusting, self._remembering)
        key = (tuple(self._pictures.here()), tuple(sorted(without)), beside, focus, tuple(np.round(xy, 2)), how)
        field = self._fields.pop(key, None) or self._carved(xy, without, beside)
        self._fields = dict([*self._fields.items(), (key, field)][-_KEPT:])
        return Together([field, Surroundings(self._unseen(without))])

    def _look_closely(self, xy: Array, without: Collection[str], beside: str | None) -> None:
        """Focus on the smallest known thing of `without`, or on the foot of the furniture `beside`."""
        names = [n for n in sorted(without) if n in self._things and n not in self._things.hands.names()]
        if names:  # a thing, not what it lies on
            boxes = [self._things.shape(n).box() for n in names]
            self.focus = min(boxes, key=lambda box: float(np.ptp(box, axis=0).max())).mean(0)
        if beside is not None and self._things[beside].shape.kind == "furniture":
            low, high = bounds(_lowest(self._parts.body(beside)))
            self.focus = np.append(np.clip(xy, low[:2], high[:2]), low[2])

    def _carved(self, xy: Array, without: Collection[str], beside: str | None) -> Obstacles:
        """The obstacles that pictures show around a place, finer around the focus."""
        told = {*without, *self._furniture()}
        explaining = [*(() if beside is None else self._parts.body(beside)), *self._explaining(told)]
        views, before = (
            [View(f.image, self._transparent(f, told, explaining), self._in_hand(f)) for f in some]
            for some in (self._pictures.here(), self._pictures.before() if self._remembering else [])
        )
        known, thick = partial(self._around, told), _SPACE.trusted_m if self._trusting else 9.0
        coarse = Field(views, xy, thick_m=thick, before=before, known=known)
        if self.focus is None:
            return coarse
        size_m, cell_m = (_SPACE.fine_m,) * 3, _SPACE.fine_cell_m
        return FineField(coarse, Field(views, self.focus, size_m, cell_m, cell_m / 2, thick, before, known))

    def _unseen(self, without: Collection[str]) -> list[Solid]:
        """The solids of things that the pictures from here do not fully show."""
        furniture = self._furniture()
        flat = {n for n in furniture if bounds(self._parts.solids(n))[1, 2] < FLOOR_M}  # a lawn bars no base
        left_out = {*without, *flat, *self._things.hands.names()}
        hidden = [t.name for t in self._things if t.name not in left_out and self._hides(t, furniture)]
        standing = [n for n in furniture if n not in without and n not in flat]
        return [
            *(s for n in hidden for s in self._parts.solids(n)),
            *(s for n in standing for s in self._parts.leaves(n)),
        ]

    def _hides(self, thing: SeenThing, furniture: Collection[str]) -> bool:
        """Whether a thing at a known place has parts that the pictures from here do not show."""
        if thing.inside is not None and not (thing.stands and thing.inside in furniture):
            return False
        shown = any(f is g for f, _ in thing.views for g in self._pictures.here())
        return thing.name in furniture or bool(thing.shape.volumes) or not shown

    def _around(self, told: Collection[str], *ranges: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """As `Remembered.around`, without surfaces explained by the things `told`; payloads explain none."""
        stays, shown = self._remembered.around(*ranges)
        if self._standing is not None:
            stays |= self._standing(*ranges)
        stays &= self._remembering
        names = sorted(n for n in told if n in self._things and n not in self._things.hands.names())
        if not names:
            return stays, shown
        cells = np.unravel_index(np.flatnonzero(stays | shown), stays.shape)
        p = np.column_stack([values[i] for values, i in zip(ranges, cells, strict=True)])
        for name in names:
            explained = Surroundings([*self._parts.solids(name), *self._parts.leaves(name)])
            furniture = self._things[name].shape.kind == "furniture"
            own = explained.distance(p) <= (2 * _SPACE.explained_m if furniture else _SPACE.roughly_m)
            gone = tuple(i[own] for i in cells)
            stays[gone] = shown[gone] = False
            cells, p = tuple(i[~own] for i in cells), p[~own]
        return stays, shown

    def passable(self) -> Obstacles:
        """Obstacles of the base, by all pictures of the last meter. What no picture shows is free."""
        hands = self._things.hands
        assert hands.felt is not None
        held, explaining = hands.names(), self._explaining(hands.names())
        views = [View(f.image, self._transparent(f, held, explaining)) for f in self._pictures.passed()]
        return Field(views, hands.felt.base_pose[:2], known=partial(self._around, ()))

    # ------------------------------------------------------------------------------------------ level faces

    def spots(self, surface: str, radius_m: float, height_m: float, near: Array) -> list[Array]:
        """As `Scene` says: on the level faces that pictures show, by distance to edges and to other things."""
        thing = self._things[surface]
        views = self._parts.head_views(thing)
        if not views:
            return []
        found: list[tuple[float, Array]] = []
        hidden = [f.robot | self._in_hand(f) for f, _ in views]
        boards = thing.shape.solids if thing.shape.kind == "furniture" else thing.shape.solids[:1]
        tops = [float(board.aabb()[1, 2]) for board in boards]
        if thing.shape.kind == "vessel":  # it may be open at its side, and have a top
            tops.append(float(thing.shape.box()[1, 2]))
        for top in tops:
            found += room(views, hidden, top, radius_m, height_m, near)
        found = sorted(found, key=lambda f: f[0])
        self.focus = found[0][1] if found else self.focus
        return [spot for _, spot in found]

    # ------------------------------------------------------------------------------------------ pixels

    def _furniture(self) -> list[str]:
        return [thing.name for thing in self._things if thing.shape.kind == "furniture"]

    def _explaining(self, names: Collection[str]) -> list[Solid]:
        """The solids of things and of their parts."""
        return [solid for name in names for solid in self._parts.whole(name)]

    def _transparent(self, frame: Frame, without: Collection[str], explaining: Sequence[Solid]) -> NDArray[np.bool_]:
        """Pixels of robot and floor, of the things `without`, and those that solids explain."""
        through = frame.robot | frame.floor
        for thing in (self._things[n] for n in without if n in self._things):
            for f, mask in thing.views:
                if f is frame and thing.shape.kind != "furniture":
                    through |= ndimage.binary_dilation(mask, iterations=1)
        if explaining:
            rows, columns = np.nonzero(~through & (frame.image.depth > 0))
            points = frame.points[rows, columns]
            low, high = bounds(explaining) + [[-_SPACE.explained_m], [_SPACE.explained_m]]
            near = ((points > low) & (points < high)).all(1)
            rows, columns, points = rows[near], columns[near], points[near]
            own = Surroundings(explaining).distance(points) < _SPACE.explained_m
            through[rows[own], columns[own]] = True
        return through

    def _in_hand(self, frame: Frame) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of what the hands hold."""
        held = frame.robot.copy()
        if frame.stand != self._pictures.stand:
            return held
        solids = [s for thing in self._things if self._things.is_carried(thing) for s in self._parts.solids(thing.name)]
        if solids:
            low, high = bounds(solids) + [[-_SPACE.explained_m], [_SPACE.explained_m]]
            held |= ((frame.points > low) & (frame.points < high)).all(-1)
        return held


def _lowest(solids: Sequence[Solid]) -> list[Solid]:
    """The solids that begin within `foot_m` of the lowest point."""
    least = min(s.aabb()[0, 2] for s in solids)
    return [s for s in solids if s.aabb()[0, 2] < least + _SPACE.foot_m]
