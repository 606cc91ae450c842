"""From the visible points of one thing to its likely shape: a box, an upright cylinder, a ball, a vessel, furniture.

A camera sees a thing from one side and from above. What it hides is filled in by the simplest solid that explains what
it shows and that stands on what is seen around it. Extents are percentiles and fits, never single points: masks bleed
onto the background, and depth is noisy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from mpvi_bt.robot.solids import Array, Solid, pose

_CELL_M = 0.015  # of the grid in which points hang together
_LARGE_M, _LARGE_CELL_M = 0.15, 0.04  # that of large things: what holds a bail may be too thin to be seen
_AROUND_M = 0.12  # from how far around a thing its support is told
_ROUND = 0.88  # share of its rectangle that an outline fills: a disc has 0.79, a rectangle 1
_CORNERED = 0.90  # what fills more of its rectangle is none
_GRAIN_PER_M = 0.0008  # depth is that much rougher for every square meter of range [m]
_WALL_M = 0.008  # of vessels
_FURNITURE_M = 0.55  # what is longer than this is furniture: faces to put things on
_UPRIGHT_M = 0.9  # likewise what is higher
_HEADROOM_M = 0.12  # what rises that high above a board makes a compartment of it
_SLICE_M = 0.01
_HOLE_CELL_M = 0.02
_SUNK_M = 0.05  # what is that much lower than a board is seen through it
_LEVEL = 0.5  # share of the points near a face's height that are on it
_WALLED = 0.4  # share of a side along which furniture has to rise for a wall
_STAVES = 16


@dataclass(frozen=True, eq=False)
class SeenBar:
    """A bar to hold a thing by, as seen (implements `mpvi_bt.perception.parts.Bar`); world frame [m]."""

    center: Array
    axis: Array
    outward: Array
    length_m: float


@dataclass(frozen=True, eq=False)
class Shape:
    """What a thing is taken to be.

    Attributes:
        kind: The simplest solid that explains its points.
        T: (4, 4) T_world_thing: a frame in its middle, z up, x along its longer side.
        solids: Of it, in the world.
        volumes: Container volumes, in the world.
        bars: To carry it by, in the world.
        support_m: Height of what it stands on.
        extent: Of furniture: the box about all that was seen of it, in the world; its solids are only its faces.
    """

    kind: Literal["box", "cylinder", "ball", "vessel", "furniture"]
    T: Array
    solids: tuple[Solid, ...]
    support_m: float
    volumes: tuple[Solid, ...] = ()
    bars: tuple[SeenBar, ...] = ()
    extent: Solid | None = None

    def moved(self, M: Array) -> Shape:
        """The same, carried along by the motion `M` (4, 4) of the world frame into itself."""
        bars = tuple(replace(b, center=M[:3, :3] @ b.center + M[:3, 3], axis=M[:3, :3] @ b.axis,
                             outward=M[:3, :3] @ b.outward) for b in self.bars)  # fmt: skip
        return replace(
            self, T=M @ self.T, solids=tuple(s.moved(M) for s in self.solids),
            volumes=tuple(v.moved(M) for v in self.volumes), bars=bars,
        )  # fmt: skip

    def box(self) -> Array:
        """(2, 3) lowest and highest corner of its axis-aligned bounding box in the world."""
        corners = np.stack([s.aabb() for s in self.solids])
        return np.stack([corners[:, 0].min(0), corners[:, 1].max(0)])


def main_cluster(points: Array) -> Array:
    """The largest part of points (n, 3) that hangs together: drops what a mask catches of the background."""
    if len(points) < 4:
        return points
    large = np.ptp(np.percentile(points, [10, 90], axis=0), axis=0).max() > _LARGE_M
    cell = _LARGE_CELL_M if large else _CELL_M
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
    return points[own == np.bincount(own).argmax()]


def thinned(points: Array, cell_m: float = 0.004) -> Array:
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

    What is seen level with the thing's lowest points is believed first; what lies lower may be another board.
    """
    lowest = float(np.percentile(points[:, 2], 2))
    if eye[2] < lowest + 0.03:
        return lowest  # the face that it stands on cannot be seen from below
    low, high = points[:, :2].min(0) - _AROUND_M, points[:, :2].max(0) + _AROUND_M
    z = around[((around[:, :2] > low) & (around[:, :2] < high)).all(1), 2]
    z = z[(z < lowest + 0.012) & (z > lowest - 0.10)]
    level = z[z > lowest - 0.012]
    z = level if len(level) > 25 else z
    if len(z) < 10:
        return lowest
    counts, edges = np.histogram(z, np.arange(z.min() - 0.002, z.max() + 0.006, 0.004))
    k = int(counts.argmax())
    return float(np.median(z[(z >= edges[k] - 0.004) & (z <= edges[k + 1] + 0.004)]))


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
        return np.asarray((xy - self.middle) @ self.frame)


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


