"""Where to stand: ranked goal poses for a target thing or room."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.navigation.grid import cost_to_reach
from mpvi_bt.finding.navigation.traversability import Traversability
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class Ranking:
    """Costs that make one place before a target worse than another, in meters of driving."""

    near: float = 6.0  # cost of each meter nearer than the preferred distance; our choice
    far: float = 3.0  # cost of each meter beyond half way from there to the handoff distance; our choice
    aside: float = 1.0  # cost of each meter off the middle of the target's side; our choice
    behind_m: float = 4.0  # cost of a place at the side of a target with a front [m]; behind it, twice that; our choice
    large_m: float = 0.6  # the base faces the center of smaller targets, the nearest point of others [m]; our choice
    # yaws off the target for a base that is not round, if it fits no better [rad]; our choice
    askew_rad: tuple[float, ...] = (0.0, 0.15, -0.15, 0.3, -0.3)
    # yaws off the best, if it matters little where the base looks [rad]; our choice
    around_rad: tuple[float, ...] = (0.0, 0.4, -0.4, 0.8, -0.8, 1.6, -1.6, np.pi)


_RANK = Ranking()


@dataclass(frozen=True)
class HandoffDistances:
    """Where navigation hands over to manipulation. Distances are from the base's center to the target's box."""

    distance_m: float = 0.9  # handoff distance d_h [m]; our choice, the paper has none: the arms reach 0.85 m and more
    preferred_m: float = 0.65  # distance kept if there is room [m]; the arms need it to unfold
    gap_m: float = 0.05  # least gap between footprint and target [m]
    slack_m: float = 0.35  # how much farther the base may stop if nothing nearer is free, as at a wide table [m]
    facing_rad: float = 0.4  # how far off the target's direction the base may point and still face it [rad]


@dataclass(frozen=True, eq=False)
class Goal:
    """A pose to drive to.

    Attributes:
        pose: (3,) x, y [m], yaw [rad] in the world.
        score: What the ranking goes by, lower is better; about meters of driving; inf where it cannot be reached.
    """

    pose: Array
    score: float


def distance_to(entry: Entry, xy: Array) -> float:
    """Distance [m] on the floor from `xy` (2,) to the nearest point of the entry's box; 0 within it."""
    return float(norm(nearest_point(entry, xy) - xy))


def nearest_point(entry: Entry, xy: Array) -> Array:
    """(..., 2) the points of the entry's box, seen from above, nearest to the points `xy` (..., 2) [m]."""
    points: Array = np.clip(xy, entry.lowest[:2], entry.highest[:2])
    return points


def facing_yaw(entry: Entry, xy: Array) -> Array:
    """(...,) yaw [rad] from `xy` (..., 2) toward the target.

    Our choice: toward the center of what is small, toward the nearest point of what is larger, so that the base stands
    square to a long counter.
    """
    toward = nearest_point(entry, xy)
    if (entry.highest - entry.lowest)[:2].max() <= _RANK.large_m:
        toward = np.broadcast_to(entry.center[:2], toward.shape)
    delta = toward - xy
    yaw: Array = np.arctan2(delta[..., 1], delta[..., 0])
    return yaw


def at_target(entry: Entry, pose: Array, grid: Traversability, handoff: HandoffDistances, slack_m: float = 0.0) -> bool:
    """Whether a base at `pose` (3,) is within the handoff distance of the target, faces it and nothing is between.

    `slack_m` is added to that distance, for a base that was sent as near as it gets.
    """
    xy = pose[:2]
    if not distance_to(entry, xy) <= handoff.distance_m + slack_m:  # nor is it where either place is no number
        return False
    if not abs(float(wrap(facing_yaw(entry, xy) - pose[2]))) <= handoff.facing_rad:
        return False
    return bool(_same_room(entry, xy[None], grid)[0] and _in_sight(entry, xy[None], grid)[0])


