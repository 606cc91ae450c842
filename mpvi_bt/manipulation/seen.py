"""The scene as the cameras have shown it: what the reactive policy works with. No simulator state comes near it.

Things are known by phrase and number, such as "can of soda 1": a detector's masks carry no names, so which mask is
which thing in the next picture is told by place. Shapes are fitted to the points of pictures from one standing place:
between two places lies a drive, and odometry that drifts on the way would smear them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from mpvi_bt.manipulation.frames import Frame, take
from mpvi_bt.manipulation.in_hand import InHand
from mpvi_bt.perception.detector import Detector, switch_of
from mpvi_bt.perception.field import Field, FineField, View
from mpvi_bt.perception.fronts import fronts, switch
from mpvi_bt.perception.knowledge import Entry, KnowledgeBase
from mpvi_bt.perception.parts import Door
from mpvi_bt.perception.shapes import SeenBar, Shape, fit, main_cluster
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot import r1
from mpvi_bt.robot.collision import Obstacles, Surroundings, Together
from mpvi_bt.robot.motion import MotionFailure
from mpvi_bt.robot.protocol import EMPTY_M, SIDES, CameraImage, Proprioception, Side
from mpvi_bt.robot.solids import Array, Solid
from mpvi_bt.robot.squeeze import squeezes

_PASSED_M = 1.0  # of driving: pictures that old still tell where the base can go
_KEPT = 20  # pictures remembered
_CARVED = 4  # pictures of the head that the field of obstacles is carved from
_MOVED = (0.01, 0.015)  # a base that has moved farther than this [m, rad] stands at another place
_NEAR_M = 0.12  # a mask this near to where a thing was is that thing, from the same place
_FAR_M = 0.30  # likewise after a drive
_RECENT_M = 1.2  # of driving: what was seen before is still good enough to be fitted to what is seen now
_SHRUNK = 0.9  # a thing that seems so much smaller than before is partly hidden
_DRIFTED_M = 0.006  # less than that views may differ without the odometry being to blame
_SEEN_PX = 6  # a mask of fewer pixels is not looked at
_ALONE_PX = 150  # a wrist's mask of as many pixels is believed against all others
_THROUGH_M = 0.06  # where the depth is that much farther than a thing, it is gone
_EXPLAINED_M = 0.025  # points this near a thing's solids are its own
_PRESSED_M = 0.06  # what two hands press is this near to both of them
_GRASPED_M = 0.06  # what a closing hand takes hold of is this near its tcp, by what was seen of it
_FINE_M, _FINE_CELL_M = 0.6, 0.01  # the finer field about what is worked on
_TRUSTED_M = 0.04  # how thick surfaces are where hidden space is given the benefit of doubt
_SPOT_M = 0.02  # grid of free places
_RECENTERED_M = 0.04  # fingers that close shift what they take by less than this


@dataclass(eq=False)
class Thing:
    """One thing that was seen.

    Attributes:
        name, phrase: "can of soda 1", "can of soda".
        shape: What it is taken to be, where it was seen or put last.
        views: Frames that show it, with its mask, newest last.
        inside: The container that it is in.
        grip: T_tcp_world (4, 4) at the moment that a hand took it, and that hand; None if it is in no hand.
    """

    name: str
    phrase: str
    shape: Shape
    views: list[tuple[Frame, NDArray[np.bool_]]] = field(default_factory=list)
    inside: str | None = None


class Seen:
    """A `mpvi_bt.manipulation.scene.Scene` and its `Sight`."""

    def __init__(self, detector: Detector) -> None:
        """See through `detector`."""
        self._detector = detector
        self.forget(())

    def forget(self, phrases: Iterable[str]) -> None:
        """Begin anew, with nothing known; from now on look for `phrases`."""
        self._phrases = tuple(dict.fromkeys(phrases))
        self._asked = (*self._phrases, *map(switch_of, self._phrases))
        self._frames: list[Frame] = []
        self._things: dict[str, Thing] = {}
        self._count: dict[str, int] = {}
        self._grip: dict[Side, tuple[str, Array]] = {}  # thing, and its motion's inverse at the grasp
        self._shown: dict[Side, InHand] = {}  # what was first seen in a hand
        self._both: tuple[str, Array] | None = None  # likewise between both hands, by the left one's motion
        self._stand, self._stood, self._way_m = 0, np.full(3, np.inf), 0.0
        self._felt: Proprioception | None = None
        self._field: tuple[object, Obstacles] | None = None
        self._fronts: tuple[object, list[Door]] | None = None
        self._trusting = False
        self._focus: Array | None = None  # what is worked on: obstacles are seen more finely around it

    # --- taking in

    def feel(self, felt: Proprioception) -> None:
        """Take in one step of proprioception: the base that moves, the hands that take and let go."""
        moved = felt.base_pose - self._stood
        if np.linalg.norm(moved[:2]) > _MOVED[0] or abs(kin.wrap(moved[2])) > _MOVED[1]:
            if self._stand:
                self._way_m += float(np.hypot(*moved[:2])) + r1.BASE_RADIUS_M * abs(float(kin.wrap(moved[2])))
            self._stand, self._stood = self._stand + 1, felt.base_pose.copy()
        self._felt = felt
        self._feel_hands(felt)

    def _feel_hands(self, felt: Proprioception) -> None:
        for side in SIDES:
            closed, gripped = felt.gripper_command[side] < -0.9, felt.holds(side)
            if side in self._grip and not gripped:
                self._release(side, dropped=felt.gripper_width[side] <= EMPTY_M)
            elif closed and gripped and side not in self._grip:
                self._grasp(side)
        if squeezes(felt) != (self._both is not None):
            self._press()

    def see(self, images: Mapping[str, CameraImage], felt: Proprioception) -> None:
        """Take in pictures."""
        self.feel(felt)
        for image in images.values():
            frame = take(image, felt, self._detector, self._asked, self._stand, self._way_m)
            self._frames = [*self._frames, frame][-_KEPT:]
            self._associate(frame)
        before = set(self._grip)
        self._feel_hands(felt)  # they may hold what has been seen only now
        for side in set(self._grip) - before:
            thing, self._shown[side] = self._things[self._grip[side][0]], InHand(felt.gripper_width[side])
            for frame, mask in thing.views:
                self._regard(thing, frame, mask)
            thing.views = []

    def _tcp(self, side: Side) -> Array:
        assert self._felt is not None
        return kin.base(self._felt.base_pose) @ kin.tcp(self._felt.torso, self._felt.arm[side], side)

    def _grasp(self, side: Side) -> None:
        """The hand has closed on something: the nearest thing, which its fingers have brought between them."""
        T = self._tcp(side)
        taken = {n for n, _ in self._grip.values()}
        near = [
            (float(Surroundings(self.solids(n)).distance(T[None, :3, 3])[0]), n)
            for n in self._things
            if n not in taken and self._things[n].shape.kind != "furniture"
        ]
        if not near or min(near)[0] > _GRASPED_M:
            return
        thing = self._things[min(near)[1]]
        if thing.shape.kind != "vessel":
            boxes = np.stack([s.moved(kin.inverse(T)).aabb() for s in thing.shape.solids])
            aside = float(boxes[:, 0, 1].min() + boxes[:, 1, 1].max()) / 2
            if abs(aside) < _RECENTERED_M:
                thing.shape = thing.shape.moved(kin.transform(np.eye(3), -aside * T[:3, 1]))
        self._grip[side] = (thing.name, kin.inverse(T))
        thing.inside = None  # its views stay: where it stood it stands no more

    def _press(self) -> None:
        """The hands have begun to press the nearest thing between them, or have ceased to."""
        if self._both is not None:
            thing = self._things[self._both[0]]
            thing.shape, self._both = self._shape(thing.name), None
            thing.views = []
            return
        hands = np.stack([self._tcp(side)[:3, 3] for side in SIDES])
        gaps = {n: float(Surroundings(self.solids(n)).distance(hands).max()) for n in self._things}
        nearest = min(gaps, key=gaps.__getitem__, default=None)
        if nearest is not None and gaps[nearest] < _PRESSED_M:
            self._both = (nearest, kin.inverse(self._tcp("left")))
            self._things[nearest].inside = None

    def _release(self, side: Side, dropped: bool) -> None:
        """The hand has let go: what it held is where it was held, or has fallen into what is below it."""
        name, _ = self._grip[side]
        thing = self._things[name]
        thing.shape = self._shape(name)
        del self._grip[side]
        self._shown.pop(side, None)
        thing.views = []
        middle = thing.shape.box().mean(0)
        for other in self._things.values():
            for volume in self._shape(other.name).volumes if other is not thing else ():
                low, high = volume.aabb()
                if not dropped and ((middle[:2] > low[:2]) & (middle[:2] < high[:2])).all() and middle[2] > low[2]:
                    thing.inside = other.name
                    fall = thing.shape.box()[0, 2] - low[2]
                    thing.shape = thing.shape.moved(kin.transform(np.eye(3), (0.0, 0.0, -float(fall))))
                    return

    def _shape(self, name: str) -> Shape:
        """A thing's shape now: what is in a hand moves with it."""
        if name not in self._things:
            raise MotionFailure("lost_sight")
        thing = self._things[name]
        carrier = name
        if thing.inside is not None and thing.inside in self._held():
            carrier = thing.inside
        if self._both is not None and self._both[0] == carrier:
            return thing.shape.moved(self._tcp("left") @ self._both[1])
        for side, (held, T_tcp_world) in self._grip.items():
            if held == carrier:
                return thing.shape.moved(self._tcp(side) @ T_tcp_world)
        return thing.shape

    def _associate(self, frame: Frame) -> None:
        """Tell which mask is which thing, by place; what should be seen and is not is gone."""
        for phrase in dict.fromkeys(d.phrase for d in frame.detections if d.phrase in self._phrases):
            masks = [d.mask for d in frame.detections if d.phrase == phrase]
            seen = [(m, main_cluster(frame.of(m))) for m in masks]
            seen = [(m, p) for m, p in seen if len(p) >= _SEEN_PX]
            known = [t for t in self._things.values() if t.phrase == phrase]
            pairs = []
            for i, (_, points) in enumerate(seen):
                for thing in known:
                    shape = self._shape(thing.name)
                    solids = shape.solids if shape.extent is None else [shape.extent]
                    gap = float(np.median(Surroundings(solids).distance(points)))
                    fresh = bool(thing.views) and thing.views[-1][0].stand == frame.stand
                    if gap < (_NEAR_M if fresh or thing.name in self._held() else _FAR_M):
                        pairs.append((gap, i, thing.name))
            done: set[object] = set()
            for _, i, name in sorted(pairs):
                if i not in done and name not in done:
                    done |= {i, name}
                    self._update(self._things[name], frame, seen[i][0])
            for i, (mask, points) in enumerate(seen):
                if i not in done:
                    self._discover(phrase, frame, mask, points)
        for name in [n for n, t in self._things.items() if not (t.views and t.views[-1][0] is frame)]:
            self._missed(name, frame)

    def _discover(self, phrase: str, frame: Frame, mask: NDArray[np.bool_], points: Array) -> None:
        shape = fit(points, frame.points[frame.measured & ~mask], frame.eye)
        if shape is not None:
            self._count[phrase] = self._count.get(phrase, 0) + 1
            name = f"{phrase} {self._count[phrase]}"
            self._things[name] = Thing(name, phrase, shape, [(frame, mask)])

    def _update(self, thing: Thing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """See a thing again; what is in hand is known better by the hand."""
        if thing.name in self._held():
            self._regard(thing, frame, mask)
            return
        thing.views = [(f, m) for f, m in thing.views if frame.way_m - f.way_m < _RECENT_M][-5:]
        thing.views.append((frame, mask))
        shape = self._fitted(thing, [v for v in thing.views if v[0].stand == frame.stand])
        if shape is None or (np.ptp(shape.box(), axis=0) < _SHRUNK * np.ptp(thing.shape.box(), axis=0))[:2].any():
            shape = self._fitted(thing, thing.views) or shape  # something hides a part of it now
        if shape is not None:
            thing.shape = shape
            if thing.inside is not None and not self._lies_in(thing, thing.inside):
                thing.inside = None

    def _regard(self, thing: Thing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """See what a hand holds: it is as good as a part of the robot; what was first seen there is seen better now."""
        for side, (name, _) in self._grip.items():
            if name == thing.name and side in self._shown:
                T = self._tcp(side)
                self._shown[side].add(frame, mask, T)
                if (shape := self._shown[side].shape(T)) is not None:
                    thing.shape, self._grip[side] = shape, (name, kin.inverse(T))
        frame.robot[:] |= ndimage.binary_dilation(mask, iterations=2)
        self._field = None

    def _fitted(self, thing: Thing, views: Sequence[tuple[Frame, NDArray[np.bool_]]]) -> Shape | None:
        """The shape that views agree on; what the wrist sees, from near, counts for where it is."""
        newest = views[-1][0].stand
        whole = [(f, m) for f, m in views if not f.cut(m)]
        whole = whole if any(f.stand == newest or f.image.camera == "head" for f, _ in whole) else list(views)
        head = [(f, m) for f, m in whole if f.image.camera == "head"]
        wrist = [(f, m) for f, m in whole if f.image.camera != "head" and f.stand == newest][-1:]
        parts = [main_cluster(f.of(m)) for f, m in head]
        fresh = [p for p, (f, _) in zip(parts, head, strict=True) if f.stand == newest]
        if fresh and len(fresh) < len(parts):  # what the odometry has done to older views is undone
            shift = _shift(np.concatenate(parts[: -len(fresh)]), np.concatenate(fresh))
            if shift is not None and np.linalg.norm(shift) > _DRIFTED_M:
                parts = [*(p + shift for p in parts[: -len(fresh)]), *fresh]
        support = None if head else thing.shape.support_m
        if wrist:
            near = main_cluster(wrist[0][0].of(wrist[0][1]))
            shift = _shift(np.concatenate(parts), near) if head and len(near) >= _SEEN_PX else np.zeros(3)
            before = fit(np.concatenate(parts), _around(head), head[-1][0].eye) if head else None
            if before is not None:
                support = before.support_m + (shift[2] if shift is not None else 0.0)
            if shift is not None:
                parts = [*(p + shift for p in parts), near]
            elif len(near) >= _ALONE_PX and not wrist[0][0].cut(wrist[0][1]):
                parts = [near]  # it was bumped since the head saw it
        eye = head[-1][0].eye if head else wrist[0][0].eye
        return fit(np.concatenate(parts), _around(head or wrist), eye, support)

    def _missed(self, name: str, frame: Frame) -> None:
        """Forget a thing where a picture shows what is behind it."""
        thing = self._things[name]
        if name in self._held() or thing.inside is not None or thing.shape.extent is not None:
            return
        depths = frame.depth_at(self._shape(name).box().mean(0))
        if depths is not None and depths[1] > depths[0] + _THROUGH_M:
            del self._things[name]

    def _lies_in(self, thing: Thing, container: str) -> bool:
        middle = thing.shape.box().mean(0)
        for volume in self.volumes(container):
            low, high = volume.aabb()
            if (middle > low - 0.02).all() and (middle[:2] < high[:2] + 0.02).all() and middle[2] < high[2] + 0.06:
                return True
        return False

    # --- the scene

    def knowledge(self) -> KnowledgeBase:
        """As `Scene` says."""
        base = KnowledgeBase()
        carried = self._held()
        for name, thing in self._things.items():
            low, high = self._shape(name).box()
            held = name in carried or thing.inside in carried
            kind = "fixture" if thing.shape.kind == "furniture" else "object"
            base.put(Entry(name, (thing.phrase,), kind, low, high, source=self._detector.name, held=held,
                           inside=thing.inside))  # fmt: skip
        return base

    def pose(self, name: str) -> Array:
        """As `Scene` says."""
        return self._shape(name).T

    def solids(self, name: str) -> Sequence[Solid]:
        """As `Scene` says."""
        return self._shape(name).solids

    def volumes(self, name: str) -> Sequence[Solid]:
        """As `Scene` says."""
        return self._shape(name).volumes

    def handles(self, name: str) -> Sequence[SeenBar]:
        """As `Scene` says."""
        return self._shape(name).bars

    def doors(self, name: str) -> Sequence[Door]:
        """As `Scene` says: the fronts with bars that the newest view of the head from its place shows."""
        views = [(f, m) for f, m in self._things[name].views if f.image.camera == "head"]
        if not views:
            return ()
        newest = [(f, m) for f, m in views if f.stand == views[-1][0].stand]
        key = (name, *(id(f) for f, _ in newest))
        if self._fronts is None or self._fronts[0] != key:
            self._fronts = (key, fronts(np.concatenate([f.of(m) for f, m in newest]), newest[-1][0].eye))
        return self._fronts[1]

    def switches(self, name: str) -> Sequence[Array]:
        """As `Scene` says: the one that was seen last."""
        for frame, mask in self._switch_seen(name):
            own = [m for f, m in self._things[name].views if f is frame]
            around = frame.of(own[0]) if own else np.empty((0, 3))
            if (T := switch(frame.of(mask), around, frame.eye)) is not None:
                return [T]
        return ()

    def _switch_seen(self, name: str) -> Iterator[tuple[Frame, NDArray[np.bool_]]]:
        """Where pictures show the switch of a thing, the newest first."""
        low, high = self._shape(name).box()
        for frame in reversed(self._frames):
            for d in frame.detections:
                points = frame.of(d.mask)
                if d.phrase == switch_of(self._things[name].phrase) and len(points):
                    at = np.median(points, axis=0)
                    if ((at > low - _NEAR_M) & (at < high + _NEAR_M)).all():
                        yield frame, d.mask

    def is_on(self, name: str) -> bool | None:
        """As `Scene` says: by the light of its switch, green for on, in the picture that showed it last."""
        for frame, mask in self._switch_seen(name):
            red, green, _ = frame.image.rgb[mask].astype(float).mean(0)
            return bool(green > red)
        return None

    def holding(self, side: Side) -> str | None:
        """As `Scene` says: what was nearest to the hand when it closed, as long as its fingers feel something."""
        return self._grip[side][0] if side in self._grip else None

    def between(self) -> str | None:
        """As `Scene` says: what was nearest to both hands when something began to keep them apart."""
        return self._both[0] if self._both is not None else None

    def within(self, name: str) -> Sequence[str]:
        """As `Scene` says: what was let go over it, or is seen in it."""
        return [n for n, t in self._things.items() if t.inside == name]

    def obstacles(self, xy: Array, radius_m: float, without: Collection[str] = ()) -> Obstacles:
        """As `Scene` says: what the pictures from this place do not show to be free, and what else is known."""
        frames = self._carved()
        thick = _TRUSTED_M if self._trusting else 9.0
        near = [n for n in without if n in self._things and n not in self._held()]
        if near:
            self._focus = self._shape(near[0]).box().mean(0)
        faces = [n for n, t in self._things.items() if t.shape.kind == "furniture"]
        focus = None if self._focus is None else tuple(np.round(self._focus, 2))
        key = (tuple(map(id, frames)), tuple(sorted(without)), tuple(np.round(xy, 2)), thick, focus)
        if self._field is None or self._field[0] != key:
            views = [View(f.image, self._transparent(f, {*without, *faces})) for f in frames]
            field: Obstacles = Field(views, xy, thick_m=thick)
            if self._focus is not None:
                fine = Field(views, self._focus, (_FINE_M,) * 3, _FINE_CELL_M, _FINE_CELL_M / 2, thick)
                field = FineField(field, fine)
            self._field = (key, field)
        unseen = [
            s for n, t in self._things.items()
            if n not in without and t.inside is None and n not in self._held()
            and (n in faces or not any(f is g for f, _ in t.views for g in frames)) for s in self.solids(n)
        ]  # fmt: skip
        return Together([self._field[1], Surroundings(unseen)])

    def passable(self) -> Obstacles:
        """What the base must not drive into, by all pictures of the last meter; what none of them shows is free."""
        assert self._felt is not None
        head = [f for f in self._frames if f.image.camera == "head" and self._way_m - f.way_m < _PASSED_M]
        views = [View(f.image, self._transparent(f, self._held())) for f in head]
        return Field(views, self._felt.base_pose[:2])

    @contextlib.contextmanager
    def trusting(self) -> Iterator[None]:
        """While this lasts, what lies hidden well behind surfaces is not taken for solid."""
        self._trusting = True
        try:
            yield
        finally:
            self._trusting = False

    def _held(self) -> set[str]:
        both = () if self._both is None else (self._both[0],)
        return {*both, *(n for n, _ in self._grip.values())}

    def _carved(self) -> list[Frame]:
        """The newest pictures of the head from this place, or else from the last one."""
        head = [f for f in self._frames if f.image.camera == "head"]
        here = [f for f in head if f.stand == self._stand] or [f for f in head if head and f.stand == head[-1].stand]
        return here[-_CARVED:]

    def _transparent(self, frame: Frame, without: Collection[str]) -> NDArray[np.bool_]:
        """Pixels of robot and floor, and those that the things `without` explain."""
        through = frame.robot | frame.floor
        solids: list[Solid] = []
        for name in without:
            if (thing := self._things.get(name)) is not None:
                solids += self.solids(name)
                solids += [s for door in self.doors(name) for s in door.solids]
                for f, mask in thing.views:
                    if f is frame and thing.shape.kind != "furniture":
                        through = through | ndimage.binary_dilation(mask, iterations=1)
        if solids:
            rows, columns = np.nonzero(~through & (frame.image.depth > 0))
            points = frame.points[rows, columns]
            boxes = np.stack([s.aabb() for s in solids])
            low, high = boxes[:, 0].min(0) - _EXPLAINED_M, boxes[:, 1].max(0) + _EXPLAINED_M
            near = ((points > low) & (points < high)).all(1)
            rows, columns, points = rows[near], columns[near], points[near]
            own = Surroundings(solids).distance(points) < _EXPLAINED_M
            through = through.copy()
            through[rows[own], columns[own]] = True
        return through

    def spots(self, surface: str, radius_m: float, height_m: float, near: Array) -> list[Array]:
        """As `Scene` says: on the largest horizontal face that is seen of it, by distance to its edge and to things."""
        thing = self._things[surface]
        views = [(f, m) for f, m in thing.views if f.image.camera == "head"]
        if not views:
            return []
        found: list[tuple[float, Array]] = []
        for board in thing.shape.solids:
            if thing.shape.kind == "furniture" or board is thing.shape.solids[0]:
                found += self._room(views, float(board.aabb()[1, 2]), radius_m, height_m, near)
        found = sorted(found, key=lambda f: f[0])
        self._focus = found[0][1] if found else self._focus
        return [spot for _, spot in found]

    def _room(
        self,
        views: Sequence[tuple[Frame, NDArray[np.bool_]]],
        top: float,
        radius_m: float,
        height_m: float,
        near: Array,
    ) -> list[tuple[float, Array]]:
        """Places (3,) with room on the face at a height [m] of what views show, each with a cost."""
        own = np.concatenate([f.of(m) for f, m in views])
        face = own[np.abs(own[:, 2] - top) < 0.012, :2]
        if len(face) < 40:
            return []
        low = face.min(0) - 0.1
        size = np.ceil((face.max(0) + 0.1 - low) / _SPOT_M).astype(int) + 1
        free = np.zeros(size, bool)
        free[tuple(((face - low) / _SPOT_M).astype(int).T)] = True
        free = ndimage.binary_closing(free, np.ones((3, 3), bool))
        for frame, _ in views:
            others = frame.points[frame.measured & ~self._in_hand(frame)]
            others = others[(others[:, 2] > top + 0.012) & (others[:, 2] < top + height_m), :2]
            cells = np.floor((others - low) / _SPOT_M).astype(int)
            cells = cells[((cells >= 0) & (cells < size)).all(1)]
            free[tuple(cells.T)] = False
        room = ndimage.distance_transform_edt(free) * _SPOT_M - _SPOT_M / 2
        cells = np.argwhere(room > radius_m)
        places = low + (cells + 0.5) * _SPOT_M
        cost = np.linalg.norm(places - near, axis=1) - 0.5 * np.minimum(room[tuple(cells.T)], 0.2)
        return [(float(cost[k]), np.array([*places[k], top])) for k in _spread(places, np.argsort(cost))]

    def _in_hand(self, frame: Frame) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of what the hands hold."""
        held = frame.robot.copy()
        carried = self._held()
        solids = [s for n in self._things if n in carried or self._things[n].inside in carried for s in self.solids(n)]
        if solids and frame.stand == self._stand:
            boxes = np.stack([s.aabb() for s in solids])
            low, high = boxes[:, 0].min(0) - _EXPLAINED_M, boxes[:, 1].max(0) + _EXPLAINED_M
            held |= ((frame.points > low) & (frame.points < high)).all(-1)
        return held


def _spread(places: Array, order: NDArray[np.intp]) -> list[int]:
    """The best places, a hand's breadth apart."""
    kept: list[int] = []
    for k in order:
        if all(np.linalg.norm(places[k] - places[j]) > 0.08 for j in kept):
            kept.append(int(k))
        if len(kept) >= 8:
            break
    return kept


def _around(views: Sequence[tuple[Frame, NDArray[np.bool_]]]) -> Array:
    return np.concatenate([f.points[f.measured & ~m] for f, m in views])


def _shift(points: Array, onto: Array) -> Array | None:
    """The translation (3,) that brings points (n, 3) onto others of the same thing; None if it is none of a few cm."""
    tree, total = cKDTree(onto), np.zeros(3)
    sample = points[:: max(1, len(points) // 300)]
    for _ in range(8):
        gap, nearest = tree.query(sample + total)
        close = gap <= np.percentile(gap, 60)  # the wrist does not see all that the head sees
        step = np.median(onto[nearest[close]] - (sample + total)[close], axis=0)
        total += step
        if np.linalg.norm(step) < 2e-4:
            break
    return total if np.linalg.norm(total) < 0.04 else None