def fit(points: Array, around: Array, eye: Array, support: float | None = None) -> Shape | None:
    """What a thing is, from its visible points.

    Args:
        points: (n, 3) of its mask, in the world.
        around: (m, 3) of everything near it but the robot.
        eye: (3,) where the camera was that saw it best.
        support: Height of what it stands on [m], if that is known from another view.

    Returns:
        The shape, or None if there is too little to see.
    """
    points = thinned(main_cluster(points))
    if len(points) < 5:
        return None
    low, top = np.percentile(points, 1, axis=0), float(np.percentile(points[:, 2], 99))
    if np.ptp(np.percentile(points, [2, 98], axis=0)[:, :2], axis=0).max() > _FURNITURE_M or top - low[2] > _UPRIGHT_M:
        return _furniture(points)
    if support is None:
        support = support_height(points, around, eye)
    support = min(support, top - 0.004)
    height = top - support
    upper = points[points[:, 2] > min(support + max(0.004, 0.3 * height), top - 0.003)]
    if len(upper) > 30:
        upper = main_cluster(upper)
    seen = outline(_trimmed(upper[:, :2]))
    vessel = _vessel(points, seen, support, top) if eye[2] > top + 0.04 else None
    if vessel is not None:
        return vessel
    grain = _GRAIN_PER_M * float(np.median(((points - eye) ** 2).sum(1)))
    ball = _ball(points, float(seen.sides[0]), support, top, grain)
    if ball is not None:
        return ball
    column = _column(points, seen, support, top, grain)
    if column is not None:
        return column
    if eye[2] < top + 0.04:  # its top is not in view, so its depth is not either
        seen = _deepened(_cornered(_trimmed(upper[:, :2])), eye[:2])
    return _upright_box(seen, support, top)


def _trimmed(xy: Array) -> Array:
    """Without the few points that stick out: half a percent on each side, along the axes and the diagonals."""
    keep = np.ones(len(xy), bool)
    if len(xy) < 60:
        return xy
    for angle in np.arange(4) * np.pi / 4:
        along = xy @ [np.cos(angle), np.sin(angle)]
        low, high = np.percentile(along, [0.5, 99.5])
        keep &= (along >= low - 1e-3) & (along <= high + 1e-3)
    return xy[keep]


def _frame(xy: Array, heading: float, low: float, high: float) -> Array:
    return pose((float(xy[0]), float(xy[1]), (low + high) / 2), heading)


def _upright_box(seen: Outline, support: float, top: float) -> Shape:
    T = _frame(seen.middle, seen.heading, support, top)
    half = np.array([*np.maximum(seen.sides, 0.004), top - support]) / 2
    return Shape("box", T, (Solid("box", half, T),), support)