def object_goals(
    entry: Entry, start: Array, grid: Traversability, handoff: HandoffDistances, most: int = 20
) -> list[Goal]:
    """Base poses for manipulating the target, best first, and far enough apart to be alternatives.

    Each is free for the footprint, reachable from `start` (2,), in the target's room, within the handoff distance,
    faces the target, and has no obstacle between but the furniture that the target is or stands on. Where no such
    pose exists, those within `slack_m` more; where none of these can be reached, they are scored inf. The best are
    cheap to reach, not nearer than preferred, square to the middle of the target's side, and before its front where
    that is known (Our choice).
    """
    if not np.isfinite((entry.lowest, entry.highest)).all():
        return []
    effort = cost_to_reach(grid.cost, grid.map.cell(start)) * grid.map.resolution_m
    margin = 2 * grid.map.resolution_m
    for reach in (handoff.distance_m - margin, handoff.distance_m + handoff.slack_m - margin):
        cells = _ring(entry, grid, grid.footprint_m + handoff.gap_m, reach)
        points = grid.points(cells)
        keep = _same_room(entry, points, grid)
        cells, points = cells[keep], points[keep]
        keep = _in_sight(entry, points, grid)
        cells, points = cells[keep], points[keep]
        yaw = _fitting(grid, points, facing_yaw(entry, points), _RANK.askew_rad)
        keep = np.isfinite(yaw)
        cells, points, yaw = cells[keep], points[keep], yaw[keep]
        reached = np.isfinite(effort[cells[:, 0], cells[:, 1]])
        if reached.any():
            cells, points, yaw = cells[reached], points[reached], yaw[reached]
            break
    nearest = nearest_point(entry, points)
    distance = norm(nearest - points, axis=1)
    aside = norm(nearest - entry.center[:2], axis=1) - _half_depth(entry, points)
    score = (
        effort[cells[:, 0], cells[:, 1]]
        + _RANK.near * np.maximum(0.0, handoff.preferred_m - distance)
        + _RANK.far * np.maximum(0.0, distance - 0.5 * (handoff.preferred_m + handoff.distance_m))
        + _RANK.aside * np.maximum(0.0, aside)
    )
    if entry.front is not None:
        score += _RANK.behind_m * (1.0 - matmul(points - nearest, entry.front) / np.maximum(distance, 1e-6))
    order = _apart(cells, score.astype(float))[:most]
    return [Goal(np.array([*points[i], yaw[i]]), float(score[i])) for i in order]


def near_goals(entry: Entry, start: Array, grid: Traversability, most: int = 20) -> list[Goal]:
    """The reachable poses nearest to a target, best first, for where nothing nearer is known to be free yet."""
    effort = cost_to_reach(grid.cost, grid.map.cell(start)) * grid.map.resolution_m
    cells = np.argwhere(np.isfinite(effort))
    points = grid.points(cells)
    apart = norm(nearest_point(entry, points) - points, axis=1)
    order = np.argsort(apart, kind="stable")[:most]
    yaw = _anyhow(grid, points[order], facing_yaw(entry, points[order]))
    return [Goal(np.array([*points[i], y]), float(apart[i])) for i, y in zip(order, yaw, strict=True)]


def room_goals(room: str, start: Array, grid: Traversability, inset_m: float = 0.6, most: int = 20) -> list[Goal]:
    """Poses well inside a room, best first: the nearest cells `inset_m` from its boundary, facing its middle.

    In a room too small for the inset, the cells deepest in it; in one that cannot be reached, scored inf.
    """
    if room not in grid.map.room_names:
        return []
    effort = cost_to_reach(grid.cost, grid.map.cell(start)) * grid.map.resolution_m
    inside = grid.map.rooms == grid.map.room_names.index(room)
    depth = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1] * grid.map.resolution_m
    free = inside & np.isfinite(grid.cost)
    if not free.any():
        return []
    reachable = free & np.isfinite(effort)
    if not reachable.any():
        reachable = free
    cells = np.argwhere(reachable & (depth >= min(inset_m, depth[reachable].max())))
    points = grid.points(cells)
    score = effort[cells[:, 0], cells[:, 1]]
    toward = grid.points(np.argwhere(inside)).mean(0) - points
    yaw = _anyhow(grid, points, np.arctan2(toward[:, 1], toward[:, 0]))
    order = _apart(cells, score.astype(float))[:most]
    return [Goal(np.array([*points[i], yaw[i]]), float(score[i])) for i in order]


