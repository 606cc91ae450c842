"""What depth pictures leave in doubt: the distance to whatever has not been seen to be free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.compiled import compiled
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE
from mpvi_bt.ground.robot.protocol import CameraImage

# Our choice: cells as fine as arms keep clear of things, in a volume of the reach of an arm.
CELL_M = 0.025
_SIZE_M = (3.2, 3.2, 2.0)  # the robot's reach from every place that it might drive to for one thing
_LOWEST_M = -0.05
_SURFACE_M = 0.012  # a point that much before a surface, beside the noise of depth, is free
_NOISE_PER_M = DEPTH_NOISE.smoothed_m
_REMEMBERED_M = 0.08  # our choice: how thick surfaces are along the line of sight that only earlier pictures showed
_FAR = 9.0  # what distance there is to nothing [m]: beyond the field's size


@dataclass(frozen=True, eq=False)
class View:
    """One depth picture.

    Attributes:
        image: The picture.
        through: (H, W) bool: pixels that tell nothing of what is behind them, such as the robot's own body or a thing
            that is to be grasped. What is before them is still seen to be free.
        own: (H, W) bool: those of them that the robot and what it holds take up; None for none.
    """

    image: CameraImage
    through: NDArray[np.bool_]
    own: NDArray[np.bool_] | None = None


class Field:
    """An `mpvi_bt.ground.robot.collision.Obstacles` from depth pictures.

    A cell is blocked if some picture shows a surface at it or before it, and none shows it to be free: what is hidden
    counts as solid. What no picture has in view is taken for free; a robot that could not move before it had seen all
    around itself would never move.
    """

    def __init__(
        self, views: Sequence[View], middle: Array, size_m: tuple[float, float, float] = _SIZE_M,
        cell_m: float = CELL_M, surface_m: float = _SURFACE_M, thick_m: float = _FAR, before: Sequence[View] = (),
        known: Callable[[Array, Array, Array], tuple[NDArray[np.bool_], NDArray[np.bool_]]] | None = None,
    ) -> None:  # fmt: skip
        """Carve the cells about a place.

        Args:
            views: What was seen, in one world frame.
            middle: (2,) [m] place on the floor about which the field extends 1.6 m to each side, and from the floor
                1.95 m up; or (3,) the middle of a field of another size.
            size_m: The field's.
            cell_m: Edge of a cell.
            surface_m: A point that much before a surface is free.
            thick_m: How far behind a surface cells count as hidden; farther behind they are given the benefit of doubt.
            before: Earlier views: what surfaces they showed counts where `views` have nothing in view.
            known: Says, for three ranges of coordinates, what counts likewise, and what counts where the robot itself
                is in the way of `views`; see `Remembered.around`.
        """
        count = np.round(np.array(size_m) / cell_m).astype(int)
        low_z = _LOWEST_M if len(middle) == 2 else float(middle[2]) - size_m[2] / 2
        self._low = np.array([*(np.asarray(middle, float)[:2] - np.array(size_m[:2]) / 2), low_z])
        self._cell = cell_m
        self._to_world = np.eye(4)
        doubt = np.zeros(tuple(count), np.uint8)
        self._mark(doubt, views, surface_m, thick_m)
        veiled = doubt == _VEILED
        doubt[veiled] = 0
        if before:
            earlier = np.where(doubt == 0, 0, _FREE).astype(np.uint8)  # only there do they count
            self._mark(earlier, before, surface_m, _REMEMBERED_M)
            doubt[earlier == _HIDDEN] = _HIDDEN
        if known is not None:
            stays, shown = known(
                *(low + cell_m * (np.arange(n) + 0.5) for low, n in zip(self._low, count, strict=True))
            )
            doubt[(doubt == 0) & (stays | (veiled & shown))] = _HIDDEN
        self.blocked: NDArray[np.bool_] = doubt == _HIDDEN
        self._distance = distance_to(self.blocked) * np.float32(cell_m) - np.float32(cell_m / 2)

    def _mark(self, doubt: NDArray[np.uint8], views: Sequence[View], surface_m: float, thick_m: float) -> None:
        """Mark cells by what views show there; those marked free stay so."""
        for view in views:
            image, K = view.image, view.image.K
            depth = np.where(view.through, -np.abs(image.depth), image.depth).astype(np.float32)
            own = np.zeros_like(view.through) if view.own is None else view.own
            first = kin.transform(np.eye(3), self._low + self._cell / 2)
            T_camera_grid = matmul(kin.inverse(image.T_world_camera), first)
            camera = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
            kernels()["carve"](doubt, depth, own, T_camera_grid, camera, self._cell, surface_m, _NOISE_PER_M, thick_m)

    def seen_from(self, T: Array) -> Field:
        """The same in another frame; `T` (4, 4) maps that frame into the present one."""
        other = copy(self)
        other._to_world = matmul(self._to_world, T)
        return other

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to the nearest blocked cell; 0 within one, at the most 9."""
        flat = np.ascontiguousarray(p, np.float64).reshape(-1, 3)
        out = np.empty(len(flat))
        kernels()["look_up"](*self.cells, flat, _FAR, out)
        return out.reshape(p.shape[:-1])

    @property
    def cells(self) -> tuple[NDArray[np.float32], Array, Array, float]:
        """Distances (n, m, k) of cells, the frame (4, 4) in the world, their lowest corner, their edge: for kernels."""
        return self._distance, self._to_world, self._low, self._cell