def _cornered(xy: Array) -> Outline:
    """The rectangle whose edges points (n, 2) of its sides are nearest to.

    Two sides make a triangle, around which other rectangles are as small.
    """
    best, found = np.inf, outline(xy)
    for heading in np.arange(0, np.pi / 2, np.pi / 90):
        c, s = np.cos(heading), np.sin(heading)
        local = xy @ np.array([[c, -s], [s, c]])
        low, high = local.min(0), local.max(0)
        off = float(np.minimum(np.minimum(local - low, high - local).min(1), 0.01).mean())
        if off < best:
            best, (a, b), middle = off, high - low, (high + low) / 2 @ np.array([[c, s], [-s, c]])
            turn = 0.0 if a >= b else np.pi / 2
            found = Outline(middle, np.array([max(a, b), min(a, b)]), float(heading + turn), found.fill)
    return found


def _deepened(seen: Outline, eye: Array) -> Outline:
    """A box of which only the front is seen, taken to be as deep as it is wide, but no deeper than a hand can span."""
    long, short = seen.sides
    depth = float(np.clip(long, 0.02, 0.08))
    if short > 0.6 * depth:
        return seen
    inward = seen.frame[:, 1]
    if inward @ (seen.middle - eye) < 0:
        inward = -inward
    middle = seen.middle + inward * (depth - short) / 2
    sides, heading = np.array([long, depth]), seen.heading
    if depth > long:
        sides, heading = sides[::-1], heading + np.pi / 2
    return Outline(middle, sides, heading, 1.0)


def circle(xy: Array) -> tuple[Array, float, float]:
    """Middle (2,), radius and typical deviation [m] of the circle through points (n, 2), outliers dropped once."""
    for _ in range(2):
        A = np.c_[2 * xy, np.ones(len(xy))]
        s = np.linalg.lstsq(A, (xy**2).sum(1), rcond=None)[0]
        radius = float(np.sqrt(max(s[2] + s[0] ** 2 + s[1] ** 2, 1e-8)))
        off = np.abs(np.linalg.norm(xy - s[:2], axis=1) - radius)
        keep = off <= 2.5 * np.median(off) + 1e-4
        if keep.all() or keep.sum() < 8:
            break
        xy = xy[keep]
    return s[:2], radius, float(np.sqrt(np.mean(off**2)))


def _ball(points: Array, width: float, support: float, top: float, grain: float) -> Shape | None:
    """The far half of a ball is unseen: its outline would be too small and too near."""
    if len(points) < 12:
        return None
    A = np.c_[2 * points, np.ones(len(points))]
    s = np.linalg.lstsq(A, (points**2).sum(1), rcond=None)[0]
    radius = float(np.sqrt(max(s[3] + s[:3] @ s[:3], 1e-8)))
    off = np.linalg.norm(points - s[:3], axis=1) - radius
    noise = float(np.sqrt(np.mean(off**2)))
    tall = (top - support) / 2
    off_m, tall_m = max(0.002, 0.06 * radius) + grain, max(0.004, 0.15 * radius) + grain
    if not 0.006 < radius < min(0.10, 0.65 * width + 0.004) or noise > off_m or abs(radius - tall) > tall_m:
        return None
    center = np.array([s[0], s[1], support + tall])
    T = pose(center)
    return Shape("ball", T, (Solid("sphere", np.full(3, (radius + tall) / 2), T),), support)


def _column(points: Array, seen: Outline, support: float, top: float, grain: float) -> Shape | None:
    """An upright cylinder, by its outline, or by the bend of its side where something hides a part of it."""
    height, (long, short) = top - support, seen.sides
    middle, radius = seen.middle, float(long + short) / 4
    whole = seen.fill < _ROUND and long - short < max(0.003, 0.06 * long)
    side = points[(points[:, 2] > support + 0.15 * height) & (points[:, 2] < top - max(0.4 * height, 0.008)), :2]
    bent = False
    if seen.fill < _CORNERED and height > 0.03 and len(side) >= 16:
        m, r, noise = circle(side)
        bend = np.arctan2(*(side - m).T[::-1])
        turn = np.angle(np.exp(1j * (bend - np.angle(np.exp(1j * bend).mean()))))
        arc = float(np.ptp(np.percentile(turn, [3, 97])))
        doubt = 4 * noise / (1 - float(np.cos(arc / 2)) + 1e-6) / float(np.sqrt(len(side)))  # of the radius
        bent = (
            noise < max(0.002, 0.04 * r) + grain and doubt < 0.004 and 0.008 < r < min(0.25, 0.8 * float(long) + 0.004)
        )
        if bent:
            middle, radius = m, r
    if not (whole or bent) and not (seen.fill < _ROUND and long - short < max(0.012, 0.15 * long)):
        return None
    T = _frame(middle, 0.0, support, top)
    return Shape("cylinder", T, (Solid("cylinder", np.array([radius, radius, height / 2]), T),), support)


