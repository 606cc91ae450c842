"""Cells of the map that the robot's footprint may enter, and their costs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.scene.field import distance_to
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.mobile_base import MobileBase

Box = tuple[tuple[float, float], tuple[float, float]]  # lowest and highest corner [m], of floor that is taken
Disc = tuple[float, float, float]  # x, y, radius [m]

ESCAPE_COST = 20.0  # our choice: of a cell too near an obstacle, which only a robot that stands there may use
GRAIN = 0.27
"""Cells by which distances to obstacles may be less than they are taken to be, where they are interpolated.

They are distances to centers of cells less half a cell: a corner is 0.21 nearer. And where a distance is r cells, the
interpolation is up to 1/(8 r) too large, 0.06 for circles that are wider than two.
"""


@dataclass(frozen=True)
class Escape:
    """Limits for driving a base out of a place too close to an obstacle."""

    near_m: float = 0.6  # radius around the base in which it may leave [m]; our choice
    out_m: float = 0.15  # distance beyond the nearest place with room, if that is more [m]; our choice
    deep_m: float = 1.3  # largest distance to that place [m]; our choice


_ESCAPE = Escape()
Corners = tuple[Array | tuple[float, float], Array | tuple[float, float]]


@dataclass(frozen=True)
class ClearanceCost:
    """How dearly the planner pays for passing close to obstacles.

    Our choice: 1 in the open and up to `1 + weight` where the footprint touches, falling off as a square over
    `margin_m`; the path keeps to the middle of doorways and off furniture without long detours.
    """

    margin_m: float = 0.30
    weight: float = 4.0


@dataclass(frozen=True, eq=False)
class Traversability:
    """A planning grid.

    Attributes:
        map: The map that it was made from; cells are the same.
        occupied: (H, W) bool; the map's obstacles and those that were added.
        clearance_m: (H, W) distance from each cell's center to the nearest obstacle's edge.
        cost: (H, W) float32, at least 1, inf where the footprint does not fit.
        footprint_m: Radius that was kept clear.
        base: (n, 3) x, y, radius [m] of circles that turn with the base, which are kept clear besides.
    """

    map: OccupancyMap
    occupied: NDArray[np.bool_]
    clearance_m: Array
    cost: NDArray[np.float32]
    footprint_m: float
    base: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """(H, W) bool; where the robot's center may not be."""
        return np.isinf(self.cost)

    def cells(self, xy: Array) -> Array:
        """(..., 2) rows and columns, with fractions, of world points (..., 2) [m]."""
        return ((np.asarray(xy, float)[..., :2] - self.map.origin_m) / self.map.resolution_m)[..., ::-1]

    def points(self, cells: NDArray[np.int64]) -> Array:
        """(N, 2) world x, y [m] of the centers of cells (N, 2)."""
        return self.map.origin_m + (np.asarray(cells)[:, ::-1] + 0.5) * self.map.resolution_m

    def fits(self, poses: Array) -> NDArray[np.bool_]:
        """(...,) whether nothing is in the way of how the base is turned, at poses (..., 3) of cells that are free."""
        if not len(self.base):
            return np.ones(poses.shape[:-1], bool)
        return np.asarray((self.room(turned(self.base, poses)) >= self.base[:, 2]).all(-1))

    def room(self, xy: Array) -> Array:
        """(...,) how far [m] world points (..., 2) are from obstacles, at the least; -9 off the map.

        Between the centers of cells that is interpolated; only good where it is more than a cell.
        """
        cells = np.moveaxis(self.cells(xy) - 0.5, -1, 0)
        room: Array = ndimage.map_coordinates(self.clearance_m, cells, order=1, cval=-9.0)
        return room - GRAIN * self.map.resolution_m

    def escaping(self, xy: Array) -> Traversability:
        """The same grid for a robot that stands closer to an obstacle than its footprint: it may leave.

        Cells near `xy` that are no closer to an obstacle than it is now, or no deeper in one, become dear instead of
        blocked. Manipulation leaves the base in such places, also well within what the map takes for an obstacle: under
        the open lid of a trunk.
        """
        row, column = self.map.cell(xy)
        if not self.map.inside(row, column) or not np.isinf(self.cost[row, column]):
            return self
        rows, columns = np.ogrid[: self.cost.shape[0], : self.cost.shape[1]]
        away_m = np.hypot(rows - row, columns - column) * self.map.resolution_m
        out_m = float(away_m[np.isfinite(self.cost)].min(initial=np.inf)) + _ESCAPE.out_m
        near = away_m <= (max(out_m, _ESCAPE.near_m) if out_m <= _ESCAPE.deep_m else _ESCAPE.near_m)
        clear = self.clearance_m
        if self.occupied[row, column]:
            clear = clear - ndimage.distance_transform_edt(self.occupied) * self.map.resolution_m
        leave = near & np.isinf(self.cost) & (clear >= clear[row, column] - 1e-9)
        cost = np.where(leave, np.float32(ESCAPE_COST), self.cost)
        return replace(self, cost=cost)


