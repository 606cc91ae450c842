"""Where to stand: a base pose, a torso posture and an arm path from which a hand can do what it has to.

Reach alone is not enough. A stance is one from which every waypoint of the hand is reachable without a jump of the
elbow, the arm, the idle arm, what is held, head and chest are clear of everything, and the base can drive there. What
is cheap to refute comes first: the hand alone, then the base alone, then postures, then paths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.manipulation import hand
from mpvi_bt.robot import arm_motion, r1
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.collision import NOTHING, Body, Load, Obstacles, Surroundings, Together
from mpvi_bt.robot.motion import Motion
from mpvi_bt.robot.protocol import SIDES, Side, other
from mpvi_bt.robot.solids import Array, Solid, box

_LIFTS = (0.0, 0.1, 0.2, 0.3, 0.42, 0.55)
_PITCHES = (0.0, 0.25, 0.5, 0.8, 1.1)
_MARGIN_M = 0.012
# Of the arm's way to where the hand works, the wide berth first: an arm in motion runs up to 2 cm beside its path.
WAY_MARGINS_M = (0.03, 0.005)
_BASE_CLEAR_M = 0.30
_KNOWN_M = 1.4  # from here; farther off there may be walls that are not among the obstacles
_TOUCH_M = 0.008  # the spheres reach that far beyond what they stand for: what may be near a hand that touches
_RANKED_POSTURES = 1200  # of one base pose, checked where the hand works
_GLANCED_POSTURES = 80  # of those, looked at where the other waypoints are, and found wanting,
_REFUSED = 4  # as many for one option
_CHECKED_POSTURES = 16  # of those that are left, on the whole way
_GLANCE = 0.25  # of a full check: no posture was clear even where the hand works
_CHECKED_BASES = 12  # of one spacing
SPACINGS = ((0.12, 0.5), (0.05, 0.25))  # [m, rad] between base poses: what fails here fails a hand's breadth away
_STEP_M = 0.06  # between checks on the way in
_VIAS = ((-0.35, 0.0), (-0.7, 0.0), (0.0, 0.5), (0.0, -0.5), (-0.35, 0.5), (-0.35, -0.5))  # ahead and left of here [m]
# Where the other hand may bring what it holds: x, y toward its own side, z [m]; reachable from a bent torso too.
_ASIDE = ((0.50, 0.30, 0.76), (0.52, 0.16, 0.76), (0.42, 0.36, 0.78), (0.50, 0.30, 0.90))
FLOOR = box((0.0, 0.0, -0.1), (60.0, 60.0, 0.2))
_HEIGHTS = np.array(
    [[0.0, 0.0, z] for z in (0.04, 0.11, 0.18, 0.25)] + [[-0.1, 0.0, z] for z in (0.35, 0.5, 0.65, 0.8)]
)
_REACHES = np.array([_BASE_CLEAR_M] * 4 + [0.14] * 4)


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
        run_up_m: The arm takes its first posture that far behind, in the open, and the base drives it straight in; what
            is done leaves the same way.
        load: What the hand has after the contact, in the tcp frame; None if nothing.
        opening_m: Between the fingers while they are open: up to the contact if the hand takes something, from the
            contact on if it lets go.
    """

    waypoints: Array
    contact: int
    cost: float = 0.0
    run_up_m: float = 0.0
    load: Load | None = None
    opening_m: float = hand.FULL_M


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
        route: (n, 3) base poses to drive to, one after the other. At the last one the arm takes its posture; where that
            is not `base` the base then drives straight in.
        opening_m: Of the option.
    """

    base: Array
    torso: Array
    option: int
    path: list[Array]
    waypoints: Array
    aside: list[Array]
    level: Mapping[Side, list[Array]]
    route: list[Array]
    opening_m: float

    @property
    def runs_up(self) -> bool:
        """Whether the base drives in with the arm in its posture, and out again."""
        return bool(np.linalg.norm(self.route[-1][:2] - self.base[:2]) > 0.05)


@dataclass(frozen=True, eq=False)
class Standing:
    """The body once the torso has moved, and how the other hand was kept level meanwhile."""

    body: Body
    level: Mapping[Side, list[Array]]


@dataclass(eq=False)
class Effort:
    """What stance searches may still take, counted and not timed so that the same seed plans the same motions.

    Attributes:
        left: Base poses that may still be checked in full; what is played earns more.
        failed: Base poses (3,) that did not do, by what was searched for, since a search last found something: a retry
            goes on where the last try ended.
    """

    left: float = np.inf
    failed: dict[bytes, list[Array]] = field(default_factory=dict)


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
        tried: Base poses (3,) that did not do.
        effort: What it may take.
    """

    motion: Motion
    side: Side
    held: Mapping[Side, Held]
    obstacles: Obstacles
    touched: Sequence[Solid]
    rng: np.random.Generator
    tried: list[Array] = field(default_factory=list)
    effort: Effort = field(default_factory=Effort)

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

    def find(
        self, focus_xy: Array, options: Sequence[Option], here_first: bool = False, spacings: Sequence[int] = (0, 1)
    ) -> Stance | None:
        """The nearest good stance for one of `options` about a place in the world (2,), or None.

        Args:
            focus_xy: What to stand about.
            options: Ways to do it; one is enough.
            here_first: Whether a stance that needs no drive is good enough if it serves, tried before or not.
            spacings: How closely to look, one after the other: 0 coarsely, 1 finely.
        """
        if self.effort.left <= 0:
            return None
        options = [self._as_it_stands(option) for option in options]
        able = [k for k, option in enumerate(options) if self.fits(option)]
        if not able:
            return None
        here = self.motion.felt.base_pose
        if here_first and (found := self._here(here, options, able)) is not None:
            return found
        bases = _bases(here, focus_xy, self.side)
        bases = bases[self._stands(bases)]
        before = self.effort.failed.setdefault(self._sought(options, able), [])
        failed: list[Array] = [*self.tried, *before]
        for apart_m, apart_rad in (SPACINGS[k] for k in spacings):
            checked = 0.0
            for base in bases:
                if any(np.linalg.norm(base[:2] - b[:2]) < apart_m and abs(kin.wrap(base[2] - b[2])) < apart_rad
                       for b in failed):  # fmt: skip
                    continue
                if self.effort.left <= 0:
                    return None
                found, effort = self._from(here, base, options, able)
                self.effort.left -= effort
                if found is not None:
                    self.effort.failed.clear()
                    return found
                failed.append(base)
                if effort:
                    before.append(base)
                checked += effort
                if checked >= _CHECKED_BASES:
                    break
        return None

    def _sought(self, options: Sequence[Option], able: Sequence[int]) -> bytes:
        """The same for searches for the same with the same hand, to the centimeter."""
        at = np.stack([options[k].waypoints[min(options[k].contact, len(options[k].waypoints) - 1)] for k in able])
        return self.side.encode() + np.round(at[:, :3, 3] * 100).astype(int).tobytes()

    def _here(self, here: Array, options: Sequence[Option], able: Sequence[int]) -> Stance | None:
        """A stance whose arm takes its posture where the robot stands."""
        ahead = np.array([np.cos(here[2]), np.sin(here[2]), 0.0])
        for run_up in sorted({options[k].run_up_m for k in able}):
            some = [k for k in able if options[k].run_up_m == run_up]
            lane = _lane(here, here + ahead * run_up)
            if run_up and not self._stands(lane).all():
                continue
            for hold in self._holds:
                found, _ = self._at(lane, [here.copy()], options, some, hold)
                if found is not None:
                    return found
        return None

    def fits(self, option: Option) -> bool:
        """Whether the bare hand, with what it holds, is clear of everything at each waypoint, whatever the arm does."""
        takes = option.load is not None
        for k, T in enumerate(option.waypoints):
            around = self._all if k < option.contact else self._others
            parts = [(*hand.palm(), _TOUCH_M)]
            if k <= option.contact if takes else k >= option.contact:
                parts.append((*hand.fingers(option.opening_m), 0.0))
            load = None if k == option.contact else self._load(k, option)
            if load is not None:
                parts.append((load.centers, load.radii, _TOUCH_M))
            for centers, radii, slack in parts:
                if (around.distance(centers @ T[:3, :3].T + T[:3, 3]) < radii - slack).any():
                    return False
        return True

    def _as_it_stands(self, option: Option) -> Option:
        """An option whose load is no larger than the room where it stands, next to a wall or among other things."""
        if option.load is None or option.contact >= len(option.waypoints):
            return option
        T = option.waypoints[option.contact]
        room = self._others.distance(option.load.centers @ T[:3, :3].T + T[:3, 3])
        return replace(option, load=option.load.within(room + _TOUCH_M / 2))

    def _load(self, k: int, option: Option) -> Load | None:
        if k > option.contact:
            return option.load
        return self.held[self.side].load if self.side in self.held else None

    def _stands(self, bases: Array) -> NDArray[np.bool_]:
        """(n,) bool: base poses (n, 3) that are clear of everything as far as the base goes."""
        ahead = np.stack([np.cos(bases[:, 2]), np.sin(bases[:, 2])], -1)
        p = np.empty((len(bases), len(_HEIGHTS), 3))
        p[..., :2] = bases[:, None, :2] + ahead[:, None] * _HEIGHTS[:, :1]
        p[..., 2] = _HEIGHTS[:, 2]
        known = np.linalg.norm(bases[:, :2] - self.motion.felt.base_pose[:2], axis=1) <= _KNOWN_M
        return np.asarray((self._standing.distance(p) >= _REACHES).all(1) & known)

    def _from(
        self, here: Array, base: Array, options: Sequence[Option], able: Sequence[int]
    ) -> tuple[Stance | None, float]:
        """A stance there; and what looking for it took, 1 for a full check."""
        effort = 0.0
        ways: dict[float, list[int]] = {}
        for k in able:
            ways.setdefault(options[k].run_up_m, []).append(k)
        for run_up, some in ways.items():
            ready = base - np.array([np.cos(base[2]), np.sin(base[2]), 0.0]) * run_up
            lane = _lane(ready, base)
            if not self._stands(lane).all() or (route := self.route(here, ready)) is None:
                continue
            effort = max(effort, _GLANCE)
            for hold in self._holds:
                found, looked = self._at(lane, route, options, some, hold)
                if found is not None:
                    return found, 1.0
                effort = 1.0 if looked else effort
        return None, effort

    def route(self, here: Array, goal: Array) -> list[Array] | None:
        """Base poses to drive to `goal` by: straight, or by one place on the way."""
        if self.drivable(here, goal):
            return [goal]
        for start in (here, goal):
            for x, y in _VIAS:
                c, s = np.cos(start[2]), np.sin(start[2])
                via = np.array([start[0] + c * x - s * y, start[1] + s * x + c * y, start[2]])
                if self._stands(via[None])[0] and self.drivable(here, via) and self.drivable(via, goal):
                    return [via, goal]
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
        shares = [u for u in np.linspace(0, 1, n + 1)[1:] if u > 0.3 or n == 2]
        poses = np.stack([np.append(start[:2] + (goal[:2] - start[:2]) * u, start[2] + turn * u) for u in shares])
        if not self._stands(poses).all():
            return False
        for base in poses if self.held else ():
            body = self.body(self.motion.torso, self.around(base, touched=True))
            if not all(body.clearance(s, self.motion.arm(s)[None])[0][0] > 0 for s in self.held):
                return False
        return True

    def _at(self, lane: Array, route: list[Array], options: Sequence[Option], able: Sequence[int], hold: list[Array]
            ) -> tuple[Stance | None, bool]:  # fmt: skip
        """A stance at the end of a lane (n, 3) of base poses that lead straight in, from where the arm moves.

        Also whether that took more than a glance.
        """
        base = lane[-1]
        T = kin.inverse(kin.base(base))
        goals = [np.stack([T @ w for w in options[k].waypoints]) for k in able]
        torsos = np.array([(lift, 0.0, pitch, r1.TRAVEL_TORSO[3]) for lift in _LIFTS for pitch in _PITCHES])
        chests = kin.inverse(kin.chest(torsos))
        keys = [min(options[k].contact, len(options[k].waypoints) - 1) for k in able]
        key_goals = np.stack([g[key] for g, key in zip(goals, keys, strict=True)])
        at, q = kin.arm_inverse((chests[:, None] @ key_goals[None]).reshape(-1, 4, 4), self.side, swivels=12)
        if not len(at):
            return None, False
        t, g = at // len(able), at % len(able)
        limits = r1.ARM_LIMITS[self.side]
        edge = np.maximum(np.abs(q - limits.mean(1)) / (np.ptp(limits, axis=1) / 2) - 0.8, 0).sum(1)
        cost = (
            3 * edge + 0.6 * torsos[t, 2] + 0.5 * np.abs(torsos[t, 0] - self.motion.torso[0])
            + np.array([options[k].cost for k in able])[g] + 0.1 * np.abs(q - self.motion.arm(self.side)).sum(1)
        )  # fmt: skip
        arms = {s: self.motion.arm(s) for s in SIDES}
        behind = self.around(lane[0], touched=True)
        if self.other is not None:
            arms[self.other] = hold[-1]
            if not self.body(self.motion.torso, behind, arms).free(self.other, hold[-1])[0]:
                return None, False
        rows = np.argsort(cost)[:_RANKED_POSTURES]
        touching = np.array([options[k].contact == key for k, key in zip(able, keys, strict=True)])
        rows = rows[self._clear(base, torsos, t[rows], q[rows], touching[g[rows]], arms)]
        seen: dict[tuple[int, int], int] = {}
        refused: dict[int, int] = {}
        checked = 0
        standing: dict[int, Standing | None] = {}
        for row in rows:
            where = (int(t[row]), int(g[row]))
            if seen.get(where, 0) >= 2 or refused.get(where[1], 0) >= _REFUSED:
                continue
            seen[where] = seen.get(where, 0) + 1
            if checked >= _CHECKED_POSTURES or sum(refused.values()) >= _GLANCED_POSTURES:
                break
            torso, k, key = torsos[t[row]], able[where[1]], keys[where[1]]
            posed = replace(self.body(torso, behind, arms), torso=torso)
            if not self._postures_clear(posed, base, options[k], goals[where[1]], key, q[row]):
                refused[where[1]] = refused.get(where[1], 0) + 1
                continue
            checked += 1
            if where[0] not in standing:
                standing[where[0]] = self._stood(torso, behind, arms)
            stood = standing[where[0]]
            if stood is None:
                continue
            path = self._reached(stood.body, lane, options[k], goals[where[1]], key, q[row])
            if path is not None:
                return Stance(
                    base, torso, k, path, goals[where[1]], hold, stood.level, route, options[k].opening_m
                ), True
        return None, len(rows) > 0

    def _clear(self, base: Array, torsos: Array, t: NDArray[np.intp], q: Array, touching: NDArray[np.bool_],
               arms: Mapping[Side, Array]) -> NDArray[np.bool_]:  # fmt: skip
        """(n,) bool: postures q (n, 7) with torsos `t` (n,) that are clear where the hand works, the trunk too."""
        out = np.zeros(len(q), bool)
        bare = {s: h.load for s, h in self.held.items() if s != self.side}
        near, loose = self.around(base, touched=True), self.around(base, touched=False)
        for k in np.unique(t):
            body = replace(self.body(torsos[k], near, arms), torso=torsos[k])
            if not body.trunk_free():
                continue
            rows = np.flatnonzero((t == k) & touching)
            out[rows] = replace(body, around=loose, held=bare).free(self.side, q[rows], -_TOUCH_M, grasping=True)
            rows = np.flatnonzero((t == k) & ~touching)
            out[rows] = body.free(self.side, q[rows], _MARGIN_M)
        return out

    def _stood(self, torso: Array, around: Obstacles, arms: Mapping[Side, Array]) -> Standing | None:
        """The body once the torso has moved there, the other hand level if it holds something; None if it cannot."""
        body = self.body(self.motion.torso, around, arms)
        level = None
        # What the hands hold keeps its place while the torso moves, or rides along with it.
        for still in ({self.other, self.side} & set(self.held), {self.other} - {None}):
            hands = {s: arm_motion.stay(kin.tcp(body.torso, arms[s], s)) for s in SIDES if s in still}
            level = arm_motion.sweep(body, torso, hands, samples=6)
            if level is not None or self.side not in self.held:
                break
        if level is None:
            return None
        return Standing(replace(body, torso=torso, arms={**arms, **{s: q[-1] for s, q in level.items()}}), level)

    def _postures_clear(self, body: Body, base: Array, option: Option, goals: Array, key: int, q_key: Array) -> bool:
        """A glance at the ends of the lines, before the lines themselves and before the torso's way is looked at."""
        chest = kin.inverse(kin.chest(body.torso))
        for k, goal in enumerate(goals):
            near = q_key if k == key else kin.nearest_posture(chest @ goal, self.side, q_key)
            if near is None or not self._free(body, base, option, k, near):
                return False
        return True

    def _free(self, body: Body, base: Array, option: Option, k: int, q: Array) -> bool:
        """Whether posture q (7,) is clear at waypoint `k`."""
        if k < option.contact:
            there = replace(body, around=self.around(base, touched=True))
            return bool(there.free(self.side, q, _MARGIN_M)[0])
        held = self._after(body, option) if k > option.contact else self._bare(body)
        there = replace(body, around=self.around(base, touched=False), held=held)
        return bool(there.free(self.side, q, -_TOUCH_M, grasping=True)[0])

    def _bare(self, body: Body) -> dict[Side, Load]:
        """What the other hand holds."""
        return {s: load for s, load in body.held.items() if s != self.side}

    def _after(self, body: Body, option: Option) -> dict[Side, Load]:
        """What the hands hold after the contact."""
        bare = self._bare(body)
        return bare if option.load is None else {**bare, self.side: option.load}

    def _reached(
        self, body: Body, lane: Array, option: Option, goals: Array, key: int, q_key: Array
    ) -> list[Array] | None:
        """The arm's path to the first waypoint if all of them, and the way in, are reachable and free."""
        base = lane[-1]
        postures: dict[int, Array] = {key: q_key}
        for order in (range(key - 1, -1, -1), range(key + 1, len(goals))):
            for k in order:
                line = arm_motion.trace(body.torso, self.side, postures[k + 1 if k < key else k - 1], goals[k])
                if line is None or not self._free(body, base, option, k, line[-1]):
                    return None
                postures[k] = line[-1]
        if len(lane) > 1:
            last = replace(body, held=self._after(body, option)) if option.contact < len(goals) else body
            if not self._leads(body, lane, postures[0], touched=True):
                return None
            if not self._leads(last, lane, postures[len(goals) - 1], touched=option.load is None, slack=_TOUCH_M):
                return None
        for margin in WAY_MARGINS_M:
            path = arm_motion.plan(body, self.side, postures[0], self.rng, margin)
            if path is not None:
                return path
        return None

    def _leads(self, body: Body, lane: Array, q: Array, touched: bool, slack: float = 0.0) -> bool:
        """Whether the robot, its arm in posture `q`, is clear of everything all along a lane."""
        idle = other(self.side)
        arms = {**body.arms, self.side: q}
        for base in lane:
            there = replace(body, around=self.around(base, touched), arms=arms)
            if not (there.trunk_free() and there.free(self.side, q, -slack, grasping=slack > 0)[0]
                    and there.clearance(idle, arms[idle])[0][0] > 0):  # fmt: skip
                return False
        return True