def _vessel(points: Array, seen: Outline, support: float, top: float) -> Shape | None:
    """Something hollow that is open above: walls around an opening through which its inside is seen."""
    rim, bar = _rim(points, seen, support, top)
    if seen.sides[1] < 0.045 or rim - support < 0.025:
        return None
    edge = points[(points[:, 2] > rim - min(0.02, 0.3 * (rim - support))) & (points[:, 2] < rim + 0.006), :2]
    if len(edge) < 12:
        return None
    around = outline(_trimmed(edge))
    below = points[(points[:, 2] > support + 0.4 * (rim - support)) & (points[:, 2] < rim + 0.006), :2]
    if ((wide := outline(_trimmed(below))).sides - around.sides).max() > _WALL_M * 3:
        around = wide  # a bar may hide a part of the rim, not of the wall below it
    if around.sides[1] < 0.6 * seen.sides[1]:
        return None
    at, half = np.abs(around.local(points[:, :2])), np.maximum(around.sides / 2, 0.01)
    middle, radius, bent = circle(edge)
    local = np.abs(around.local(edge))
    straight = float(np.sqrt(np.mean((around.sides / 2 - local).min(1) ** 2)))  # off the sides of the rectangle
    round_ = bent < straight and 0.4 * around.sides[1] < radius < 0.7 * around.sides[0]
    off = np.hypot(*(at / half).T) if round_ else (at / half).max(1)
    inward = (1 - off) * half.min() if round_ else (half - at).min(1)  # from the outer edge [m]
    low = points[:, 2] < rim - min(0.012, 0.3 * (rim - support))
    below_rim = points[:, 2] < rim + 0.006
    covered = int((~low & below_rim & (off < 0.5)).sum())
    if int((low & (inward > 0.6 * _WALL_M)).sum()) < 8 or covered > 0.04 * len(points) + 2:
        return None
    bottom = points[(off < 0.6) & (points[:, 2] < rim + 0.006), 2]
    floor = support + _WALL_M
    if len(bottom) > 12:
        floor = float(np.clip(np.percentile(bottom, 10), floor, rim - 0.01))
        floor = floor if floor < support + 0.35 * (rim - support) else support + _WALL_M
    bars = () if bar is None else (bar,)
    if round_:
        return _round_vessel(middle, radius, support, floor, rim, bars)
    return _square_vessel(around, support, floor, rim, bars)


def _rim(points: Array, seen: Outline, support: float, top: float) -> tuple[float, SeenBar | None]:
    """Height of a vessel's rim, and the bar that spans it higher up, if there is one."""
    edges = np.arange(top + 0.002, support + 0.02, -_SLICE_M)
    levels = [points[(points[:, 2] <= high) & (points[:, 2] > high - 2 * _SLICE_M), :2] for high in edges]
    enough = max(8.0, 0.3 * float(np.median([len(level) for level in levels] or [0])))
    rim = top
    for high, level in zip(edges, levels, strict=True):
        if len(level) > enough:
            across = np.percentile(seen.local(level), [3, 97], axis=0)
            if (np.ptp(across, axis=0) > 0.6 * seen.sides).all():
                rim = min(float(high), top)
                near = points[(points[:, 2] <= rim) & (points[:, 2] > rim - 2 * _SLICE_M), 2]
                counts, bins = np.histogram(near, np.arange(rim - 2 * _SLICE_M, rim + 0.004, 0.004))
                rim = min(rim, float(bins[np.flatnonzero(counts > 0.3 * counts.max())[-1] + 1]))
                break
    if top - rim < 0.025:
        return top, None
    above = points[points[:, 2] > max(top - 0.03, rim + 0.015)]
    if len(above) < 8:
        return rim, None
    bar = outline(above[:, :2])
    if bar.sides[1] > 0.045 or bar.sides[0] < 0.05 or np.linalg.norm(bar.middle - seen.middle) > 0.5 * seen.sides[1]:
        return rim, None
    center = np.array([*bar.middle, top - 0.010])
    axis = np.array([np.cos(bar.heading), np.sin(bar.heading), 0.0])
    return rim, SeenBar(center, axis, np.array([0.0, 0.0, 1.0]), float(bar.sides[0]))


