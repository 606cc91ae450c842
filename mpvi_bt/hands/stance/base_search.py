"""The search for a base pose: candidates near a target, their filter, their ranking, and the budget of the checks.

Four searches use it: for a stance, the start of a course, a grip with two hands, and a set-down with two hands. Each
gives the offsets of the target from the base, the cost of a candidate, and what to check there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import NOTHING, Obstacles, Surroundings, Together
from mpvi_bt.ground.robot.drives import legs
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.hands.stance.refusals import deepest
from mpvi_bt.hands.stance.site import Site

KNOWN_M = 1.4  # our choice: walls this near to the base are among the obstacles; farther ones may not be
RUN_UPS_M = (0.4, 0.3, 0.2)  # our choice: so far a base drives straight in with both arms formed, the longest first
_Found = TypeVar("_Found")


@dataclass(frozen=True)
class ShortWays:
    """Which ways of the base are searched.

    Our choice: as a person would step around a chair. Longer ways are left to navigation.
    """

    # intermediate places if the straight way is barred: ahead and left of either end of it [m]
    vias_m: tuple[tuple[float, float], ...] = (
        (-0.35, 0.0),
        (-0.7, 0.0),
        (0.0, 0.5),
        (0.0, -0.5),
        (-0.35, 0.5),
        (-0.35, -0.5),
    )
    legs_m: tuple[float, ...] = (1.3, 1.0, 0.7)  # legs toward a place that is too far off, the longest first [m]
    headings: int = 16  # directions of such legs around the base
    nearer_m: float = 0.2  # least gain of such a leg [m]
    step_m: float = 0.12  # distance between two checks on a leg [m]
    step_rad: float = 0.3  # largest turn between two checks [rad]
    leaving: float = 0.3  # first part of a way that is not checked, as the base stands there already [ratio]
    turning: float = 1 / 3  # first part of a leg on which the corners of a base that is not round swing out [ratio]
    turning_samples: int = 4  # checks on that part


_WAYS = ShortWays()


@dataclass(frozen=True)
class WorkPlace:
    """Costs that make one base pose worse than another, by the work place seen from it."""

    ahead: float = 1.2  # cost of each meter off the most comfortable distance ahead; our choice
    lateral_m: float = 0.16  # most comfortable offset to the side of the hand [m]; our choice
    lateral: float = 0.5  # cost of each meter off that offset; our choice


WORK_PLACE = WorkPlace()


@dataclass(frozen=True)
class Alike:
    """When two base poses count as one: if one fails, the other one is skipped."""

    apart_m: float  # closer than this [m]
    turned_rad: float = math.inf  # and turned alike up to this [rad]

    def without(self, bases: Array, base: Array) -> NDArray[np.bool_]:
        """(n,) bool: which of base poses (n, 3) do not count as one with another base pose (3,)."""
        near = norm(bases[:, :2] - base[:2], axis=1) < self.apart_m
        return ~(near & (np.abs(kin.wrap(bases[:, 2] - base[2])) < self.turned_rad))


@dataclass(eq=False)
class SearchBudget:
    """Limits of the effort of one search.

    Attributes:
        most: Largest effort of this search.
        effort: Effort of all searches together; if None, this search does not count toward it.
        spent: Effort of this search so far.
        left: Number of unchecked candidates when a limit was reached.
    """

    most: float = math.inf
    effort: Effort | None = None
    spent: float = 0.0
    left: int = 0

    def take(self, effort: float) -> None:
        """Count the effort of a check."""
        self.spent += effort
        if self.effort is not None:
            self.effort.left -= effort

    @property
    def used_up(self) -> bool:
        """Whether a limit is reached."""
        return self.spent >= self.most or (self.effort is not None and self.effort.left <= 0)


def about(places: Array, yaw: Array | float, ahead: Array | float, left: Array | float) -> Array:
    """(..., 3) base poses with a yaw [rad] and a place (..., 2) at these offsets ahead and left [m]; all broadcast."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = places[..., 0] - (c * ahead - s * left), places[..., 1] - (s * ahead + c * left)
    return np.stack(np.broadcast_arrays(x, y, yaw), -1)


def ranked(cost: Array) -> NDArray[np.intp]:
    """(n,) indices of candidates by their cost, the cheapest first; equal costs keep their order."""
    return np.argsort(cost, kind="stable")


