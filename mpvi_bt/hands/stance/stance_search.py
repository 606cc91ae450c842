"""The search for a stance: base poses about what a hand works on, the nearest first, until it can be done from one.

What is cheap to refute comes first: the hand alone, then the base alone, then how to stand there. The base can drive to
what is found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Load
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.stance.base_search import KNOWN_M, WORK_PLACE, Alike, BaseSearch, SearchBudget, before, behind, first
from mpvi_bt.hands.stance.detour import Detours
from mpvi_bt.hands.stance.glance import TOUCH_M
from mpvi_bt.hands.stance.postures import stance_at
from mpvi_bt.hands.stance.stance import Option, Stance


@dataclass(frozen=True)
class BaseParameters:
    """Which base poses are searched.

    Our choice: as many as keep a search below some seconds.
    """

    glance: float = 0.25  # effort of a check that finds no clear posture at the work place [ratio of a full check]
    checked: int = 12  # base poses checked at one spacing
    been_m: float = 0.4  # base poses this close to one with nothing in reach are skipped [m]
    step_m: float = 0.06  # distance between checks on the way in [m]
    best_m: float = 0.58  # most comfortable distance to the place [m]
    way_cost: float = 0.6  # cost of each meter of driving
    turn_cost: float = 0.3  # cost of each radian of `turns_rad`
    # offsets from straight ahead of the place to the side of the hand [m]
    laterals_m: tuple[float, ...] = (0.0, 0.10, 0.18, 0.26)
    # headings off the direction of the place, the plainest first [rad]
    # fmt: off
    turns_rad: tuple[float, ...] = (
        0.0, 0.15, -0.15, 0.3, -0.3, 0.45, -0.45, 0.6, -0.6, 0.9, -0.9, 1.3, -1.3, 1.8, -1.8, 2.4, -2.4, 3.0,
    )
    # fmt: on


_BASES = BaseParameters()
# Our choice: what fails here fails a hand's breadth away.
SPACINGS = (Alike(0.12, 0.5), Alike(0.05, 0.25))
# Our choice, from base poses to the place, see `_bases`: so fine that one nearly touches what stands before it, for
# deep in a compartment an arm reaches it from no farther off.
_DISTANCES_M = np.arange(0.46, 0.98, 0.03)


@dataclass(frozen=True, eq=False)
class Search(BaseSearch):
    """A search for a stance at a site."""

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
            self.refusals.add("not looked at, as planning took too long", count=len(options))
            return None
        options = [self._as_it_stands(option) for option in options]
        able = [k for k, option in enumerate(options) if self.fits(option)]
        self.refusals.add("no room for the hand", count=len(options) - len(able))
        if not able:
            return None
        here = self.motion.felt.base_pose
        if here_first and (found := self._here(here, options, able)) is not None:
            return found
        bases = _bases(here, focus_xy, self.side)
        standing = self.stands(bases)
        self.refuse_bases(bases[~standing])
        bases = bases[standing]
        before = self.effort.failed.setdefault(self._sought(options, able), [])
        failed: list[Array] = [*self.tried, *before]

        def check(k: int) -> tuple[Stance | None, float]:
            found, effort = self._from(here, bases[k], options, able)
            if found is None:
                failed.append(bases[k])
                before.extend([bases[k]] if effort else [])
            return found, effort

        for alike in (SPACINGS[k] for k in spacings):
            budget = SearchBudget(_BASES.checked, self.effort)
            if (found := first(bases, check, alike, failed, budget)) is not None:
                self.effort.failed.clear()
                return found
            if budget.left and budget.spent < budget.most:
                self.refusals.add("not looked at, as planning took too long", count=budget.left)
                return None
        self.refusals.add("left for the next try", count=budget.left)
        return None

    def go_around(self, focus_xy: Array, been: Sequence[Array]) -> list[Array] | None:
        """Base poses to drive to: around what stands before where one may stand about a place (2,), or nearer to it.

        Nearer where what is around it is not known yet. None if all of that was in reach from here or from where the
        robot has `been` (3,), or is out of reach.
        """
        here, detours = self.motion.felt.base_pose, Detours(self)
        bases = _bases(here, focus_xy, self.side)
        left, failed = bases[self.stands(bases)], list[Array]()
        for place in been:
            left = left[Alike(_BASES.been_m).without(left, place)]

        def check(k: int) -> tuple[list[Array] | None, float]:
            failed.append(left[k])
            return (detours.way(left[k]) if self.route(here, left[k]) is None else None), 0.0

        if (way := first(left, check, SPACINGS[0], failed, SearchBudget())) is not None:
            return way
        for place in been:
            bases = bases[Alike(KNOWN_M).without(bases, place)]
        return self.toward(bases)

    def _sought(self, options: Sequence[Option], able: Sequence[int]) -> bytes:
        """The same for searches for the same with the same hand, to the centimeter, that trust hidden space alike."""
        at = np.stack([options[k].waypoints[min(options[k].contact, len(options[k].waypoints) - 1)] for k in able])
        trusting = b"trusting" if self.trusting else b""
        return self.side.encode() + trusting + np.round(at[:, :3, 3] * 100).astype(int).tobytes()

    def _here(self, here: Array, options: Sequence[Option], able: Sequence[int]) -> Stance | None:
        """A stance whose arm takes its posture where the robot stands."""
        ahead = np.array([np.cos(here[2]), np.sin(here[2]), 0.0])
        for run_up in sorted({options[k].run_up_m for k in able}):
            some = [k for k in able if options[k].run_up_m == run_up]
            lane = _lane(here, here + ahead * run_up)
            if run_up and not self.stands(lane).all():
                continue
            for hold in self.holds:
                found, _ = stance_at(self, lane, [here.copy()], options, some, hold)
                if found is not None:
                    return found
        return None

    def _from(
        self, here: Array, base: Array, options: Sequence[Option], able: Sequence[int]
    ) -> tuple[Stance | None, float]:
        """A stance there; and what looking for it took, 1 for a full check."""
        effort = 0.0
        ways: dict[float, list[int]] = {}
        for k in able:
            ways.setdefault(options[k].run_up_m, []).append(k)
        for run_up, some in ways.items():
            ready = behind(base, run_up)
            lane = _lane(ready, base)
            if not self.stands(lane).all():
                self.refusals.add("no room to drive in")
                continue
            if (route := self.route(here, ready)) is None:
                self.refusals.add("no way there")
                continue
            effort = max(effort, _BASES.glance)
            for hold in self.holds:
                found, looked = stance_at(self, lane, route, options, some, hold)
                if found is not None:
                    return found, 1.0
                effort = 1.0 if looked else effort
        return None, effort

    def admits(self, options: Sequence[Option]) -> bool:
        """Whether there is room for the bare hand in one of `options` at least."""
        return any(self.fits(self._as_it_stands(option)) for option in options)

    def fits(self, option: Option) -> bool:
        """Whether the bare hand, with what it holds, is clear of everything at each waypoint, whatever the arm does."""
        hand, takes = self.motion.robot.hand, option.load is not None
        parts: dict[bool, list[tuple[Array, Array]]] = {True: [], False: []}  # by whether it may touch what it works on
        for k, T in enumerate(option.waypoints):
            spheres = [(hand.palm[0], hand.palm[1] - TOUCH_M)]
            if k <= option.contact if takes else k >= option.contact:
                spheres.append(hand.fingers(option.opening_m))
            load = None if k == option.contact else self._load(k, option)
            if load is not None:
                spheres.append((load.centers, load.radii - TOUCH_M))
            centers, radii = (np.concatenate(some) for some in zip(*spheres, strict=True))
            parts[k >= option.contact].append((matmul(centers, T[:3, :3].T) + T[:3, 3], radii))
        for touching, some in parts.items():
            if some:
                centers, radii = (np.concatenate(each) for each in zip(*some, strict=True))
                if ((self.rest if touching else self.everything).distance(centers) < radii).any():
                    return False
        return True

    def _as_it_stands(self, option: Option) -> Option:
        """An option whose load is no larger than the room where it stands, next to a wall or among other things."""
        if option.load is None or option.contact >= len(option.waypoints):
            return option
        T = option.waypoints[option.contact]
        room = self.rest.distance(matmul(option.load.centers, T[:3, :3].T) + T[:3, 3])
        return replace(option, load=option.load.within(room + TOUCH_M / 2))

    def _load(self, k: int, option: Option) -> Load | None:
        if k > option.contact:
            return option.load
        return self.held[self.side].load if self.side in self.held else None


def _lane(start: Array, end: Array) -> Array:
    """(n, 3) base poses on the straight way from `start` to `end` (3,), both included; one if they are the same."""
    length = float(norm(end[:2] - start[:2]))
    return np.linspace(start, end, int(np.ceil(length / _BASES.step_m)) + 1) if length > 1e-6 else end[None].copy()


def _bases(here: Array, focus: Array, side: Side) -> Array:
    """(n, 3) base poses about a place (2,) in the world, the nearest and plainest first."""
    bearing = float(np.arctan2(focus[1] - here[1], focus[0] - here[0]))
    offsets = _DISTANCES_M, _BASES.laterals_m, _BASES.turns_rad

    def cost(ahead: Array, lateral: Array, turn: Array, way: Array) -> Array:
        near = _BASES.way_cost * way + _BASES.turn_cost * np.abs(turn)
        off = WORK_PLACE.ahead * np.abs(ahead - _BASES.best_m)
        return np.asarray(near + off + WORK_PLACE.lateral * np.abs(lateral - WORK_PLACE.lateral_m))

    return before(focus, bearing, offsets, side, here, cost)