def _bar_solids(bars: Sequence[SeenBar], rim: float) -> list[Solid]:
    out = []
    for bar in bars:
        heading = float(np.arctan2(bar.axis[1], bar.axis[0]))
        out.append(Solid("box", np.array([bar.length_m / 2, 0.009, 0.010]), pose(bar.center, heading)))
        tall = float(bar.center[2]) - 0.01 - rim
        for sign in (-1, 1):
            foot = bar.center + sign * bar.axis * (bar.length_m / 2 - 0.004)
            T = pose((float(foot[0]), float(foot[1]), rim + tall / 2), heading)
            out.append(Solid("box", np.array([0.004, 0.009, tall / 2]), T))
    return out


def _square_vessel(around: Outline, support: float, floor: float, rim: float, bars: tuple[SeenBar, ...]) -> Shape:
    x, y = around.sides
    T = _frame(around.middle, around.heading, support, rim)
    half = (rim - support) / 2
    solids = [Solid("box", np.array([x / 2, y / 2, (floor - support) / 2]), T @ pose((0, 0, (floor - rim) / 2)))]
    for sign in (-1, 1):
        side = pose((sign * (x - _WALL_M) / 2, 0, 0))
        solids.append(Solid("box", np.array([_WALL_M / 2, y / 2, half]), T @ side))
        side = pose((0, sign * (y - _WALL_M) / 2, 0))
        solids.append(Solid("box", np.array([x / 2 - _WALL_M, _WALL_M / 2, half]), T @ side))
    inside = np.array([x / 2 - _WALL_M, y / 2 - _WALL_M, (rim - floor) / 2])
    volume = Solid("box", inside, T @ pose((0, 0, half - (rim - floor) / 2)))
    return Shape("vessel", T, (*solids, *_bar_solids(bars, rim)), support, (volume,), bars)


def _round_vessel(
    middle: Array, radius: float, support: float, floor: float, rim: float, bars: tuple[SeenBar, ...]
) -> Shape:
    """`radius` is that of the middle of its wall."""
    T = _frame(middle, 0.0, support, rim)
    half = (rim - support) / 2
    solids = [Solid("cylinder", np.array([radius, radius, (floor - support) / 2]), T @ pose((0, 0, (floor - rim) / 2)))]
    stave = (radius + _WALL_M / 2) * float(np.tan(np.pi / _STAVES))
    for angle in np.arange(_STAVES) * (2 * np.pi / _STAVES):
        at = pose((radius * np.cos(angle), radius * np.sin(angle), 0), float(angle))
        solids.append(Solid("box", np.array([_WALL_M / 2, stave, half]), T @ at))
    inner, deep = radius - _WALL_M / 2, (rim - floor) / 2
    volume = Solid("cylinder", np.array([inner, inner, deep]), T @ pose((0, 0, half - deep)))
    return Shape("vessel", T, (*solids, *_bar_solids(bars, rim)), support, (volume,), bars)


