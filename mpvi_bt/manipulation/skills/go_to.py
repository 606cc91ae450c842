"""Driving by sight: toward what is seen, straight, as long as there is room ahead. It keeps no map and plans no route.

Our choice throughout: it stands in for how a VLA drives, and is not meant to be better at it than a VLA is.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Generator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.manipulation.motion.carry import settle
from mpvi_bt.manipulation.motion.gaze import look_at
from mpvi_bt.manipulation.motion.work import Words, Work
from mpvi_bt.manipulation.stance.site import base_clear
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.motion import Actions, MotionFailure
from mpvi_bt.robot.protocol import SIDES
from mpvi_bt.robot.solids import Array
from mpvi_bt.robot.squeeze import squeezes
from mpvi_bt.scene.knowledge import Entry

_AT_M = 0.85  # from the base to the thing, within the handoff distance of navigation,
_AS_NEAR_AS_IT_GETS_M = 1.2  # or what is near enough where something is in the way, such as the table that it lies on
_TILT_RAD = 0.4  # of the head: the floor from 0.8 m on, and what is far
_LEGS = 80
_LEG_M = 1.2  # at most, from one look to the next
_LEAST_M = 0.15  # a way is barred if there is less room
_LEGS_AHEAD = 3  # before it looks around again
_ASIDE_RAD = (0.6, 1.2, 1.8)  # off the way to the thing where that is barred, to one side and then to the other
_LOOKS = 5  # a full turn
_AROUND_BASE_M = 0.02  # that are free around the base where it drives
_HEIGHT_M = (0.06, 1.45)  # of what is in the way; lower is the floor
_SPECKS = 10  # so many pixels may be noise
_LOAD_M = 0.4  # what is so near to a hand that holds something, and moves along, is what that holds,
_ALONG_M = 0.03  # its depth the same by this;
_AROUND_M = 0.2  # so much about such a hand the way has to be free, too


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
        yield from work.motion.stand(work.motion.bent(tilt=_TILT_RAD))
    yield from work.see("head")
    yield from _Drive(work, words["target"]).all()


class _Drive:
    """One drive to a thing."""

    def __init__(self, work: Work, phrase: str) -> None:
        """Begin where a picture was just taken."""
        self._work, self._phrase = work, phrase
        self._side = float(work.rng.choice((-1.0, 1.0)))  # to pass on what bars the way
        self._first = None if work.scene.exact else work.images["head"].depth  # shows what is carried, too

    def all(self) -> Actions:
        """The whole of it."""
        for _ in range(_LEGS):
            if (thing := self._nearest()) is None:
                yield from self._look_for()
                continue
            way = self._way(thing)
            if _length(way) > _AT_M and (yield from self._advance(way)):
                continue
            yield from self._turn(_bearing(way))
            if _length(way) <= _AS_NEAR_AS_IT_GETS_M:
                with contextlib.suppress(MotionFailure):
                    yield from look_at(self._work, thing.name)
                return
            self._side = -self._side
        raise MotionFailure("not_found")

    def _nearest(self) -> Entry | None:
        """The nearest thing called so that is neither carried nor put away, if any is known."""
        loads = _loads(self._work)
        found = [e for e in self._work.scene.knowledge().find(self._phrase) if not e.held and e.inside is None]
        found = [e for e in found if all(_length(e.center[:2] - load) > _LOAD_M for load in loads)]
        return min(found, key=lambda e: _length(self._way(e)), default=None)

    def _way(self, thing: Entry) -> Array:
        """(2,) from the base to the nearest point of a thing on the floor [m]."""
        here = self._work.motion.felt.base_pose[:2]
        return np.asarray(np.clip(here, thing.lowest[:2], thing.highest[:2]) - here)

    def _advance(self, way: Array) -> Generator[Array, None, bool]:
        """A leg toward a thing or, where that is barred, past what bars it; returns whether it got anywhere."""
        yield from self._turn(_bearing(way))
        if (yield from self._leg(_length(way) - _AT_M + 0.05)):
            return True
        if _length(way) <= _AS_NEAR_AS_IT_GETS_M:
            return False
        for turn in (s * a for s in (self._side, -self._side) for a in _ASIDE_RAD):
            yield from self._turn(_bearing(way) + turn)
            if (yield from self._leg()):
                return True
        return False

    def _leg(self, most_m: float = _LEG_M) -> Generator[Array, None, bool]:
        """Drive ahead as far as there is room, and look; returns whether it got anywhere."""
        leg_m = min(most_m, _LEG_M, self._room())
        if leg_m < min(_LEAST_M, most_m):
            return False
        motion, here = self._work.motion, self._work.motion.felt.base_pose.copy()
        with contextlib.suppress(MotionFailure):  # something that was not seen
            yield from motion.drive(here + leg_m * np.array([math.cos(here[2]), math.sin(here[2]), 0.0]))
        yield from self._work.see("head")
        return _length(motion.felt.base_pose[:2] - here[:2]) > leg_m / 2

    def _turn(self, yaw: float) -> Actions:
        """Turn on the spot and look there."""
        x, y, now = self._work.motion.felt.base_pose
        if abs(turn := float(kin.wrap(yaw - now))) > 0.05:
            with contextlib.suppress(MotionFailure):  # what it does not turn to it does not see
                yield from self._work.motion.drive(np.array([x, y, now + turn]))
        yield from self._work.see("head")

    def _look_for(self) -> Actions:
        """Turn around until a thing is seen; where it is not, go on in some direction, an open one rather."""
        start, openness = float(self._work.motion.felt.base_pose[2]), []
        for k in range(_LOOKS):
            yield from self._turn(start + 2 * math.pi * k / _LOOKS)
            if self._nearest() is not None:
                return
            openness.append(self._room() + 0.1)
        chance = np.array(openness) / sum(openness)
        yield from self._turn(start + 2 * math.pi * int(self._work.rng.choice(_LOOKS, p=chance)) / _LOOKS)
        for _ in range(_LEGS_AHEAD):
            if not (yield from self._leg()) or self._nearest() is not None:
                return

    def _room(self) -> float:
        """How far the base can go ahead [m], by the picture just taken; by the scene, a leg at most, where none is."""
        work = self._work
        if self._first is None:
            near, steps = work.near(), np.arange(_LEAST_M, _LEG_M + 0.01, 0.15)
            stops = (kin.transform(np.eye(3), (x, 0.0, 0.0)) for x in steps)
            free = [base_clear(work.motion.robot, near.seen_from(matmul(work.base, T))) for T in stops]
            return float(steps[free.index(False)]) - 0.15 if False in free else _LEG_M
        image = replace(work.images["head"], T_world_camera=work.motion.robot.head_camera(work.motion.felt.torso))
        p = image.points_world()  # (H, W, 3) in the base frame
        ahead, aside = (work.motion.robot.base.reach(yaw) + _AROUND_BASE_M for yaw in (0.0, math.pi / 2))
        own = np.hypot(p[..., 0], p[..., 1]) < max(ahead, aside)  # its folded hands
        along = _along(self._first, image.depth)
        front, left, right = ahead, aside, -aside
        for load in _loads(work):
            x, y = matmul(kin.inverse(work.base), np.append(load, (0.0, 1.0)))[:2]
            own |= along & (np.hypot(p[..., 0] - x, p[..., 1] - y) < _LOAD_M)
            front, left, right = max(front, x + _AROUND_M), max(left, y + _AROUND_M), min(right, y - _AROUND_M)
        barring = (p[..., 1] < left) & (p[..., 1] > right) & (p[..., 2] > _HEIGHT_M[0]) & (p[..., 2] < _HEIGHT_M[1])
        ahead_m = np.sort(p[barring & ~own & (p[..., 0] > 0), 0])
        far_m = float(ahead_m[min(_SPECKS, len(ahead_m) - 1)]) if len(ahead_m) else 9.0
        return max(0.0, far_m - front)


def _loads(work: Work) -> list[Array]:
    """Where the hands are, (2,) each on the floor in the world [m], that hold something: it may not know what."""
    felt = work.motion.felt
    sides = [side for side in SIDES if squeezes(felt) or felt.holds(side)]
    return [work.hand(side)[:2, 3] for side in sides]


def _along(before: NDArray[np.float32], now: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) bool: pixels as deep as they or their neighbors were before: they may show what moves with the camera."""
    low, high = ndimage.minimum_filter(before, 5), ndimage.maximum_filter(before, 5)
    return np.asarray((now > low - _ALONG_M) & (now < high + _ALONG_M))


def _length(way: Array) -> float:
    return float(norm(way))


def _bearing(way: Array) -> float:
    return math.atan2(way[1], way[0])