def before(
    place: Array, heading: float, offsets: tuple[ArrayLike, ArrayLike, ArrayLike], side: Side, here: Array,
    cost: Callable[[Array, Array, Array, Array], Array],
) -> Array:  # fmt: skip
    """(n, 3) base poses before a place (2,), the cheapest first.

    Args:
        place: The target of the hand, in the world.
        heading: Yaw of a base that faces it [rad].
        offsets: Distances to the place ahead, and toward the side of the hand [m]; turns off the heading [rad].
        side: The hand.
        here: (3,) the present base pose.
        cost: Cost of base poses, by their three offsets and the length of the way there [m], each (n,).
    """
    ahead, lateral, turn = (axis.ravel() for axis in np.meshgrid(*offsets, indexing="ij"))
    bases = about(place, heading + turn, ahead, lateral * SIGN[side])
    bases[:, 2] = kin.wrap(bases[:, 2])
    return bases[ranked(cost(ahead, lateral, turn, norm(bases[:, :2] - here[:2], axis=1)))]


def behind(base: Array, by_m: float) -> Array:
    """The base pose (3,) straight behind another one."""
    return about(base[:2], base[2], by_m, 0.0)


def first(
    bases: Array, check: Callable[[int], tuple[_Found | None, float]], alike: Alike, failed: Sequence[Array],
    budget: SearchBudget, reached: Callable[[int], bool] = lambda k: True,
) -> _Found | None:  # fmt: skip
    """The result of the first candidate that passes its check; None if there is none.

    Args:
        bases: (n, 3) candidates, the best first.
        check: Checks the candidate with this index. Returns its result or None, and the effort: 1 for a full check.
        alike: Candidates that count as one with a failed base pose are skipped.
        failed: Base poses (3,) that failed. `check` may add to it.
        budget: Limits of the effort.
        reached: Whether there is a way to the candidate with this index. It is asked before the budget.
    """
    left, known = np.arange(len(bases)), 0
    while True:
        for base in failed[known:]:
            left = left[alike.without(bases[left], base)]
        known = len(failed)
        if not len(left):
            return None
        k, rest = int(left[0]), left[1:]
        if reached(k):
            if budget.used_up:
                budget.left = len(left)
                return None
            found, effort = check(k)
            budget.take(effort)
            if found is not None:
                return found
        left = rest


