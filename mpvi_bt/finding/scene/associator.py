"""Matches the masks of a picture to known things by place, because a detector's masks carry no names."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mpvi_bt.finding.scene.assignment import NEVER, associated
from mpvi_bt.finding.scene.frames import SEEN_PX, Frame
from mpvi_bt.finding.scene.handling import Handling
from mpvi_bt.finding.scene.hands import TOUCH
from mpvi_bt.finding.scene.seen_parts import SeenParts
from mpvi_bt.finding.scene.several_views import View, fitted
from mpvi_bt.finding.scene.thing_store import SeenThing, ThingStore
from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.in_part import as_outside, in_part, shrunk
from mpvi_bt.finding.shapes.moving_parts import to_and_behind
from mpvi_bt.finding.shapes.outlines import main_cluster
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE


@dataclass(frozen=True)
class Tracking:
    """Thresholds for matching masks to known things.

    Our choice: odometry does not drift at one standing place; after a drive it is off by its drift over some meters.
    """

    near_m: float = 0.12  # a mask this close to where a thing was is that thing, from the same place [m]
    far_m: float = 0.30  # the same after a drive [m]
    recent_m: float = 1.2  # driving after which an older picture is no longer fitted together with new ones [m]
    through_m: float = 0.06  # a hollow thing is gone if the depth is this far behind its middle [m]
    aside_m: float = 0.05  # pieces of a thing lie within this of where it was [m]
    behind_m: float = 0.01  # another thing is gone if the depth is this far behind it, beside the noise of depth [m]
    inside_m: tuple[float, float] = (0.02, 0.06)  # largest distance beside and above a container of what is in it [m]
    deeper_m: float = 0.1  # a vessel in the hand may be this much deeper than it seems [m]


_TRACK = Tracking()


@dataclass(frozen=True)
class Sameness:
    """When two sightings are of one thing.

    Our choice: from one side, or from nearby, only a part of a thing is in view.
    """

    sampled: int = 500  # points that are enough to place a part
    shared: float = 0.6  # least shared part of the smaller one's length, width and height, for furniture [ratio]
    alike: float = 0.8  # the same for two other things [ratio]; stacked bowls share less of their height
    outside_m: float = 0.05  # a leg may stand this far outside of the visible top of a table [m]


_SAME = Sameness()


class Associator:
    """Keeps a store of things up to date with pictures."""

    def __init__(self, things: ThingStore, phrases: Collection[str], parts: SeenParts, handling: Handling) -> None:
        """Update the `things` that `phrases` name. `handling` updates payloads."""
        self._things, self._phrases, self._parts, self._handling = things, phrases, parts, handling

    def associate(self, frame: Frame) -> None:
        """Match the masks of a picture to things, and forget things that the picture shows to be gone."""
        for phrase in dict.fromkeys(d.phrase for d in frame.detections if d.phrase in self._phrases):
            self._match(phrase, frame)
        for thing in [t for t in self._things if not (t.views and t.views[-1][0] is frame)]:
            if self._is_gone(thing, frame):
                self._things.drop(thing.name)
        for thing in [t for t in self._things if any(is_part(t, other) for other in self._things)]:
            self._things.drop(thing.name)
        self._merge()

    def fill_vessels(self) -> None:
        """Put things into the vessels that they are seen in."""
        for thing in self._things:
            held = thing.name in self._things.hands.names()
            if thing.inside is None and not held and thing.shape.kind != "furniture":
                vessels = [t for t in self._things if t.shape.kind == "vessel" and self._holds(t, thing)]
                vessel = next((t for t in vessels if self._lies_in(thing.shape, t.name)), None)
                if vessel is not None:
                    self._things.put_into(thing, vessel.name)

    def loose(self, frame: Frame) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of the named things, without furniture. Furniture stays where it is."""
        fixed = [m for t in self._things if t.shape.kind == "furniture" for f, m in t.views if f is frame]
        named = np.any([np.zeros(frame.robot.shape, bool), *(s.mask for s in frame.detections)], axis=0)
        return np.asarray(named & ~np.any([np.zeros(frame.robot.shape, bool), *fixed], axis=0))

    # ------------------------------------------------------------------------------------------ matching

    def _match(self, phrase: str, frame: Frame) -> None:
        """Update the things of one phrase by their masks, and add new things."""
        masks = [d.mask for d in frame.detections if d.phrase == phrase]
        seen = [(mask, points) for mask in masks if len(points := main_cluster(frame.of(mask))) >= SEEN_PX]
        known = [t for t in self._things if t.phrase == phrase]
        which = associated(self._misfits(frame, [points for _, points in seen], known))
        for k, (mask, _) in zip(which, seen, strict=True):
            if k is not None:
                self._update(known[k], frame, mask)
        left = [t for k, t in enumerate(known) if k not in which]
        for k, (mask, points) in zip(which, seen, strict=True):
            if k is None:
                self._add(phrase, frame, mask, points, left)

    def _add(
        self, phrase: str, frame: Frame, mask: NDArray[np.bool_], points: Array, left: list[SeenThing]
    ) -> None:  # fmt: skip
        """Update one of the things `left` that was opened since, or add a new thing."""
        opened = next((t for t in left if self._opened(t, points)), None)
        if opened is None:
            self._discover(phrase, frame, mask, points)
        else:
            left.remove(opened)
            self._update(opened, frame, mask)

    def _misfits(self, frame: Frame, seen: Sequence[Array], known: Sequence[SeenThing]) -> Array:
        """(n, m) how badly points (k, 3) of each of n masks fit each of m things."""
        # Things at the edge of every picture so far: compare the part that was in the last one.
        parts = {t.name: main_cluster(t.views[-1][0].of(t.views[-1][1])) for t in known
                 if t.views and all(f.cut(m) for f, m in t.views)}  # fmt: skip
        misfits = np.full((len(seen), len(known)), NEVER)
        for i, points in enumerate(seen):
            tree = cKDTree(points) if parts else None
            for k, thing in enumerate(known):
                shape = self._things.shape(thing.name)
                solids = shape.solids if shape.extent is None else [shape.extent]
                gap = float(np.median(Surroundings(solids).distance(points)))
                if tree is not None and thing.name in parts:
                    gap = min(gap, apart(parts[thing.name], tree))
                fresh = bool(thing.views) and thing.views[-1][0].stand == frame.stand
                gate = _TRACK.near_m if fresh or thing.name in self._things.hands.names() else _TRACK.far_m
                misfits[i, k] = gap / gate if gap < gate else NEVER
        return misfits

    def _opened(self, thing: SeenThing, points: Array) -> bool:
        """Whether points (n, 3) may belong to a thing that was opened since.

        If only the front of the thing was known, most new points are far from it: they show the door and the inside.
        """
        rooms = [to_and_behind(door) for door in self._parts.doors(thing.name)]
        return bool(rooms) and float(np.median(Surroundings(rooms).distance(points))) < _TRACK.near_m

    # ------------------------------------------------------------------------------------------ changing the store

    def _discover(self, phrase: str, frame: Frame, mask: NDArray[np.bool_], points: Array) -> None:
        """Add a new thing, if its points (n, 3) have a shape."""
        shape = fit(points, frame.points[frame.measured & ~mask], frame.eye)
        if shape is not None:
            view = (frame, mask)
            inner = [view] if shape.volumes else []
            name = self._things.new_name(phrase)
            self._things.put(SeenThing(name, phrase, shape, [view], inner, lowest_m=shape.support_m))

    def _update(self, thing: SeenThing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """Update a thing by a new view."""
        held = self._things.hands.names()
        if thing.name in held:
            self._handling.see_payload(thing, frame, mask)
        elif thing.inside in held:
            self._update_carried(thing, frame, mask)
        else:
            self._update_standing(thing, frame, mask)

    def _update_carried(self, thing: SeenThing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """Update a thing in a held container. Older views show its old place."""
        thing.views = [(frame, mask)]
        shape = fitted(thing.views, thing.shape.support_m)
        if shape is not None and not self._lies_in(shape, str(thing.inside)):
            thing.shape, thing.inside = shape, None
            self._things.hands.take_out(thing.name)

    def _update_standing(self, thing: SeenThing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """Update a thing that no hand carries."""
        thing.views = [(f, m) for f, m in thing.views if frame.way_m - f.way_m < _TRACK.recent_m][-5:]
        thing.views.append((frame, mask))
        here = [v for v in thing.views if v[0].stand == frame.stand]
        if (shape := self._fitted(thing, here)) is None:
            return
        thing.lowest_m = min(thing.lowest_m, shape.support_m)
        if thing.shape.kind == "furniture" and in_part(shape, thing.shape):
            return  # from near only a part of it is in view
        if thing.shape.kind == "vessel" and as_outside(shape, thing.shape):
            return  # from low or far off only its outside is
        thing.inner = here if shape.volumes else thing.inner
        thing.shape, container, thing.inside = shape, thing.inside, None
        if container is not None and self._lies_in(shape, container):
            self._things.put_into(thing, container)

    def _fitted(self, thing: SeenThing, here: list[View]) -> Shape | None:
        """The shape by the views from `here`; by all views if something hides a part of the thing now."""
        shape = fitted(here, thing.shape.support_m)
        if len(here) < len(thing.views) and (shape is None or shrunk(shape, thing.shape)):
            return fitted(thing.views, thing.shape.support_m) or shape
        return shape

    def _is_gone(self, thing: SeenThing, frame: Frame) -> bool:
        """Whether a picture shows the background behind a thing. A hollow thing may be seen down to its floor."""
        if self._things.is_carried(thing) or thing.shape.extent is not None:
            return False
        if self._is_in_pieces(thing, frame):
            return True
        depths = frame.depth_at(self._things.shape(thing.name).box().mean(0))
        through = _TRACK.through_m if thing.shape.volumes else _TRACK.behind_m
        return depths is not None and depths[1] > depths[0] + through + DEPTH_NOISE.smoothed_m * depths[0] ** 2

    def _is_in_pieces(self, thing: SeenThing, frame: Frame) -> bool:
        """Whether a picture shows what was cut from a thing in its place: halves of a whole, dice of a half."""
        low, high = self._things.shape(thing.name).box()
        whole = thing.phrase.removeprefix("half ")
        for other in frame.detections:
            if other.phrase != thing.phrase and other.phrase.endswith(f" {whole}"):
                points = frame.of(other.mask)
                there = ((points > low - _TRACK.aside_m) & (points < high + _TRACK.aside_m)).all(1)
                if np.count_nonzero(there) >= SEEN_PX and there.mean() > 0.5:
                    return True
        return False

    def _merge(self) -> None:
        """Merge entries of the same thing. The entry seen more often by the head stays."""
        still = [t for t in self._things if not self._things.is_carried(t)]
        known = sorted(still, key=lambda t: -sum(f.image.camera == "head" for f, _ in t.views))
        for k, thing in enumerate(known):
            if (first := next((other for other in known[:k] if is_again(thing, other)), None)) is not None:
                self._things.drop(thing.name)
                for name in self._things.within(thing.name):
                    self._things[name].inside = first.name

    # ------------------------------------------------------------------------------------------ what is in what

    def _holds(self, vessel: SeenThing, thing: SeenThing) -> bool:
        """Whether a vessel is large enough, seen from above, to contain a thing.

        Two phrases of a prompt may name one basket. Then it is known as two things, and neither contains the other.
        """
        boxes = [self._things.shape(t.name).box() for t in (vessel, thing)]
        outer, inner = (float(np.prod(np.ptp(box, axis=0)[:2])) for box in boxes)
        return vessel is not thing and outer > TOUCH.outer * inner

    def _lies_in(self, shape: Shape, container: str) -> bool:
        """Whether a shape is in a container. The depth of a container in a hand may be out of view."""
        if container not in self._things:  # it was forgotten, not what was in it
            return False
        aside, above = _TRACK.inside_m
        middle, deeper = shape.box().mean(0), _TRACK.deeper_m if container in self._things.hands.names() else 0.0
        boxes = [volume.aabb() for volume in self._parts.volumes(container)]
        below, beyond = np.array([aside, aside, aside + deeper]), np.array([aside, aside, above])
        return any(bool(((middle > low - below) & (middle < high + beyond)).all()) for low, high in boxes)


def apart(part: Array, whole: cKDTree) -> float:
    """Median distance of points (n, 3) of a part to all points of the thing [m]."""
    sample = part[:: max(1, len(part) // _SAME.sampled)]
    return float(np.median(whole.query(sample)[0])) if len(part) else np.inf


def is_again(thing: SeenThing, other: SeenThing) -> bool:
    """Whether a thing is another once more: the ends of a table, seen by head and hand, are no two tables.

    Nor are the foot of a coffee maker and its top, with the kettle before it, two coffee makers once all of it is seen.
    """
    large = [shape.extent for shape in (thing.shape, other.shape) if shape.extent is not None]
    if thing.phrase != other.phrase or len(large) == 1:
        return False
    (low, high), (low2, high2) = (
        [extent.aabb() for extent in large] if large else [thing.shape.box(), other.shape.box()]
    )
    shared = np.minimum(high, high2) - np.maximum(low, low2)
    return bool((shared > (_SAME.shared if large else _SAME.alike) * np.minimum(high - low, high2 - low2)).all())


def is_part(thing: SeenThing, furniture: SeenThing) -> bool:
    """Whether a thing is but a part of furniture of that name: a leg of a table, seen by a hand, is no other table."""
    if thing.phrase != furniture.phrase or thing.shape.kind == "furniture" or furniture.shape.kind != "furniture":
        return False
    (low, high), middle = furniture.shape.box(), thing.shape.box().mean(0)
    return bool((middle[:2] > low[:2] - _SAME.outside_m).all() and (middle < high + _SAME.outside_m).all())
