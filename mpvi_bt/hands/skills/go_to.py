"""Driving by sight: toward what is seen, straight, as long as there is room ahead. It keeps no map and plans no route.

Our choice throughout: it stands in for how a VLA drives, and is not meant to be better at it than a VLA is.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.stance.site import base_clear


@dataclass(frozen=True)
class Legs:
    """How the base drives to a thing by sight."""

    at_m: float = 0.85  # distance from the base to a reached thing, within the handoff distance of navigation [m]
    near_m: float = 1.2  # distance at which it stops before an obstacle, such as the table that the thing lies on [m]
    tilt_rad: float = 0.4  # tilt of the head [rad]; it sees the floor from 0.8 m on, and far things
    legs: int = 80  # legs before it gives up
    leg_m: float = 1.2  # longest leg, from one look to the next [m]
    beyond_m: float = 0.05  # overshoot of the last leg, so that it ends near enough [m]
    least_m: float = 0.15  # shortest leg [m]; with less room the way is barred
    ahead: int = 3  # legs in an open direction before it looks around again
    # directions off a barred way that are tried, to one side and then to the other [rad]
    aside_rad: tuple[float, ...] = (0.6, 1.2, 1.8)
    looks: int = 5  # looks in a full turn
    turned_rad: float = 0.05  # smaller turns are not made [rad]


_LEGS = Legs()


@dataclass(frozen=True)
class RoomAhead:
    """Which points of a picture are in the way of the base."""

    around_m: float = 0.02  # clearance around the base [m]
    loaded_m: float = 0.2  # clearance around a hand with a payload [m]
    # lowest and highest point of an obstacle [m]; lower is the floor, and the robot passes below higher ones
    height_m: tuple[float, float] = (0.06, 1.45)
    specks: int = 10  # pixels nearer than an obstacle that may be noise
    far_m: float = 9.0  # room ahead if no obstacle is seen [m]
    step_m: float = 0.15  # distance between two checks if the scene needs no looks [m]
    load_m: float = 0.4  # radius around a hand with a payload in which what moves along is the payload [m]
    along_m: float = 0.03  # largest change of a payload's depth [m]
    pixels: int = 5  # window in which its depth is compared [px]


_ROOM = RoomAhead()


def go_to(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Look around for a thing, wander where it is not in view, and drive up to it, stopping or turning where barred.

    Raises:
        MotionFailure: "not_found" if it did not get there in a good while.
    """
    known = work.scene.between() is not None or len(work.held()) == len(_loads(work))
    with contextlib.suppress(MotionFailure):
        if known:  # what it holds without knowing what stays as it is
            yield from settle(work)
    with contextlib.suppress(MotionFailure):
        yield from work.motion.stand(work.motion.bent(tilt=_LEGS.tilt_rad))
    yield from work.see("head")
    yield from _Drive(work, words["target"]).all()


