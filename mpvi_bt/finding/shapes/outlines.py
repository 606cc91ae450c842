"""Points of one thing: the main cluster, the height of the support, and the outline from above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.linear_algebra import least_squares, matmul, norm
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class Clusters:
    """How points of one thing are joined.

    Our choice, by the distance of pixels on a surface at 1 to 2 m.
    """

    cell_m: float = 0.015  # cell of the grid in which points are joined [m]
    large_m: float = 0.15  # size of a large thing [m]
    large_cell_m: float = 0.04  # cell for large things [m]; the holder of a bail may be too thin to be seen
    huge_m: float = 0.4  # length or height of a huge thing [m]
    part: float = 0.1  # a huge thing also owns parts with this share of its points [ratio]
    around_m: float = 0.12  # distance around a thing in which its support is looked for [m]
    face: float = 0.45  # share of the points level with a thing's foot that lie within 4 mm on a true face [ratio]
    little: float = 0.1  # other level points count if they have this part of the points of the fullest face [ratio]


_CLUSTER = Clusters()
THIN_M = 0.004  # our choice, a pixel at 1 to 2 m: of points that lie that near to each other one is kept


def main_cluster(points: Array) -> Array:
    """The largest cluster of points (n, 3), without background points caught by a mask.

    A large part right below or above it belongs to it: a power drill, seen from in front, hides its own grip, but not
    its foot. Of furniture that is seen in several parts, such as a door that stands open and, past an arm, the inside
    behind it, those that are large belong together.
    """
    if len(points) < 4:
        return points
    large = np.ptp(percentile(points, [10, 90]), axis=0).max() > _CLUSTER.large_m
    cell = _CLUSTER.large_cell_m if large else _CLUSTER.cell_m
    cells = ((points - points.min(0)) / cell).astype(int)
    if cells.max() > 300:  # a speck far away would make the grid huge
        points = points[np.abs(points - np.median(points, axis=0)).max(1) < 150 * cell]
        cells = ((points - points.min(0)) / cell).astype(int)
    grid = np.zeros(cells.max(0) + 1, bool)
    grid[tuple(cells.T)] = True
    parts, count = ndimage.label(grid, np.ones((3, 3, 3)))
    if count < 2:
        return points
    own = parts[tuple(cells.T)]
    counts = np.bincount(own)
    main = int(counts.argmax())
    belongs = counts > _CLUSTER.part * counts.max()
    if np.ptp(points[own == main], axis=0).max() < _CLUSTER.huge_m:
        largest = points[own == main, :2]
        for k in np.flatnonzero(belongs):
            part = points[own == k, :2]
            belongs[k] = _within(part, largest) or _within(largest, part)
    return points[belongs[own]]


def _within(xy: Array, other: Array) -> bool:
    """Whether points (n, 2) lie in the box about others (m, 2)."""
    return bool((xy > other.min(0) - _CLUSTER.cell_m).all() and (xy < other.max(0) + _CLUSTER.cell_m).all())


def thinned(points: Array, cell_m: float = THIN_M) -> Array:
    """One point a cell that points (n, 3) lie in, their mean: a picture from near must not outvote the others."""
    if len(points) < 2:
        return points
    cells = np.floor((points - points.min(0)) / cell_m).astype(np.int64)
    size = cells.max(0) + 1
    _, own, counts = np.unique((cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2],
                               return_inverse=True, return_counts=True)  # fmt: skip
    own = own.ravel()
    return np.stack([np.bincount(own, points[:, k]) for k in range(3)], 1) / counts[:, None]


def support_height(points: Array, around: Array, eye: Array) -> float:
    """Height [m] of what a thing with `points` (n, 3) stands on, from points (m, 3) of everything else.

    A face that is seen level with the thing's lowest points is believed first; what lies lower may be another board.
    But the sides of what lies beside it, such as the other eggs in a basket and its walls, are no face.
    """
    lowest = float(percentile(points[:, 2], 2))
    if eye[2] < lowest + 0.03:
        return lowest  # the face that it stands on cannot be seen from below
    low, high = points[:, :2].min(0) - _CLUSTER.around_m, points[:, :2].max(0) + _CLUSTER.around_m
    z = _heights(around, np.append(low, lowest - 0.10), np.append(high, lowest + 0.012))
    level = z[z > lowest - 0.012]
    if len(level) > 25:
        height, most = _fullest(level)
        if most > _CLUSTER.face * len(level) or most > _CLUSTER.little * _fullest(z)[1]:
            return height
    return _fullest(z)[0] if len(z) >= 10 else lowest


@compiled_later
def _heights(points, low, high):  # type: ignore
    """(k,) heights of the points (n, 3) in a box, in order."""
    out, k = np.empty(points.shape[0]), 0
    for i in range(points.shape[0]):
        x, y, z = points[i]
        if low[0] < x < high[0] and low[1] < y < high[1] and low[2] < z < high[2]:
            out[k] = z
            k += 1
    return out[:k].copy()


def _fullest(z: Array) -> tuple[float, int]:
    """The height at which most of some points are, and how many [m]."""
    counts, edges = np.histogram(z, np.arange(z.min() - 0.002, z.max() + 0.006, 0.004))
    k = int(counts.argmax())
    return float(np.median(z[(z >= edges[k] - 0.004) & (z <= edges[k + 1] + 0.004)])), int(counts[k])


@dataclass(frozen=True, eq=False)
class Outline:
    """The smallest rectangle around points seen from above.

    Attributes:
        middle: (2,) [m].
        sides: (2,) the long and the short one [m].
        heading: Of the long side [rad].
        fill: Share of it that the points' convex hull fills.
    """

    middle: Array
    sides: Array
    heading: float
    fill: float

    @property
    def frame(self) -> Array:
        """(2, 2) its axes as columns, the long one first."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.array([[c, -s], [s, c]])

    def local(self, xy: Array) -> Array:
        """(n, 2) points in its axes, about its middle."""
        return np.asarray(matmul(xy - self.middle, self.frame))