def _lane(start: Array, end: Array) -> Array:
    """(n, 3) base poses on the straight way from `start` to `end` (3,), both included; one if they are the same."""
    length = float(np.linalg.norm(end[:2] - start[:2]))
    return np.linspace(start, end, int(np.ceil(length / _STEP_M)) + 1) if length > 1e-6 else end[None].copy()


def base_clear(around: Obstacles) -> bool:
    """Whether the base and the column above it keep clear of what is `around`, in the base frame."""
    return bool((around.distance(_HEIGHTS) >= _REACHES).all())


def _bases(here: Array, focus: Array, side: Side) -> Array:
    """(n, 3) base poses about a place (2,) in the world, the nearest and plainest first."""
    bearing = float(np.arctan2(focus[1] - here[1], focus[0] - here[0]))
    ranked = []
    for distance in (0.46, 0.52, 0.58, 0.64, 0.70, 0.76, 0.84, 0.92):
        for lateral in (0.0, 0.10, 0.18, 0.26):
            for turn in (0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9, 1.3, -1.3, 1.8, -1.8, 2.4, -2.4, 3.0):
                yaw, y = bearing + turn, lateral * r1.SIGN[side]
                c, s = np.cos(yaw), np.sin(yaw)
                xy = focus - [c * distance - s * y, s * distance + c * y]
                near = 0.6 * float(np.linalg.norm(xy - here[:2])) + 0.3 * abs(turn)
                ranked.append(
                    (near + 1.2 * abs(distance - 0.58) + 0.5 * abs(lateral - 0.16), np.array([*xy, kin.wrap(yaw)]))
                )
    return np.stack([base for _, base in sorted(ranked, key=lambda r: r[0])])
