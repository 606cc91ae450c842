"""A floor whose corners are right angles, cut into rectangles."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.house.generated.plane import Rect

Point = tuple[float, float]


def floor_rectangles(corners: Sequence[Point], smallest_m: float) -> tuple[list[Rect], float]:
    """Cut a floor into few rectangles, the largest first.

    The largest rectangle that is still free is cut off again and again, which gives the fewest for an L and nearly so
    for what rooms are like; our choice, since an exact minimum brings nothing here.

    Args:
        corners: x, y of its corners in order [m]; every edge runs along x or y.
        smallest_m: Shortest side that a rectangle may have.

    Returns:
        The rectangles, and the area [m2] that is in none, since it is narrower than that.

    Raises:
        ValueError: An edge runs askew, or there is no area.
    """
    path = [*corners, *corners[:1]]
    if any(a[0] != b[0] and a[1] != b[1] for a, b in pairwise(path)):
        raise ValueError("it has walls that are not at right angles")
    xs, ys = (sorted({corner[k] for corner in corners}) for k in (0, 1))
    if len(xs) < 2 or len(ys) < 2:
        raise ValueError("it has no area")
    middles = [[((x0 + x1) / 2, (y0 + y1) / 2) for x0, x1 in pairwise(xs)] for y0, y1 in pairwise(ys)]
    free = np.array([[_inside(point, path) for point in row] for row in middles])
    widths, heights = np.diff(xs), np.diff(ys)
    cut: list[Rect] = []
    while (found := _largest(free, widths, heights, smallest_m)) is not None:
        i0, i1, j0, j1 = found
        free[j0:j1, i0:i1] = False
        cut.append((xs[i0], ys[j0], xs[i1], ys[j1]))
    return cut, float((free * heights[:, None] * widths).sum())


def _inside(point: Point, path: Sequence[Point]) -> bool:
    """Whether a point is inside a closed path, by the walls to the right of it."""
    x, y = point
    crossed = [a[0] > x and min(a[1], b[1]) < y < max(a[1], b[1]) for a, b in pairwise(path)]
    return sum(crossed) % 2 == 1


def _largest(
    free: NDArray[np.bool_], widths: NDArray[np.float64], heights: NDArray[np.float64], smallest_m: float
) -> tuple[int, int, int, int] | None:
    """Columns and rows of the largest free rectangle with no side shorter than so much; None: there is none."""
    best, largest = None, 0.0
    rows, columns = free.shape
    for j0 in range(rows):
        open_ = np.ones(columns, bool)
        for j1 in range(j0 + 1, rows + 1):
            open_ &= free[j1 - 1]
            height = heights[j0:j1].sum()
            for i0 in range(columns):
                i1 = i0
                while i1 < columns and open_[i1]:
                    i1 += 1
                width = widths[i0:i1].sum()
                if min(width, height) >= smallest_m and width * height > largest + 1e-9:
                    best, largest = (i0, i1, j0, j1), width * height
    return best