class FineField:
    """A field with finer cells about one place: both keep too far from things, so the larger distance is the better."""

    def __init__(self, coarse: Field, fine: Field) -> None:
        """Join a field and a smaller, finer one."""
        self._coarse, self._fine = coarse, fine

    def seen_from(self, T: Array) -> FineField:
        """The same in another frame; `T` (4, 4) maps that frame into the present one."""
        return FineField(self._coarse.seen_from(T), self._fine.seen_from(T))

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to what may be in the way; 9 if there is nothing."""
        flat = np.ascontiguousarray(p, np.float64).reshape(-1, 3)
        out = np.empty(len(flat))
        kernels()["look_up"](*self._coarse.cells, flat, _FAR, out)
        kernels()["refine"](*self._fine.cells, flat, _FAR, out)
        return out.reshape(p.shape[:-1])


def distance_to(blocked: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Distance of the center of every cell, of a plane or of space, to that of the nearest blocked one, in cells.

    1000 where there is none. By lower envelopes of parabolas (Felzenszwalb and Huttenlocher 2012), compiled.
    """
    out = np.empty(blocked.shape, np.float32)
    deep = (-1, *blocked.shape[-2:])
    kernels()["squared"](np.ascontiguousarray(blocked).reshape(deep), out.reshape(deep))
    return np.sqrt(out, out=out)


_HIDDEN, _FREE, _VEILED = 1, 2, 3


@cache
def kernels() -> dict[str, Callable[..., None]]:
    """The compiled loops."""
    loops = (_carve, _look_up, _refine, _squared, _score, _recall)
    return {loop.__name__.lstrip("_"): compiled(loop) for loop in loops}


def _carve(doubt, depth, own, T, camera, cell, surface, noise, thick):  # type: ignore
    """Mark cells: 2 free in some picture, 1 hidden in some and free in none, 3 behind the robot's own body in some.

    `T` maps cell corners to the camera.
    """
    height, width = depth.shape
    sides = np.empty((4, 4))  # planes that bound what is in view: x, y, z and 1 times these are at least 0 there
    for c in range(4):
        for axis in range(2):
            along, end = camera[axis] * T[axis, c], float(height if axis else width)
            sides[2 * axis, c] = along + camera[2 + axis] * T[2, c]
            sides[2 * axis + 1, c] = (end - camera[2 + axis]) * T[2, c] - along
    for i in range(doubt.shape[0]):
        for j in range(doubt.shape[1]):
            x0, y0 = i * cell, j * cell
            first, last = 0, doubt.shape[2] - 1  # cells of this column that are in view, and one more at each end
            for side in range(4):
                rise = sides[side, 2] * cell
                start = sides[side, 0] * x0 + sides[side, 1] * y0 + sides[side, 3]
                if rise > 1e-9:
                    first = max(first, int(min(-start / rise, 1e6)) - 1)
                elif rise < -1e-9:
                    last = min(last, int(min(-start / rise, 1e6)) + 1)
                elif start < -1e-6:
                    last = -1
            for k in range(first, last + 1):
                if doubt[i, j, k] == 2:
                    continue
                z0 = k * cell
                z = T[2, 0] * x0 + T[2, 1] * y0 + T[2, 2] * z0 + T[2, 3]
                if z < 0.03:
                    continue
                x = T[0, 0] * x0 + T[0, 1] * y0 + T[0, 2] * z0 + T[0, 3]
                y = T[1, 0] * x0 + T[1, 1] * y0 + T[1, 2] * z0 + T[1, 3]
                u = int(np.floor(camera[0] * x / z + camera[2]))
                v = int(np.floor(camera[1] * y / z + camera[3]))
                if u < 0 or v < 0 or u >= width or v >= height:
                    continue
                seen = depth[v, u]
                if seen == 0:
                    continue
                far = abs(seen)
                if z < far - surface - noise * far * far:
                    doubt[i, j, k] = 2
                elif seen > 0 and z < far + thick:
                    doubt[i, j, k] = 1
                elif own[v, u] and doubt[i, j, k] == 0:
                    doubt[i, j, k] = 3


