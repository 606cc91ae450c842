"""Drawing on a map from above, north (world y) up: ways, bases of robots, finds, names of rooms, hatched floor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.mobile_base import placed
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.labels import Color, Labels, Picture, Rectangle
from mpvi_bt.runs.recording.search_view import Mask, called

_LEAST_PX = 5  # of a base: it is drawn larger on a map where it would be smaller


def cells_north_up(grid_map: OccupancyMap, xy: Array) -> Array:
    """(..., 2) column and row, counted from the north, of places (..., 2 or more) [m]; not rounded."""
    cells = (np.asarray(xy, float)[..., :2] - grid_map.origin_m) / grid_map.resolution_m
    return np.stack([cells[..., 0], grid_map.occupied.shape[0] - cells[..., 1]], -1)


class DrawnMap:
    """A picture of a map that is drawn on."""

    def __init__(self, rgb: Picture, grid_map: OccupancyMap, scale: float) -> None:
        """Draw on `rgb` in place, which shows `grid_map` with `scale` pixels a cell."""
        import cv2

        self._cv, self._rgb, self._map, self._scale = cv2, rgb, grid_map, scale

    def px(self, xy: Array) -> NDArray[np.int32]:
        """(..., 2) pixel columns and rows of places (..., 2 or more) [m]."""
        pixels: NDArray[np.int32] = np.round(cells_north_up(self._map, xy) * self._scale).astype(np.int32)
        return pixels

    def line(self, points: Array, color: Color, width: int) -> None:
        """A line through places (n, 2 or more)."""
        self._cv.polylines(self._rgb, [self.px(points)], False, color, width, self._cv.LINE_AA)

    def base(
        self, pose: Array, outline: Array, edge: Color, width: int = 2, fill: Color | None = None, tip: float = 0.0
    ) -> Rectangle:
        """Draw the outline (n, 2) of a base at a pose (3,), with a line for its heading. Returns its box.

        Args:
            pose: In the world [m, m, rad].
            outline: In the base frame [m].
            edge: Color of its lines.
            width: Of these [px].
            fill: Its color; None: what is below it stays.
            tip: Length of the arrow's tip, as a share of that line; 0: no tip.
        """
        center = self.px(pose[:2])
        ahead_px = float(norm(self.px(pose[:2] + np.array([outline[:, 0].max(), 0.0])) - center))
        outline = outline * max(1.0, _LEAST_PX / max(ahead_px, 1e-9))
        corners, (front,) = (self.px(placed(p, pose)) for p in (outline, np.array([[outline[:, 0].max(), 0.0]])))
        if fill is not None:
            self._cv.fillPoly(self._rgb, [corners], fill, self._cv.LINE_AA)
        self._cv.polylines(self._rgb, [corners], True, edge, width, self._cv.LINE_AA)
        if tip:
            self._cv.arrowedLine(self._rgb, center.tolist(), front.tolist(), edge, width, self._cv.LINE_AA, 0, tip)
        else:
            self._cv.line(self._rgb, center.tolist(), front.tolist(), edge, width, self._cv.LINE_AA)
        return around(corners)

    def square(self, xy: Array, half: int) -> Rectangle:
        """The square of `2 * half` pixels about a place."""
        u, v = self.px(xy).tolist()
        return u - half, v - half, u + half, v + half

    def found(self, entries: Sequence[Entry], labels: Labels, half: int, rim: int, ink: Color, paper: Color) -> None:
        """Draw a named square at each believed place, in a rim of ink."""
        marks = [self.square(entry.center, half) for entry in entries]
        for left, top, right, bottom in marks:
            self._cv.rectangle(self._rgb, (left, top), (right, bottom), ink, -1)
            self._cv.rectangle(self._rgb, (left + rim, top + rim), (right - rim, bottom - rim), colors.FOUND, -1)
        labels.taken += marks
        for entry, mark in zip(entries, marks, strict=True):
            labels.beside(mark, called(entry), ink, paper)

    def names(
        self, places: Iterable[tuple[str, Array]], labels: Labels, size: float, thick: int, ink: Color, *, lower: bool
    ) -> None:
        """Write each room's name where it has most space; names that do not fit are left out.

        Args:
            places: Names of rooms, and (2,) where there is most space for each.
            labels: What writes them.
            size, thick: Of the letters, as OpenCV counts them.
            ink: Their color.
            lower: Whether a name may stand a line lower.
        """
        for name, place in places:
            (wide, tall), _ = self._cv.getTextSize(name, self._cv.FONT_HERSHEY_SIMPLEX, size, thick)
            u, v = self.px(place).tolist()
            v += tall * lower
            labels.beside((u - wide // 2, v, u, v), name, ink)


def around(pixels: NDArray[np.int32]) -> Rectangle:
    """The rectangle about some pixels (n, 2)."""
    (left, top), (right, bottom) = pixels.min(0).tolist(), pixels.max(0).tolist()
    return left, top, right, bottom


def hatch(shape: tuple[int, int], crossed: bool, pitch_px: int = 8, thick_px: int = 1) -> Mask:
    """(H, W) bool, diagonal lines, one way or both ways."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    lines = (rows + columns) % pitch_px < thick_px
    return lines | ((rows - columns) % pitch_px < thick_px) if crossed else lines


def hatched(color: Color, shape: tuple[int, int]) -> Picture:
    """(H, W, 3) of one color, hatched if it is drawn so on maps."""
    picture = np.full((*shape, 3), color, np.uint8)
    if color in (colors.UNSEEN, colors.UNKNOWN):
        lines = hatch(shape, color == colors.UNKNOWN)
        picture[lines] = (picture[lines] * colors.HATCH).astype(np.uint8)
    return picture
