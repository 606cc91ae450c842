"""Where to stand: a base pose, a torso posture and an arm path from which a hand can do what it has to.

Reach alone is not enough. A stance is one from which every waypoint of the hand is reachable without a jump of the
elbow, the arm, the idle arm, what is held, head and chest are clear of everything, and the base can drive there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mpvi_bt.robot import arm_motion, r1
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.collision import NOTHING, Body, Load, Obstacles, Surroundings, Together
from mpvi_bt.robot.motion import Motion
from mpvi_bt.robot.protocol import SIDES, Side
from mpvi_bt.robot.solids import Array, Solid, box

_LIFTS = (0.0, 0.1, 0.2, 0.3, 0.42, 0.55)
_PITCHES = (0.0, 0.25, 0.5, 0.8, 1.1)
_MARGIN_M = 0.012
_BASE_CLEAR_M = 0.30
_CHECKED_POSTURES = 30  # of one base pose
_CHECKED_BASES = 24
# Where the other hand may bring what it holds: x, y toward its own side, z [m]; reachable from a bent torso too.
_ASIDE = ((0.50, 0.30, 0.76), (0.52, 0.16, 0.76), (0.42, 0.36, 0.78), (0.50, 0.30, 0.90))
FLOOR = box((0.0, 0.0, -0.1), (60.0, 60.0, 0.2))
_HEIGHTS = np.array([[0.0, 0.0, z] for z in (0.04, 0.11, 0.18, 0.25)] + [[-0.1, 0.0, z] for z in (0.35, 0.5)])
_REACHES = np.array([_BASE_CLEAR_M] * 4 + [0.14] * 2)


@dataclass(frozen=True, eq=False)
class Held:
    """What a hand holds.

    Attributes:
        name: The thing.
        T_tcp_thing: (4, 4).
        solids: Of it and what lies in it, in the tcp frame.
        load: The same, for collision checks.
    """

    name: str
    T_tcp_thing: Array
    solids: tuple[Solid, ...]
    load: Load


@dataclass(frozen=True, eq=False)
class Option:
    """One way to do it, as the hand's waypoints in the world.

    Attributes:
        waypoints: (K, 4, 4) T_world_tcp, in order; a planned arm motion reaches the first, straight lines the others.
        contact: From this waypoint on the hand may touch what it works on.
        cost: Preference.
    """

    waypoints: Array
    contact: int
    cost: float = 0.0


@dataclass(frozen=True, eq=False)
class Stance:
    """A place and posture that work.

    Attributes:
        base: (3,) x, y [m], yaw [rad] in the world.
        torso: (4,).
        option: Index of the option that it serves.
        path: Postures (7,) of the arm from where it is to the first waypoint.
        waypoints: (K, 4, 4) T_base_tcp.
        aside: Postures (7,) that bring the other hand, with what it holds, out of the way first.
        level: Postures (7,) of the other arm, if its hand holds something, while the torso moves: they keep it level.
    """

    base: Array
    torso: Array
    option: int
    path: list[Array]
    waypoints: Array
    aside: list[Array]
    level: Mapping[Side, list[Array]]


@dataclass(frozen=True, eq=False)
class Standing:
    body: Body
    level: Mapping[Side, list[Array]]


@dataclass(frozen=True, eq=False)
class Search:
    """What a stance search is about.

    Attributes:
        motion: The robot's present command and feeling.
        side: The hand that works.
        held: What each hand holds.
        obstacles: What is in the way, in the world, without what is held.
        touched: Those solids in the world that the hand works on: obstacles to the base and until contact.
        rng: Randomness of arm planning.
    """

    motion: Motion
    side: Side
    held: Mapping[Side, Held]
    obstacles: Obstacles
    touched: Sequence[Solid]
    rng: np.random.Generator
    tried: list[Array] = field(default_factory=list)

    @property
    def other(self) -> Side | None:
        """The other hand, if it holds something: that has to stay level."""
        return next((s for s in self.held if s != self.side), None)

    @cached_property
    def _holds(self) -> list[list[Array]]:
        """Ways to bring the other hand aside, each a path of postures; the first is to leave it where it is."""
        side = self.other
        if side is None:
            return [[]]
        now, body = self.motion.hand(side), self.body(self.motion.torso, NOTHING)
        holds = [[self.motion.arm(side)]]
        for x, y, z in _ASIDE:
            T = kin.transform(now[:3, :3], (x, y * r1.SIGN[side], z))
            if (path := arm_motion.plan_level(body, side, T)) is not None:
                holds.append(path)
        return holds

    def find(self, focus_xy: Array, options: Sequence[Option], here_first: bool = False) -> Stance | None:
        """The nearest good stance for one of `options` about a place in the world (2,), or None.

        Args:
            focus_xy: What to stand about.
            options: Ways to do it; one is enough.
            here_first: Whether where the robot stands now is good enough if it serves, tried before or not.
        """
        if not options:
            return None
        here = self.motion.felt.base_pose
        if here_first:
            for hold in self._holds:
                if (found := self._at(here.copy(), options, hold)) is not None:
                    return found
        failed: list[Array] = list(self.tried)
        for base in _bases(here, focus_xy, self.side):
            # What failed here would fail a hand's breadth away; other sides of the thing are worth more.
            if any(np.linalg.norm(base[:2] - b[:2]) < 0.12 and abs(kin.wrap(base[2] - b[2])) < 0.5 for b in failed):
                continue
            if not self.drivable(here, base):
                continue
            for hold in self._holds:
                if (found := self._at(base, options, hold)) is not None:
                    return found
            failed.append(base)
            if len(failed) - len(self.tried) >= _CHECKED_BASES:
                break
        return None

    def around(self, base: Array, touched: bool) -> Obstacles:
        """What is in the way and the floor in the frame of a base pose, with or without what the hand works on."""
        return (self._all if touched else self._others).seen_from(kin.base(base))

    @cached_property
    def _standing(self) -> Obstacles:
        return Together([self.obstacles, Surroundings(self.touched)])

    @cached_property
    def _all(self) -> Obstacles:
        return Together([self.obstacles, Surroundings([FLOOR, *self.touched])])

    @cached_property
    def _others(self) -> Obstacles:
        return Together([self.obstacles, Surroundings([FLOOR])])

    def body(self, torso: Array, around: Obstacles, arms: Mapping[Side, Array] | None = None) -> Body:
        """The robot in a posture, with what it holds."""
        arms = arms or {s: self.motion.arm(s) for s in SIDES}
        return Body(torso, arms, {s: h.load for s, h in self.held.items()}, around)

    def drivable(self, start: Array, goal: Array) -> bool:
        """Straight from start to goal: nothing in the way of the base or of what it carries."""
        turn = kin.wrap(goal[2] - start[2])
        n = max(2, int(np.ceil(max(float(np.linalg.norm(goal[:2] - start[:2])) / 0.12, abs(float(turn)) / 0.3))))
        for u in np.linspace(0, 1, n + 1)[1:]:
            base = np.append(start[:2] + (goal[:2] - start[:2]) * u, start[2] + turn * u)
            if u > 0.3 or n == 2:
                if not base_clear(self._standing.seen_from(kin.base(base))):
                    return False
                body = self.body(self.motion.torso, self.around(base, touched=True))
                if self.held and not all(body.clearance(s, self.motion.arm(s)[None])[0][0] > 0 for s in self.held):
                    return False
        return True

    def _at(self, base: Array, options: Sequence[Option], hold: list[Array]) -> Stance | None:
        T = kin.inverse(kin.base(base))
        goals = np.stack([[T @ w for w in o.waypoints] for o in options])  # (G, K, 4, 4)
        torsos = np.array([(lift, 0.0, pitch, r1.TRAVEL_TORSO[3]) for lift in _LIFTS for pitch in _PITCHES])
        chests = kin.inverse(kin.chest(torsos))
        key = min(options[0].contact, goals.shape[1] - 1)
        targets = (chests[:, None] @ goals[None, :, key]).reshape(-1, 4, 4)
        at, q = kin.arm_inverse(targets, self.side, swivels=12)
        if not len(at):
            return None
        t, g = at // len(options), at % len(options)
        limits = r1.ARM_LIMITS[self.side]
        edge = np.maximum(np.abs(q - limits.mean(1)) / (np.ptp(limits, axis=1) / 2) - 0.8, 0).sum(1)
        cost = (
            3 * edge + 0.6 * torsos[t, 2] + 0.5 * np.abs(torsos[t, 0] - self.motion.torso[0])
            + np.array([o.cost for o in options])[g] + 0.1 * np.abs(q - self.motion.arm(self.side)).sum(1)
        )  # fmt: skip
        free_around, all_around = self.around(base, touched=False), self.around(base, touched=True)
        arms = {s: self.motion.arm(s) for s in SIDES}
        if self.other is not None:
            arms[self.other] = hold[-1]
            if not self.body(self.motion.torso, all_around, arms).free(self.other, hold[-1])[0]:
                return None
        seen: dict[tuple[int, int], int] = {}
        standing: dict[int, Standing | None] = {}
        for row in np.argsort(cost)[: 40 * _CHECKED_POSTURES]:
            where = (int(t[row]), int(g[row]))
            if seen.get(where, 0) >= 2:
                continue
            seen[where] = seen.get(where, 0) + 1
            if len(seen) > _CHECKED_POSTURES:
                break
            torso = torsos[t[row]]
            if where[0] not in standing:
                standing[where[0]] = self._stood(torso, all_around, arms)
            stood = standing[where[0]]
            if stood is None:
                continue
            path = self._reached(stood.body, free_around, goals[where[1]], options[where[1]].contact, key, q[row])
            if path is not None:
                return Stance(base, torso, where[1], path, goals[where[1]], hold, stood.level)
        return None

    def _stood(self, torso: Array, around: Obstacles, arms: Mapping[Side, Array]) -> Standing | None:
        """The body once the torso has moved there, the other hand level if it holds something; None if it cannot."""
        body = self.body(self.motion.torso, around, arms)
        hands = (
            {}
            if self.other is None
            else {self.other: arm_motion.stay(kin.tcp(body.torso, arms[self.other], self.other))}
        )
        level = arm_motion.sweep(body, torso, hands, samples=6)
        if level is None:
            return None
        return Standing(replace(body, torso=torso, arms={**arms, **{s: q[-1] for s, q in level.items()}}), level)

    def _reached(
        self, body: Body, free_around: Obstacles, goals: Array, contact: int, key: int, q_key: Array
    ) -> list[Array] | None:
        """The arm's path to the first waypoint if all waypoints are reachable and free from there on."""
        postures: dict[int, Array] = {key: q_key}
        for order in (range(key - 1, -1, -1), range(key + 1, len(goals))):
            for k in order:
                line = arm_motion.trace(body.torso, self.side, postures[k + 1 if k < key else k - 1], goals[k])
                if line is None:
                    return None
                postures[k] = line[-1]
        loose = replace(body, around=free_around)
        for k, q in postures.items():
            b = loose if k >= contact else body
            if not b.free(self.side, q, _MARGIN_M if k < contact else 0.0, grasping=k >= contact)[0]:
                return None
        return arm_motion.plan(body, self.side, postures[0], self.rng, margin=0.005)