class _Drive:
    """One drive to a thing."""

    def __init__(self, work: Work, phrase: str) -> None:
        """Begin where a picture was just taken."""
        self._work, self._phrase = work, phrase
        self._side = float(work.rng.choice((-1.0, 1.0)))  # to pass on what bars the way
        self._first = work.images["head"].depth if work.scene.needs_looks else None  # shows what is carried, too

    def all(self) -> Actions:
        """The whole of it."""
        for _ in range(_LEGS.legs):
            if (thing := self._nearest()) is None:
                yield from self._look_for()
                continue
            way = self._way(thing)
            if _length(way) > _LEGS.at_m and (yield from self._advance(way)):
                continue
            yield from self._turn(_bearing(way))
            if _length(way) <= _LEGS.near_m:
                with contextlib.suppress(MotionFailure):
                    yield from look_at(self._work, thing.name)
                return
            self._side = -self._side
        raise MotionFailure("not_found")

    def _nearest(self) -> Entry | None:
        """The nearest thing called so that is neither carried nor put away, if any is known."""
        loads = _loads(self._work)
        found = [e for e in self._work.scene.knowledge().find(self._phrase) if not e.held and e.inside is None]
        found = [e for e in found if all(_length(e.center[:2] - load) > _ROOM.load_m for load in loads)]
        return min(found, key=lambda e: _length(self._way(e)), default=None)

    def _way(self, thing: Entry) -> Array:
        """(2,) from the base to the nearest point of a thing on the floor [m]."""
        here = self._work.motion.felt.base_pose[:2]
        return np.asarray(np.clip(here, thing.lowest[:2], thing.highest[:2]) - here)

    def _advance(self, way: Array) -> Generator[Array, None, bool]:
        """A leg toward a thing or, where that is barred, past what bars it; returns whether it got anywhere."""
        yield from self._turn(_bearing(way))
        if (yield from self._leg(_length(way) - _LEGS.at_m + _LEGS.beyond_m)):
            return True
        if _length(way) <= _LEGS.near_m:
            return False
        for turn in (s * a for s in (self._side, -self._side) for a in _LEGS.aside_rad):
            yield from self._turn(_bearing(way) + turn)
            if (yield from self._leg()):
                return True
        return False

    def _leg(self, most_m: float = _LEGS.leg_m) -> Generator[Array, None, bool]:
        """Drive ahead as far as there is room, and look; returns whether it got anywhere."""
        leg_m = min(most_m, _LEGS.leg_m, self._room())
        if leg_m < min(_LEGS.least_m, most_m):
            return False
        motion, here = self._work.motion, self._work.motion.felt.base_pose.copy()
        with contextlib.suppress(MotionFailure):  # something that was not seen
            yield from motion.drive(here + leg_m * np.array([math.cos(here[2]), math.sin(here[2]), 0.0]))
        yield from self._work.see("head")
        return _length(motion.felt.base_pose[:2] - here[:2]) > leg_m / 2

    def _turn(self, yaw: float) -> Actions:
        """Turn on the spot and look there."""
        x, y, now = self._work.motion.felt.base_pose
        if abs(turn := float(kin.wrap(yaw - now))) > _LEGS.turned_rad:
            with contextlib.suppress(MotionFailure):  # what it does not turn to it does not see
                yield from self._work.motion.drive(np.array([x, y, now + turn]))
        yield from self._work.see("head")

    def _look_for(self) -> Actions:
        """Turn around until a thing is seen; where it is not, go on in some direction, an open one rather."""
        start, openness = float(self._work.motion.felt.base_pose[2]), []
        for k in range(_LEGS.looks):
            yield from self._turn(start + 2 * math.pi * k / _LEGS.looks)
            if self._nearest() is not None:
                return
            openness.append(self._room() + 0.1)
        chance = np.array(openness) / sum(openness)
        yield from self._turn(start + 2 * math.pi * int(self._work.rng.choice(_LEGS.looks, p=chance)) / _LEGS.looks)
        for _ in range(_LEGS.ahead):
            if not (yield from self._leg()) or self._nearest() is not None:
                return

    def _room(self) -> float:
        """How far the base can go ahead [m], by the picture just taken; by the scene, a leg at most, where none is."""
        work = self._work
        if self._first is None:
            near, steps = work.near(), np.arange(_LEGS.least_m, _LEGS.leg_m + 0.01, _ROOM.step_m)
            stops = (kin.transform(np.eye(3), (x, 0.0, 0.0)) for x in steps)
            free = [base_clear(work.motion.robot, near.seen_from(matmul(work.base, T))) for T in stops]
            return float(steps[free.index(False)]) - _ROOM.step_m if False in free else _LEGS.leg_m
        image = replace(work.images["head"], T_world_camera=work.motion.robot.head_camera(work.motion.felt.torso))
        p = image.points_world()  # (H, W, 3) in the base frame
        ahead, aside = (work.motion.robot.base.reach(yaw) + _ROOM.around_m for yaw in (0.0, math.pi / 2))
        own = np.hypot(p[..., 0], p[..., 1]) < max(ahead, aside)  # its folded hands
        along = _along(self._first, image.depth)
        front, left, right = ahead, aside, -aside
        for load in _loads(work):
            x, y = matmul(kin.inverse(work.base), np.append(load, (0.0, 1.0)))[:2]
            own |= along & (np.hypot(p[..., 0] - x, p[..., 1] - y) < _ROOM.load_m)
            front, left, right = (
                max(front, x + _ROOM.loaded_m),
                max(left, y + _ROOM.loaded_m),
                min(right, y - _ROOM.loaded_m),
            )
        barring = (
            (p[..., 1] < left) & (p[..., 1] > right) & (p[..., 2] > _ROOM.height_m[0]) & (p[..., 2] < _ROOM.height_m[1])
        )
        ahead_m = np.sort(p[barring & ~own & (p[..., 0] > 0), 0])
        far_m = float(ahead_m[min(_ROOM.specks, len(ahead_m) - 1)]) if len(ahead_m) else _ROOM.far_m
        return max(0.0, far_m - front)


def _loads(work: Work) -> list[Array]:
    """Where the hands are, (2,) each on the floor in the world [m], that hold something: it may not know what."""
    felt = work.motion.felt
    sides = [side for side in SIDES if squeezes(felt) or felt.holds(side)]
    return [work.hand(side)[:2, 3] for side in sides]


def _along(before: NDArray[np.float32], now: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) bool: pixels as deep as they or their neighbors were before: they may show what moves with the camera."""
    low, high = ndimage.minimum_filter(before, _ROOM.pixels), ndimage.maximum_filter(before, _ROOM.pixels)
    return np.asarray((now > low - _ROOM.along_m) & (now < high + _ROOM.along_m))


def _length(way: Array) -> float:
    return float(norm(way))


def _bearing(way: Array) -> float:
    return math.atan2(way[1], way[0])
