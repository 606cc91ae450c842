"""Doors and drawers, as they show from outside: flat fronts with bars that stand off them.

A bar says most of how a front opens. An upright bar near one edge: it turns about the other edge. A lying bar near the
top: it turns about its lower edge, and near the bottom about the upper one; in between, or with others above and below:
a drawer. How far a front stands open is told from the rest of the thing: a door against the directions of its other
faces, a drawer against the plane of its neighbors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.shapes.moving_parts import PART, Door
from mpvi_bt.finding.shapes.shape import SeenBar
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm, principal_axes
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE


@dataclass(frozen=True)
class FrontParameters:
    """How a closed front with a bar is found.

    Our choice, by kitchen furniture: bars stand off by a few centimeters so that fingers fit behind them.
    """

    samples: int = 300  # pairs of points that upright planes are tried through
    planes: int = 4  # most planes of one thing
    flat_m: float = 0.010  # points this close to a plane, beside the noise of depth, are on it [m]
    least_points: int = 150  # least points of a plane
    tall_m: float = 0.1  # least height of the bulk of an upright plane [m]
    explained: float = 0.8  # least part of a thing's other points that lie behind a closed door [ratio]
    off_m: tuple[float, float] = (0.022, 0.095)  # least and largest standoff of a bar [m]
    strip_m: tuple[float, float] = (0.012, 0.045)  # distance from a bar in which its face shows, from and to [m]
    clear_m: float = 0.2  # clearance of a bar from what is before it [m]
    before: float = 0.15  # points allowed before a bar per point of the bar [ratio]
    cell_m: float = 0.012  # cell of the grid in which points of a bar are joined [m]
    bar_length_m: tuple[float, float] = (0.07, 0.6)  # least and largest length of a bar [m]
    bar_width_m: float = 0.05  # largest width of a bar [m]
    bar_radius_m: float = 0.009  # radius assumed for a bar [m]
    near_edge: float = 0.3  # part of a front's height in which a lying bar is near an edge [ratio]
    drawer_m: float = 0.42  # a lower front with a lying bar is a drawer [m]
    ajar_rad: float = 0.12  # a hinged front that is open less is taken as closed [rad]
    ajar_m: float = 0.035  # a drawer that is open less is taken as closed [m]
    widest_rad: float = 2.1  # widest position of a hinge that is tried [rad]
    doubt: float = 0.1  # part of the points that each radian has to explain in addition [ratio]; few doors open wide
    switch_points: int = 4  # fewer points make no switch
    beside_m: float = 0.035  # distance around a button in which its surface is measured [m]
    flatness: float = 0.35  # largest spread through a surface, per spread along it, that tells its direction [ratio]


_FRONT = FrontParameters()
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class _Plane:
    """An upright plane: n . p = d, with n (3,) toward the eye; u (3,) lies in it, to the right of who faces it."""

    n: Array
    d: float
    u: Array
    own: NDArray[np.bool_]  # which points are on it


@dataclass(frozen=True, eq=False)
class _Front:
    """A flat face with one bar, in the plane's u and z."""

    plane: _Plane
    bar: SeenBar
    low: Array
    high: Array


def fronts(points: Array, eye: Array) -> list[Door]:
    """The doors and drawers of a thing, as seen.

    Args:
        points: (n, 3) of the thing, in the world [m].
        eye: (3,) where they were seen from.

    Returns:
        Those with a bar, in the world, named by their number; their limits are guesses.
    """
    if len(points) < _FRONT.least_points:
        return []
    planes = list(_planes(points, eye))
    found: list[_Front] = []
    for plane in planes:
        found += _fronts_on(points, plane, eye)
    doors: list[Door] = []
    for front in found:
        if not any(_same(front, other) for other in found[: found.index(front)]):
            doors.append(_door(front, f"front {len(doors) + 1}", found, planes, points))
    return doors


def switch(points: Array, around: Array, eye: Array) -> Array | None:
    """T_world_switch (4, 4) of a button, z out of the surface that it sits on.

    Args:
        points: (n, 3) of the button [m].
        around: (m, 3) of the thing that it belongs to.
        eye: (3,) where they were seen from.

    Returns:
        None if hardly anything of it was measured.
    """
    if len(points) < _FRONT.switch_points:
        return None
    center = np.median(points, axis=0)
    near = np.concatenate([points, around[norm(around - center, axis=1) < _FRONT.beside_m]])
    sight = (eye - center) / norm(eye - center)
    spread, axes = principal_axes(near)
    flat = spread[2] < _FRONT.flatness * spread[1]
    z = axes[2] * np.sign(matmul(axes[2], sight)) if flat else sight * [1.0, 1.0, 0.0]
    if abs(z[2]) > 0.85:
        z = _Z * np.sign(z[2])
    elif abs(z[2]) < 0.4:
        z = z * [1.0, 1.0, 0.0]
    z = z / norm(z)
    x = np.cross(_Z if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0], z)
    x /= norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), center
    return T


