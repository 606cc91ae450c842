"""Floor seen by the camera: rays over its field of view, stopped by walls, furniture and depth readings."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.kinematics import inverse, rot_z
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE
from mpvi_bt.ground.robot.protocol import CameraImage

# Our choice: floor counts as seen if a small thing on it would be, so rays go to this height above it.
LOOK_M = 0.10
_BEFORE_M, _BEFORE_PER_M = 0.05, DEPTH_NOISE.ray_m  # what is measured so little before a cell is in it


_SEEN, _HIDDEN = 1, 2  # what a look found of a cell
_NO_DEPTH = np.zeros((0, 0), np.float32)


class VisibilityMap:
    """The floor that was seen so far (Paper, Navigation appendix: ray-based visibility updates on the occupancy map).

    A cell is seen from a picture if it is free, if a straight line from the camera reaches it without crossing an
    occupied cell, and if the point 10 cm above its center lies within the picture with nothing measured before it: a
    thing that the map lacks hides what is behind it, and a pixel without depth tells nothing.

    Attributes:
        seen: (H, W) bool, cells as those of the map.
    """

    def __init__(self, grid_map: OccupancyMap, reach_m: float = 4.0) -> None:
        """Nothing is seen yet.

        Args:
            grid_map: Says where the cells are. What is occupied is told anew with each update.
            reach_m: How far a look counts; small things farther away are too small in the picture.
        """
        self.seen: NDArray[np.bool_] = np.zeros(grid_map.occupied.shape, bool)
        self._origin, self._res, self._reach_m = np.asarray(grid_map.origin_m, float), grid_map.resolution_m, reach_m
        self._to_world = np.array([[self._res, 0, 0], [0, self._res, 0], [0, 0, 0], [0, 0, 1]], float)
        self._to_world[:3, 2] = *self._origin, LOOK_M  # of (column, row, 1)
        self._last: CameraImage | None = None

    def update(self, image: CameraImage, occupied: NDArray[np.bool_]) -> int:
        """Add what a picture shows.

        Args:
            image: Of any camera; its pose in the world says where it looks.
            occupied: (H, W) bool, what sight is blocked by.

        Returns:
            How many cells were seen for the first time.
        """
        self._last = image
        yaw, half = _field_of_view(image)
        depth = np.ascontiguousarray(image.depth, np.float32)
        return self._look(image.T_world_camera, yaw, half, occupied, None, depth, image, True)

    def would_see(
        self,
        xy: Array,
        yaw: float,
        fov_rad: float,
        occupied: NDArray[np.bool_],
        wanted: NDArray[np.bool_] | None = None,
    ) -> int:
        """How many unseen cells a look would add if depth showed nothing that the map lacks.

        Floor that the last picture's camera, moved there, would not have in its picture does not count, such as that
        right before the robot: what is foretold can be had.

        Args:
            xy: (2,) where the camera would be [m].
            yaw: Where it would look [rad].
            fov_rad: Its horizontal field of view.
            occupied: (H, W) bool, what sight is blocked by.
            wanted: (H, W) bool, the cells that count; None: all that are unseen.
        """
        T = np.eye(4)
        if self._last is not None:
            turn = yaw - _heading(self._last.T_world_camera)
            T[:3, :3] = matmul(rot_z(turn), self._last.T_world_camera[:3, :3])
            T[2, 3] = self._last.T_world_camera[2, 3]
        T[:2, 3] = np.asarray(xy, float)[:2]
        return self._look(T, yaw, fov_rad / 2, occupied, wanted, _NO_DEPTH, self._last, False)

    def within_reach(self, xy: Array, wanted: NDArray[np.bool_]) -> int:
        """How many cells of `wanted` (H, W) a look from `xy` (2,) [m] might show: `would_see` never says more."""
        x, y = ((np.asarray(xy, float)[:2] - self._origin) / self._res).tolist()
        return int(np.count_nonzero(wanted[self._window(y, x)])) if self._inside(y, x) else 0

    def _look(
        self, T_world_camera: Array, yaw: float, half: float, occupied: NDArray[np.bool_],
        wanted: NDArray[np.bool_] | None, depth: NDArray[np.float32], picture: CameraImage | None, keep: bool,
    ) -> int:  # fmt: skip
        """Cast rays `half` to each side of `yaw`; floor counts that a picture like `picture` would have in it."""
        if occupied.shape != self.seen.shape:
            raise ValueError(f"occupied is {occupied.shape}, the visibility map {self.seen.shape}")
        x, y = ((T_world_camera[:2, 3] - self._origin) / self._res).tolist()
        reach = self._reach_m / self._res
        if not self._inside(y, x):
            return 0
        window = self._window(y, x)  # only where rays can get: a look costs the same on any map
        seen = np.ascontiguousarray(self.seen[window]) if wanted is None else ~wanted[window]
        fresh = np.zeros(seen.shape, np.uint8)
        rays = max(2, math.ceil(2 * half * reach / 0.5))  # half a cell apart at the far end
        height, width = (0, 0) if picture is None else picture.depth.shape
        project = np.eye(3)
        if picture is not None:
            project = matmul(picture.K, inverse(T_world_camera)[:3], self._to_world)
        count: int = _cast(
            np.ascontiguousarray(occupied), seen, fresh, window[0].start, window[1].start, y, x, yaw, half,
            rays, reach, height, width, depth, project,
        )  # fmt: skip
        if keep and count:
            self.seen[window] |= fresh == _SEEN
        return count

    def _inside(self, row: float, column: float) -> bool:
        """Whether a place [cells] is on the map; what is no number is nowhere."""
        return 0 <= row < self.seen.shape[0] and 0 <= column < self.seen.shape[1]

    def _window(self, row: float, column: float) -> tuple[slice, slice]:
        """The rows and columns that a look from a place [cells] on the map can get to."""
        reach, (height, width) = self._reach_m / self._res, self.seen.shape
        rows = slice(max(math.floor(row - reach) - 1, 0), min(math.ceil(row + reach) + 1, height))
        return rows, slice(max(math.floor(column - reach) - 1, 0), min(math.ceil(column + reach) + 1, width))


def _heading(T_world_camera: Array) -> float:
    return math.atan2(T_world_camera[1, 2], T_world_camera[0, 2])


@lru_cache(maxsize=1)  # two maps take in each picture
def _field_of_view(image: CameraImage) -> tuple[float, float]:
    """A camera's heading [rad], and the angle [rad] to each side of it covered by the picture on the floor."""
    height, width = image.depth.shape
    (fx, _, cx), (_, fy, cy), _ = image.K
    corners = np.array([[(u - cx) / fx, (v - cy) / fy, 1.0] for u in (0, width) for v in (0, height)])
    rays = matmul(corners, image.T_world_camera[:3, :3].T)
    yaw = _heading(image.T_world_camera)
    along, across = matmul(rays[:, :2], rot_z(yaw)[:2, :2]).T
    if along.min() < 1e-6:  # so far down that the picture holds the place below the camera: all around
        return yaw, math.pi
    return yaw, float(np.abs(np.arctan2(across, along)).max())


