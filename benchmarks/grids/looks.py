"""Marks of what a camera sees of the floor."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.grids.maps import RES_M
from benchmarks.grids.timing import Side, Timed
from mpvi_bt.finding.navigation.grid import Cell
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.finding.scene.visibility import LOOK_M, VisibilityMap
from mpvi_bt.ground.robot.protocol import CameraImage

FOV_RAD, REACH_M = 1.48, 4.0
_REACH = round(REACH_M / RES_M)  # cells
_STEPS = np.arange(0, _REACH, 0.5)
_SPREAD = np.linspace(-FOV_RAD / 2, FOV_RAD / 2, round(FOV_RAD * _REACH * 2))  # half a cell apart at the far end
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Look:
    """From the middle of a cell. The picture is level, 10 cm above the floor, and nothing is before the map's walls.

    Attributes:
        cell: Where from.
        yaw: Where to [rad].
        image: What the camera gives.
    """

    cell: Cell
    yaw: float
    image: CameraImage

    @classmethod
    def taken(cls, grid_map: OccupancyMap, cell: Cell, yaw: float) -> Look:
        """With its picture."""
        focal = 160 / math.tan(FOV_RAD / 2)
        ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        T = np.eye(4)
        T[:3, :3] = np.stack([np.cross(ahead, [0, 0, 1]), [0, 0, -1], ahead], 1)
        T[:3, 3] = *grid_map.center(*cell), LOOK_M
        K = np.array([[focal, 0, 160], [0, focal, 120], [0, 0, 1]])
        depth = np.full((240, 320), 100.0, np.float32)
        return cls(cell, yaw, CameraImage("head", np.zeros((240, 320, 3), np.uint8), depth, None, {}, K, T))

    @property
    def window(self) -> tuple[slice, slice]:
        """Of the map, what is in reach."""
        (row, column), (r, c) = self.cell, self.middle
        return np.s_[row - r : row + _REACH + 1, column - c : column + _REACH + 1]

    @property
    def middle(self) -> Cell:
        """The cell, within the window."""
        return min(self.cell[0], _REACH), min(self.cell[1], _REACH)


def sides(grid_map: OccupancyMap) -> Iterator[Side]:
    """Takes a look at a map of which nothing was seen, gives what was seen, in the look's window.

    Each counts and keeps what is new. Libraries get the window; ours is given the whole map and the depth picture.
    """
    ours = VisibilityMap(grid_map, REACH_M)

    def update(look: Look) -> Mask:
        ours.seen[look.window] = False
        ours.update(look.image, grid_map.occupied)
        return ours.seen[look.window].copy()

    yield Side("ours", update)
    seen = np.zeros_like(grid_map.occupied)

    def marking(shown: Callable[[Look, Mask], Mask]) -> Callable[[Look], Mask]:
        def mark(look: Look) -> Mask:
            seen[look.window] = False
            occupied = grid_map.occupied[look.window]
            new = shown(look, occupied) & ~occupied & ~seen[look.window]
            new.sum()
            seen[look.window] |= new
            return seen[look.window].copy()

        return mark

    if importlib.util.find_spec("tcod"):
        yield Side("tcod compute_fov", marking(_shadows))
    if importlib.util.find_spec("cv2"):
        yield Side("OpenCV fillPoly", marking(_filled))
    if importlib.util.find_spec("skimage"):
        yield Side("scikit-image polygon", marking(_drawn))


def judge(grid_map: OccupancyMap, looks: Sequence[Look], timed: Sequence[Timed]) -> dict[str, tuple[str, None]]:
    """Of each side: of the cells whose center is in line of sight, how many it missed; how many more it marked."""
    truth = [_in_sight(grid_map, look) for look in looks]
    total = sum(int(mask.sum()) for mask in truth)
    verdicts = {}
    for one in timed:
        pairs = list(zip(truth, one.results, strict=True))
        missed = sum(int((sight & ~mask).sum()) for sight, mask in pairs)
        more = sum(int((mask & ~sight).sum()) for sight, mask in pairs)
        verdicts[one.side.name] = (f"missed {100 * missed / total:.2f} %, more {100 * more / total:.1f} %", None)
    return verdicts


_OFFSETS = np.mgrid[-_REACH : _REACH + 1, -_REACH : _REACH + 1]
_BEARING, _NEAR = np.arctan2(*_OFFSETS), np.hypot(*_OFFSETS) <= _REACH


def _sector(look: Look, shape: tuple[int, ...]) -> Mask:
    """Which cells of the window are in the field of view."""
    r, c = _REACH - look.middle[0], _REACH - look.middle[1]
    part = np.s_[r : r + shape[0], c : c + shape[1]]
    off = (_BEARING[part] - look.yaw + math.pi) % (2 * math.pi) - math.pi
    return (np.abs(off) <= FOV_RAD / 2) & _NEAR[part]


def _shadows(look: Look, occupied: Mask) -> Mask:
    import tcod.constants
    import tcod.map

    kind = tcod.constants.FOV_SYMMETRIC_SHADOWCAST
    return tcod.map.compute_fov(~occupied, look.middle, _REACH, False, kind) & _sector(look, occupied.shape)


def _outline(look: Look, occupied: Mask) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rows and columns of where rays end, and of the camera."""
    row, column = look.middle
    angle = look.yaw + _SPREAD[:, None]
    rows, columns = row + np.sin(angle) * _STEPS, column + np.cos(angle) * _STEPS
    r, c = np.rint(rows).astype(np.intp), np.rint(columns).astype(np.intp)
    stopped = occupied[r.clip(0, occupied.shape[0] - 1), c.clip(0, occupied.shape[1] - 1)]
    end = np.where(stopped.any(1), stopped.argmax(1), len(_STEPS) - 1)
    each = np.arange(len(_SPREAD))
    return np.append(rows[each, end], row), np.append(columns[each, end], column)


def _filled(look: Look, occupied: Mask) -> Mask:
    import cv2

    corners = np.rint(np.stack(_outline(look, occupied)[::-1], 1) * 16).astype(np.int32)
    return cv2.fillPoly(np.zeros(occupied.shape, np.uint8), [corners], 1, shift=4).view(bool)


def _drawn(look: Look, occupied: Mask) -> Mask:
    from skimage.draw import polygon

    shown = np.zeros(occupied.shape, bool)
    shown[polygon(*_outline(look, occupied), occupied.shape)] = True
    return shown


def _in_sight(grid_map: OccupancyMap, look: Look) -> Mask:
    """Free cells in the field of view to whose center the straight line is free, by samples."""
    occupied = grid_map.occupied[look.window]
    cells = np.argwhere(_sector(look, occupied.shape) & ~occupied)
    share = np.linspace(0, 1, 500)
    rows = np.rint(look.middle[0] + np.outer(cells[:, 0] - look.middle[0], share)).astype(np.intp)
    columns = np.rint(look.middle[1] + np.outer(cells[:, 1] - look.middle[1], share)).astype(np.intp)
    sight = np.zeros_like(occupied)
    sight[tuple(cells.T)] = ~occupied[rows, columns].any(1)
    return sight