def _planes(points: Array, eye: Array) -> Iterator[_Plane]:
    """Upright planes through the points, the one with the most points first."""
    rng = np.random.default_rng(0)
    left = np.ones(len(points), bool)
    sample = points if len(points) < 4000 else points[rng.choice(len(points), 4000, replace=False)]
    tolerance, slack = (_FRONT.flat_m + DEPTH_NOISE.smoothed_m * norm(p - eye, axis=1) ** 2 for p in (points, sample))
    free = np.ones(len(sample), bool)
    for _ in range(_FRONT.planes):
        if free.sum() < _FRONT.least_points // 4:
            return
        choice = np.flatnonzero(free)
        a, b = sample[rng.choice(choice, _FRONT.samples)], sample[rng.choice(choice, _FRONT.samples)]
        along = (b - a)[:, :2]
        length = norm(along, axis=1)
        good = length > 0.08
        if not good.any():
            return
        n = np.stack([-along[good, 1], along[good, 0]], 1) / length[good, None]
        d = (n * a[good, :2]).sum(1)
        best = int(_on_lines(sample[free, :2], slack[free], n, d).argmax())
        normal, distance = n[best], d[best]
        for _ in range(3):  # settle on the points themselves
            near = np.abs(matmul(points[:, :2], normal) - distance) < tolerance
            if near.sum() < _FRONT.least_points:
                return
            middle = np.median(points[near, :2], axis=0)
            _, (_, normal) = principal_axes(points[near, :2])
            distance = float(np.median(matmul(points[near, :2], normal))) if abs(matmul(normal, middle)) >= 0 else 0.0
        own = (np.abs(matmul(points[:, :2], normal) - distance) < tolerance) & left
        if own.sum() < _FRONT.least_points:
            return
        free &= np.abs(matmul(sample[:, :2], normal) - distance) > slack
        left &= ~own
        if np.ptp(percentile(points[own, 2], [15, 85])) < _FRONT.tall_m:
            continue  # a slice of a top
        sign = 1.0 if matmul(normal, eye[:2]) > distance else -1.0
        n3 = np.append(sign * normal, 0.0)
        yield _Plane(n3, sign * distance, np.cross(_Z, n3), own)


@compiled_later
def _on_lines(xy, slack, n, d):  # type: ignore
    """(m,) how many points (k, 2) lie within their slack (k,) of lines n . p = d."""
    out = np.zeros(n.shape[0], np.int64)
    for line in range(n.shape[0]):
        for k in range(xy.shape[0]):
            if abs(xy[k, 0] * n[line, 0] + xy[k, 1] * n[line, 1] - d[line]) < slack[k]:
                out[line] += 1
    return out


def _fronts_on(points: Array, plane: _Plane, eye: Array) -> list[_Front]:
    """Faces of a plane that have a bar."""
    off = matmul(points, plane.n) - plane.d
    u, z = matmul(points, plane.u), points[:, 2]
    low, high = percentile(u[plane.own], [0.5, 99.5]), percentile(z[plane.own], [0.5, 99.5])
    near = (u > low[0] - 0.02) & (u < low[1] + 0.02) & (z > high[0] - 0.02) & (z < high[1] + 0.02)
    standing = near & (off > _FRONT.off_m[0]) & (off < _FRONT.off_m[1])
    beyond = near & (off >= _FRONT.off_m[1]) & (off < _FRONT.off_m[1] + _FRONT.clear_m)
    uz = np.stack([u, z], 1)
    bars = [b for b in _bars(points[standing], plane, off[standing], uz[beyond]) if _backed(b, uz[plane.own], plane)]
    if not bars:
        return []
    face = np.array([[low[0], high[0]], [low[1], high[1]]])
    return [_Front(plane, bar, *_around(bar, bars, face, plane)) for bar in bars]


