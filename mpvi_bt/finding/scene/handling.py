"""Identity and shape of payloads, and the places of things after release."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.frames import SEEN_PX, Frame, Pictures, grown
from mpvi_bt.finding.scene.hand_history import HandHistory
from mpvi_bt.finding.scene.hands import TOUCH, Hand, falls_into
from mpvi_bt.finding.scene.remembered import Remembered
from mpvi_bt.finding.scene.seen_parts import SeenParts
from mpvi_bt.finding.scene.thing_store import SeenThing, ThingStore
from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.outlines import main_cluster
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm, principal_axes
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side


@dataclass(frozen=True)
class Grasping:
    """Effects of grasping and releasing.

    Our choice, by errors of shapes.
    """

    spans: float = 0.8  # a thing smaller than this part of the gap between the fingers is likely not held [ratio]
    set_down_m: float = 0.03  # a payload released no higher than this stays where it is [m]
    recentered_m: float = 0.04  # closing fingers shift their payload by less than this [m]
    beside_m: float = 0.025  # points this close to a vessel and its contents are theirs [m]
    above_m: float = 0.01  # if they are this far above its support [m]


_GRASPING = Grasping()


@dataclass(frozen=True)
class InHandParameters:
    """Which part of a picture is the payload of a hand.

    Our choice, by things of the size that one hand holds.
    """

    reach_m: float = 0.35  # points of a mask farther than this from the hand are of another thing [m]
    kept: int = 8  # remembered pictures of a payload; what hangs in a hand swings a little
    alike: float = 0.9  # part of its points that lie where its shape has them [ratio]; with fewer it has slipped
    alike_m: float = 0.008  # largest distance of such a point from its surface [m]
    long: float = 2.0  # least length by width for a slanted payload [ratio]
    slanted_rad: tuple[float, float] = (0.06, 1.0)  # slants from upright [rad]; a payload across the hand is level


_HOLDING = InHandParameters()


class Handling:
    """Keeps a store of things up to date with what the hands do."""

    def __init__(
        self, things: ThingStore, pictures: Pictures, parts: SeenParts, history: HandHistory, remembered: Remembered
    ) -> None:
        """Update `things` and `history`. Payloads are removed from `pictures` and from `remembered` surfaces."""
        self._things, self._pictures, self._parts = things, pictures, parts
        self._hands, self._history, self._remembered = things.hands, history, remembered
        self._shown: dict[Hand, InHand] = {}  # what was first seen in a hand

    def feel(self, felt: Proprioception) -> None:
        """Take in one step of proprioception."""
        for hand, holds in self._hands.feel(felt):
            if holds:
                self._take(hand)
            else:
                self._release(hand)

    def find_payloads(self, felt: Proprioception) -> None:
        """Match unknown payloads to the things that pictures have shown in the hands since."""
        for hand in [h for h, grip in self._hands.grips.items() if grip.name is None]:
            self._take(hand)
            if hand != "both" and (name := self._hands.held(hand)) is not None:
                thing = self._things[name]
                if not self._recognize(hand, thing):
                    self._shown[hand] = InHand(felt.gripper_width[hand])
                for frame, mask in thing.views:
                    self.see_payload(thing, frame, mask)
                thing.views = []

    def see_payload(self, thing: SeenThing, frame: Frame, mask: NDArray[np.bool_]) -> None:
        """Add a view of a payload. Its pixels count as the robot's; it improves a shape first seen in the hand."""
        for hand, shown in self._shown.items():
            if self._hands.held(hand) == thing.name:
                T = self._hands.tcps(hand)[0]
                shown.add(frame, mask, T)
                shape = shown.shape(T)
                # the wall of a vessel, seen from outside, is no reason to take it for massive
                if shape is not None and (shape.kind == "vessel" or thing.shape.kind != "vessel"):
                    thing.shape = shape
                    self._hands.load(hand, thing.name, shape)
        self._pictures.give_to_robot(frame, grown(mask, 2))

    # ------------------------------------------------------------------------------------------ from prompt to prompt

    def keep_payloads(self) -> None:
        """Remember the payloads before all things are forgotten, so that they are recognized later."""
        for side in SIDES:
            if (name := self._hands.held(side)) is not None:
                shape = self._things.shape(name).moved(kin.inverse(self._hands.tcps(side)[0]))
                self._history.taken[side] = self._things[name].phrase, shape
        for hand in self._hands.grips:
            self._hands.take(hand, None)

    def recognized(self, side: Side) -> bool:
        """Whether the shape of a payload is known from an earlier prompt, so that no further view is needed."""
        known = self._hands.held(side) is not None
        return known and side in self._history.taken and side not in self._shown

    def _recognize(self, side: Side, thing: SeenThing) -> bool:
        """Use the shape of a payload from an earlier prompt, unless the payload looks different now.

        Vessels are viewed again: they swing by their rims and bails, and things have to fall into them.
        """
        phrase, shape = self._history.taken.get(side, ("", thing.shape))
        now = shape.moved(self._hands.tcps(side)[0])
        points = np.concatenate([np.empty((0, 3)), *(frame.of(mask) for frame, mask in thing.views)])
        if phrase != thing.phrase or shape.kind == "vessel" or not is_of(points, now):
            return False
        thing.shape = now
        self._hands.load(side, thing.name, now)
        return True

    # ------------------------------------------------------------------------------------------ taking

    def _take(self, hand: Hand) -> None:
        """Let a hand, or both hands, hold the nearest known thing."""
        name = self._nearest(hand)
        if name is None:
            self._hands.take(hand, None)
            return
        thing, shape = self._things[name], self._between_fingers(hand, name)
        self._take_along(thing)
        self._hands.take(hand, name)
        thing.inside, thing.shape = None, shape  # its views stay: where it stood it stands no more
        for n in (name, *self._things.within(name)):
            self._hands.load(hand, n, shape if n == name else self._things.shape(n))
        self._history.take(hand, thing.phrase, shape.box().mean(0), shape.kind == "vessel")

    def _nearest(self, hand: Hand) -> str | None:
        """The thing that a hand has closed on; None if no thing is near it.

        A thing in a vessel may be nearer than the vessel's wall, but it is too small to keep the fingers apart.
        """
        T, near = self._hands.tcps(hand), []
        for thing in self._things:
            if thing.shape.kind == "furniture" and hand != "both":
                continue
            gap = max(self._parts.gap(thing.name, p) for p in T[:, :3, 3])
            if gap < TOUCH.reach_m(hand):
                long_m = np.ptp(self._things.shape(thing.name).box(), axis=0).max()
                small = hand != "both" and bool(long_m < _GRASPING.spans * self._hands.width[hand])
                near.append((small, gap, thing.name))
        return min(near)[2] if near else None

    def _between_fingers(self, hand: Hand, name: str) -> Shape:
        """The shape of a thing in the hand. Closing fingers move it to their middle."""
        T, shape = self._hands.tcps(hand), self._things.shape(name)
        if hand == "both" or shape.kind == "vessel" or self._hands.holder(name) is not None:
            return shape
        aside = float(bounds(s.moved(kin.inverse(T[0])) for s in shape.solids).mean(0)[1])
        if abs(aside) >= _GRASPING.recentered_m:
            return shape
        return shape.moved(kin.transform(np.eye(3), -aside * T[0, :3, 1]))

    def _take_along(self, vessel: SeenThing) -> None:
        """Count the contents of a vessel that a hand takes as pixels of the robot, because they move along."""
        others = [s for name in self._parts.others(vessel.name) for s in self._parts.solids(name)]
        if not others:
            return
        solids = [*vessel.shape.solids, *others]
        low, high = bounds(solids) + [[-_GRASPING.beside_m], [_GRASPING.beside_m]]
        low[2] = vessel.shape.support_m + _GRASPING.above_m
        around = Surroundings(solids)
        for frame in self._pictures.frames:
            rows, columns = np.nonzero(((frame.points > low) & (frame.points < high)).all(-1))
            own = around.distance(frame.points[rows, columns]) < _GRASPING.beside_m
            self._pictures.give_to_robot(frame, (rows[own], columns[own]))
        self._remembered.forget(low, high)

    # ------------------------------------------------------------------------------------------ letting go

    def _release(self, hand: Hand) -> None:
        """Leave a payload where a hand has released it, or in the container below."""
        for n in self._hands.grips[hand].loads:
            if n in self._things:
                self._things[n].shape = self._things.shape(n)
        name = self._hands.release(hand).name
        self._shown.pop(hand, None)
        if name is not None and (taker := self._hands.holder(name)) is not None:
            self._history.pass_on(hand, taker)
        elif name is not None and name in self._things and self._hands.felt is not None:
            thing = self._things[name]
            thing.views = []
            dropped = hand != "both" and self._hands.felt.gripper_width[hand] <= self._hands.felt.grasp_m
            if not dropped:
                self._fall(thing)
            self._history.put_down(hand, thing.phrase, self._things.shape(name).box(), dropped)
        self._history.empty(hand)

    def _fall(self, thing: SeenThing) -> None:
        """Let a released thing fall into the open container below it."""
        others = [other for other in self._things if other is not thing]
        rooms = [(other, volume.aabb()) for other in others for volume in self._parts.volumes(other.name)]
        low, high = thing.shape.box()
        if (k := falls_into((low + high) / 2, [room for _, room in rooms])) is None:
            return
        other, room = rooms[k]
        fall = float(low[2] - room[0, 2])
        thing.shape = thing.shape.moved(kin.transform(np.eye(3), (0.0, 0.0, -fall)))
        thing.stands = abs(fall) < _GRASPING.set_down_m
        self._things.put_into(thing, other.name)
        if other.shape.kind == "vessel":
            middle: Array = self._things.shape(other.name).box().mean(0)
            self._history.fill(thing.phrase, middle, self._hands.holder(other.name))