def base_clear(around: Obstacles) -> bool:
    """Whether the base and the column above it keep clear of what is `around`, in the base frame."""
    return bool((around.distance(_HEIGHTS) >= _REACHES).all())


def _bases(here: Array, focus: Array, side: Side) -> Iterator[Array]:
    """Base poses about a place (2,) in the world, the nearest and plainest first."""
    bearing = float(np.arctan2(focus[1] - here[1], focus[0] - here[0]))
    ranked = []
    for distance in (0.46, 0.52, 0.58, 0.64, 0.70, 0.76):
        for lateral in (0.0, 0.10, 0.18, 0.26):
            for turn in (0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9, 1.3, -1.3, 1.8, -1.8, 2.4, -2.4, 3.0):
                yaw, y = bearing + turn, lateral * r1.SIGN[side]
                c, s = np.cos(yaw), np.sin(yaw)
                xy = focus - [c * distance - s * y, s * distance + c * y]
                near = 0.6 * float(np.linalg.norm(xy - here[:2])) + 0.3 * abs(turn)
                ranked.append(
                    (near + 1.2 * abs(distance - 0.58) + 0.5 * abs(lateral - 0.16), np.array([*xy, kin.wrap(yaw)]))
                )
    return iter([base for _, base in sorted(ranked, key=lambda r: r[0])])