def warm() -> None:
    """Compile the rays, or load them from numba's disk cache, before time matters."""
    floor = OccupancyMap(np.zeros((2, 2), bool), np.zeros((2, 2), np.int16), ("room",), 0.05, np.zeros(2))
    VisibilityMap(floor).would_see(np.array([0.05, 0.05]), 0.0, 1.0, floor.occupied)


@compiled_later
def _cast(occupied, seen, fresh, low_row, low_column, y, x, yaw, half, rays, reach, height, width, depth, project):  # type: ignore
    """Mark in `fresh` the unseen free cells that rays from (y, x) meet: 1 seen, 2 not; return how many are seen.

    Everything is in cells; `seen` and `fresh` begin at (low_row, low_column). `project` (3, 3) takes (column, row, 1)
    to the pixels of a picture of height x width, 0 for none. Its depth says what is hidden; an empty one hides nothing.
    """
    rows, columns = occupied.shape
    count = 0
    for ray in range(rays):
        angle = yaw - half + 2.0 * half * ray / (rays - 1)
        dx, dy = math.cos(angle), math.sin(angle)
        column, row = int(x), int(y)
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        # Along the ray: the way from one cell border to the next, and to the next one from here.
        per_x = abs(1.0 / dx) if dx != 0.0 else 1e30
        per_y = abs(1.0 / dy) if dy != 0.0 else 1e30
        next_x = (column + 1 - x if dx > 0 else x - column) * per_x
        next_y = (row + 1 - y if dy > 0 else y - row) * per_y
        first = True
        while True:
            if occupied[row, column]:
                if not first:
                    break
            elif not seen[row - low_row, column - low_column] and fresh[row - low_row, column - low_column] == 0:
                shown = True
                if height > 0:
                    a, b = column + 0.5, row + 0.5
                    z = project[2, 0] * a + project[2, 1] * b + project[2, 2]
                    shown = z > 1e-3
                    if shown:
                        u = (project[0, 0] * a + project[0, 1] * b + project[0, 2]) / z
                        v = (project[1, 0] * a + project[1, 1] * b + project[1, 2]) / z
                        shown = u >= 0 and v >= 0 and u < width and v < height
                        if shown and depth.size > 0:
                            measured = depth[int(v), int(u)]
                            # Neither nan, inf nor what is not above 0 tells anything.
                            near = z - _BEFORE_M - _BEFORE_PER_M * z * z
                            shown = measured > 0 and measured >= near and measured < np.inf
                fresh[row - low_row, column - low_column] = _SEEN if shown else _HIDDEN
                count += shown
            first = False
            if next_x < next_y:
                if next_x > reach:
                    break
                column += step_x
                next_x += per_x
            else:
                if next_y > reach:
                    break
                row += step_y
                next_y += per_y
            if column < 0 or row < 0 or column >= columns or row >= rows:
                break
    return count
