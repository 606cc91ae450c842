"""Pure pursuit: follow a path within limits of speed and acceleration, then settle on a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.traversability import Traversability, turned
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.drives import steering
from mpvi_bt.ground.robot.protocol import CONTROL_HZ


@dataclass(frozen=True)
class Limits:
    """How fast the base may go. Our choice: slow enough that tucked arms and payloads do not swing."""

    speed_m_s: float = 0.6  # speed in the open [m/s]
    turn_rad_s: float = 1.2  # turning speed in the open [rad/s]
    acceleration_m_s2: float = 1.0  # largest acceleration and deceleration [m/s2]
    turn_acceleration_rad_s2: float = 2.5  # largest acceleration and deceleration of a turn [rad/s2]
    tight_m_s: float = 0.25  # speed where the footprint touches an obstacle [m/s]
    roomy_m: float = 0.25  # distance beyond the footprint with room for full speed; speed grows evenly up to it [m]


CARRYING = Limits(speed_m_s=0.6, turn_rad_s=1.0, acceleration_m_s2=0.5, turn_acceleration_rad_s2=1.2, tight_m_s=0.20)
"""Our choice: limits with something in a hand, as a step in velocity flings what friction holds."""

AT_REST: Array = np.zeros(3)


@dataclass(frozen=True)
class PathPursuit:
    """How a path is followed."""

    easy: float = 0.7  # planned part of the acceleration limit [ratio]; the rest is for corrections; our choice
    settling: float = 4.0  # largest speed near the end, per meter to go [1/s]; our choice
    settling_steps: float = 0.3  # largest part of the way left in one step [ratio], or the base chatters; our choice
    turn_first: float = 1.5  # a base off its way by a right angle divided by this first turns on the spot; our choice
    there: float = 0.6  # part of the tolerance where a base without sideways motion turns to its goal; our choice
    # lookahead on a path of poses: where loads touch, and where there is room [m, and rad]; our choice
    aim: tuple[float, float] = (0.06, 0.25)
    keeps_rad: float = 0.15  # yaw error up to which the next pose may be approached [rad]; our choice
    bend: int = 4  # points of a path of poses before and after a bend; our choice
    after: int = 6  # points after a bend at which there has to be room for what swings out; our choice
    off_m: float = 0.015  # deviation from such a path that is always allowed [m]; our choice
    seen_every: int = 3  # one point in this many of such a path is checked for new obstacles; our choice


_PURSUIT = PathPursuit()


@dataclass(frozen=True)
class Tolerance:
    """When a pose counts as reached."""

    position_m: float = 0.03
    yaw_rad: float = 0.05
    speed_m_s: float = 0.02
    turn_rad_s: float = 0.05


class PathFollower:
    """Drives along one path to one pose.

    Far from the end the base faces along the path and slows down while it does not, as its camera looks ahead; within
    `arrive_m` of the end it slides sideways if need be and turns to the goal's yaw. A path of poses says itself how the
    base is to be turned where. A base that cannot go sideways faces its way, or has it behind, up to the end, and turns
    there. Speeds are profiles that can still stop in time, so that the end is reached without
    overshoot.

    Attributes:
        path: (N, 2) x, y [m].
        grid: What it was planned on.
        velocity: (3,) of the last command: vx, vy [m/s] in the world, yaw rate [rad/s].
    """

    def __init__(
        self,
        path: Array,
        goal: Array,
        grid: Traversability,
        limits: Limits = Limits(),
        tolerance: Tolerance = Tolerance(),
        lookahead_m: float = 0.40,
        arrive_m: float = 0.45,
        footprint: Footprint | None = None,
        velocity: Array = AT_REST,
        sideways: bool = True,
    ) -> None:
        """Take a path.

        Args:
            path: (N, 2) world x, y [m], or (N, 3) with the yaw [rad] to have there, which runs on beyond half a turn;
                replaced at its end by the goal.
            goal: (3,) x, y [m], yaw [rad].
            grid: Where the base's center may be; the lookahead point is always in straight reach.
            limits: Speed and acceleration.
            tolerance: When the goal counts as reached.
            lookahead_m: How far along the path the base aims.
            arrive_m: Distance to go from which the base turns to the goal's yaw.
            footprint: What turns with the base, for a path of poses; None: nothing.
            velocity: (3,) vx, vy [m/s] in the world and yaw rate [rad/s] that the base has now.
            sideways: Whether the base can go sideways.
        """
        self.path = np.vstack([path[:-1, :2], goal[:2]]) if len(path) > 1 else goal[None, :2].copy()
        self._yaws = path[:, 2] if path.shape[1] == 3 else None
        self.goal, self.limits, self.tolerance = goal, limits, tolerance
        self.grid, self._free, self._cells = grid, np.isfinite(grid.cost), np.ascontiguousarray(grid.cells(self.path))
        self._lookahead_m, self._arrive_m = lookahead_m, arrive_m
        steps = norm(np.diff(self.path, axis=0), axis=1)
        self._to_go = np.append(np.cumsum(steps[::-1])[::-1], 0.0)  # (N,) distance to the end along the path
        self._at = 0  # index of the path's point nearest to the base; it never runs back
        self._footprint = footprint if footprint is not None and self._yaws is not None else None
        self._room = self._rooms()
        self._most = self._speeds()
        self.velocity = np.array(velocity, float)
        self._aim_at, self._sideways = 0, sideways

    @property
    def aim(self) -> Array:
        """(2,) the point of the path [m] that the last command aimed at."""
        point: Array = self.path[self._aim_at]
        return point

    def remaining_m(self, pose: Array) -> float:
        """Distance [m] still to drive from `pose` (3,)."""
        return float(math.dist(self.path[self._at], pose[:2]) + self._to_go[self._at])

    def reached(self, pose: Array, velocity: Array) -> bool:
        """Whether the base stands still at the goal. `pose` (3,) world, `velocity` (3,) base frame."""
        return (
            math.dist(self.goal[:2], pose[:2]) <= self.tolerance.position_m
            and abs(_wrap(self.goal[2] - pose[2])) <= self.tolerance.yaw_rad
            and math.hypot(velocity[0], velocity[1]) <= self.tolerance.speed_m_s
            and abs(velocity[2]) <= self.tolerance.turn_rad_s
        )

    def command(self, pose: Array, dt_s: float = 1.0 / CONTROL_HZ) -> Array:
        """(3,) vx, vy [m/s] and yaw rate [rad/s] in the base frame for the next `dt_s`.

        Args:
            pose: (3,) where the base is now.
            dt_s: One control step.
        """
        if self._yaws is None:
            world, rate = self._along(pose, dt_s)
        else:
            world, rate = self._through(self._yaws, pose, dt_s)
        return self._changed(pose, world, rate, dt_s)

    def _along(self, pose: Array, dt_s: float) -> tuple[Array, float]:
        """The wanted velocity (2,) [m/s] in the world and yaw rate on a path of places."""
        (x, y), resolution = self.grid.map.origin_m, self.grid.map.resolution_m
        row, column = (pose[1] - y) / resolution, (pose[0] - x) / resolution
        self._at, self._aim_at = _ahead(self._cells, self._to_go, self._free, self._at, row, column, self._lookahead_m)
        delta = self.aim - pose[:2]
        distance = math.hypot(*delta)
        to_go = distance + self._to_go[self._aim_at]
        arriving = to_go < (self._arrive_m if self._sideways else _PURSUIT.there * self.tolerance.position_m)
        heading = self.goal[2] if arriving else math.atan2(delta[1], delta[0])
        turn = _wrap(heading - pose[2])
        if not self._sideways and not arriving and to_go < self._arrive_m and abs(turn) > math.pi / 2:
            turn = _wrap(turn + math.pi)  # it is nearly there: back up to it
        speed = min(self._most[self._at], _stopping_speed(to_go, self.limits.acceleration_m_s2, dt_s))
        if not self._sideways and arriving:
            speed = 0.0
        if not arriving:
            speed *= max(0.0, math.cos(min(abs(turn) * _PURSUIT.turn_first, math.pi / 2)))  # turn first, then go
        return delta * (speed / max(distance, 1e-9)), self._rate(turn, dt_s)

    def _through(self, yaws: Array, pose: Array, dt_s: float) -> tuple[Array, float]:
        """The wanted velocity (2,) [m/s] in the world and yaw rate on a path of poses."""
        last = len(self.path) - 1
        here = self._away(pose, self._at)
        while self._at < last and abs(_wrap(yaws[self._at] - pose[2])) < _PURSUIT.keeps_rad:
            there = self._away(pose, self._at + 1)
            if there > here:
                break
            here, self._at = there, self._at + 1
        at = aim = self._at
        ahead = _PURSUIT.aim[0] + (_PURSUIT.aim[1] - _PURSUIT.aim[0]) * self._room[at]
        while aim < last and self._to_go[at] - self._to_go[aim + 1] <= ahead:
            if abs(yaws[aim + 1] - yaws[at]) > ahead:
                break
            aim += 1
        aim = max(aim, min(at + 1, last))
        self._aim_at = aim
        delta, turn = self.aim - pose[:2], _wrap(yaws[aim] - pose[2])
        distance = math.hypot(*delta)
        ends = self._to_go[aim] if self._to_go[at] - self._to_go[aim] > ahead / 2 else 0.0  # else it turns there
        stop = _stopping_speed(distance + ends, self.limits.acceleration_m_s2, dt_s)
        speed = min(self._most[at], stop) * max(0.0, 1.0 - abs(turn) / (2 * _PURSUIT.aim[1]))
        return delta * (speed / max(distance, 1e-9)), self._rate(turn, dt_s)

    def _away(self, pose: Array, at: int) -> float:
        """How far [m] the base has to go to a point of the path: ahead or back, where it cannot go sideways."""
        if self._sideways:
            return math.dist(pose[:2], self.path[at])
        x, y = (self.path[at] - pose[:2]).tolist()
        return abs(math.cos(pose[2]) * x + math.sin(pose[2]) * y)

    def _rate(self, turn: float, dt_s: float) -> float:
        limits = self.limits
        rate = min(limits.turn_rad_s, _stopping_speed(abs(turn), limits.turn_acceleration_rad_s2, dt_s))
        return math.copysign(rate, turn)

    def brake(self, pose: Array, dt_s: float = 1.0 / CONTROL_HZ) -> Array:
        """(3,) as `command`, but on the way to a standstill."""
        return self._changed(pose, np.zeros(2), 0.0, dt_s)

    def _changed(self, pose: Array, world: Array, rate: float, dt_s: float) -> Array:
        """Change the velocity toward (2,) [m/s] in the world and a yaw rate, within limits; (3,) in the base frame."""
        (vx, vy, before), limits = self.velocity.tolist(), self.limits
        dx, dy = float(world[0]) - vx, float(world[1]) - vy
        share = min(1.0, limits.acceleration_m_s2 * dt_s / max(math.hypot(dx, dy), 1e-9))
        vx, vy = vx + share * dx, vy + share * dy
        most = limits.turn_acceleration_rad_s2 * dt_s
        rate = before + min(max(rate - before, -most), most)
        self.velocity = np.array([vx, vy, rate])
        yaw = float(pose[2]) + 0.5 * rate * dt_s  # feed forward: the base turns while the step lasts
        c, s = math.cos(yaw), math.sin(yaw)
        ahead, aside = c * vx + s * vy, -s * vx + c * vy
        if self._sideways:
            return np.array([ahead, aside, rate])
        self.velocity = np.array([c * ahead, s * ahead, rate])
        return np.array([ahead, 0.0, rate + steering(ahead, aside)])

    def meets(self, grid_map: OccupancyMap, occupied: NDArray[np.bool_]) -> bool:
        """Whether cells that have been occupied since the path was planned are within the footprint on its rest."""
        grid = self.grid
        if occupied.shape != grid.occupied.shape or not np.array_equal(grid_map.origin_m, grid.map.origin_m):
            return True
        new = occupied & ~grid.occupied
        if not new.any():
            return False
        if _touches(new, self._cells[self._at :], grid.footprint_m / grid.map.resolution_m):
            return True
        if self._footprint is None:
            return False
        footprint, poses = self._footprint, self._poses()[self._at :: _PURSUIT.seen_every]
        for circles in (footprint.loads, footprint.base):
            radii = circles[:, 2] / grid.map.resolution_m
            cells = np.moveaxis(grid.cells(turned(circles, poses)), 1, 0)  # (circles, N, 2)
            if any(_touches(new, at, radius) for at, radius in zip(cells, radii, strict=True)):
                return True
        return False

    def may_go(self, pose: Array, move: Array) -> bool:
        """Whether a straight move (2,) [m] from a pose (3,) keeps off obstacles, or comes no nearer to them."""
        xy = pose[:2]
        along = xy + np.linspace(0, 1, 2 + math.ceil(math.hypot(*move) / self.grid.map.resolution_m))[:, None] * move
        cells = np.floor(self.grid.cells(along)).astype(int)
        if cells.min() < 0 or (cells >= self.grid.occupied.shape).any():
            return False
        clear = self.grid.clearance_m[cells[:, 0], cells[:, 1]]
        if self._footprint is not None:
            room = self._footprint.room(self.grid, np.column_stack([along, np.full(len(along), pose[2])]))
            if not (room >= min(0.0, room[0])).all():
                return False
        return bool((clear >= min(self.grid.footprint_m, clear[0])).all())

    def _rooms(self) -> Array:
        """(N,) 0 to 1: whether footprint or loads touch an obstacle at each point of the path, or have enough room."""
        cells = np.floor(self._cells).astype(int).clip(0, np.array(self._free.shape) - 1)
        room = self.grid.clearance_m[cells[:, 0], cells[:, 1]] - self.grid.footprint_m
        if self._footprint is not None:
            room = np.minimum(room, self._footprint.slack(self.grid, self._poses()))
        rooms: Array = (room / self.limits.roomy_m).clip(0.0, 1.0)
        return rooms

    def _in_bends(self) -> Array:
        """(N,) the speed [m/s] with which the base is not carried out of a bend farther than there is room for it."""
        n = len(self.path)
        before, after = (
            self.path[(np.arange(n) + d).clip(0, n - 1)] - self.path for d in (-_PURSUIT.bend, _PURSUIT.bend)
        )
        along, back = np.arctan2(after[:, 1], after[:, 0]), np.arctan2(-before[:, 1], -before[:, 0])
        moves = np.hypot(*before.T) * np.hypot(*after.T) > 0
        bend = np.where(moves, np.abs(wrap(along - back)), 0.0)
        points = _PURSUIT.after
        room = ndimage.minimum_filter1d(self._room, 2 * points + 1, origin=-points)  # the least from here on
        off = _PURSUIT.off_m + self.limits.roomy_m * room
        speeds: Array = np.sqrt(2.0 * _PURSUIT.easy * self.limits.acceleration_m_s2 * off) / np.maximum(bend, 1e-3)
        return speeds

    def _poses(self) -> Array:
        return np.column_stack([self.path, np.zeros(len(self.path)) if self._yaws is None else self._yaws])

    def _speeds(self) -> Array:
        """(N,) the most speed [m/s] at each point of the path: slow near obstacles, and in time before them."""
        slow, fast = self.limits.tight_m_s, self.limits.speed_m_s
        caps = slow + (fast - slow) * self._room
        if self._yaws is not None:
            caps = np.minimum(caps, self._in_bends())
        twice = 2.0 * _PURSUIT.easy * self.limits.acceleration_m_s2
        # From v at i, w at j is reached in time if v^2 <= w^2 + 2 a (s_j - s_i): the least over all later j counts.
        energy = caps**2 - twice * self._to_go
        later = np.minimum.accumulate(energy[::-1])[::-1]
        speeds: Array = np.sqrt(later + twice * self._to_go)
        return speeds


def _wrap(angle: float) -> float:
    """The same angle [rad] within half a turn."""
    return math.remainder(angle, 2 * math.pi)


@compiled_later
def _ahead(path, to_go, free, at, row, column, lookahead_m):  # type: ignore
    """Progress of the base along a path, never backward, and the point to aim at.

    Args:
        path: (N, 2) float64 rows and columns with fractions.
        to_go: (N,) [m] to the end.
        free: (H, W) bool; where the base's center may be.
        at: Index of where it was on the path.
        row, column: Of the base, with fractions.
        lookahead_m: How far along the path to aim at the most.

    Returns:
        Indices of the nearest of the next 40 points, and of the farthest one within the lookahead that a straight line
        over free cells reaches; the next one if that is none.
    """
    last = path.shape[0] - 1
    nearest, least = at, np.inf
    for i in range(at, min(at + 40, last + 1)):
        away = (path[i, 0] - row) ** 2 + (path[i, 1] - column) ** 2
        if away < least:
            nearest, least = i, away
    aim = nearest
    while aim < last and to_go[nearest] - to_go[aim] < lookahead_m:
        aim += 1
    while aim > nearest:
        dr, dc = path[aim, 0] - row, path[aim, 1] - column
        n = math.ceil(max(abs(dr), abs(dc)) * 4) + 1  # four samples a cell
        clear = True
        for k in range(n):
            share = k / max(n - 1, 1)
            r, c = math.floor(row + share * dr), math.floor(column + share * dc)
            if r < 0 or c < 0 or r >= free.shape[0] or c >= free.shape[1] or not free[r, c]:
                clear = False
                break
        if clear:
            break
        aim -= 1
    return nearest, max(aim, min(nearest + 1, last))


def _touches(occupied: NDArray[np.bool_], cells: Array, radius: float) -> bool:
    """Whether an occupied cell is within a circle, its radius in cells, about one of some cells (N, 2)."""
    n = math.ceil(radius + 0.5)
    offsets = np.argwhere(np.hypot(*np.ogrid[-n : n + 1, -n : n + 1]) < radius + 0.5) - n
    rows, columns = np.moveaxis(np.floor(cells).astype(int)[:, None] + offsets, -1, 0)
    return bool(occupied[rows.clip(0, occupied.shape[0] - 1), columns.clip(0, occupied.shape[1] - 1)].any())


def _stopping_speed(distance: float, acceleration: float, dt_s: float) -> float:
    """The speed from which a stop within `distance` is possible, with a linear end: no chatter at the goal."""
    return min(
        math.sqrt(2.0 * _PURSUIT.easy * acceleration * distance),
        distance * min(_PURSUIT.settling, _PURSUIT.settling_steps / dt_s),
    )
