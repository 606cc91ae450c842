"""The scene as the cameras have shown it: what the reactive policy works with. No simulator state comes near it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase
from mpvi_bt.finding.perception.detector import Detector, switch_of
from mpvi_bt.finding.scene import field
from mpvi_bt.finding.scene.contents import contents
from mpvi_bt.finding.scene.faces import room
from mpvi_bt.finding.scene.field import Field, FineField
from mpvi_bt.finding.scene.frames import FLOOR_M, Frame
from mpvi_bt.finding.scene.memory import Memory
from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.finding.scene.several_views import View
from mpvi_bt.finding.scene.thing import SeenThing
from mpvi_bt.finding.shapes.box_lids import lid
from mpvi_bt.finding.shapes.fronts import fronts, switch
from mpvi_bt.finding.shapes.layers import layers
from mpvi_bt.finding.shapes.moving_parts import Door
from mpvi_bt.finding.shapes.open_leaves import leaf, with_leaf, within_drawer
from mpvi_bt.finding.shapes.shape import SeenBar, Shape
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.collision import Obstacles, Surroundings, Together
from mpvi_bt.ground.robot.protocol import Side

# Whether something stands at the crossings of three ranges of coordinates [m], as `Occupancy.standing`.
Standing = Callable[[Array, Array, Array], NDArray[np.bool_]]
_IN = "what is in "  # a thing that is known: all else that is seen in it, as one thing


@dataclass(frozen=True)
class Looking:
    """What pictures show of things beside their shapes.

    Our choice: fits are off by some centimeters, and odometry after a drive by as much again.
    """

    passed_m: float = 1.0  # driving after which a picture no longer shows where the base can go [m]
    carved: int = 4  # pictures of the head that the field of obstacles is carved from
    near_m: float = 0.12  # a switch this close to a thing belongs to it [m]
    face_px: int = 30  # things with fewer pixels are not searched for doors
    explained_m: float = 0.025  # points this close to a thing's solids are its own [m]
    roughly_m: float = 0.1  # the same for a thing remembered from before it was asked for [m]; shapes leave parts out
    button_m: float = 0.02  # radius around a switch of what is touched with it [m]
    fine_m: float = 0.6  # width of the finer field around the work place [m]
    fine_cell_m: float = 0.01  # cell of that field [m]
    ajar: float = 0.5  # a door open by more than this is remembered [ratio of its limit]
    hinge_m: float = 0.1  # largest distance of two hinges of one door [m]
    most: float = 0.8  # least height and width of a door that replaces it [ratio]
    beyond_m: float = 0.1  # a view this far behind the remembered door ends it, too [m]
    foot_m: float = 0.1  # parts of furniture that begin this close to the lowest one are its foot [m]
    trusted_m: float = 0.04  # thickness of surfaces when hidden space is trusted [m]


_LOOK = Looking()


class Seen(Memory):
    """A `mpvi_bt.finding.scene.scene.Scene` of pictures."""

    needs_looks = True
    pose_error_m = 0.06  # our choice: fits are off by some centimeters, and odometry after a drive by as much again

    def __init__(self, detector: Detector, standing: Standing | None = None) -> None:
        """See through `detector`; `standing` says what stands where no picture that was taken in here looks."""
        self._standing = standing
        super().__init__(detector)

    def knowledge(self) -> KnowledgeBase:
        """As `Scene` says."""
        base = KnowledgeBase()
        carried = self._hands.names()
        for name, thing in self._things.items():
            low, high = self._shape(name).box()
            held = name in carried or thing.inside in carried
            laid = not held and self._deeds.is_laid(thing.phrase, (low + high) / 2)
            put = self._deeds.put_into((low + high) / 2) if thing.shape.kind == "vessel" and not held else ()
            kind: Literal["fixture", "object"] = "fixture" if thing.shape.kind == "furniture" else "object"
            base.put(Entry(name, (thing.phrase,), kind, low, high, source=self._detector.name, held=held,
                           inside=thing.inside, laid=laid, filled=tuple(put)))  # fmt: skip
        return base

    def pose(self, name: str) -> Array:
        """As `Scene` says."""
        return self._shape(name).T

    def solids(self, name: str) -> Sequence[Solid]:
        """As `Scene` says."""
        return self._contents(name.removeprefix(_IN)) if name.startswith(_IN) else self._shape(name).solids

    def body(self, name: str) -> Sequence[Solid]:
        """As `Scene` says: of furniture all that its views show, the trunk below a crown and the side of a bed."""
        thing = self._known(name)
        views = [(f, m) for f, m in self._views(thing) if f.of(m).size]
        if thing.shape.kind != "furniture" or not views:
            return self.solids(name)
        seen, known = ([f for f, _ in views], thing.lowest_m), self._bodies.get(name)
        if known is None or known[0] != seen:
            self._bodies[name] = known = (seen, layers(np.concatenate([f.of(m) for f, m in views]), thing.lowest_m))
        return known[1] or self.solids(name)

    def covered(self, places: Array, radius_m: float) -> NDArray[np.bool_]:
        """As `Scene` says."""
        return self._deeds.covered(places, radius_m)

    def volumes(self, name: str) -> Sequence[Solid]:
        """As `Scene` says; what is drawn out of furniture is seen by its face, for that hides what is behind it."""
        own = super().volumes(name)
        if self._known(name).shape.kind != "furniture":
            return own
        return [*own, *(inner for door in self.doors(name) if (inner := within_drawer(door)) is not None)]

    def handles(self, name: str) -> Sequence[SeenBar]:
        """As `Scene` says."""
        return self._shape(name).bars

    def doors(self, name: str) -> Sequence[Door]:
        """As `Scene` says: what stands open, and fronts with bars, by the views of the head from its newest place."""
        views = [(f, m) for f, m in self._known(name).views if f.image.camera == "head"]
        if not views:
            return ()
        newest = [(f, m) for f, m in views if f.stand == views[-1][0].stand]
        frames, known = [f for f, _ in newest], self._fronts.get(name)
        if known is None or known[0] != frames:
            points, eye = np.concatenate([f.of(m) for f, m in newest]), newest[-1][0].eye
            small = self._known(name).shape.kind != "furniture"
            self._fronts[name] = known = (
                frames,
                _opening(points, eye, small) if len(points) >= _LOOK.face_px else [],
            )
        return known[1]

    def mounts(self, name: str) -> Sequence[Mount]:
        """None: no picture tells where a thing fits another."""
        return ()

    def switches(self, name: str) -> Sequence[Array]:
        """As `Scene` says: the one that was seen last."""
        for frame, mask in self._switch_seen(name):
            own = [m for f, m in self._known(name).views if f is frame]
            around = frame.of(own[0]) if own else np.empty((0, 3))
            if (T := switch(frame.of(mask), around, frame.eye)) is not None:
                return [T]
        return ()

    def _switch_seen(self, name: str) -> Iterator[tuple[Frame, NDArray[np.bool_]]]:
        """Where pictures show the switch of a thing, the newest first, in each the nearest one first."""
        low, high = self._shape(name).box()
        phrase = switch_of(self._things[name].phrase)
        for frame in reversed(self._frames):
            near = []
            for d in frame.detections:
                if d.phrase == phrase and len(points := frame.of(d.mask)):
                    at = np.median(points, axis=0)
                    gap = self._gap(name, at)
                    # of a lamp only the shade may be known, of a screen its foot: the pole is below, the rest is seen
                    if gap < _LOOK.near_m or ((at > low - _LOOK.near_m) & (at < high + _LOOK.near_m))[:2].all():
                        near.append((gap, d))
            yield from ((frame, d.mask) for _, d in sorted(near, key=lambda n: n[0]))

    def is_on(self, name: str) -> bool | None:
        """As `Scene` says: by the light of its switch, green for on, in the picture that showed it last."""
        for frame, mask in self._switch_seen(name):
            red, green, _ = frame.image.rgb[mask].astype(float).mean(0)
            return bool(green > red)
        return None

    def holding(self, side: Side) -> str | None:
        """As `Scene` says: what was nearest to the hand when it closed, as long as its fingers feel something."""
        return self._hands.held(side)

    def between(self) -> str | None:
        """As `Scene` says: what was nearest to both hands when something began to keep them apart."""
        return self._hands.held("both")

    def others(self, name: str) -> Sequence[str]:
        """As `Scene` says: all of it as one thing."""
        vessel = name in self._things and self._things[name].shape.kind == "vessel"
        return [_IN + name] if vessel and name not in self._hands.names() else []

    def _contents(self, name: str) -> list[Solid]:
        """By the newest pictures of the head; of what is in a hand that is part of that."""
        if not self.others(name):
            return []
        frames, inside = self._carved(), [self._shape(n) for n in self.within(name)]
        key: list[Frame | Shape] = [*frames, self._things[name].shape, *inside]
        if (known := self._others.get(name)) is None or known[0] != key:
            points = np.concatenate([np.empty((0, 3)), *(f.points[f.measured] for f in frames)])
            own = [s for shape in (self._shape(name), *inside) for s in shape.solids]
            found = [c for room in super().volumes(name) for c in contents(points, room, own)]
            self._others[name] = known = (key, found)
        return known[1]

    def laden(self, name: str) -> bool:
        """As `Scene` says: with what is known to be in it, or what was put in it under an earlier prompt."""
        return bool(self.within(name)) or any(self._hands.held(hand) == name for hand in self._deeds.laden)

    def obstacles(
        self, xy: Array, radius_m: float, without: Collection[str] = (), beside: str | None = None
    ) -> Obstacles:
        """As `Scene` says: what the pictures from this place do not show to be free, and what else is known."""
        frames = self._carved()
        if beside is not None:
            without = {*without, beside}
        thick = _LOOK.trusted_m if self._trusting else 9.0
        near = [self._shape(n).box() for n in sorted(without) if n in self._things and n not in self._hands.names()]
        if near:  # a thing, not what it lies on
            self._focus = min(near, key=lambda box: float(np.ptp(box, axis=0).max())).mean(0)
        if beside is not None and self._known(beside).shape.kind == "furniture":
            self._focus = self._foot(beside, xy)
        faces = [n for n, t in self._things.items() if t.shape.kind == "furniture"]
        focus = None if self._focus is None else tuple(np.round(self._focus, 2))
        what = (tuple(sorted(without)), beside, focus)
        key = (tuple(map(id, frames)), what, tuple(np.round(xy, 2)), thick, self._remembering)
        if self._field is None or self._field[0] != key:
            told = {*without, *faces}
            explaining = [*(() if beside is None else self.body(beside)), *self._explaining(told)]
            views, before = (
                [field.View(f.image, self._transparent(f, told, explaining), self._in_hand(f)) for f in some]
                for some in (frames, self._before(frames) if self._remembering else [])
            )
            known = partial(self._around, told)
            coarse = Field(views, xy, thick_m=thick, before=before, known=known)
            if self._focus is None:
                self._field = (key, coarse)
            else:
                size_m, cell_m = (_LOOK.fine_m,) * 3, _LOOK.fine_cell_m
                fine = Field(views, self._focus, size_m, cell_m, cell_m / 2, thick, before, known)
                self._field = (key, FineField(coarse, fine))
        flat = {n for n in faces if bounds(self.solids(n))[1, 2] < FLOOR_M}  # a lawn bars no base
        left_out, held = {*without, *flat}, self._hands.names()
        unseen = [
            s for n, t in self._things.items()
            if n not in left_out and n not in held and (t.inside is None or (t.stands and t.inside in faces))
            and (n in faces or t.shape.volumes
                 or not any(f is g for f, _ in t.views for g in frames)) for s in self.solids(n)
        ]  # fmt: skip
        leaves = [s for n in faces if n not in left_out for s in self._leaves(n)]
        return Together([self._field[1], Surroundings([*unseen, *leaves])])

    def _around(self, told: Collection[str], *ranges: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """`Remembered.around`, less what things that are `told` of better explain where they stand, not in a hand."""
        stays, shown = self._remembered.around(*ranges)
        if self._standing is not None:
            stays |= self._standing(*ranges)
        stays &= self._remembering
        names = sorted(n for n in told if n in self._things and n not in self._hands.names())
        if not names:
            return stays, shown
        cells = np.unravel_index(np.flatnonzero(stays | shown), stays.shape)
        p = np.column_stack([values[i] for values, i in zip(ranges, cells, strict=True)])
        for name in names:
            explained = Surroundings([*self.solids(name), *self._leaves(name)])
            margin = 2 * _LOOK.explained_m if self._known(name).shape.kind == "furniture" else _LOOK.roughly_m
            own = explained.distance(p) <= margin
            gone = tuple(i[own] for i in cells)
            stays[gone] = shown[gone] = False
            cells, p = tuple(i[~own] for i in cells), p[~own]
        return stays, shown

    def _leaves(self, name: str) -> list[Solid]:
        """The solids of what opens of a thing; what stood open, and is out of view now, stands there still."""
        doors, known = self.doors(name), self._fronts.get(name)
        now = [(known[0][-1], d) for d in doors if known is not None and d.position > _LOOK.ajar * d.limit]
        before = [(f, d) for f, d in self._ajar.get(name, []) if not self._gone(d, f) and not _again(d, now)]
        self._ajar[name] = [*before, *now]
        return [s for door in (*(d for _, d in before), *doors) for s in door.solids]

    def _gone(self, door: Door, since: Frame) -> bool:
        """Whether a later picture of the head shows what is behind the middle of a door's panel."""
        middle = door.solids[0].T[:3, 3]
        later = self._frames[self._frames.index(since) + 1 :] if since in self._frames else self._frames
        seen = [d for f in later if f.image.camera == "head" and (d := f.depth_at(middle)) is not None]
        return bool(seen) and seen[-1][1] > seen[-1][0] + _LOOK.beyond_m

    def passable(self) -> Obstacles:
        """What the base must not drive into, by all pictures of the last meter; what none of them shows is free."""
        assert self._hands.felt is not None
        head = [f for f in self._frames if f.image.camera == "head" and self._way_m - f.way_m < _LOOK.passed_m]
        held, explaining = self._hands.names(), self._explaining(self._hands.names())
        views = [field.View(f.image, self._transparent(f, held, explaining)) for f in head]
        return Field(views, self._hands.felt.base_pose[:2], known=partial(self._around, ()))

    @contextlib.contextmanager
    def trusting(self, remembering: bool = False) -> Iterator[None]:
        """While this lasts, what lies hidden well behind surfaces is not taken for solid; `remembering` as `Scene`."""
        self._trusting, self._remembering = True, remembering
        try:
            yield
        finally:
            self._trusting, self._remembering = False, True

    def _carved(self) -> list[Frame]:
        """The newest pictures of the head from this place, or else from the last one."""
        head = [f for f in self._frames if f.image.camera == "head"]
        here = [f for f in head if f.stand == self._stand] or [f for f in head if head and f.stand == head[-1].stand]
        return here[-_LOOK.carved :]

    def _before(self, carved: Sequence[Frame]) -> list[Frame]:
        """The newest pictures of the head from other places near by: from here less may be in view than on the way."""
        stand = carved[-1].stand if carved else self._stand
        near = [f for f in self._frames if f.stand != stand and self._way_m - f.way_m < _LOOK.passed_m]
        return [f for f in near if f.image.camera == "head"][-_LOOK.carved :]

    def _foot(self, name: str, xy: Array) -> Array:
        """Where (3,) the lowest part of furniture is nearest to a place (2,)."""
        low, high = bounds(_lowest(self.body(name)))
        return np.append(np.clip(xy, low[:2], high[:2]), low[2])

    def _explaining(self, names: Collection[str]) -> list[Solid]:
        """The solids of things, of what opens of them and of their switches."""
        solids: list[Solid] = []
        for name in names:
            if name.startswith(_IN):
                solids += self.solids(name)
            elif name in self._things:
                solids += self.solids(name)
                solids += self._leaves(name)
                solids += [Solid("sphere", np.full(3, _LOOK.button_m), T) for T in self.switches(name)]
        return solids

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
            low, high = bounds(explaining) + [[-_LOOK.explained_m], [_LOOK.explained_m]]
            near = ((points > low) & (points < high)).all(1)
            rows, columns, points = rows[near], columns[near], points[near]
            own = Surroundings(explaining).distance(points) < _LOOK.explained_m
            through[rows[own], columns[own]] = True
        return through

    def spots(self, surface: str, radius_m: float, height_m: float, near: Array) -> list[Array]:
        """As `Scene` says: on the largest horizontal face that is seen of it, by distance to its edge and to things."""
        thing = self._known(surface)
        views = self._views(thing)
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
        self._focus = found[0][1] if found else self._focus
        return [spot for _, spot in found]

    def _views(self, thing: SeenThing) -> list[View]:
        """What the head has seen of a thing, and of the room in it."""
        before = [(f, m) for f, m in thing.inner if all(f is not g for g, _ in thing.views)]
        return [(f, m) for f, m in (*before, *thing.views) if f.image.camera == "head"]

    def _in_hand(self, frame: Frame) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of what the hands hold."""
        held = frame.robot.copy()
        if frame.stand != self._stand:
            return held
        carried = self._hands.names()
        solids = [s for n in self._things if n in carried or self._things[n].inside in carried for s in self.solids(n)]
        if solids:
            low, high = bounds(solids) + [[-_LOOK.explained_m], [_LOOK.explained_m]]
            held |= ((frame.points > low) & (frame.points < high)).all(-1)
        return held


def _opening(points: Array, eye: Array, small: bool) -> list[Door]:
    """What opens of a thing that shows points (n, 3): the lid of a small one, or else its doors and drawers."""
    if small and (on_top := lid(points, eye)) is not None:
        return [on_top]
    return with_leaf(fronts(points, eye), leaf(points, eye))


def _again(door: Door, seen: Sequence[tuple[Frame, Door]]) -> bool:
    """Whether one of the doors that are seen now is that door, and no smaller part of it."""
    return any(
        norm((door.origin - other.origin)[:2]) < _LOOK.hinge_m
        and (other.solids[0].half_m > _LOOK.most * door.solids[0].half_m).sum() >= 2
        for _, other in seen
    )


def _lowest(solids: Sequence[Solid]) -> list[Solid]:
    """Those that reach down as far as any, but for a hand's breadth."""
    least = min(s.aabb()[0, 2] for s in solids)
    return [s for s in solids if s.aabb()[0, 2] < least + _LOOK.foot_m]