def _furniture(points: Array) -> Shape:
    """Slabs under the large horizontal faces, and the frame of the largest."""
    slabs: list[tuple[int, Solid]] = []
    faces: list[Array] = []
    z = points[:, 2]
    counts, edges = np.histogram(z, np.arange(z.min() - 0.01, z.max() + 0.03, 0.01))
    level = counts.astype(float)
    for _ in range(4):
        k = int(level.argmax())
        if level[k] < 40:
            break
        height = float(np.median(z[(z > edges[k] - 0.01) & (z < edges[k + 1] + 0.01)]))
        level[max(k - 3, 0) : k + 4] = 0
        face = _level(points, height)
        if len(face) < 40:
            continue
        around = outline(_trimmed(face[:, :2]))
        if around.sides[1] > 0.1:
            if slabs:  # what is seen of a face in part may be a triangle: boards lie as the largest one does
                around = _along(_trimmed(face[:, :2]), float(np.arctan2(*slabs[0][1].T[1::-1, 0])))
            T = pose((*around.middle, height - 0.0125), around.heading)
            slabs.append((len(face), Solid("box", np.array([*around.sides / 2, 0.0125]), T)))
            faces.append(face)
    if not slabs:
        around = outline(_trimmed(points[:, :2]))
        low, high = np.percentile(z, [1, 99])
        box = _upright_box(around, float(low), float(high))
        return replace(box, kind="furniture", extent=_extent(points))
    order = sorted(range(len(slabs)), key=lambda k: -slabs[k][0])
    boards, faces = [slabs[k][1] for k in order], [faces[k] for k in order]
    solids: list[Solid] = []
    volumes: list[Solid] = []
    for board, face in zip(boards, faces, strict=True):
        below = points[z < board.T[2, 3] - _SUNK_M]
        if (found := _hole(board, face, below)) is None:
            solids.append(board)
        else:
            rest, basin = _cut_out(board, *found)
            solids += rest
            volumes.append(basin)
    for board in boards:
        if (volume := _compartment(board, boards, points)) is not None:
            volumes.append(volume)
    return Shape("furniture", boards[0].T, tuple(solids), float(z.min()), tuple(volumes), extent=_extent(points))


def _level(points: Array, height: float) -> Array:
    """The points (n, 3) of a level face: where walls are seen as many points lie above and below it as on it."""
    near = points[np.abs(points[:, 2] - height) < 0.04]
    cells = np.floor((near[:, :2] - near[:, :2].min(0)) / 0.03).astype(np.int64)
    own = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    on = np.abs(near[:, 2] - height) < 0.012
    share = np.bincount(own, on) / np.maximum(np.bincount(own), 1)
    return np.asarray(near[on & (share[own] > _LEVEL)])


def _hole(board: Solid, face: Array, below: Array) -> tuple[Array, float] | None:
    """An opening in the middle of a board through which what is below is seen, such as that of a basin in a counter.

    Args:
        board: The board.
        face: (n, 3) points of its face.
        below: (m, 3) points lower than that.

    Returns:
        (2, 2) its lowest and highest corner in the board's axes, and the height down to which is seen; None if there
        is none.
    """
    half, axes = board.half_m[:2], board.T[:2, :2]
    size = np.maximum(np.ceil(2 * half / _HOLE_CELL_M).astype(int), 1)
    closed = np.zeros(size, bool)
    cells = [np.floor(((p[:, :2] - board.T[:2, 3]) @ axes + half) / _HOLE_CELL_M).astype(int) for p in (face, below)]
    on, under = (((c >= 0) & (c < size)).all(1) for c in cells)
    closed[tuple(cells[0][on].T)] = True
    parts, count = ndimage.label(~(closed | ndimage.binary_closing(closed)))
    own = parts[tuple(cells[1][under].T)]
    counts = np.bincount(own, minlength=count + 1)
    edge = np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]])
    counts[np.append(edge, 0)] = 0  # at the edge: what is below is beside the board
    part = int(counts.argmax())
    if counts[part] < 40:
        return None
    at = np.argwhere(parts == part)
    low, high = at.min(0) * _HOLE_CELL_M - half, (at.max(0) + 1) * _HOLE_CELL_M - half
    filled = len(at) * _HOLE_CELL_M**2 / float(np.prod(high - low))
    if filled < 0.7 or (high - low).min() < 0.1:
        return None
    return np.stack([low, high]), float(np.percentile(below[under][own == part, 2], 3))