def _score(score, depth, T, camera, cell, range_m, sure):  # type: ignore
    """Count pictures with a surface at each cell, less those with free space there, up to `sure`; see `remembered`."""
    height, width = depth.shape
    for i in range(score.shape[0]):
        for j in range(score.shape[1]):
            for k in range(score.shape[2]):
                x0, y0, z0 = i * cell, j * cell, k * cell
                z = T[2, 0] * x0 + T[2, 1] * y0 + T[2, 2] * z0 + T[2, 3]
                if z < 0.1 or z > range_m:
                    continue
                x = T[0, 0] * x0 + T[0, 1] * y0 + T[0, 2] * z0 + T[0, 3]
                y = T[1, 0] * x0 + T[1, 1] * y0 + T[1, 2] * z0 + T[1, 3]
                u = int(np.floor(camera[0] * x / z + camera[2]))
                v = int(np.floor(camera[1] * y / z + camera[3]))
                if u < 0 or v < 0 or u >= width or v >= height or depth[v, u] == 0:
                    continue
                far = abs(depth[v, u])
                off = cell / 2 + _NOISE_PER_M * z * z
                if z < far - off - cell:
                    score[i, j, k] = max(score[i, j, k] - 1, -sure)
                elif depth[v, u] > 0 and abs(z - far) < off:
                    score[i, j, k] = min(score[i, j, k] + 1, sure)


def _recall(score, i, j, k, z, cell, low, twice, tall_m, whole, overhead, stays, shown):  # type: ignore
    """Mark what is there at cells (i, j, k) of the scores, out of view or not, at heights z; see `remembered`."""
    for a in range(len(i)):
        for b in range(len(j)):
            if i[a] < 0 or j[b] < 0 or i[a] >= score.shape[0] or j[b] >= score.shape[1]:
                continue
            column = score[i[a], j[b]]
            foot, top, count = 0, 0, 0  # of what was seen in this column
            for h in range(len(column)):
                if column[h] > 0:
                    foot, top, count = foot if count else h, h + 1, count + 1
            stands = (top - foot) * cell >= tall_m and count >= whole * (top - foot)
            top_m = low + cell * top if stands else 0.0
            for c in range(len(k)):
                seen = 0 <= k[c] < len(column) and column[k[c]] >= twice
                shown[a, b, c] = seen
                stays[a, b, c] = (z[c] < top_m and top_m > overhead) or (seen and z[c] > overhead)


def _look_up(distance, T, low, cell, points, far, out):  # type: ignore
    """The distance at each point, of the cell that it lies in; `far` outside."""
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        i = int(np.floor((T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3] - low[0]) / cell))
        j = int(np.floor((T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3] - low[1]) / cell))
        k = int(np.floor((T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3] - low[2]) / cell))
        inside = i >= 0 and j >= 0 and k >= 0
        if inside and i < distance.shape[0] and j < distance.shape[1] and k < distance.shape[2]:
            out[n] = min(max(distance[i, j, k], 0.0), far)
        else:
            out[n] = far


def _refine(distance, T, low, cell, points, far, out):  # type: ignore
    """Raise distances to those of a finer field, as far as its border: outside of it may be anything."""
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        u = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3] - low[0]
        v = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3] - low[1]
        w = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3] - low[2]
        border = min(u, v, w)
        for at, count in ((u, distance.shape[0]), (v, distance.shape[1]), (w, distance.shape[2])):
            border = min(border, count * cell - at)
        if border <= out[n]:
            continue
        i, j, k = int(np.floor(u / cell)), int(np.floor(v / cell)), int(np.floor(w / cell))
        if i < distance.shape[0] and j < distance.shape[1] and k < distance.shape[2]:
            out[n] = max(out[n], min(max(distance[i, j, k], 0.0), far, border))


def _squared(blocked, out):  # type: ignore
    """Squared distances in cells: along the last axis by scans to and fro, along the others by envelopes."""
    nx, ny, nz = blocked.shape
    nothing = np.float32(1e6)
    for i in range(nx):
        for j in range(ny):
            gap = 1000
            for k in range(nz):
                gap = 0 if blocked[i, j, k] else min(gap + 1, 1000)
                out[i, j, k] = gap * gap
            gap = 1000
            for k in range(nz - 1, -1, -1):
                gap = 0 if blocked[i, j, k] else min(gap + 1, 1000)
                out[i, j, k] = min(out[i, j, k], np.float32(gap * gap))
    longest = max(nx, ny)
    at, height, edge = np.zeros(longest, np.int64), np.zeros(longest), np.zeros(longest + 1)
    half = 0.5 / np.maximum(np.arange(longest), 1)
    for axis in range(2):
        n = nx if axis else ny
        for i in range(ny if axis else nx):
            plane = out[:, i] if axis else out[i]
            rows = plane.T.copy()
            for r in range(nz):
                f, last = rows[r], -1
                for q in range(n):
                    if f[q] >= nothing:
                        continue
                    h, s = f[q] + q * q, -1e20  # of the parabola about q: its height at 0, and where it comes to lead
                    while last >= 0:
                        s = (h - height[last]) * half[q - at[last]]
                        if s > edge[last]:
                            break
                        last, s = last - 1, -1e20
                    last += 1
                    at[last], height[last], edge[last] = q, h, s
                if last < 0:
                    continue
                edge[last + 1] = 1e20
                k = 0
                for q in range(n):
                    while edge[k + 1] < q:
                        k += 1
                    gap = q - at[k]
                    plane[q, r] = min(gap * gap + f[at[k]], nothing)