class InHand:
    """Points of one payload, in the frame of the hand."""

    def __init__(self, width_m: float) -> None:
        """Begin with the points between the fingers, which stand `width_m` apart."""
        at = np.stack(np.meshgrid([-0.008, 0.0, 0.008], [-width_m / 2, 0.0, width_m / 2], [0.0]), -1)
        self._points: list[Array] = [at.reshape(-1, 3)]
        self._eyes: list[Array] = []  # of the head, in the hand's frame

    def add(self, frame: Frame, mask: NDArray[np.bool_], T_world_tcp: Array) -> None:
        """Add one picture, taken with the hand at `T_world_tcp` (4, 4)."""
        self.take_in(frame.of(mask), frame.eye if frame.image.camera == "head" else None, T_world_tcp)

    def take_in(self, points: Array, eye: Array | None, T_world_tcp: Array) -> None:
        """Add points (n, 3) in the world; `eye` (3,) is the place of the head's camera if it saw them."""
        T = kin.inverse(T_world_tcp)
        points = matmul(points, T[:3, :3].T) + T[:3, 3]
        points = points[norm(points, axis=1) < _HOLDING.reach_m]  # fingers part what they hold in two
        if len(points) < SEEN_PX:
            return
        self._points = [self._points[0], *self._points[1:][1 - _HOLDING.kept :], points]
        if eye is not None:
            self._eyes = [*self._eyes[1 - _HOLDING.kept :], matmul(T[:3, :3], eye) + T[:3, 3]]

    def shape(self, T_world_tcp: Array) -> Shape | None:
        """The shape of the payload, with the hand at `T_world_tcp` now; None if too little was seen.

        It is taken to be held upright, unless it is long and seen to hang on a slant: a bottle turns about the fingers.
        """
        if len(self._points) < 2:
            return None
        points = matmul(np.concatenate(self._points), T_world_tcp[:3, :3].T) + T_world_tcp[:3, 3]
        eyes = matmul(np.reshape(self._eyes, (-1, 3)), T_world_tcp[:3, :3].T) + T_world_tcp[:3, 3]
        R = _slant(points)
        points, eyes = matmul(points, R), matmul(eyes, R)
        # what was once seen from above stays seen
        shape = fit(points, np.zeros((0, 3)), eyes[eyes[:, 2].argmax()] if len(eyes) else np.zeros(3))
        return None if shape is None else shape.moved(kin.transform(R, (0.0, 0.0, 0.0)))


def _slant(points: Array) -> Array:
    """Rotation (3, 3) from upright to the direction of long hanging points (n, 3); none if they are not long."""
    spread, axes = principal_axes(main_cluster(points))
    along = axes[0] * np.sign(axes[0, 2])
    turn = np.cross([0.0, 0.0, 1.0], along)
    angle = float(np.arctan2(norm(turn), along[2]))
    if spread[0] < _HOLDING.long * spread[1] or not _HOLDING.slanted_rad[0] < angle < _HOLDING.slanted_rad[1]:
        return np.eye(3)
    return np.asarray(Rotation.from_rotvec(turn / norm(turn) * angle).as_matrix())


def is_of(points: Array, shape: Shape) -> bool:
    """Whether points (n, 3) of a payload lie on a shape: it has not slipped or turned in the hand."""
    if len(points) < SEEN_PX:
        return False
    gaps = np.abs(Surroundings(shape.solids).distance(main_cluster(points)))
    return bool(np.quantile(gaps, _HOLDING.alike) < _HOLDING.alike_m)
