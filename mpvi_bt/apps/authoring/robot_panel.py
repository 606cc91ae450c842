"""One view of a robot, from its side or from above, to scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.recording.labels import Color, Labels

View = Literal["side", "above"]
AXES: dict[View, tuple[int, int]] = {"side": (0, 2), "above": (0, 1)}  # what points to the right, and up

INK: Color = (40, 44, 54)
PAPER: Color = (255, 255, 255)
_GRID: Color = (226, 229, 234)
_FLOOR: Color = (120, 126, 138)
_GRID_M = 0.5
_LETTERS = 0.85  # as OpenCV counts them
_DASH_PX, _APART_PX, _LINE_PX = 18, 12, 56


class RobotPanel:
    """A picture that is drawn on, places in the base frame [m].

    Args:
        view: From where the robot is seen: the right side, or above.
        low, high: (3,) what is in view.
        scale: Pixels a meter.

    Attributes:
        picture: (H, W, 3) uint8 RGB.
    """

    def __init__(self, view: View, low: Array, high: Array, scale: float) -> None:
        import cv2

        self._cv = cv2
        self._axes, self._scale = AXES[view], scale
        self._low, self._high = low[[*self._axes]], high[[*self._axes]]
        width, height = (round(float(length) * scale) for length in self._high - self._low)
        self.picture = np.full((height, width, 3), PAPER, np.uint8)
        self._labels = Labels(self.picture, _LETTERS)
        self._grid()

    def px(self, points: Array) -> NDArray[np.int32]:
        """(n, 2) pixels of points (n, 3)."""
        flat = np.atleast_2d(points)[:, [*self._axes]]
        up = np.array([1.0, -1.0]) * (flat - np.array([self._low[0], self._high[1]])) * self._scale
        return np.round(up).astype(np.int32)

    def _grid(self) -> None:
        """A line each half meter with its figure, and the floor or the middle."""
        height, width = self.picture.shape[:2]
        for k in (0, 1):
            for step in range(math.ceil(self._low[k] / _GRID_M), math.floor(self._high[k] / _GRID_M) + 1):
                at = np.zeros(3)
                at[self._axes[k]] = step * _GRID_M
                u, v = self.px(at)[0].tolist()
                start, end = ((u, 0), (u, height)) if k == 0 else ((0, v), (width, v))
                strong = step == 0 and k == 1
                self._cv.line(self.picture, start, end, _FLOOR if strong else _GRID, 3 if strong else 2)
                where = (u + 6, height - 10) if k == 0 else (6, v - 8)
                self._cv.putText(self.picture, f"{step * _GRID_M:g} m", where, 0, 0.7, _FLOOR, 1, self._cv.LINE_AA)

    def solid(self, points: Array, color: Color) -> None:
        """The convex hull of points (n, 3), with its edge."""
        hull = self._cv.convexHull(self.px(points))
        self._cv.fillConvexPoly(self.picture, hull, color, self._cv.LINE_AA)
        self._cv.polylines(self.picture, [hull], True, _darker(color), 2, self._cv.LINE_AA)

    def cone(self, points: Array, color: Color) -> None:
        """The convex hull of points (n, 3), the first of which is the camera: one sees through it."""
        hull = self._cv.convexHull(self.px(points))
        tinted = self.picture.copy()
        self._cv.fillConvexPoly(tinted, hull, color, self._cv.LINE_AA)
        self.picture[:] = self._cv.addWeighted(tinted, 0.18, self.picture, 0.82, 0)
        self._cv.polylines(self.picture, [hull], True, color, 2, self._cv.LINE_AA)

    def outline(self, points: Array, color: Color, dashed: bool = False) -> None:
        """The convex line around points (n, 3)."""
        corners = self._cv.convexHull(self.px(points))[:, 0]
        if not dashed:
            self._cv.polylines(self.picture, [corners], True, color, 4, self._cv.LINE_AA)
            return
        closed = np.concatenate([corners, corners[:1]]).astype(float)
        along = np.concatenate([[0.0], np.hypot(*np.diff(closed, axis=0).T).cumsum()])
        places = np.arange(0.0, along[-1], _DASH_PX)
        dots = np.stack([np.interp(places, along, closed[:, k]) for k in (0, 1)], 1).round().astype(int)
        for a, b in zip(dots[::2], dots[1::2], strict=False):
            self._cv.line(self.picture, a.tolist(), b.tolist(), color, 3, self._cv.LINE_AA)

    def bones(self, places: Array) -> None:
        """Lines from joint to joint (n, 3), with a dot at each."""
        points = self.px(places)
        self._cv.polylines(self.picture, [points], False, INK, 2, self._cv.LINE_AA)
        for point in points.tolist():
            self._cv.circle(self.picture, point, 5, INK, -1, self._cv.LINE_AA)

    def arrow(self, start: Array, end: Array, color: Color) -> None:
        """An arrow."""
        a, b = self.px(np.stack([start, end])).tolist()
        self._cv.arrowedLine(self.picture, a, b, color, 4, self._cv.LINE_AA, 0, 0.25)

    def mark(self, place: Array, color: Color) -> None:
        """A ring."""
        self._cv.circle(self.picture, self.px(place)[0].tolist(), 9, color, 4, self._cv.LINE_AA)

    def name(self, place: Array, text: str, color: Color, below: bool = False) -> None:
        """Text above a place or `below` it, or beside it where it would cover another; there may be no room for it."""
        u, v = self.px(place)[0].tolist()
        v += _LINE_PX if below else 0
        self._labels.beside((u - _APART_PX, v - _APART_PX, u + _APART_PX, v + _APART_PX), text, color, PAPER)


def _darker(color: Sequence[int]) -> Color:
    red, green, blue = (round(0.6 * value) for value in color)
    return red, green, blue