def _cut_out(board: Solid, hole: Array, bottom: float) -> tuple[list[Solid], Solid]:
    """What is left of a board around an opening, and the volume below that down to a height [m]."""
    (x0, y0), (x1, y1) = hole
    a, b, thick = board.half_m
    parts = [(-a, x0, -b, b), (x1, a, -b, b), (x0, x1, -b, y0), (x0, x1, y1, b)]
    rest = [
        Solid("box", np.array([(right - left) / 2, (far - near) / 2, thick]),
              board.T @ pose(((left + right) / 2, (near + far) / 2, 0.0)))
        for left, right, near, far in parts if right - left > 0.01 and far - near > 0.01
    ]  # fmt: skip
    deep = (float(board.aabb()[1, 2]) - bottom) / 2
    middle = pose(((x0 + x1) / 2, (y0 + y1) / 2, thick - deep))
    return rest, Solid("box", np.array([(x1 - x0) / 2, (y1 - y0) / 2, deep]), board.T @ middle)


def _along(xy: Array, heading: float) -> Outline:
    """The rectangle of a heading around points (n, 2)."""
    axes = Outline(np.zeros(2), np.zeros(2), heading, 1.0).frame
    low, high = (xy @ axes).min(0), (xy @ axes).max(0)
    return Outline(axes @ (low + high) / 2, high - low, heading, 1.0)


def _extent(points: Array) -> Solid:
    low, high = np.percentile(points, [1, 99], axis=0)
    return Solid("box", np.maximum((high - low) / 2, 0.01), pose((low + high) / 2))


def _compartment(board: Solid, boards: Sequence[Solid], points: Array) -> Solid | None:
    """The space above a board, up to the next one or as high as the furniture rises; None if it has no two walls."""
    face = float(board.aabb()[1, 2])
    at = (points[:, :2] - board.T[:2, 3]) @ board.T[:2, :2]
    risen = (np.abs(at) < board.half_m[:2] + 0.05).all(1) & (points[:, 2] > face + _HEADROOM_M)
    around, at = points[risen, 2], at[risen]
    walls = 0
    for axis in (0, 1):
        for sign in (-1, 1):
            wall = at[sign * at[:, axis] > board.half_m[axis] - 0.05, 1 - axis]
            bins = max(3, round(2 * float(board.half_m[1 - axis]) / 0.06))
            counts, _ = np.histogram(wall, bins, (-board.half_m[1 - axis], board.half_m[1 - axis]))
            walls += int((counts > 2).mean() > _WALLED)
    if len(around) < 20 or walls < 2:
        return None
    above = [float(b.aabb()[0, 2]) for b in boards if b.aabb()[0, 2] > face + _HEADROOM_M]
    high = min([*above, float(np.percentile(around, 98))])
    roofs = [b for b in boards if b.aabb()[0, 2] > face + _HEADROOM_M]
    low, up = -board.half_m[:2], board.half_m[:2]
    if roofs:  # only what is under the next board: a thing falls past what is before it
        roof = min(roofs, key=lambda b: float(b.T[2, 3]))
        half = np.abs(board.T[:2, :2].T @ roof.T[:2, :2]) @ roof.half_m[:2]
        middle = (roof.T[:2, 3] - board.T[:2, 3]) @ board.T[:2, :2]
        low, up = np.maximum(low, middle - half), np.minimum(up, middle + half)
        if (up - low < 0.05).any():
            return None
    T = board.T @ pose((*(low + up) / 2, 0.0))
    T[2, 3] = (face + high) / 2
    half = np.append((up - low) / 2, (high - face) / 2)
    return Solid("box", half, T)
