"""Where a hand is to work: what is around, where the base can stand and drive to, and how the body then stands."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.held import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import NOTHING, Body, Obstacles, Surroundings, Together
from mpvi_bt.ground.robot.drives import legs
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.hands.stance.refusals import Refusals, deepest

FLOOR = box((0.0, 0.0, -0.1), (60.0, 60.0, 0.2))  # our choice: its top is the floor, and no house is as wide
KNOWN_M = 1.4  # our choice: walls this near to the base are among the obstacles; farther ones may not be
_VIEWS = 16  # our choice: views of the surroundings that are kept


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
class PayloadAside:
    """How an idle hand moves its payload aside."""

    # pitches of the torsos from which the payload should be in reach there [rad]; our choice
    pitches_rad: tuple[float, ...] = (0.0, 0.25, 0.5, 0.8, 1.1)
    # turns of the payload about the vertical [rad]; bent torsos need one for a wrist of little range; our choice
    turns_rad: tuple[float, ...] = (0.0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, np.pi)
    share: float = 0.2  # least part of the torsos that reach the payload, or another turn is tried [ratio]; our choice
    swivels: int = 12  # positions of the elbow; our choice


_ASIDE = PayloadAside()


@dataclass(frozen=True)
class PayloadMeanwhile:
    """Where the working hand holds its payload while the torso moves: out, or on to the work place.

    Our choice: a lowered or bent torso would meet a payload that hangs close to it, such as a sack from its handle.
    """

    # offsets out from where the payload is: x, y toward the hand's own side, z [m]
    out_m: tuple[tuple[float, float, float], ...] = ((0.12, 0.1, -0.12), (0.2, 0.1, -0.15), (0.3, 0.1, -0.2))
    # turns about the vertical out there, for a broad payload on the near side of its hand [rad]
    out_rad: tuple[float, ...] = (0.0, 0.8, -0.8)
    # offsets of the middle of the way on, if something over the place leaves no room out there [m]
    on_m: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.15),
        (-0.15, 0.0, 0.0),
        (0.15, 0.0, 0.15),
    )
    samples: int = 6  # samples of a payload's way while it keeps its place or rides along
    more: int = 12  # samples while it is moved out or on


_MEANWHILE = PayloadMeanwhile()


@dataclass(frozen=True)
class Comfort:
    """Costs that make one posture worse than another."""

    limit: float = 3.0  # cost of joints near their limits; our choice
    pitch: float = 0.6  # cost of each radian of the trunk's pitch; our choice
    lift: float = 0.5  # cost of each meter that the trunk is raised or lowered; our choice
    arm: float = 0.1  # cost of each radian that a joint of the arm moves; our choice


_COMFORT = Comfort()


@dataclass(frozen=True)
class WorkPlace:
    """Costs that make one base pose worse than another, by the work place seen from it."""

    ahead: float = 1.2  # cost of each meter off the most comfortable distance ahead; our choice
    lateral_m: float = 0.16  # most comfortable offset to the side of the hand [m]; our choice
    lateral: float = 0.5  # cost of each meter off that offset; our choice


WORK_PLACE = WorkPlace()


@dataclass(frozen=True, eq=False)
class Standing:
    """The body once the torso has moved, and how the other hand was kept level meanwhile."""

    body: Body
    level: Mapping[Side, list[Array]]


@dataclass(frozen=True, eq=False)
class Site:
    """What a search for a place to stand is about.

    Attributes:
        motion: The robot's present command and feeling.
        side: The hand that works.
        held: What each hand holds.
        obstacles: What is in the way, in the world, without what is held.
        touched: Those solids in the world that the hand works on: obstacles to the base and until contact.
        rng: Randomness of arm planning.
        tried: Base poses (3,) that did not do.
        effort: What it may take.
        underfoot: What is in the way of the base besides, in the world.
        refusals: What candidates are refused for.
    """

    motion: Motion
    side: Side
    held: Mapping[Side, Held]
    obstacles: Obstacles
    touched: Sequence[Solid]
    rng: np.random.Generator
    tried: list[Array] = field(default_factory=list)
    effort: Effort = field(default_factory=Effort)
    underfoot: Obstacles = field(default=NOTHING, kw_only=True)
    refusals: Refusals = field(default_factory=Refusals, kw_only=True)

    @property
    def other(self) -> Side | None:
        """The other hand, if it holds something: that has to stay level."""
        return next((s for s in self.held if s != self.side), None)

    @cached_property
    def holds(self) -> list[list[Array]]:
        """Ways to bring the other hand aside, each a path of postures; the first is to leave it where it is."""
        side = self.other
        if side is None:
            return [[]]
        body, holds = self.body(self.motion.torso, NOTHING), [[self.motion.arm(side)]]
        for at in self.motion.robot.aside * [1, SIGN[side], 1]:
            T = self._turned(self.motion.hand(side), side, at)
            if (path := arm_motion.plan_level(body, side, T)) is not None:
                holds.append(path)
        return holds

    def _turned(self, T: Array, side: Side, at: Array) -> Array:
        """T_base_tcp (4, 4) at a place (3,), as upright as before; turned if few torsos would have it in reach so."""
        robot = self.motion.robot
        turned = np.stack([kin.transform(matmul(kin.rot_z(turn), T[:3, :3]), at) for turn in _ASIDE.turns_rad])
        chests = kin.inverse(robot.chest(self.torsos(_ASIDE.pitches_rad)[0]))
        reached, _ = robot.arm_inverse(
            matmul(chests[:, None], turned[None]).reshape(-1, 4, 4), side, swivels=_ASIDE.swivels
        )
        shares = np.bincount(np.unique(reached) % len(turned), minlength=len(turned)) / len(chests)
        return np.asarray(turned[0 if shares[0] >= _ASIDE.share else int(shares.argmax())])

    def torsos(self, pitches: Sequence[float]) -> tuple[Array, Array]:
        """Joints (m, 4) and postures (m, 4) of the torsos that a search tries, at pitches [rad]."""
        robot = self.motion.robot
        postures = robot.postures(pitches, float(robot.trunk.posture(robot.travel_torso)[3]))
        return robot.trunk.joints(postures), postures

    def postures(
        self, goals: Array, costs: Sequence[float], pitches: Sequence[float], swivels: int
    ) -> tuple[Array, NDArray[np.intp], NDArray[np.intp], Array]:
        """Postures of torso and arm in which the hand that works reaches a goal, the most comfortable first.

        Args:
            goals: (k, 4, 4) T_base_tcp.
            costs: Preference, of each goal.
            pitches: Of the torso [rad].
            swivels: How many places of the elbow.

        Returns:
            Torsos (m, 4); the index of its torso (n,), the index of its goal (n,) and the arm (n, 7) of each posture.
        """
        robot = self.motion.robot
        torsos, postures = self.torsos(pitches)
        lift = robot.trunk.posture(self.motion.torso)[0]
        chests = kin.inverse(robot.chest(torsos))
        at, q = robot.arm_inverse(matmul(chests[:, None], goals[None]).reshape(-1, 4, 4), self.side, swivels=swivels)
        t, g = at // len(goals), at % len(goals)
        cost = (
            _COMFORT.limit * robot.limit_cost(q, self.side)
            + _COMFORT.pitch * postures[t, 2] + _COMFORT.lift * np.abs(postures[t, 0] - lift)
            + np.array(costs)[g] + _COMFORT.arm * np.abs(q - self.motion.arm(self.side)).sum(1)
        )  # fmt: skip
        rows = np.argsort(cost)
        return torsos, t[rows], g[rows], q[rows]

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

    def around(self, base: Array, touched: bool) -> Obstacles:
        """What is in the way and the floor in the frame of a base pose, with or without what the hand works on."""
        key = base.tobytes(), touched
        if key not in self._near:
            if len(self._near) >= _VIEWS:
                self._near.clear()
            self._near[key] = (self.everything if touched else self.rest).seen_from(kin.base(base))
        return self._near[key]

    @cached_property
    def _near(self) -> dict[tuple[bytes, bool], Obstacles]:
        return {}  # of the last base poses: at each one it is asked hundreds of times

    @cached_property
    def _standing(self) -> Obstacles:
        return Together([self.obstacles, self.underfoot, Surroundings(self.touched)])

    @cached_property
    def everything(self) -> Obstacles:
        """All that is in the way, what the hand works on and the floor too, in the world."""
        return Together([self.obstacles, Surroundings([FLOOR, *self.touched])])

    @cached_property
    def rest(self) -> Obstacles:
        """The same without what the hand works on."""
        return Together([self.obstacles, Surroundings([FLOOR])])

    def body(self, torso: Array, around: Obstacles, arms: Mapping[Side, Array] | None = None) -> Body:
        """The robot in a posture, with what it holds."""
        arms = arms or {s: self.motion.arm(s) for s in self.motion.robot.sides}
        key = torso.tobytes(), *(q.tobytes() for q in arms.values())
        if key not in self._bodies:
            held = {s: h.load for s, h in self.held.items()}
            self._bodies[key] = Body(self.motion.robot, torso, dict(arms), held)
        return self._bodies[key].amid(around)

    @cached_property
    def _bodies(self) -> dict[tuple[bytes, ...], Body]:
        return {}  # by posture, among nothing: a search takes the same ones at every base pose

    def stood(
        self, torso: Array, around: Obstacles, arms: Mapping[Side, Array], first: Array | None = None
    ) -> Standing | None:
        """The body once the torso has moved there, the other hand level if it holds something; None if it cannot.

        Args:
            torso: (4,) where to.
            around: What is in the way, in the base frame.
            arms: Postures (7,) of the arms before.
            first: T_base_tcp (4, 4) where the hand that works goes next: it may go there meanwhile, if what it holds is
                not filled, as that may be on a slant.
        """
        body = self.body(self.motion.torso, around, arms)
        now = {s: body.robot.tcp(body.torso, arms[s], s) for s in self.held}
        stays = {s: arm_motion.stay(T) for s, T in now.items()}
        # What the hands hold keeps its place while the torso moves, or rides along with it, or is brought out, or on.
        ways, on = [stays], []
        if self.side in self.held:
            ways.append({s: path for s, path in stays.items() if s != self.side})
            for turn, off in itertools.product(_MEANWHILE.out_rad, np.array(_MEANWHILE.out_m)):
                R = matmul(kin.rot_z(turn), now[self.side][:3, :3])
                out = kin.transform(R, now[self.side][:3, 3] + off * [1, SIGN[self.side], 1])
                ways.append({**stays, self.side: arm_motion.glide(now[self.side], out)})
            if first is not None and not self.held[self.side].laden:
                on = [
                    {**stays, self.side: arm_motion.glide(now[self.side], first, detour)}
                    for detour in np.array(_MEANWHILE.on_m)
                ]
        for k, hands in enumerate(ways + on):
            samples = _MEANWHILE.samples if k < 2 else _MEANWHILE.more
            key: tuple[int | bytes, ...] = (k, torso.tobytes(), *(q.tobytes() for q in arms.values()))
            if first is not None and k >= len(ways):
                key += (first.tobytes(),)
            if key not in self._swung:
                self._swung[key] = arm_motion.swing(body, torso, hands, samples)
            level = self._swung[key]
            if level is not None and arm_motion.swings_clear(body, torso, level, samples):
                after = {**arms, **{s: q[-1] for s, q in level.items()}}
                return Standing(replace(body, torso=torso, arms=after), level)
        return None

    @cached_property
    def _swung(self) -> dict[tuple[int | bytes, ...], dict[Side, list[Array]] | None]:
        return {}  # by way and postures, once they are asked for: the body does the same at every base pose


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


def base_clear(robot: RobotModel, around: Obstacles) -> bool:
    """Whether the base and the column above it keep clear of what is `around`, in the base frame."""
    standing = robot.hull.standing
    return bool((around.distance(standing[:, :3]) >= standing[:, 3]).all())