def traversability(
    grid_map: OccupancyMap,
    footprint_m: float,
    boxes: Iterable[Corners] = (),
    discs: Iterable[Disc] = (),
    clearance_cost: ClearanceCost = ClearanceCost(),
    base: MobileBase | None = None,
) -> Traversability:
    """Inflate a map by the robot's radius, with obstacles that the map lacks.

    Args:
        grid_map: The prior map.
        footprint_m: Radius of the robot's footprint with all that it holds.
        boxes: Lowest and highest corners, (2,) or (3,) each [m], of things on the floor.
        discs: x, y, radius [m] of places found to be blocked.
        clearance_cost: How dear it is to pass close by.
        base: What of it turns; None: nothing.
    """
    res = grid_map.resolution_m
    taken = occupied(grid_map, boxes, discs)
    clearance, cost = np.zeros(taken.shape), np.full(taken.shape, np.inf, np.float32)
    window = about(~taken)
    framed = np.pad(taken[window], 1, constant_values=True)  # what lies beyond cannot be entered
    to_center = distance_to(framed)[1:-1, 1:-1].astype(float) * res
    clear = clearance[window] = np.maximum(to_center - res / 2, 0.0)
    near = np.clip((footprint_m + clearance_cost.margin_m - clear) / clearance_cost.margin_m, 0.0, 1.0)
    cost[window] = np.where(clear < footprint_m, np.inf, 1.0 + clearance_cost.weight * near**2)
    if base is None or not len(base.corners):
        return Traversability(grid_map, taken, clearance, cost, footprint_m)
    off_m, radius_m = base.core  # wherever the base is, a place for its largest circle is near
    far = clear.size > 0 and distance_to(clear >= radius_m) * res > off_m + res
    cost[window] = np.where(far, np.inf, cost[window])
    return Traversability(grid_map, taken, clearance, cost, footprint_m, base.circles)


def turned(circles: Array, poses: Array) -> Array:
    """(..., n, 2) where circles' centers (n, >= 2) in the base frame are [m] with the base at poses (..., 3)."""
    c, s = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    x, y = circles[:, 0], circles[:, 1]
    places: Array = np.stack([c * x - s * y, s * x + c * y], -1) + poses[..., None, :2]
    return places


def about(cells: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The smallest window around all true cells (H, W): without a prior map only a small part of a map is free."""
    rows, columns = (np.flatnonzero(cells.any(axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0), slice(0)
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def occupied(grid_map: OccupancyMap, boxes: Iterable[Corners] = (), discs: Iterable[Disc] = ()) -> NDArray[np.bool_]:
    """(H, W) bool; the map's obstacles with boxes and discs besides; see `traversability`."""
    taken = grid_map.occupied.copy()
    for lowest, highest in boxes:
        (r0, c0), (r1, c1) = grid_map.cell(lowest), grid_map.cell(highest)
        taken[max(r0, 0) : max(r1 + 1, 0), max(c0, 0) : max(c1 + 1, 0)] = True
    for x, y, radius in discs:
        (r0, c0), (r1, c1) = (grid_map.cell((x + d, y + d)) for d in (-radius, radius))
        rows, columns = slice(max(r0, 0), max(r1 + 1, 0)), slice(max(c0, 0), max(c1 + 1, 0))
        window = taken[rows, columns]
        if window.size:
            r, c = np.ogrid[: window.shape[0], : window.shape[1]]
            away = grid_map.center(rows.start, columns.start) - (x, y)
            window |= np.hypot(r * grid_map.resolution_m + away[1], c * grid_map.resolution_m + away[0]) <= radius
    return taken


def snapped(grid_map: OccupancyMap, boxes: Iterable[Corners]) -> tuple[Box, ...]:
    """The same boxes, from center to center of their outermost cells: what rests does not seem to move."""

    def center(corner: Array | tuple[float, float]) -> tuple[float, float]:
        x, y = grid_map.center(*grid_map.cell(corner)).tolist()
        return x, y

    return tuple(sorted({(center(lowest), center(highest)) for lowest, highest in boxes}))


def floor_obstacles(entries: Iterable[Entry], low_m: float = 0.30) -> list[tuple[Array, Array]]:
    """Boxes of the movable things that stand on the floor, for `traversability`.

    Our choice: those that begin below `low_m` and are neither carried nor in a container; what lies on furniture is
    over cells that are occupied anyway.
    """
    return [
        (e.lowest, e.highest)
        for e in entries
        if e.kind == "object" and not e.held and e.inside is None and e.lowest[2] < low_m
        if np.isfinite((e.lowest, e.highest)).all()
    ]