def outline(xy: Array) -> Outline:
    """The smallest rectangle around points (n, 2)."""
    try:
        hull = ConvexHull(xy)
        corners, area = xy[hull.vertices], float(hull.volume)
    except (QhullError, ValueError):  # on a line, or too few
        corners, area = xy, 0.0
    sides = np.roll(corners, -1, axis=0) - corners
    headings = np.unique(np.round(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2), 4))
    c, s = np.cos(headings), np.sin(headings)
    u, v = corners[:, :1] * c + corners[:, 1:] * s, corners[:, 1:] * c - corners[:, :1] * s
    size = np.stack([np.ptp(u, axis=0), np.ptp(v, axis=0)])
    k = int((size[0] * size[1]).argmin())
    middle = np.array([u[:, k].max() + u[:, k].min(), v[:, k].max() + v[:, k].min()]) / 2
    heading, (a, b) = float(headings[k]), size[:, k]
    center = np.array([c[k] * middle[0] - s[k] * middle[1], s[k] * middle[0] + c[k] * middle[1]])
    if a < b:
        a, b, heading = b, a, heading + np.pi / 2
    return Outline(center, np.array([a, b]), heading, area / max(float(a * b), 1e-9))


def trimmed(xy: Array) -> Array:
    """Without the few points that stick out: half a percent on each side, along the axes and the diagonals."""
    keep = np.ones(len(xy), bool)
    if len(xy) < 60:
        return xy
    for angle in np.arange(4) * np.pi / 4:
        along = matmul(xy, [np.cos(angle), np.sin(angle)])
        low, high = percentile(along, [0.5, 99.5])
        keep &= (along >= low - 1e-3) & (along <= high + 1e-3)
    return xy[keep]


def circle(xy: Array) -> tuple[Array, float, float]:
    """Middle (2,), radius and typical deviation [m] of the circle through points (n, 2), outliers dropped once."""
    for _ in range(2):
        A = np.c_[2 * xy, np.ones(len(xy))]
        s = least_squares(A, (xy**2).sum(1))
        radius = float(np.sqrt(max(s[2] + s[0] ** 2 + s[1] ** 2, 1e-8)))
        off = np.abs(norm(xy - s[:2], axis=1) - radius)
        keep = off <= 2.5 * np.median(off) + 1e-4
        if keep.all() or keep.sum() < 8:
            break
        xy = xy[keep]
    return s[:2], radius, float(np.sqrt(np.mean(off**2)))