@dataclass(frozen=True, eq=False)
class BaseSearch(Site):
    """A site, with base poses where the robot can stand, and ways to them."""

    def stands(self, bases: Array) -> NDArray[np.bool_]:
        """(n,) bool: base poses (n, 3) that are clear of everything as far as the base goes."""
        standing = self.motion.robot.hull.standing
        clear = self._standing.distance(_placed(standing[:, :3], bases)) >= standing[:, 3]
        return np.asarray(clear.all(1) & self._known(bases))

    def refuse_bases(self, bases: Array) -> None:
        """Note what base poses (n, 3) that do not stand are refused for."""
        known = self._known(bases)
        self.refusals.add("too far off", count=int((~known).sum()))
        if known.any():
            self.refusals.add("no room for the base", *(partial(self._blocked, base) for base in bases[known]))

    def _blocked(self, base: Array) -> Array:
        """(4,) the sphere of the base that would meet something at a pose (3,)."""
        standing = self.motion.robot.hull.standing
        return deepest(self._standing, _placed(standing[:, :3], base[None])[0], standing[:, 3], np.eye(4))

    def _known(self, bases: Array) -> NDArray[np.bool_]:
        return np.asarray(norm(bases[:, :2] - self.motion.felt.base_pose[:2], axis=1) <= KNOWN_M)

    def toward(self, goals: Array) -> list[Array] | None:
        """Base poses to drive to, nearer to some of `goals` (n, 3) that are too far off for what is known from here.

        None if there is none, or no way to come nearer to it.
        """
        here = self.motion.felt.base_pose
        far = goals[~self._known(goals)]
        if not len(far):
            return None
        ring = [
            (r * np.cos(a), r * np.sin(a))
            for r in _WAYS.legs_m
            for a in 2 * np.pi * np.arange(_WAYS.headings) / _WAYS.headings
        ]
        steps = np.column_stack([here[:2] + ring, np.full(len(ring), here[2])])
        steps = steps[self.stands(steps)]
        left = norm(steps[:, None, :2] - far[None, :, :2], axis=-1).min(1)
        now = float(norm(far[:, :2] - here[:2], axis=1).min())
        for k in np.argsort(left):
            if left[k] > now - _WAYS.nearer_m:
                return None
            if (route := self.route(here, steps[k])) is not None:
                return route
        return None

    def route(self, here: Array, goal: Array) -> list[Array] | None:
        """Base poses to drive to `goal` by: straight, or by one place on the way."""
        if self.drivable(here, goal):
            return [goal]
        for via in self._vias(here, goal):
            if self.stands(via[None])[0] and self.drivable(here, via) and self.drivable(via, goal):
                return [via, goal]
        return None

    def way_behind(self, base: Array, by_m: Sequence[float], straight_in: bool = False) -> list[Array] | None:
        """A route whose last base pose (3,) is behind `base`, at the first of some distances [m] with a way; else None.

        With `straight_in`, the way from there to `base` has to be free, too.
        """
        here = self.motion.felt.base_pose
        for back in (behind(base, by) for by in by_m):
            if straight_in and not self.drivable(back, base):
                continue
            if (route := self.route(here, back)) is not None:
                return route
        return None

    def _vias(self, here: Array, goal: Array) -> Iterator[Array]:
        """Base poses (3,) that the way may lead by; a base with corners may turn at one end of it only."""
        if len(self.motion.robot.base.corners):
            yield np.append(goal[:2], here[2])
            yield np.append(here[:2], goal[2])
        for start in (here, goal):
            for x, y in _WAYS.vias_m:
                c, s = np.cos(start[2]), np.sin(start[2])
                yield np.array([start[0] + c * x - s * y, start[1] + s * x + c * y, start[2]])

    def drivable(self, start: Array, goal: Array) -> bool:
        """Straight from start to goal: nothing in the way of the base, of a knee before it, or of what it carries."""
        key = start.tobytes(), goal.tobytes()
        if key not in self._legs:
            self._legs[key] = self._leg_free(start, goal)
        return self._legs[key]

    @cached_property
    def _legs(self) -> dict[tuple[bytes, bytes], bool]:
        return {}  # by both ends: ways to all base poses begin with the same few legs

    def _leg_free(self, start: Array, goal: Array) -> bool:
        robot = self.motion.robot
        ends = [start, *legs(robot, start, goal)]
        poses = np.concatenate([_on_leg(a, b, leaving=k == 0) for k, (a, b) in enumerate(pairwise(ends))])
        if not self.stands(poses).all():
            return False
        body = self.body(self.motion.torso, NOTHING)
        carrying = [(p[0], radii) for p, radii in (body.spheres(s, self.motion.arm(s)) for s in self.held)]
        if len(robot.base.corners):
            leaving, standing = _leaving(*ends[:2]), robot.hull.standing
            whole = np.concatenate([leaving, poses])
            kept = [
                (self._standing, standing[:, :3], standing[:, 3], leaving),
                (self.everything, *robot.links(body.torso), whole),
                *((self.underfoot, p, radii, whole) for p, radii in carrying),
            ]
            if not all(self._passes(*each, start) for each in kept):
                return False
        return all((self.everything.distance(_placed(p, poses)) > radii).all() for p, radii in carrying)

    @staticmethod
    def _passes(around: Obstacles, centers: Array, radii: Array, bases: Array, start: Array) -> bool:
        """Whether spheres in the base frame are clear at base poses (n, 3), or as near as at the start at the most."""
        slack = np.minimum(around.distance(_placed(centers, start[None])) - radii, 0.0) - 1e-6
        return bool((around.distance(_placed(centers, bases)) - radii >= slack).all())

    @cached_property
    def _standing(self) -> Obstacles:
        return Together([self.obstacles, self.underfoot, Surroundings(self.touched)])


def _placed(points: Array, bases: Array) -> Array:
    """(n, m, 3) in the world where points (m, 3) in the base frame are at base poses (n, 3)."""
    c, s = np.cos(bases[:, 2:]), np.sin(bases[:, 2:])
    x, y, z = points.T
    xy = bases[:, None, :2] + np.stack([c * x - s * y, s * x + c * y], -1)
    return np.concatenate([xy, np.broadcast_to(z[:, None], (*xy.shape[:2], 1))], -1)


def _on_leg(start: Array, goal: Array, leaving: bool) -> Array:
    """(n, 3) base poses on a straight leg that are worth a look; `leaving`: the first third is where it stands."""
    turn = kin.wrap(goal[2] - start[2])
    n = max(2, int(np.ceil(max(float(norm(goal[:2] - start[:2])) / _WAYS.step_m, abs(float(turn)) / _WAYS.step_rad))))
    shares = np.linspace(0, 1, n + 1)[1:]
    return _along(start, goal, shares[shares > _WAYS.leaving] if leaving and n > 2 else shares)


def _leaving(start: Array, goal: Array) -> Array:
    """(n, 3) base poses on the first third of a straight leg, where corners swing out."""
    return _along(start, goal, np.linspace(0, _WAYS.turning, _WAYS.turning_samples + 1)[1:])


def _along(start: Array, goal: Array, shares: Array) -> Array:
    way = np.append(goal[:2] - start[:2], kin.wrap(goal[2] - start[2]))
    return np.asarray(start + way * shares[:, None])