def _bars(points: Array, plane: _Plane, off: Array, beyond: Array) -> list[SeenBar]:
    """Slender things among points that stand off a plane, with nothing before them (u and z of points `beyond`)."""
    if len(points) < 8:
        return []
    uz = np.stack([matmul(points, plane.u), points[:, 2]], 1)
    cells = ((uz - uz.min(0)) / _FRONT.cell_m).astype(int)
    grid = np.zeros(cells.max(0) + 1, bool)
    grid[tuple(cells.T)] = True
    whole = ndimage.binary_closing(np.pad(grid, 3), np.ones((3, 3)), iterations=2)[3:-3, 3:-3] | grid
    parts, count = ndimage.label(whole, np.ones((3, 3)))
    part = parts[tuple(cells.T)]
    out = []
    for k in range(1, count + 1):
        own = part == k
        if own.sum() < 8:
            continue
        span = percentile(uz[own], [2, 98])
        size = span[1] - span[0]
        longer = int(size.argmax())
        before = ((beyond > span[0] - _FRONT.cell_m) & (beyond < span[1] + _FRONT.cell_m)).all(1)
        if before.sum() > _FRONT.before * own.sum():
            continue  # the edge of a board, or of another front
        if not (
            _FRONT.bar_length_m[0] < size[longer] < _FRONT.bar_length_m[1] and size[1 - longer] < _FRONT.bar_width_m
        ):
            continue
        if size[longer] < 2.5 * size[1 - longer]:
            continue
        inner = np.abs(uz[own, longer] - span[:, longer].mean()) < 0.4 * size[longer]  # without the posts
        if inner.sum() < 4:
            continue
        outermost = float(percentile(off[own][inner], 85)) - _FRONT.bar_radius_m
        across = uz[own][inner][off[own][inner] > outermost - _FRONT.bar_radius_m, 1 - longer]
        at = np.empty(2)
        at[longer] = span[:, longer].mean()
        at[1 - longer] = percentile(across, [5, 95]).mean() if len(across) else span[:, 1 - longer].mean()
        center = plane.u * at[0] + _Z * at[1] + plane.n * (plane.d + outermost)
        out.append(SeenBar(center, (plane.u, _Z)[longer].copy(), plane.n.copy(), float(size[longer])))
    return out


def _backed(bar: SeenBar, face: Array, plane: _Plane) -> bool:
    """Whether there is a face (points (n, 2) in u and z) on both sides of a bar: else it is an edge of something."""
    along = int(abs(bar.axis[2]) > 0.5)
    local = face - [matmul(bar.center, plane.u), bar.center[2]]
    beside = local[np.abs(local[:, along]) < bar.length_m / 2]
    cells = max(1, int(bar.length_m / _FRONT.cell_m))
    shares = []
    for sign in (-1, 1):
        strip = beside[
            (sign * beside[:, 1 - along] > _FRONT.strip_m[0]) & (sign * beside[:, 1 - along] < _FRONT.strip_m[1])
        ]
        shares.append(len(np.unique((strip[:, along] / _FRONT.cell_m).astype(int))) / cells)
    return min(shares) > 0.3


def _around(bar: SeenBar, bars: list[SeenBar], face: Array, plane: _Plane) -> tuple[Array, Array]:
    """(u, z) of the lowest and highest corner of the part of a face that a bar belongs to."""
    low, high = face[0].copy(), face[1].copy()
    at = np.array([matmul(bar.center, plane.u), bar.center[2]])
    lying = abs(bar.axis[2]) < 0.5
    for other in bars:
        if other is bar:
            continue
        there = np.array([matmul(other.center, plane.u), other.center[2]])
        k = 1 if lying else 0
        if lying != (abs(other.axis[2]) < 0.5) or abs(there[1 - k] - at[1 - k]) > 0.25:
            continue
        if lying:  # bars sit alike on their fronts, so fronts begin as far apart as their bars do
            if there[1] > at[1]:
                high[1] = min(high[1], (there[1] + at[1]) / 2 + _above(bars, face))
            else:
                low[1] = max(low[1], (there[1] + at[1]) / 2 + _above(bars, face))
        elif there[0] > at[0]:
            high[0] = min(high[0], (there[0] + at[0]) / 2)
        else:
            low[0] = max(low[0], (there[0] + at[0]) / 2)
    return low, high


def _above(bars: list[SeenBar], face: Array) -> float:
    """How far fronts reach up beyond the middle between their lying bars: from the top one, which is seen whole."""
    heights = sorted(float(b.center[2]) for b in bars if abs(b.axis[2]) < 0.5)
    if len(heights) < 2:
        return 0.0
    pitch = (heights[-1] - heights[0]) / (len(heights) - 1)
    return float(np.clip(face[1, 1] - heights[-1] - pitch / 2, -0.3 * pitch, 0.3 * pitch))


def _same(a: _Front, b: _Front) -> bool:
    return bool(norm(a.bar.center - b.bar.center) < 0.06)


