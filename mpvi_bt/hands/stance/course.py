"""Courses: what the hand leads along, or pushes, while the whole robot goes with it; and where to stand for one.

A door swings, a drawer slides, a chair is pushed: the hand follows the part and the base follows the hand, so that the
arm's posture hardly changes. A stance for a course is one from which that works from the first touch to the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body, Obstacles, Surroundings, Together
from mpvi_bt.ground.robot.protocol import Side, other
from mpvi_bt.hands.stance.base_search import WORK_PLACE, Alike, BaseSearch, SearchBudget, before, first
from mpvi_bt.hands.stance.postures import WAY_MARGINS_M
from mpvi_bt.hands.stance.site import FLOOR, Standing, base_clear


@dataclass(frozen=True)
class CourseParameters:
    """How a course is searched for.

    Our choice: as many checks as keep a search below some seconds.
    """

    pitches_rad: tuple[float, ...] = (0.0, 0.3, 0.6, 0.9, 1.2)  # pitches of the trunk [rad]
    # the arm takes its posture this far behind, in the open, and the base drives it in [m]
    run_ups_m: tuple[float, float, float] = (0.4, 0.25, 0.12)
    samples: int = 5  # samples of a course for collision checks
    between: int = 4  # steps between two samples, for checks of reach
    leap_rad: float = 0.5  # joint change between steps above which the elbow flips [rad]
    checked_postures: int = 12  # postures checked of one base pose
    most_effort: float = 24.0  # effort of one search; a base pose takes 1
    glance: float = 0.25  # effort of a base pose without a posture worth a look at its whole way
    margin_m: float = 0.01  # clearance of the arm [m]
    alike_m: float = 0.05  # ends of courses closer than this are one [m], or as many radians
    checked_run_up: tuple[float, ...] = (1.0, 0.66, 0.33, 0.0)  # parts of the run-up where the body is checked [ratio]
    swivels: int = 16  # positions of the elbow
    pitch_weight: float = 0.8  # weight of a radian of pitch in the distance of two torsos; a meter of lift has 1
    # distances of the base from the place of the touch [m]
    ahead_m: tuple[float, ...] = (0.40, 0.46, 0.52, 0.58, 0.64, 0.70, 0.77, 0.84)
    best_m: float = 0.56  # the most comfortable of them [m]
    laterals_m: tuple[float, ...] = (0.18, 0.10, 0.26, 0.02, 0.34, -0.08)  # offsets to the side of the hand [m]
    turns_rad: tuple[float, ...] = (0.0, 0.25, -0.25, 0.5, -0.5, 0.8, -0.8)  # turns from the course's heading [rad]
    turn_cost: float = 0.4  # cost of each radian of turn
    way_cost: float = 0.1  # cost of each meter of driving
    bent_rad: float = -0.4  # least bend of the elbow [rad]; a stretched arm cannot make up for a base that trails


_COURSE = CourseParameters()
_BEEN = Alike(0.05, 0.2)  # our choice: a base pose fails, too, that is so near to one that failed
_SAME = Alike(0.02, 0.05)  # our choice: base poses of two searches count as one that are no farther apart
_ELBOW = 3  # index of its joint
AROUND_M = 2.5  # our choice, an arm and the longest way of a base: obstacles farther from the robot matter to no course
SHORT_M = 0.10  # our choice: a fist or fingertips wait that far before what they push: a look is off by centimeters


@dataclass(frozen=True, eq=False)
class Course:
    """How a hand leads something along.

    Attributes:
        before: T_world_tcp (4, 4) short of the touch; from there a straight line leads to `hand(0)`.
        hand: Progress 0..1 to T_world_tcp (4, 4).
        carry: Progress 0..1 to the (4, 4) planar motion that has taken the base along by then; the identity at 0.
        moving: Progress 0..1 to what moves with the hand, in the world.
        heading: Direction to look at it from [rad].
        cost: Preference.
    """

    before: Array
    hand: Callable[[float], Array]
    carry: Callable[[float], Array]
    moving: Callable[[float], Sequence[Solid]]
    heading: float
    cost: float = 0.0

    @cached_property
    def touch(self) -> Array:
        """`hand(0)`: (4, 4)."""
        return self.hand(0.0)

    def pulled(self, x: float) -> Array:
        """`hand(x)` as the base of the start would see it after it went along: (4, 4)."""
        return matmul(kin.inverse(self.carry(x)), self.hand(x))

    def base(self, x: float, start: Array) -> Array:
        """(3,) where the base is by then if it stood at `start` (3,)."""
        turn = self.carry(x)
        T = matmul(turn, kin.base(start))
        return np.array([T[0, 3], T[1, 3], start[2] + np.arctan2(turn[1, 0], turn[0, 0])])


@dataclass(frozen=True, eq=False)
class CourseStart:
    """Where a course can begin.

    Attributes:
        base: (3,) x, y [m], yaw [rad] at the touch.
        route: Base poses (3,) on the way, the last of which is where the arm takes its first posture; straight lines
            between them, and from there to `base`.
        torso: (4,) at the touch.
        torso_after: (4,) at the end of the course.
        course: Index of the course.
        path: Postures (7,) of the arm, from where it is to short of the touch.
        aside: Postures (7,) that bring the other hand, with what it holds, out of the way first.
        level: Postures (7,) of the other arm, if its hand holds something, while the torso moves.
    """

    base: Array
    route: list[Array]
    torso: Array
    torso_after: Array
    course: int
    path: list[Array]
    aside: list[Array]
    level: Mapping[Side, list[Array]]


@dataclass(frozen=True, eq=False)
class CourseSearch(BaseSearch):
    """A stance search for courses; `touched` is the thing as it stands.

    Attributes:
        stays: What of the thing stays where it is during the course, in the world.
        bendable: Whether the torso may move during the course.
    """

    stays: Sequence[Solid] = ()
    bendable: bool = False

    def start(self, courses: Sequence[Course]) -> CourseStart | None:
        """A good place to begin one of `courses` from, which lead the same thing along; None if there is none."""
        if not courses:
            return None
        courses = [replace(c, hand=cache(c.hand), carry=cache(c.carry), moving=cache(c.moving)) for c in courses]
        focus = np.mean([c.touch[:2, 3] for c in courses], axis=0)
        bases = _bases(self.motion.felt.base_pose, focus, courses[0].heading, self.side)
        before = self.effort.failed.setdefault(self._sought(courses), [])
        for base in before:
            bases = bases[_SAME.without(bases, base)]
        routes: dict[int, list[Array]] = {}

        def reached(k: int) -> bool:
            if not self.stands(bases[k : k + 1])[0]:
                self.refuse_bases(bases[k : k + 1])
                return False
            if (route := self.way_behind(bases[k], _COURSE.run_ups_m)) is None:
                self.refusals.add("no way there")
                return False
            routes[k] = route
            return True

        def check(k: int) -> tuple[CourseStart | None, float]:
            spent = 0.0
            for hold in self.holds:
                found, effort = self._begin(bases[k], routes[k], courses, hold)
                spent += effort
                if found is not None:
                    self.effort.failed.clear()
                    return found, spent
            before.append(bases[k])
            return None, spent

        budget = SearchBudget(_COURSE.most_effort, self.effort)
        start = first(bases, check, _BEEN, self.tried, budget, reached)
        if budget.left:
            self.refusals.add("and more not looked at, as planning took too long")
        return start

    def _sought(self, courses: Sequence[Course]) -> bytes:
        """The same for searches for the same with the same hand, to the centimeter."""
        at = np.stack([course.hand(x)[:3, 3] for course in courses for x in (0.0, 1.0)])
        return self.side.encode() + np.round(at * 100).astype(int).tobytes() + np.round(courses[0].heading, 2).tobytes()

    def _then(self, course: Course, x: float, base: Array) -> Obstacles:
        """What is in the way as the course goes on, in the frame of a base that has gone along."""
        if (course, x) not in self._as_it_goes_on:
            solids = Surroundings([FLOOR, *self.stays, *course.moving(x)])
            self._as_it_goes_on[course, x] = Together([self.obstacles, solids])
        return self._as_it_goes_on[course, x].seen_from(kin.base(course.base(x, base)))

    @cached_property
    def _as_it_goes_on(self) -> dict[tuple[Course, float], Obstacles]:
        return {}  # what is in the way in the world, by course and progress: the same from every base pose

    def _fits(self, course: Course, base: Array) -> bool:
        """Whether the base can stand there and go along."""
        for x in np.linspace(0, 1, _COURSE.samples):
            solids = Surroundings([*self.stays, *course.moving(float(x))])
            around = Together([self.obstacles, solids]).seen_from(kin.base(course.base(float(x), base)))
            if not base_clear(self.motion.robot, around):
                return False
        return True

    def _begin(
        self, base: Array, route: list[Array], courses: Sequence[Course], hold: list[Array]
    ) -> tuple[CourseStart | None, float]:
        """A start there; and what looking for it took, 1 for a full check."""
        back = route[-1]
        T = kin.inverse(kin.base(base))
        touches = matmul(T, np.stack([course.touch for course in courses]))
        torsos, t, g, q = self.postures(
            touches, [course.cost for course in courses], self.torsos(_COURSE.pitches_rad), swivels=_COURSE.swivels
        )
        if not len(q):
            self.refusals.add("out of reach")
            return None, _COURSE.glance
        arms = {s: self.motion.arm(s) for s in self.motion.robot.sides}
        if self.other is not None:
            arms[self.other] = hold[-1]
        behind = self.around(back, touched=True)
        if self.other is not None and not self.body(self.motion.torso, behind, arms).free(self.other, hold[-1])[0]:
            self.refusals.add("other hand in the way")
            return None, _COURSE.glance
        fits: dict[int, bool] = {}
        alike: dict[tuple[float, ...], bool] = {}  # courses that end alike fit alike
        seen: dict[tuple[int, int], int] = {}
        standing: dict[int, Standing | None] = {}
        refused = "torso cannot get there"
        for row in range(len(q)):
            where = (int(t[row]), int(g[row]))
            course = courses[where[1]]
            if where[1] not in fits:
                end = tuple(np.round(course.base(1.0, base) / _COURSE.alike_m))
                if end not in alike:
                    alike[end] = self._fits(course, base)
                fits[where[1]] = alike[end]
            if not fits[where[1]] or seen.get(where, 0) >= 2:
                continue
            seen[where] = seen.get(where, 0) + 1
            if len(seen) > _COURSE.checked_postures:
                break
            torso = torsos[t[row]]
            if where[0] not in standing:
                standing[where[0]] = self.stood(torso, behind, arms)
            stood = standing[where[0]]
            if stood is None:
                continue
            refused = "no free line to the touch"
            short = self._touch(stood.body, base, back, course, q[row])
            if short is None:
                continue
            after = self._along(stood.body, base, course, q[row])
            if after is None:
                refused = "arm cannot go along"
                continue
            refused = "no path of the arm"
            for margin in WAY_MARGINS_M:
                path = arm_motion.plan(stood.body, self.side, short, self.rng, margin)
                if path is not None:
                    return CourseStart(base, route, torso, after, where[1], path, hold, stood.level), 1.0
        self.refusals.add(refused if standing else "no room to go along")
        return None, 1.0 if standing else _COURSE.glance

    def _touch(self, body: Body, base: Array, back: Array, course: Course, q: Array) -> Array | None:
        """The posture (7,) short of the touch, if the arm can be driven in with it and led on to the touch."""
        there = replace(body, around=self._then(course, 0.0, base), arms={**body.arms, self.side: q})
        if not there.free(self.side, q, grasping=True)[0]:
            return None
        T_base_before = matmul(kin.inverse(kin.base(base)), course.before)
        line = arm_motion.trace(body.robot, body.torso, self.side, q, T_base_before)
        if line is None:
            return None
        short = line[-1]
        for u in _COURSE.checked_run_up:
            at = base + (back - base) * u
            arms = {**body.arms, self.side: short}
            there = replace(body, around=self.around(at, touched=True), arms=arms)
            if (
                not there.free(self.side, short, _COURSE.margin_m)[0]
                or not there.trunk_free()
                or not self._idle_free(there)
            ):
                return None
        return short

    def _along(self, body: Body, base: Array, course: Course, q: Array) -> Array | None:
        """The torso (4,) at the end of the course, if everything stays free and reachable on the way."""
        xs = np.linspace(0, 1, (_COURSE.samples - 1) * _COURSE.between + 1)
        poses = [(float(x), matmul(kin.inverse(kin.base(base)), course.pulled(float(x)))) for x in xs]
        for end in [body.torso, *(self._bends(body, poses) if self.bendable else ())]:
            if self._goes_along(body, base, course, q, end, poses):
                return np.asarray(end, float)
        return None

    def _bends(self, body: Body, poses: Sequence[tuple[float, Array]]) -> Array:
        """(m, 4) torsos to bend to during a course, the nearest first, if the arm reaches its middle and its end so."""
        robot = body.robot
        now = robot.trunk.posture(body.torso)
        every = robot.postures(_COURSE.pitches_rad, float(now[3]))
        ends = robot.trunk.joints(
            every[np.argsort(matmul(np.abs(every[:, :3] - now[:3]), [1.0, 0.0, _COURSE.pitch_weight]))]
        )
        for x, T in (poses[len(poses) // 2], poses[-1]):
            chests = robot.chest(body.torso + (ends - body.torso) * x)
            reached, q = robot.arm_inverse(matmul(kin.inverse(chests), T), self.side, swivels=_COURSE.swivels)
            ends = ends[np.unique(reached[q[:, _ELBOW] <= _COURSE.bent_rad])]
        return ends

    def _goes_along(
        self, body: Body, base: Array, course: Course, q: Array, end: Array, poses: Sequence[tuple[float, Array]]
    ) -> bool:
        torsos = body.torso + (end - body.torso) * np.array([[x] for x, _ in poses])
        targets = matmul(kin.inverse(body.robot.chest(torsos)), np.stack([T for _, T in poses]))
        arms = body.robot.postures_along(targets, self.side, q, _COURSE.leap_rad)
        if arms is None or (arms[:, _ELBOW] > _COURSE.bent_rad).any():
            return False
        for (x, _), torso, arm in list(zip(poses, torsos, arms, strict=True))[:: _COURSE.between]:
            around = self._then(course, x, base)
            there = replace(body, torso=torso, around=around, arms={**body.arms, self.side: arm})
            if not (there.free(self.side, arm, grasping=True)[0] and there.trunk_free() and self._idle_free(there)):
                return False
        return True

    def _idle_free(self, body: Body) -> bool:
        idle = other(self.side)
        return idle not in body.arms or bool(body.clearance(idle, body.arms[idle][None])[0][0] > 0)


def _bases(here: Array, focus: Array, heading: float, side: Side) -> Array:
    """(n, 3) base poses before a place (2,) in the world, looking along `heading` or past it, the plainest first."""
    offsets = _COURSE.ahead_m, _COURSE.laterals_m, _COURSE.turns_rad

    def cost(ahead: Array, lateral: Array, turn: Array, way: Array) -> Array:
        off = WORK_PLACE.ahead * np.abs(ahead - _COURSE.best_m)
        off += WORK_PLACE.lateral * np.abs(lateral - WORK_PLACE.lateral_m)
        return off + _COURSE.turn_cost * np.abs(turn) + _COURSE.way_cost * way

    return before(focus, heading, offsets, side, here, cost)
