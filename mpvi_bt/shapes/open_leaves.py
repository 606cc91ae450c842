"""What stands open, told from the body that it belongs to: no bar needs to be seen.

A body is what fills its width and height behind a front plane; what reaches out before that plane hangs on it by one
edge. A sheet that is thin from side to side is a door on an upright hinge, one that is thin in height a flap, and what
is neither is a drawer. So a door is seen from within, where it hides its own bar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.collision import Surroundings
from mpvi_bt.robot.linear_algebra import matmul, norm, principal_axes
from mpvi_bt.robot.solids import Array, Solid
from mpvi_bt.shapes.moving_parts import Door
from mpvi_bt.shapes.outlines import main_cluster

_SAMPLE = 6000
_TURN_DEG, _APART_DEG, _HEADINGS = 1.0, 5.0, 6
_ROW_M, _ROWS = 0.015, 2
_LEVEL = 4.0  # rows in height that are so many times as full as the usual one are level faces
_SLICE_M = 0.02
_LEAST_POINTS, FEWEST = 60, 20  # FEWEST: of any part that something is told from
_BODY = 0.62  # a slice of the body has at least that share of the largest one's width times height
_DULL = 0.95  # what explains as much without anything that stands open is the less likely: a side face, mostly
_BEFORE_M = 0.03  # what is that far before the front is not of the body
_REACH_M = 0.12  # what reaches out less may be a bar, or a switch
_BARS, _FACE = 5, 4.0  # slices that bars reach out, and how many times as full as one of them a face is
_THIN_M = 0.13  # a slice of a sheet is thinner
_SHEET_M, _ON_SHEET = 0.025, 0.7  # how near points are to a sheet, and how many of them
_FARTHEST_M, _RARER = 0.45, 0.7  # how far drawers come out; a sheet that explains as much is the likelier
_AS_TALL = 0.75  # a drawer is not as tall as what it comes out of
_INNER = 0.8  # of an opening, without its rim
_LEAST_RAD, _MOST_RAD, _MOST_FLAP_RAD = 0.3, 2.2, 1.75
_BAR_OFF_M, _ALIKE = 0.12, 0.95  # how far bars are from their faces; cosine of directions that are alike
_SHUT = 0.1  # of its limit: a front that is taken to be closed
_PANEL_M = 0.018
_UPRIGHT_RAD, _FLAP_RAD, _SLIDE_M = 1.6, 1.3, 0.32  # what is taken for the limit
_FACING = -0.3  # cosine, of fronts with the way to the eye
_BESIDE_M = 0.05  # how far before a front the eye has to be to see what it shows
_DEEP_M = 0.12  # a body is deeper: a mere face may be anything
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Leaf:
    """What stands open of a thing.

    Attributes:
        door: It; without a bar.
        out: (3,) unit vector out of the front that it hangs on.
        front_m: Where that front is along `out`.
    """

    door: Door
    out: Array
    front_m: float


def leaf(points: Array, eye: Array) -> Leaf | None:
    """What stands open of a thing.

    Args:
        points: (n, 3) of the thing, in the world [m].
        eye: (3,) where they were seen from.

    Returns:
        None if nothing reaches out far enough.
    """
    rng = np.random.default_rng(0)
    points = points if len(points) < _SAMPLE else points[rng.choice(len(points), _SAMPLE, replace=False)]
    toward = (eye - np.median(points, axis=0)) * [1.0, 1.0, 0.0]
    toward /= max(float(norm(toward)), 1e-9)
    steep = _steep(points)
    most, found = -1.0, None
    for yaw in _headings(points[steep]):
        for out in (np.array([np.cos(a), np.sin(a), 0.0]) for a in yaw + np.arange(4) * np.pi / 2):
            if matmul(out, toward) > _FACING:
                explained, way = _explained(points, steep, eye, out, most)
                if explained > most:
                    most, found = explained, way
    return found


def with_leaf(fronts: Sequence[Door], found: Leaf | None) -> list[Door]:
    """Fronts that were told by their bars, with what stands open, which tells more: the others there are closed.

    Closed fronts that lie elsewhere than where it hangs speak against it.
    """
    if found is None:
        return list(fronts)
    door, closed = found.door, []
    for front in fronts:
        bar = front.bar
        assert bar is not None
        off_m = matmul(bar.center, found.out) - found.front_m
        shut = front.position < _SHUT * front.limit
        if float(Surroundings(found.door.solids).distance(bar.center[None])[0]) < _BAR_OFF_M:
            door = replace(door, bar=bar, solids=(*door.solids[:1], *front.solids[1:]))
        elif abs(off_m) < _BAR_OFF_M and matmul(bar.outward, found.out) > _ALIKE:
            closed.append(replace(front, position=0.0))
        elif shut:
            return list(fronts)
    return [door, *closed]


def within_drawer(door: Door) -> Solid | None:
    """The room inside a drawer that stands open, in the world: behind its face, as high as that; None where none is."""
    if door.kind != "slide" or door.position < _REACH_M:
        return None
    across = np.cross(_Z, door.axis)
    R, face = np.stack([door.axis, across, _Z], axis=1), door.solids[0]
    half = matmul(np.abs(matmul(R.T, face.T[:3, :3])), face.half_m)
    inner = np.array([door.position / 2, half[1] - _PANEL_M, half[2] - _PANEL_M / 2])
    middle = face.T[:3, 3] - door.axis * (half[0] + inner[0]) + _Z * _PANEL_M / 2  # it has a bottom
    return Solid("box", inner, kin.transform(R, middle))


def _headings(steep: Array) -> list[float]:
    """Angles [rad], modulo a right angle, along which points lie in rows, the sharpest first."""
    angles = np.radians(np.arange(0.0, 90.0, _TURN_DEG))
    sharp = np.array([
        sum(float((np.bincount(np.floor((row - row.min()) / _ROW_M).astype(int)) ** 2.0).sum()) for row in rows)
        for rows in (matmul([[np.cos(a), np.sin(a), 0.0], [-np.sin(a), np.cos(a), 0.0]], steep.T) for a in angles)
    ])  # fmt: skip
    out: list[int] = []
    for i in np.argsort(-sharp):
        if all(min(abs(i - j), len(angles) - abs(i - j)) > _APART_DEG / _TURN_DEG for j in out):
            out.append(int(i))
    return [float(angles[i]) for i in out[:_HEADINGS]]


def _steep(points: Array) -> NDArray[np.bool_]:
    """(n,) bool: points that are not on level faces."""
    k = np.floor((points[:, 2] - points[:, 2].min()) / _ROW_M).astype(int)
    counts = np.bincount(k)
    return np.asarray(counts[k] < max(_LEVEL * np.median(counts[counts > 0]), _LEAST_POINTS / 4))


def _explained(
    points: Array, steep: NDArray[np.bool_], eye: Array, out: Array, most: float
) -> tuple[float, Leaf | None]:
    """How many points a body whose front faces `out`, with what hangs on it, explains, and that; 0 if surely no more.

    Args:
        points: (n, 3).
        steep: (n,) bool, see `_steep`.
        eye: (3,) where they were seen from.
        out: (3,) unit vector.
        most: So many another one explains.
    """
    across = np.cross(_Z, out)
    suz = np.stack([matmul(points, out), matmul(points, across), points[:, 2]], 1)
    front = front_of(suz)
    if front is None or matmul(eye, out) < front + _BESIDE_M or front - np.percentile(suz[:, 0], 1) < _DEEP_M:
        return 0.0, None
    of_body = suz[:, 0] <= front + _BEFORE_M
    body, ahead = suz[of_body], suz[~of_body]
    explained = float(_in_rows(suz[of_body & steep]))
    if explained + len(ahead) <= most:
        return 0.0, None
    ahead = main_cluster(ahead) if len(ahead) >= _LEAST_POINTS else ahead[:0]
    if len(ahead) < _LEAST_POINTS or np.percentile(ahead[:, 0], 98) - front < _REACH_M:
        return _DULL * explained, None
    box = np.percentile(body, [1, 99], axis=0)
    ways = [
        _drawer(ahead, front, box),
        *(hinged(ahead, front, box, k) for k in (1, 2) if _thickness(ahead, k) < _THIN_M),
    ]
    able = [way for way in ways if way is not None]
    if not able:
        return _DULL * explained, None
    door, share = max(able, key=lambda way: way[1])
    deeper, solid = _opening(door, body, front) if door.kind == "hinge" else (0, 0)
    if solid > deeper:
        return _DULL * explained, None
    R = np.stack([out, across, _Z], axis=1)
    T = np.eye(4)
    T[:3, :3] = R
    solids = tuple(s.moved(T) for s in door.solids)
    origin, axis = matmul(R, door.origin), matmul(R, door.axis)
    door = Door(door.name, door.kind, origin, axis, door.position, door.limit, None, solids)
    return explained + share * len(ahead), Leaf(door, out, front)


def _opening(door: Door, body: Array, front: float) -> tuple[int, int]:
    """How many points are behind the closed place of a hinged door, and how many are in it, in (s, u, z)."""
    R = Rotation.from_rotvec(-door.axis * door.position).as_matrix()
    shut = matmul(kin.transform(R, door.origin - matmul(R, door.origin)), door.solids[0].T)
    half = door.solids[0].half_m
    local = np.abs(matmul(body - shut[:3, 3], shut[:3, :3]))
    behind = body[(local[:, 0] < _INNER * half[0]) & (local[:, 2] < _INNER * half[2])]
    deeper = int((behind[:, 0] < front - _BEFORE_M).sum())
    return deeper, len(behind) - deeper


def _in_rows(body: Array) -> int:
    """How many points are in the fullest rows along the first two axes."""
    own = np.zeros(len(body), bool)
    if not len(body):
        return 0
    for axis in (0, 1):
        k = np.floor((body[:, axis] - body[:, axis].min()) / _ROW_M).astype(int)
        own |= np.isin(k, np.argsort(-np.bincount(k))[:_ROWS])
    return int(own.sum())


def front_of(suz: Array) -> float | None:
    """Where the body ends, along the first axis."""
    k = np.floor(suz[:, 0] / _SLICE_M).astype(int)
    first = k.min()
    order = np.argsort(k, kind="stable")
    starts = np.searchsorted(k[order], np.arange(first, k.max() + 2))
    u, z = suz[order, 1], suz[order, 2]
    areas = np.zeros(len(starts) - 1)
    for i, end in enumerate(starts[1:]):
        own = slice(starts[max(i - 1, 0)], end)
        if end - own.start >= FEWEST:
            areas[i] = _span(u[own]) * _span(z[own])
    if areas.max() <= 0:
        return None
    last = int(np.flatnonzero(areas >= _BODY * areas.max()).max())
    # Bars of what is closed reach out, too, and lie far apart: the face that they stand on has many times their points.
    near = [_fullest(suz[(k - first >= last - back) & (k - first <= last + 1), 0]) for back in (1, _BARS)]
    return near[1][0] if near[1][1] > _FACE * near[0][1] else near[0][0]


def _span(values: Array) -> float:
    """From the 3rd to the 97th percentile of at least two values, as np.percentile has it, at a sixth of the cost."""
    at = [share * (len(values) - 1) for share in (0.03, 0.97)]
    part = np.partition(values, [k for x in at for k in (int(x), int(x) + 1)])
    low, high = (_between(float(part[int(x)]), float(part[int(x) + 1]), x - int(x)) for x in at)
    return high - low


def _between(a: float, b: float, share: float) -> float:
    return a + (b - a) * share if share < 0.5 else b - (b - a) * (1 - share)


def _fullest(values: Array) -> tuple[float, int]:
    """The value that most are near to, and how many."""
    counts, edges = np.histogram(values, np.arange(values.min(), values.max() + 0.01, 0.005))
    return float(edges[int(counts.argmax())] + 0.0025), int(counts.max())


def _thickness(ahead: Array, axis: int) -> float:
    """How thick slices are along an axis, the median."""
    k = np.floor(ahead[:, 0] / _SLICE_M).astype(int)
    spans = [np.ptp(np.percentile(own[:, axis], [5, 95])) for i in np.unique(k) if len(own := ahead[k == i]) >= 8]
    return float(np.median(spans)) if spans else 0.0


def hinged(ahead: Array, front: float, body: Array, k: int) -> tuple[Door, float] | None:
    """A sheet that turns about an edge at the front; `k` is the axis in which it is thin. In (s, u, z)."""
    rng = np.random.default_rng(0)
    flat = ahead[:, [0, k]]
    best, normal, at = 0, np.zeros(2), 0.0
    for a, b in rng.integers(len(flat), size=(150, 2)):
        along = flat[b] - flat[a]
        length = float(norm(along))
        if length < 0.05:
            continue
        n = np.array([-along[1], along[0]]) / length
        near = int((np.abs(matmul(flat - flat[a], n)) < _SHEET_M / 2).sum())
        if near > best:
            best, normal, at = near, n, float(matmul(flat[a], n))
    own = np.abs(matmul(flat, normal) - at) < _SHEET_M
    share = float(own.mean())
    if share < _ON_SHEET or abs(normal[1]) < 0.05:
        return None
    middle, (_, (t, _)) = flat[own].mean(0), principal_axes(flat[own])
    t = t * np.sign(t[0])  # from the hinge to the free edge
    if t[0] < 0.1:
        return None
    hinge = middle + t * (front - middle[0]) / t[0]
    width = float(np.percentile(matmul(flat[own] - hinge, t), 99))
    low, high = body[:, k]
    inward = 1.0 if hinge[1] + width - high < low - (hinge[1] - width) else -1.0
    angle = float(np.arctan2(t[0], inward * t[1]))
    if not _LEAST_RAD < angle < (_MOST_RAD if k == 1 else _MOST_FLAP_RAD):
        return None
    other = 3 - k
    span = np.percentile(ahead[own][:, other], [1, 99])
    origin = np.zeros(3)
    origin[[0, k]], origin[other] = hinge, span.mean()
    closed = np.zeros(3)
    closed[k] = inward
    axis = np.cross(closed, [1.0, 0.0, 0.0])
    along = np.zeros(3)
    along[[0, k]] = t
    T = np.eye(4)
    outward = np.cross(axis, along)
    T[:3, :3] = np.stack([along, outward, np.cross(along, outward)], axis=1)
    T[:3, 3] = origin + along * width / 2 - outward * 0.0
    half = np.array([width, _PANEL_M, float(np.ptp(span))]) / 2
    limit = max(_UPRIGHT_RAD if k == 1 else _FLAP_RAD, angle)
    return Door("leaf", "hinge", origin, axis, angle, limit, None, (Solid("box", half, T),)), share


def _drawer(ahead: Array, front: float, body: Array) -> tuple[Door, float] | None:
    """What is drawn out of a front, in (s, u, z), and the share of points on its faces."""
    k = np.floor(ahead[:, 0] / _SLICE_M).astype(int)
    areas = {
        i: _span(own[:, 1]) * _span(own[:, 2])
        for i in np.unique(k) if len(own := ahead[(k == i) | (k == i + 1)]) >= FEWEST
    }  # fmt: skip
    most = max(areas.values(), default=0.0)
    last = max((i for i, area in areas.items() if area > 0.6 * most), default=int(k.max()))
    own = ahead[(k >= last) & (k <= last + 1)]
    face = float(np.median(own[:, 0]))
    low, high = np.percentile(own[:, 1:], [2, 98], axis=0)
    T = np.eye(4)
    T[:3, 3] = [face - _PANEL_M / 2, *((low + high) / 2)]
    half = np.array([_PANEL_M, *(high - low)]) / 2
    drawn = face - front
    if not _REACH_M / 2 < drawn < _FARTHEST_M or high[1] - low[1] > _AS_TALL * np.ptp(body[:, 2]):
        return None
    off = [np.abs(ahead[:, 0] - face), *np.abs(ahead[:, 1:] - low).T, *np.abs(ahead[:, 1:] - high).T]
    share = _RARER * float((np.min(off, axis=0) < _SHEET_M).mean())
    solids = (Solid("box", half, T),)
    out = np.array([1.0, 0.0, 0.0])
    return Door("leaf", "slide", T[:3, 3].copy(), out, drawn, max(_SLIDE_M, drawn), None, solids), share
