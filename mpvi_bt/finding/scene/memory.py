"""What has been seen and felt: things, told apart by place, and what the hands hold of them.

Things are known by phrase and number, such as "can of soda 1": a detector's masks carry no names, so which mask is
which thing in the next picture is told by where it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from mpvi_bt.finding.perception.detector import Detector, switch_of
from mpvi_bt.finding.scene.association import NEVER, associated
from mpvi_bt.finding.scene.deeds import Deeds
from mpvi_bt.finding.scene.frames import SEEN_PX, Frame, take
from mpvi_bt.finding.scene.hands import TOUCH, Hand, HandTracker, falls_into
from mpvi_bt.finding.scene.in_hand import InHand, is_of
from mpvi_bt.finding.scene.remembered import Remembered
from mpvi_bt.finding.scene.several_views import fitted
from mpvi_bt.finding.scene.thing import SeenThing, apart, is_again, is_part
from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.in_part import as_outside, in_part, shrunk
from mpvi_bt.finding.shapes.moving_parts import Door, to_and_behind
from mpvi_bt.finding.shapes.outlines import main_cluster
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.collision import Obstacles, Surroundings
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE
from mpvi_bt.ground.robot.motion import MotionFailure
from mpvi_bt.ground.robot.protocol import EMPTY_M, SIDES, CameraImage, Proprioception, Side
from mpvi_bt.ground.robot.robots import robot_named


@dataclass(frozen=True)
class Tracking:
    """Thresholds for matching masks to known things.

    Our choice: odometry does not drift at one standing place; after a drive it is off by its drift over some meters.
    """

    kept: int = 20  # remembered pictures
    moved: tuple[float, float] = (0.01, 0.015)  # a base that has moved farther stands at another place [m, rad]
    near_m: float = 0.12  # a mask this close to where a thing was is that thing, from the same place [m]
    far_m: float = 0.30  # the same after a drive [m]
    recent_m: float = 1.2  # driving after which an older picture is no longer fitted together with new ones [m]
    through_m: float = 0.06  # a hollow thing is gone if the depth is this far behind its middle [m]
    behind_m: float = 0.01  # another thing is gone if the depth is this far behind it, beside the noise of depth [m]
    beside_m: float = 0.025  # points this close to a vessel and its contents are theirs [m]
    above_m: float = 0.01  # if they are this far above its support [m]


_TRACK = Tracking()


@dataclass(frozen=True)
class Grasping:
    """Effects of grasping and releasing.

    Our choice, by errors of shapes.
    """

    spans: float = 0.8  # a thing smaller than this part of the gap between the fingers is likely not held [ratio]
    set_down_m: float = 0.03  # a payload released no higher than this stays where it is [m]
    deeper_m: float = 0.1  # a vessel in the hand may be this much deeper than it seems [m]
    recentered_m: float = 0.04  # closing fingers shift their payload by less than this [m]


_GRASPING = Grasping()


class Memory:
    """What pictures and proprioception have told of things since the policy was last reset."""

    def __init__(self, detector: Detector) -> None:
        """See through `detector`."""
        self._detector = detector
        self._remembered = Remembered()
        self._deeds = Deeds()
        self._hands = HandTracker[Shape]()
        self.forget(())

    def forget(self, phrases: Iterable[str]) -> None:
        """Begin anew, with no thing known; from now on look for `phrases`, of which no two mean the same things.

        What a hand holds is known again once it is seen there.
        """
        for side in SIDES:
            if (name := self._hands.held(side)) is not None:
                shape = self._shape(name).moved(kin.inverse(self._hands.tcps(side)[0]))
                self._deeds.taken[side] = self._things[name].phrase, shape
        self._phrases = tuple(dict.fromkeys(phrases))
        self._asked = (*self._phrases, *map(switch_of, self._phrases))
        self._frames: list[Frame] = []
        self._things: dict[str, SeenThing] = {}
        self._count: dict[str, int] = {}
        for hand in self._hands.grips:
            self._hands.take(hand, None)
        self._shown: dict[Hand, InHand] = {}  # what was first seen in a hand
        self._stand, self._stood, self._way_m = 0, np.full(3, np.inf), 0.0
        self._field: tuple[object, Obstacles] | None = None
        self._fronts: dict[str, tuple[list[Frame], list[Door]]] = {}  # of furniture, as these pictures show it
        self._bodies: dict[str, tuple[tuple[list[Frame], float], list[Solid]]] = {}  # likewise, seen down to so far
        self._ajar: dict[str, list[tuple[Frame, Door]]] = {}  # likewise, where something was seen to stand open
        self._others: dict[str, tuple[list[Frame | Shape], list[Solid]]] = {}  # in vessels, likewise
        self._trusting, self._remembering = False, True
        self._focus: Array | None = None  # what is worked on: obstacles are seen more finely around it

    def feel(self, felt: Proprioception) -> None:
        """Take in one step of proprioception: the base that moves, the hands that take and let go."""
        moved = felt.base_pose - self._stood
        if norm(moved[:2]) > _TRACK.moved[0] or abs(kin.wrap(moved[2])) > _TRACK.moved[1]:
            if self._stand:
                turned = robot_named(felt.robot).base.turn_m * abs(float(kin.wrap(moved[2])))
                self._way_m += float(np.hypot(*moved[:2])) + turned
            self._stand, self._stood = self._stand + 1, felt.base_pose.copy()
        for hand, holds in self._hands.feel(felt):
            if holds:
                self._take(hand)
            else:
                self._release(hand)

    def see(self, images: Mapping[str, CameraImage], felt: Proprioception) -> None:
        """Take in pictures."""
        self.feel(felt)
        for image in images.values():
            frame = take(image, felt, self._detector, self._asked, self._stand, self._way_m)
            self._frames = [*self._frames, frame][-_TRACK.kept :]
            self._associate(frame)
            if image.camera == "head":
                self._remembered.see(frame.image, frame.measured & ~self._loose(frame))
        for hand in [
            h for h, grip in self._hands.grips.items() if grip.name is None
        ]:  # they may hold what has been seen only now
            self._take(hand)
            if hand != "both" and (name := self._hands.held(hand)) is not None:
                thing = self._things[name]
                if not self._recognize(hand, thing):
                    self._shown[hand] = InHand(felt.gripper_width[hand])
                for frame, mask in thing.views:
                    self._regard(thing, frame, mask)
                thing.views = []
        for thing in self._things.values():  # what is seen in a vessel is in it
            if thing.inside is None and thing.name not in self._hands.names() and thing.shape.kind != "furniture":
                vessels = [n for n, t in self._things.items() if t.shape.kind == "vessel" and self._holds(t, thing)]
                if (vessel := next((n for n in vessels if self._lies_in(thing.shape, n)), None)) is not None:
                    self._put(thing, vessel)

    def _recognize(self, side: Side, thing: SeenThing) -> bool:
        """Take what is seen in a hand for what that took under an earlier prompt, unless it looks otherwise now.

        Vessels are shown anew: they swing by their rims and bails, and things are to fall into them.
        """
        phrase, shape = self._deeds.taken.get(side, ("", thing.shape))
        now = shape.moved(self._hands.tcps(side)[0])
        points = np.concatenate([np.empty((0, 3)), *(frame.of(mask) for frame, mask in thing.views)])
        if phrase != thing.phrase or shape.kind == "vessel" or not is_of(points, now):
            return False
        thing.shape = now
        self._hands.load(side, thing.name, now)
        return True

    def recognized(self, side: Side) -> bool:
        """Whether what a hand holds is known from when it was taken, and need not be shown from all sides."""
        known = self._hands.held(side) is not None
        return known and side in self._deeds.taken and side not in self._shown

    def _loose(self, frame: Frame) -> NDArray[np.bool_]:
        """(H, W) bool: where a picture shows what was asked for, but for furniture: that stays where it is."""
        fixed = [m for t in self._things.values() if t.shape.kind == "furniture" for f, m in t.views if f is frame]
        named = np.any([np.zeros(frame.robot.shape, bool), *(s.mask for s in frame.detections)], axis=0)
        return np.asarray(named & ~np.any([np.zeros(frame.robot.shape, bool), *fixed], axis=0))

    def _holds(self, vessel: SeenThing, thing: SeenThing) -> bool:
        """Whether a vessel is so much larger, seen from above, that a thing may be in it.

        One basket may be known by two phrases of a prompt, as two things in one place: neither is in the other.
        """
        outer, inner = (float(np.prod(np.ptp(self._shape(t.name).box(), axis=0)[:2])) for t in (vessel, thing))
        return vessel is not thing and outer > TOUCH.outer * inner

    def _take(self, hand: Hand) -> None:
        """A hand has closed on something, or both press something: the nearest thing, if one is known near it.

        What lies in a vessel may be nearer than its wall, but is too small to keep the fingers apart.
        """
        T, width = self._hands.tcps(hand), self._hands.width
        near = [
            (hand != "both" and np.ptp(self._shape(n).box(), axis=0).max() < _GRASPING.spans * width[hand], gap, n)
            for n, t in self._things.items()
            if (t.shape.kind != "furniture" or hand == "both")
            and (gap := max(self._gap(n, p) for p in T[:, :3, 3])) < TOUCH.reach_m(hand)
        ]
        if not near:
            self._hands.take(hand, None)
            return
        name = min(near)[2]
        thing, shape = self._things[name], self._shape(name)
        if hand != "both" and shape.kind != "vessel" and self._hands.holder(name) is None:
            aside = float(bounds(s.moved(kin.inverse(T[0])) for s in shape.solids).mean(0)[1])
            if abs(aside) < _GRASPING.recentered_m:  # fingers have brought it between them
                shape = shape.moved(kin.transform(np.eye(3), -aside * T[0, :3, 1]))
        self._take_along(thing)
        self._hands.take(hand, name)
        thing.inside, thing.shape = None, shape  # its views stay: where it stood it stands no more
        for n in (name, *self.within(name)):
            self._hands.load(hand, n, shape if n == name else self._shape(n))
        self._deeds.take(hand, thing.phrase, shape.box().mean(0), shape.kind == "vessel")

    def _take_along(self, vessel: SeenThing) -> None:
        """What pictures show in a vessel that a hand takes is as good as a part of the robot: it goes along."""
        if not (others := self._contents(vessel.name)):
            return
        solids = [*vessel.shape.solids, *others]
        low, high = bounds(solids) + [[-_TRACK.beside_m], [_TRACK.beside_m]]
        low[2] = vessel.shape.support_m + _TRACK.above_m
        around = Surroundings(solids)
        for frame in self._frames:
            rows, columns = np.nonzero(((frame.points > low) & (frame.points < high)).all(-1))
            own = around.distance(frame.points[rows, columns]) < _TRACK.beside_m
            frame.robot[rows[own], columns[own]] = True
        self._remembered.forget(low, high)
        self._field = None

    def _gap(self, name: str, p_world: Array) -> float:
        """Distance of a point (3,) to a thing [m]: to its shape, or to what is seen of it where that misses a part."""
        views = [v for v in self._things[name].views if v[0].stand == self._stand]
        seen = [norm(frame.of(mask) - p_world, axis=1) for frame, mask in views]
        shape = float(Surroundings(self._shape(name).solids).distance(p_world[None])[0])
        return min([shape, *(float(gaps.min()) for gaps in seen if len(gaps) >= SEEN_PX)])

    def _release(self, hand: Hand) -> None:
        """A hand has let go: what it held is where it was held, or has fallen into what is below it."""
        for n in self._hands.grips[hand].loads:
            if n in self._things:
                self._things[n].shape = self._shape(n)
        name = self._hands.release(hand).name
        self._shown.pop(hand, None)
        if name is not None and (taker := self._hands.holder(name)) is not None:
            self._deeds.pass_on(hand, taker)
        elif name in self._things and self._hands.felt is not None:
            thing = self._things[name]
            thing.views = []
            dropped = hand != "both" and self._hands.felt.gripper_width[hand] <= EMPTY_M
            if not dropped:
                self._fall(thing)
            self._deeds.put_down(hand, thing.phrase, self._shape(name).box(), dropped)
        self._deeds.empty(hand)

    def _fall(self, thing: SeenThing) -> None:
        """What was let go of falls into what is below it, if that is open there."""
        others = [other for other in self._things.values() if other is not thing]
        rooms = [(other, volume.aabb()) for other in others for volume in self.volumes(other.name)]
        low, high = thing.shape.box()
        if (k := falls_into((low + high) / 2, [room for _, room in rooms])) is None:
            return
        other, room = rooms[k]
        fall = float(low[2] - room[0, 2])
        thing.shape = thing.shape.moved(kin.transform(np.eye(3), (0.0, 0.0, -fall)))
        thing.stands = abs(fall) < _GRASPING.set_down_m
        self._put(thing, other.name)
        if other.shape.kind == "vessel":
            self._deeds.fill(thing.phrase, self._shape(other.name).box().mean(0), self._hands.holder(other.name))

    def _put(self, thing: SeenThing, container: str) -> None:
        """Take a thing, whose shape is known where it is now, to be in a container, and to be carried along with it."""
        thing.inside = container
        if (hand := self._hands.holder(container)) is not None:
            self._hands.load(hand, thing.name, thing.shape)

    def _known(self, name: str) -> SeenThing:
        """A thing. Raises MotionFailure "lost_sight" if it is not where it was seen any more."""
        if name not in self._things:
            raise MotionFailure("lost_sight")
        return self._things[name]

    def _shape(self, name: str) -> Shape:
        """A thing's shape now: what is in a hand moves with it."""
        thing, carried = self._known(name), self._hands.carried(name)
        return thing.shape if carried is None else carried

    def volumes(self, name: str) -> Sequence[Solid]:
        """The room inside a thing, as boxes or cylinders in the world."""
        return self._shape(name).volumes

    def within(self, name: str) -> Sequence[str]:
        """As `Scene` says: what was let go over it, or is seen in it."""
        return [n for n, t in self._things.items() if t.inside == name]

    def _associate(self, frame: Frame) -> None:
        """Tell which mask is which thing, by place; what should be seen and is not is gone."""
        for phrase in dict.fromkeys(d.phrase for d in frame.detections if d.phrase in self._phrases):
            masks = [d.mask for d in frame.detections if d.phrase == phrase]
            seen = [(m, main_cluster(frame.of(m))) for m in masks]
            seen = [(m, p) for m, p in seen if len(p) >= SEEN_PX]
            known = [t for t in self._things.values() if t.phrase == phrase]
            # Of what was never whole in a picture the part that was: where is that now?
            parts = {t.name: main_cluster(t.views[-1][0].of(t.views[-1][1])) for t in known
                     if t.views and all(f.cut(m) for f, m in t.views)}  # fmt: skip
            misfits = np.full((len(seen), len(known)), NEVER)
            for i, (_, points) in enumerate(seen):
                tree = cKDTree(points) if parts else None
                for k, thing in enumerate(known):
                    shape = self._shape(thing.name)
                    solids = shape.solids if shape.extent is None else [shape.extent]
                    gap = float(np.median(Surroundings(solids).distance(points)))
                    if tree is not None and thing.name in parts:
                        gap = min(gap, apart(parts[thing.name], tree))
                    fresh = bool(thing.views) and thing.views[-1][0].stand == frame.stand
                    gate = _TRACK.near_m if fresh or thing.name in self._hands.names() else _TRACK.far_m
                    misfits[i, k] = gap / gate if gap < gate else NEVER
            which = associated(misfits)
            done = {known[again].name for again in which if again is not None}
            for again, (mask, _) in zip(which, seen, strict=True):
                if again is not None:
                    self._update(known[again], frame, mask)
            for mask, points in (s for again, s in zip(which, seen, strict=True) if again is None):
                opened = [t for t in known if t.name not in done and self._opened(t, points)]
                if opened:
                    done.add(opened[0].name)
                    self._update(opened[0], frame, mask)
                else:
                    self._discover(phrase, frame, mask, points)
        for name in [n for n, t in self._things.items() if not (t.views and t.views[-1][0] is frame)]:
            self._missed(name, frame)
        for name in [n for n, t in self._things.items() if any(is_part(t, other) for other in self._things.values())]:
            del self._things[name]
        still = [
            t
            for t in self._things.values()
            if t.name not in self._hands.names() and t.inside not in self._hands.names()
        ]
        known = sorted(still, key=lambda t: -sum(f.image.camera == "head" for f, _ in t.views))
        for k, thing in enumerate(known):
            if (first := next((other for other in known[:k] if is_again(thing, other)), None)) is not None:
                del self._things[thing.name]
                for inner in (t for t in self._things.values() if t.inside == thing.name):
                    inner.inside = first.name

    def _opened(self, thing: SeenThing, points: Array) -> bool:
        """Whether points (n, 3) may be those of a thing that was closed and of which a door stands open now.

        Of what was known by its front alone, most of what shows then is far from that: its door, and what is behind.
        """
        rooms = [to_and_behind(door) for door in self.doors(thing.name)]
        return bool(rooms) and float(np.median(Surroundings(rooms).distance(points))) < _TRACK.near_m

    def doors(self, name: str) -> Sequence[Door]:
        """What is known of a thing that opens."""
        return ()

    def _contents(self, name: str) -> Sequence[Solid]:
        """What is seen in a vessel of things that nobody asked for."""
        return ()

    def _discover(self, phrase: str, frame: Frame, mask: NDArray[np.bool_], points: Array) -> None:
        shape = fit(points, frame.points[frame.measured & ~mask], frame.eye)
        if shape is not None:
            self._count[phrase] = self._count.get(phrase, 0) + 1
            name = f"{phrase} {self._count[phrase]}"
            view = (frame, mask)
            inner = [view] if shape.volumes else []
            self._things[name] = SeenThing(name, phrase, shape, [view], inner, lowest_m=shape.support_m)

    def _update(self, thing: SeenThing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """See a thing again; what is in hand is known better by the hand."""
        if thing.name in self._hands.names():
            self._regard(thing, frame, mask)
            return
        if thing.inside in self._hands.names():  # it has come along: older views show where it was
            thing.views = [(frame, mask)]
            shape = fitted(thing.views, thing.shape.support_m)
            if shape is not None and not self._lies_in(shape, str(thing.inside)):
                thing.shape, thing.inside = shape, None
                self._hands.take_out(thing.name)
            return
        thing.views = [(f, m) for f, m in thing.views if frame.way_m - f.way_m < _TRACK.recent_m][-5:]
        thing.views.append((frame, mask))
        here = [v for v in thing.views if v[0].stand == frame.stand]
        shape = fitted(here, thing.shape.support_m)
        if len(here) < len(thing.views) and (shape is None or shrunk(shape, thing.shape)):
            shape = fitted(thing.views, thing.shape.support_m) or shape  # something hides a part of it now
        if shape is not None:
            thing.lowest_m = min(thing.lowest_m, shape.support_m)
        if thing.shape.kind == "furniture" and (shape is None or in_part(shape, thing.shape)):
            return  # from near only a part of it is in view
        if thing.shape.kind == "vessel" and shape is not None and as_outside(shape, thing.shape):
            return  # from low or far off only its outside is
        if shape is not None:
            thing.inner = here if shape.volumes else thing.inner
            thing.shape, container, thing.inside = shape, thing.inside, None
            if container is not None and self._lies_in(shape, container):
                self._put(thing, container)

    def _regard(self, thing: SeenThing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """See what a hand holds: it is as good as a part of the robot; what was first seen there is seen better now."""
        for hand, shown in self._shown.items():
            if self._hands.held(hand) == thing.name:
                T = self._hands.tcps(hand)[0]
                shown.add(frame, mask, T)
                shape = shown.shape(T)
                # the wall of a vessel, seen from outside, is no reason to take it for massive
                if shape is not None and (shape.kind == "vessel" or thing.shape.kind != "vessel"):
                    thing.shape = shape
                    self._hands.load(hand, thing.name, shape)
        frame.robot[:] |= ndimage.binary_dilation(mask, iterations=2)
        self._field = None

    def _missed(self, name: str, frame: Frame) -> None:
        """Forget a thing where a picture shows what is behind it; what is hollow may be seen through to its floor."""
        thing, held = self._things[name], self._hands.names()
        if name in held or thing.inside in held or thing.shape.extent is not None:
            return
        depths = frame.depth_at(self._shape(name).box().mean(0))
        through = _TRACK.through_m if thing.shape.volumes else _TRACK.behind_m
        if depths is not None and depths[1] > depths[0] + through + DEPTH_NOISE.smoothed_m * depths[0] ** 2:
            del self._things[name]

    def _lies_in(self, shape: Shape, container: str) -> bool:
        """Whether what has a shape, where it is now, is in a container; how deep one in hand is may be out of view."""
        if container not in self._things:  # it was forgotten, not what was in it
            return False
        middle, deeper = shape.box().mean(0), _GRASPING.deeper_m if container in self._hands.names() else 0.0
        for volume in self.volumes(container):
            low, high = volume.aabb()
            if (
                (middle > low - [0.02, 0.02, 0.02 + deeper]).all()
                and (middle[:2] < high[:2] + 0.02).all()
                and middle[2] < high[2] + 0.06
            ):
                return True
        return False