def _door(front: _Front, name: str, found: list[_Front], planes: list[_Plane], points: Array) -> Door:
    plane, bar = front.plane, front.bar
    wide, high = front.high - front.low
    at = (np.array([matmul(bar.center, plane.u), bar.center[2]]) - front.low) / np.maximum([wide, high], 1e-6)
    middle = plane.u * (front.low[0] + wide / 2) + _Z * (front.low[1] + high / 2) + plane.n * plane.d
    T = np.eye(4)
    T[:3, :3] = np.stack([plane.u, plane.n, np.cross(plane.u, plane.n)], axis=1)
    T[:3, 3] = middle - plane.n * PART.panel_m / 2
    solids = (Solid("box", np.array([wide, PART.panel_m, high]) / 2, T), _rod(bar))
    if abs(bar.axis[2]) > 0.5:
        free = plane.u if at[0] > 0.5 else -plane.u  # from the hinge to the free edge
        origin = middle - free * wide / 2
        axis = np.cross(free, plane.n)
        position = _ajar(origin, free, plane, axis, planes, points)
        return Door(name, "hinge", origin, axis, position, max(PART.upright_rad, position), bar, solids)
    stacked = any(abs(other.bar.axis[2]) < 0.5 and not _same(front, other) for other in found)
    if stacked or high < _FRONT.drawer_m or _FRONT.near_edge < at[1] < 1 - _FRONT.near_edge:
        position = _pulled(front, found, planes)
        return Door(name, "slide", middle, plane.n, position, max(PART.slide_m, position), bar, solids)
    up = 1.0 if at[1] > 0.5 else -1.0
    origin = middle - up * _Z * high / 2
    return Door(name, "hinge", origin, np.cross(up * _Z, plane.n), 0.0, PART.flap_rad, bar, solids)


def _rod(bar: SeenBar) -> Solid:
    T = np.eye(4)
    T[:3, :3] = np.stack([bar.outward, np.cross(bar.axis, bar.outward), bar.axis], axis=1)
    T[:3, 3] = bar.center
    return Solid("cylinder", np.array([_FRONT.bar_radius_m, _FRONT.bar_radius_m, bar.length_m / 2]), T)


def _ajar(origin: Array, free: Array, plane: _Plane, axis: Array, planes: list[_Plane], points: Array) -> float:
    """How far a door is open [rad]: by the turn that brings it before the rest of the thing, along its other faces."""
    rest = points[~plane.own]
    rest = rest[np.abs(matmul(rest - origin, plane.n)) > _FRONT.off_m[1]]
    if not len(rest):
        return 0.0
    shares = {0.0: _behind(rest - origin, free, plane.n)}
    aligned = 0.0  # points on faces along or across the door, less those on others
    for other in planes:
        base = float(np.arctan2(matmul(np.cross(free, other.u), axis), matmul(free, other.u)))
        if other is not plane:
            askew = abs((base + np.pi / 4) % (np.pi / 2) - np.pi / 4)
            tall = float(np.ptp(percentile(points[other.own, 2], [15, 85])))  # slices of a top are not
            aligned += float(other.own.sum()) * tall**2 * (1 if askew < _FRONT.ajar_rad else -1)
        for turn in base + np.arange(4) * np.pi / 2 if other is not plane else ():
            back = float(-np.arctan2(np.sin(turn), np.cos(turn)))
            if _FRONT.ajar_rad < back < _FRONT.widest_rad:
                R = Rotation.from_rotvec(-back * axis).as_matrix()
                shares[back] = _behind(rest - origin, matmul(R, free), matmul(R, plane.n))
    if shares[0.0] > _FRONT.explained and aligned >= 0:
        return 0.0
    if aligned < 0 and len(shares) > 1:
        del shares[0.0]
    return max(shares, key=lambda back: shares[back] - _FRONT.doubt * back)


def _behind(local: Array, free: Array, out: Array) -> float:
    """Share of points, relative to the hinge, behind a door along `free` with its face toward `out`."""
    return float(((matmul(local, out) < 0.05) & (matmul(local, free) > -0.05)).mean())


def _pulled(front: _Front, found: list[_Front], planes: list[_Plane]) -> float:
    """How far a drawer is open [m]: before the plane of its neighbors or, without any, of the frame around it."""
    gaps = {
        front.plane.d - other.d: (any(f.plane is other for f in found), int(other.own.sum()))
        for other in planes
        if matmul(other.n, front.plane.n) > 0.97 and _FRONT.ajar_m < front.plane.d - other.d < PART.slide_m + 0.2
    }
    return max(gaps, key=lambda gap: gaps[gap], default=0.0)