def _fitting(grid: Traversability, points: Array, yaw: Array, offs_rad: Iterable[float]) -> Array:
    """(N,) yaw at points (N, 2): the first of `yaw` plus each offset with room for the base; nan if there is none."""
    best = np.full(len(points), np.nan)
    for off in offs_rad:
        left = np.flatnonzero(np.isnan(best))
        tried = yaw[left] + off
        best[left] = np.where(grid.fits(np.column_stack([points[left], tried])), tried, np.nan)
    return best


def _anyhow(grid: Traversability, points: Array, yaw: Array) -> Array:
    """(N,) as `_fitting`, for a yaw of little importance; `yaw` itself if there is no room for the base."""
    best = _fitting(grid, points, yaw, _RANK.around_rad)
    return np.where(np.isnan(best), yaw, best)


def _apart(cells: NDArray[np.int64], score: Array) -> NDArray[np.int64]:
    """Which of the cells (N, 2) to take, best first: of each square of 3 x 3 the best."""
    order = np.argsort(score, kind="stable")
    _, first = np.unique(cells[order] // 3, axis=0, return_index=True)
    return np.asarray(order[np.sort(first)], np.int64)


def _ring(entry: Entry, grid: Traversability, inner_m: float, outer_m: float) -> NDArray[np.int64]:
    """(N, 2) the free cells whose centers are between two distances from the entry's box."""
    (r0, c0), (r1, c1) = grid.map.cell(entry.lowest[:2] - outer_m), grid.map.cell(entry.highest[:2] + outer_m)
    r0, c0 = max(r0, 0), max(c0, 0)
    cells = np.argwhere(np.isfinite(grid.cost[r0 : r1 + 1, c0 : c1 + 1])) + np.array([r0, c0])
    points = grid.points(cells)
    distance = norm(nearest_point(entry, points) - points, axis=1)
    ring: NDArray[np.int64] = cells[(distance >= inner_m) & (distance <= outer_m)]
    return ring


def _half_depth(entry: Entry, points: Array) -> Array:
    """(N,) half extent of the box along the axis that each point (N, 2) looks at it."""
    half = (entry.highest - entry.lowest)[:2] / 2
    off = np.abs(points - entry.center[:2]) - half
    depth: Array = np.where(off[:, 0] > off[:, 1], half[0], half[1])
    return depth


def _same_room(entry: Entry, points: Array, grid: Traversability) -> NDArray[np.bool_]:
    """(N,) bool; whether points (N, 2) are in the target's room; all of them where it is in none, as in a doorway."""
    name = entry.room or grid.map.room_at(entry.center[:2])
    if name not in grid.map.room_names:
        return np.ones(len(points), bool)
    cells = np.floor(grid.cells(points)).astype(int).clip(0, np.array(grid.occupied.shape) - 1)
    rooms = grid.map.rooms[cells[:, 0], cells[:, 1]]
    same: NDArray[np.bool_] = rooms == grid.map.room_names.index(name)
    return same


def _in_sight(entry: Entry, points: Array, grid: Traversability) -> NDArray[np.bool_]:
    """(N,) bool; whether the line from each point (N, 2) to the target meets one obstacle at most, the last.

    Seen from the target outward the line may start in an obstacle (the target, or what it stands on) but, once in
    the open, must stay there.
    """
    target = nearest_point(entry, points)
    reach = float(norm(target - points, axis=1).max(initial=0.0))
    n = int(np.ceil(reach / (grid.map.resolution_m / 2))) + 2
    along = target[:, None] + np.linspace(0, 1, n)[:, None] * (points - target)[:, None]  # (N, n, 2)
    cells = np.floor(grid.cells(along)).astype(int).clip(0, np.array(grid.occupied.shape) - 1)
    occupied = grid.occupied[cells[..., 0], cells[..., 1]]
    opened = np.cumsum(~occupied, axis=1) > 0
    sight: NDArray[np.bool_] = ~(occupied & opened).any(axis=1)
    return sight
