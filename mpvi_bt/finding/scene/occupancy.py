"""Map of the floor for the base: a prior map updated with depth, or a map from depth alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.kinematics import inverse
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE
from mpvi_bt.ground.robot.protocol import CameraImage

# Every figure is our choice.
BAND_M = (0.06, 1.6)  # heights of what is in the way: lower things the base drives over, higher ones it passes under
REACH_M = 5.0  # beyond, the noise of depth is as large as a cell
_RISE = 0.025  # the band begins no lower than this share of the range: a camera is easily mounted a degree off
_LOOSE_M = (0.06, 0.40)  # heights at which something of all that can be moved is: seats are higher
_HITS = 2  # of pixels, before a cell counts as occupied
_SAME_M = 0.10  # what is seen so near to something of the prior map is that, a little off
_THROUGH_M, _THROUGH_PER_M = 0.10, DEPTH_NOISE.ray_m  # so far behind something it must be seen through
_BASE_M = 0.25  # what is fixed reaches up that far, as bases do
_NEAR_M = 1.5  # floor between the robot and the picture's lower edge is taken for free up to this


class Occupancy:
    """Known free and occupied floor for the base.

    Points of depth between 6 cm and 1.6 m above the floor are obstacles. A cell that has two of them becomes occupied,
    and is free again once a picture sees through where they were. What is fixed of a prior map stays; points within
    10 cm of it are taken for it, or errors of the pose would narrow every doorway. Without a prior map floor is known
    once it is seen; what is not known counts as occupied for driving, and the robot's own place as free.

    Attributes:
        map: What to drive by; another object after each change.
        known: (H, W) bool: everything with a prior map, else what was seen. `map.occupied & known` is what stands
            somewhere; the rest of `map.occupied` is only unknown.
    """

    def __init__(self, grid_map: OccupancyMap, known: NDArray[np.bool_], fixed: NDArray[np.bool_]) -> None:
        """See `prior` and `unknown`; `fixed` (H, W) stays occupied whatever is seen."""
        self.map, self.known = grid_map, known
        steps = round(_SAME_M / grid_map.resolution_m)
        self._explained = ndimage.binary_dilation(fixed, iterations=steps) if fixed.any() and steps else fixed
        self._fixed, self._complete = fixed, bool(known.all())
        self._hits = np.zeros(fixed.shape, np.uint8)
        self._lowest_cm = np.full(fixed.shape, 255, np.uint8)  # of the hits
        self._highest_cm = np.zeros(fixed.shape, np.uint8)

    @classmethod
    def prior(cls, grid_map: OccupancyMap, fixed: NDArray[np.bool_] | None = None) -> Occupancy:
        """Start with a map, of which (H, W) `fixed` is never cleared; None: nothing of it is.

        The rest, such as chairs, is free once it is seen through up to the height of a seat.
        """
        fixed = grid_map.occupied if fixed is None else fixed
        occupancy = cls(grid_map, np.ones(fixed.shape, bool), fixed.copy())
        loose = grid_map.occupied & ~fixed
        occupancy._hits[loose] = _HITS
        occupancy._lowest_cm[loose], occupancy._highest_cm[loose] = (round(100 * height) for height in _LOOSE_M)
        return occupancy

    @classmethod
    def unknown(
        cls, center_xy: Array | Sequence[float], size_m: tuple[float, float] = (40.0, 40.0), resolution_m: float = 0.05
    ) -> Occupancy:
        """Start without a map.

        Args:
            center_xy: (2,) [m] middle of what can be mapped, such as where the robot is.
            size_m: Its extent along x and y; nothing beyond is ever known.
            resolution_m: Edge of a cell.
        """
        columns, rows = (round(size / resolution_m) for size in size_m)
        origin = np.asarray(center_xy, float)[:2] - np.array([columns, rows]) * resolution_m / 2
        rooms = np.full((rows, columns), -1, np.int16)
        blank = OccupancyMap(np.ones((rows, columns), bool), rooms, (), resolution_m, origin)
        return cls(blank, np.zeros((rows, columns), bool), np.zeros((rows, columns), bool))

    def save(self) -> dict[str, NDArray[Any]]:
        """What was learned: arrays (H, W) by name."""
        return {"known": self.known, "hits": self._hits, "lowest": self._lowest_cm, "highest": self._highest_cm}

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Bring this to what was saved of another one with the same prior map.

        Raises:
            KeyError, ValueError: It is not as `save` gives it, or of another size.
        """
        arrays = [saved[name].astype(was.dtype) for name, was in self.save().items()]
        if any(array.shape != self.known.shape for array in arrays):
            raise ValueError(f"the map is {self.known.shape}, not {[array.shape for array in arrays]}")
        self.known, self._hits, self._lowest_cm, self._highest_cm = arrays
        self.map = replace(self.map, occupied=self._fixed | (self._hits >= _HITS) | ~self.known)

    def update(self, image: CameraImage, ignore: Sequence[tuple[float, float, float]] = ()) -> bool:
        """Add the obstacles in a picture, and remove those it sees through.

        Args:
            image: Upright, of the head. Pixels whose depth is nan, infinite or not above 0 tell nothing.
            ignore: x, y, radius [m] of circles whose points are no obstacles: the robot itself and what it carries.
                Their floor is known, as the robot is there.

        Returns:
            Whether anything became occupied, free or known.
        """
        res, shape = self.map.resolution_m, np.array(self._fixed.shape)
        eye = (image.T_world_camera[:2, 3] - self.map.origin_m) / res
        if not np.isfinite(image.T_world_camera).all():
            return False
        low = np.clip(np.floor(eye[::-1] - REACH_M / res).astype(int) - 1, 0, shape)
        high = np.clip(np.ceil(eye[::-1] + REACH_M / res).astype(int) + 2, low, shape)
        window = np.s_[low[0] : high[0], low[1] : high[1]]
        floor, learns = np.zeros(tuple(high - low), bool), not self._complete
        if learns:
            self._own_place(floor, ignore, low)
        corner = self.map.origin_m + low[::-1] * res
        depth = np.ascontiguousarray(image.depth.T, np.float32)  # by columns, as they are gone through
        circles = np.array(ignore, float).reshape(-1, 3)
        T, K = np.ascontiguousarray(image.T_world_camera, float), np.ascontiguousarray(image.K, float)
        explained, hits = self._explained[window].copy(), self._hits[window].copy()
        lowest, highest = self._lowest_cm[window].copy(), self._highest_cm[window].copy()
        _see(depth, K, T, inverse(T), corner, res, circles, explained, hits, lowest, highest, floor, learns)
        known = self.known[window] | floor | (hits >= _HITS)
        occupied = self._fixed[window] | (hits >= _HITS) | ~known
        self._hits[window], self._lowest_cm[window], self._highest_cm[window] = hits, lowest, highest
        if np.array_equal(known, self.known[window]) and np.array_equal(occupied, self.map.occupied[window]):
            return False
        self.known[window] = known
        whole = self.map.occupied.copy()
        whole[window] = occupied
        self.map = replace(self.map, occupied=whole)
        return True

    def standing(self, x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        """(len(x), len(y), len(z)) whether something is known to stand at the crossings of three ranges [m].

        From the floor up to the highest that pictures have shown there: what is below that may have been hidden. What
        only a prior map tells of stands as high as a base at least.
        """
        top_m = np.where(self._hits >= _HITS, self._highest_cm / 100.0, np.where(self._fixed, _BASE_M, -np.inf))
        (column, row), shape = (
            (
                np.floor((along - origin) / self.map.resolution_m).astype(int)
                for along, origin in zip((x, y), self.map.origin_m, strict=True)
            ),
            top_m.shape,
        )
        inside = ((row >= 0) & (row < shape[0]))[None, :] & ((column >= 0) & (column < shape[1]))[:, None]
        tops = top_m[np.clip(row, 0, shape[0] - 1)][:, np.clip(column, 0, shape[1] - 1)].T
        return np.asarray(np.where(inside, tops, -np.inf)[:, :, None] >= z)

    def clear(self, lowest: Array, highest: Array) -> None:
        """Clear depth obstacles at a thing's old place. In the hand, the thing may hide that place from the camera.

        Args:
            lowest, highest: (3,) corners [m] of its box in the world; what is within 10 cm goes, too.
        """
        low, high = (
            np.floor((corner[:2] - self.map.origin_m) / self.map.resolution_m).astype(int)[::-1]
            for corner in (lowest - _SAME_M, highest + _SAME_M)
        )
        rows, columns = (slice(max(a, 0), max(b + 1, 0)) for a, b in zip(low, high, strict=True))
        window = rows, columns
        self._hits[window], self._lowest_cm[window], self._highest_cm[window] = 0, 255, 0
        whole = self.map.occupied.copy()
        whole[window] = self._fixed[window] | ~self.known[window]
        self.map = replace(self.map, occupied=whole)

    def _own_place(
        self, floor: NDArray[np.bool_], circles: Sequence[tuple[float, float, float]], low: NDArray[np.int64]
    ) -> None:
        """Mark the cells of `floor` with their centers in circles. `low` is the first cell of `floor`."""
        rows, columns = np.ogrid[: floor.shape[0], : floor.shape[1]]
        for x, y, radius in circles:
            c, r = (np.array([x, y]) - self.map.origin_m) / self.map.resolution_m - low[::-1] - 0.5
            floor |= (rows - r) ** 2 + (columns - c) ** 2 <= (radius / self.map.resolution_m) ** 2


def warm() -> None:
    """Compile the update, or load it from numba's disk cache, before time matters."""
    depth, rgb = np.zeros((2, 2), np.float32), np.zeros((2, 2, 3), np.uint8)
    Occupancy.unknown((0.0, 0.0), (1.0, 1.0)).update(CameraImage("head", rgb, depth, None, {}, np.eye(3), np.eye(4)))


@compiled_later
def _see(  # type: ignore
    depth, K, T_world_camera, T_camera_world, corner, res, circles, explained, hits, lowest, highest, floor, learns
):
    """Sort the points of a picture into cells; arrays of cells begin at `corner` (2,) [m] and are changed in place.

    Of `floor` nothing is said if it `learns` nothing by it: then only points at the height of obstacles are looked at.
    """
    rows, columns = hits.shape
    T, inv = T_world_camera, T_camera_world
    now = np.zeros((rows, columns), np.uint8)
    per_pixel, per_cell = 1.0 / K[1, 1], 1.0 / res
    for u in range(depth.shape[0]):
        below = (
            2  # what the pixel below showed: 0 nothing that counts, 1 floor, 2 the robot itself or the picture's edge
        )
        last_x, last_y = T[0, 3], T[1, 3]
        tan = (u + 0.5 - K[0, 2]) / K[0, 0]
        ray_x, ray_y, ray_z = T[0, 0] * tan + T[0, 2], T[1, 0] * tan + T[1, 2], T[2, 0] * tan + T[2, 2]
        for v in range(depth.shape[1] - 1, -1, -1):
            z = float(depth[u, v])
            if not (z > 0.0 and z < 1e6):
                below = 0
                continue
            tan = (v + 0.5 - K[1, 2]) * per_pixel
            up = T[2, 3] + z * (ray_z + tan * T[2, 1])
            if not (learns or BAND_M[0] <= up <= BAND_M[1]):
                continue
            dx, dy = z * (ray_x + tan * T[0, 1]), z * (ray_y + tan * T[1, 1])
            x, y = T[0, 3] + dx, T[1, 3] + dy
            own = False
            for k in range(circles.shape[0]):
                own |= (x - circles[k, 0]) ** 2 + (y - circles[k, 1]) ** 2 <= circles[k, 2] ** 2
            if own:
                below = 2 if below == 2 else 0
                continue
            away = math.sqrt(dx * dx + dy * dy)
            least = max(BAND_M[0], _RISE * away)
            if away > REACH_M or abs(up) >= least:
                below = 0
                if away > REACH_M or not least <= up <= BAND_M[1]:
                    continue
                r, c = math.floor((y - corner[1]) * per_cell), math.floor((x - corner[0]) * per_cell)
                if 0 <= r < rows and 0 <= c < columns and not explained[r, c]:
                    now[r, c] = min(now[r, c] + 1, 200)
                    lowest[r, c], highest[r, c] = min(lowest[r, c], up * 100.0), max(highest[r, c], up * 100.0)
                continue
            # Floor: up to here from that of the pixel below; from the robot if the picture begins here.
            if below == 0 or (below == 2 and away > _NEAR_M):
                last_x, last_y = x, y
            steps = int(math.sqrt((x - last_x) ** 2 + (y - last_y) ** 2) * per_cell * 2.0) + 1
            for k in range(1, steps + 1):
                a, b = last_x + (x - last_x) * k / steps, last_y + (y - last_y) * k / steps
                r, c = math.floor((b - corner[1]) * per_cell), math.floor((a - corner[0]) * per_cell)
                if 0 <= r < rows and 0 <= c < columns:
                    floor[r, c] = True
            last_x, last_y = x, y
            below = 1
    for r in range(rows):
        for c in range(columns):
            if now[r, c] > 0:
                hits[r, c] = min(hits[r, c] + now[r, c], 200)
            elif hits[r, c] > 0:  # is where they were seen through now, as far as it is in the picture?
                through, blocked = 0, 0
                for k in range(4):
                    up = (lowest[r, c] + (highest[r, c] - float(lowest[r, c])) * k / 3.0) / 100.0
                    x, y = corner[0] + (c + 0.5) * res, corner[1] + (r + 0.5) * res
                    z = inv[2, 0] * x + inv[2, 1] * y + inv[2, 2] * up + inv[2, 3]
                    if z < 1e-3:
                        continue
                    u = K[0, 0] * (inv[0, 0] * x + inv[0, 1] * y + inv[0, 2] * up + inv[0, 3]) / z + K[0, 2]
                    v = K[1, 1] * (inv[1, 0] * x + inv[1, 1] * y + inv[1, 2] * up + inv[1, 3]) / z + K[1, 2]
                    if 0 <= u < depth.shape[0] and 0 <= v < depth.shape[1]:
                        behind = _THROUGH_M + _THROUGH_PER_M * z * z
                        if T[2, 3] > up:  # behind what is low the floor is not that far
                            behind = min(behind, 0.5 * z * up / (T[2, 3] - up))
                        if z + behind < depth[int(u), int(v)] < 1e6:
                            through += 1
                        else:
                            blocked += 1
                if through > 0 and blocked == 0:
                    hits[r, c], lowest[r, c], highest[r, c] = 0, 255, 0
