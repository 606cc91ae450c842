"""Start places on floors and lawns, and distances from places where a robot can stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.layout.prior_map import BAND_M, marked, prior_map

# All our choice.
ROBOT_CLEARANCE_M = 0.45  # free floor around the robot at the start
OBJECT_CLEARANCE_M = 0.30  # free floor around an object's edge, so that a hand gets at it
APART_M = 0.45  # between two objects' edges
DOORWAY_M = 0.9  # nothing lies this near the middle of a doorway
PASSAGE_M = 0.36  # half the width of the ways that things on the floor leave free
SHARES = (1.0, 0.7, 0.4)  # of those distances that things on the floor have, the largest that there is room for
NEAR_M = 0.5  # things on the floor lie this near to where a robot can stand
REACH_M = 0.85  # from where a robot can stand to a thing on a fixture,
TWO_HANDS_REACH_M = 0.58  # and to one that takes two hands
_DRAWS = 400


class Ground:
    """Free places on floors and lawns, fewer with each draw.

    Args:
        house: Whose.
        open_doors: Solids in the world of doors and lids that stand open.
    """

    def __init__(self, house: House, open_doors: Sequence[Solid] = ()) -> None:
        self._house, self._map = house, prior_map(house)
        occupied = marked(self._map, open_doors).occupied
        self._clearance = ndimage.distance_transform_edt(~occupied) * self._map.resolution_m
        self._reachable = standing_room(self._map)
        self._from_reachable_m, self._standing = self._nearest_standing()
        self._taken: list[tuple[Array, float]] = []
        self._reached: list[Array] = []
        self._occupied = self._map.occupied.copy()  # with what was drawn

    def _nearest_standing(self) -> tuple[Array, NDArray[np.intp]]:
        """(H, W) the distance [m] to the nearest place to stand in the same room, and (2, H, W) its cell.

        A place beyond a wall may be nearer, but nobody reaches through the wall.
        """
        away = np.full(self._reachable.shape, np.inf)
        nearest = np.indices(away.shape)
        for room in np.unique(self._map.rooms[self._reachable]):
            here = self._map.rooms == room
            far, at = ndimage.distance_transform_edt(~(self._reachable & here), return_indices=True)
            away[here], nearest[:, here] = far[here] * self._map.resolution_m, at[:, here]
        return away, nearest

    def is_ground(self, support: str) -> bool:
        """Whether a support is a floor, or so flat that a robot drives over it, such as a lawn."""
        return support.startswith("floor_") or self._house.fixtures[support].extent()[1, 2] < BAND_M[0]

    def draw(self, ground: str, radius: float, clearance: float, rng: np.random.Generator) -> tuple[Array, float]:
        """(2,) a free place [m] on some ground for something of a radius [m], and its height [m]; taken from now on.

        Raises:
            BackendError: There is none.
        """
        standing = self._reachable if radius == 0.0 else self._from_reachable_m < NEAR_M
        connected = standing_room(replace(self._map, occupied=self._occupied))
        open_ground, height = self._open(ground, radius)
        for share in SHARES if radius else SHARES[:1]:
            cells = np.argwhere(open_ground & standing & (self._clearance > radius + share * clearance))
            for _ in range(_DRAWS if len(cells) else 0):
                xy = self._map.center(*cells[rng.integers(len(cells))])
                if self._is_free(xy, radius, share) and (
                    self._leaves_a_way(xy, radius) if radius else connected[self._map.cell(xy)]
                ):
                    self._taken.append((xy, radius))
                    return xy, height
        raise BackendError(f"no free place of radius {radius:.2f} m on {ground}")

    def _open(self, ground: str, radius: float) -> tuple[NDArray[np.bool_], float]:
        """(H, W) bool: cells where a thing of a radius [m] lies wholly on some ground, and the ground's height [m]."""
        if not ground.startswith("floor_"):
            low, high = self._house.fixtures[ground].extent()
            return self._within(low + radius, high - radius), float(high[2])
        free = self._map.rooms == self._map.room_names.index(ground.removeprefix("floor_"))
        for name, fixture in self._house.fixtures.items():
            if self.is_ground(name) and any(fixture.solids()):  # such as a lawn, which covers the garden's floor
                low, high = fixture.extent()
                free = free & ~self._within(low - radius, high + radius)
        return free, 0.0

    def _within(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """(H, W) bool: the cells whose middle is between two corners."""
        rows, columns = self._map.occupied.shape
        x = self._map.origin_m[0] + (np.arange(columns) + 0.5) * self._map.resolution_m
        y = self._map.origin_m[1] + (np.arange(rows) + 0.5) * self._map.resolution_m
        return np.asarray(((low[1] < y) & (y < high[1]))[:, None] & ((low[0] < x) & (x < high[0])))

    def away_m(self, xy: Array) -> Array:
        """(n,) how far [m] places (n, 2) are from where a robot can stand in the same room; infinite outside rooms."""
        cells = self._cells(xy)
        inside = np.asarray(((cells >= 0) & (cells < self._map.occupied.shape)).all(1))
        cells = np.where(inside[:, None], cells, 0)
        return np.where(inside, self._from_reachable_m[cells[:, 0], cells[:, 1]], np.inf)

    def ahead(self, xy: Array) -> Array:
        """(n,) the heading [rad] toward places (n, 2) of a robot at the nearest place to stand in the same room."""
        cells = np.clip(self._cells(xy), 0, np.array(self._from_reachable_m.shape) - 1)
        nearest = self._standing[:, cells[:, 0], cells[:, 1]].T[:, ::-1]
        way = xy - (self._map.origin_m + (nearest + 0.5) * self._map.resolution_m)
        return np.asarray(np.arctan2(way[:, 1], way[:, 0]))

    def _cells(self, xy: Array) -> NDArray[np.intp]:
        """(n, 2) rows and columns of places (n, 2)."""
        return np.floor((xy - self._map.origin_m) / self._map.resolution_m).astype(int)[:, ::-1]

    def keep_way_to(self, xy: Array) -> None:
        """Keep a way free, in later draws, to a place (2,) of a thing off the floor."""
        self._reached.append(np.asarray(xy, float)[:2])

    def _leaves_a_way(self, xy: Array, radius: float) -> bool:
        """Whether a robot still gets, within the room, from each doorway and each thing in it to all others.

        If so, a thing stands there from now on.
        """
        cell = np.array(self._map.cell(xy))
        index = self._map.rooms[tuple(cell)]
        room = self._map.rooms == index
        (window,) = ndimage.find_objects(room.astype(np.int32))
        low = np.array([part.start for part in window])
        name = self._map.room_names[index]
        things = [(xy, radius), *self._taken]
        ends = [(np.asarray(d.at), PASSAGE_M) for d in self._house.doorways if name in d.rooms]
        ends += [(at, r + NEAR_M) for at, r in things if self._room_index(at) == index]
        ends += [(at, REACH_M) for at in self._reached if self._room_index(at) == index]
        cells = [np.array(self._map.cell(end)) - low for end, _ in ends]
        before = self._occupied[window]
        away = norm(np.moveaxis(np.indices(before.shape), 0, -1) - (cell - low), axis=-1)
        after = before | (away * self._map.resolution_m < radius)
        parts, away_m = self._parts(after, room[window], cells)
        parts_before, away_before_m = self._parts(before, room[window], cells)
        too_far = (away_m > np.array([limit for _, limit in ends])) & (away_m > away_before_m)
        if len(parts) > len(parts_before) or too_far.any():
            return False
        self._occupied[window] = after
        return True

    def _room_index(self, xy: Array) -> int:
        return int(self._map.rooms[self._map.cell(xy)])

    def _parts(self, occupied: NDArray[np.bool_], room: NDArray[np.bool_], ends: list[Array]) -> tuple[set[int], Array]:
        """The passable parts of a room nearest to some cells, and the distance [m] of each cell."""
        wide = ndimage.distance_transform_edt(~occupied) * self._map.resolution_m > PASSAGE_M
        parts, count = ndimage.label(wide & room)
        if not count:
            return set(), np.full(len(ends), np.inf)
        away, nearest = ndimage.distance_transform_edt(parts == 0, return_indices=True)
        cells = np.clip(ends, 0, np.array(parts.shape) - 1)
        away_m = np.array([away[row, column] for row, column in cells]) * self._map.resolution_m
        return {int(parts[tuple(nearest[:, row, column])]) for row, column in cells}, away_m

    def _is_free(self, xy: Array, radius: float, share: float) -> bool:
        doorways = all(norm(xy - np.asarray(d.at)) > DOORWAY_M for d in self._house.doorways)
        return doorways and all(norm(xy - other) > radius + r + share * APART_M for other, r in self._taken)


def standing_room(grid: OccupancyMap) -> NDArray[np.bool_]:
    """(H, W) bool: cells where a robot can stand and reach nearly all others."""
    clearance = ndimage.distance_transform_edt(~grid.occupied) * grid.resolution_m
    passable, _ = ndimage.label(clearance > PASSAGE_M)
    return np.asarray(passable == np.bincount(passable[passable > 0]).argmax())
