"""Open doors, flaps and drawers, found by the body behind them: no bar needs to be seen.

A body is what fills its width and height behind a front plane; what reaches out before that plane hangs on it by one
edge. A sheet that is thin from side to side is a door on an upright hinge, one that is thin in height a flap, and what
is neither is a drawer. So a door is seen from within, where it hides its own bar.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.shapes.moving_parts import PART, Door
from mpvi_bt.finding.shapes.outlines import main_cluster
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm, principal_axes
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Surroundings


@dataclass(frozen=True)
class LeafParameters:
    """How an open door, lid or drawer in front of its body is found.

    Our choice, by furniture of the simulated houses seen from 1 to 2 m.
    """

    sampled: int = 6000  # points that are enough
    turn_deg: float = 1.0  # step between headings of the front [deg]
    apart_deg: float = 5.0  # least angle between two likely headings [deg]
    headings: int = 6  # headings that are tried
    row_m: float = 0.015  # width of a row of points [m]
    rows: int = 2  # the fullest rows, which are the body's faces
    level: float = 4.0  # a row this many times as full as the usual one is a level face
    slice_m: float = 0.02  # thickness of a slice along the front's direction [m]
    least_points: int = 60  # least points of an open part
    body: float = 0.62  # least width times height of a slice of the body [ratio of the largest slice]
    dull: float = 0.95  # weight of an explanation without an open part [ratio]; it is mostly a side face
    before_m: float = 0.03  # points this far before the front are not of the body [m]
    reach_m: float = 0.12  # a part that reaches out less may be a bar or a switch [m]
    bars: int = 5  # slices that bars reach out
    face: float = 4.0  # a face is this many times as full as a slice of bars
    thin_m: float = 0.13  # largest thickness of a slice of a sheet [m]
    sheet_m: float = 0.025  # largest distance of points from their sheet [m]
    on_sheet: float = 0.7  # least part of the points on the sheet [ratio]
    farthest_m: float = 0.45  # farthest that a drawer comes out [m]
    rarer: float = 0.7  # weight of a drawer that explains as much as a sheet [ratio]
    as_tall: float = 0.75  # largest height of a drawer [ratio of its body's]
    inner: float = 0.8  # part of an opening without its rim [ratio]
    least_rad: float = 0.3  # a smaller opening looks closed [rad]
    most_rad: float = 2.2  # widest opening of an upright door [rad]
    most_flap_rad: float = 1.75  # widest opening of a flap [rad]
    bar_off_m: float = 0.12  # largest distance of a bar from its face [m]
    alike: float = 0.95  # least cosine of directions that are alike
    shut: float = 0.1  # a front that is open less is taken as closed [ratio of its limit]
    facing: float = -0.3  # least cosine of a front's direction with the direction to the eye
    beside_m: float = 0.05  # least distance of the eye before a front that it sees [m]
    deep_m: float = 0.12  # least depth of a body [m]; a mere face may be anything


_LEAF = LeafParameters()
FEWEST = 20  # our choice: points of any part that something is told from
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class OpenLeaf:
    """An open door, flap or drawer of a thing.

    Attributes:
        door: It; without a bar.
        out: (3,) unit vector out of the front that it hangs on.
        front_m: Where that front is along `out`.
    """

    door: Door
    out: Array
    front_m: float


def leaf(points: Array, eye: Array) -> OpenLeaf | None:
    """Find the open door, flap or drawer of a thing.

    Args:
        points: (n, 3) of the thing, in the world [m].
        eye: (3,) where they were seen from.

    Returns:
        None if nothing reaches out far enough.
    """
    rng = np.random.default_rng(0)
    points = points if len(points) < _LEAF.sampled else points[rng.choice(len(points), _LEAF.sampled, replace=False)]
    toward = (eye - np.median(points, axis=0)) * [1.0, 1.0, 0.0]
    toward /= max(float(norm(toward)), 1e-9)
    steep = _steep(points)
    most, found = -1.0, None
    for yaw in _headings(points[steep]):
        for out in (np.array([np.cos(a), np.sin(a), 0.0]) for a in yaw + np.arange(4) * np.pi / 2):
            if matmul(out, toward) > _LEAF.facing:
                explained, way = _explained(points, steep, eye, out, most)
                if explained > most:
                    most, found = explained, way
    return found


def with_leaf(fronts: Sequence[Door], found: OpenLeaf | None) -> list[Door]:
    """Merge the fronts found by their bars with an open door or drawer; the other fronts there count as closed.

    Closed fronts that lie elsewhere than where it hangs speak against it.
    """
    if found is None:
        return list(fronts)
    door, closed = found.door, []
    for front in fronts:
        bar = front.bar
        assert bar is not None
        off_m = matmul(bar.center, found.out) - found.front_m
        shut = front.position < _LEAF.shut * front.limit
        if float(Surroundings(found.door.solids).distance(bar.center[None])[0]) < _LEAF.bar_off_m:
            door = replace(door, bar=bar, solids=(*door.solids[:1], *front.solids[1:]))
        elif abs(off_m) < _LEAF.bar_off_m and matmul(bar.outward, found.out) > _LEAF.alike:
            closed.append(replace(front, position=0.0))
        elif shut:
            return list(fronts)
    return [door, *closed]


def within_drawer(door: Door) -> Solid | None:
    """The volume inside an open drawer, in the world: behind its face and as high. None if no drawer is open."""
    if door.kind != "slide" or door.position < _LEAF.reach_m:
        return None
    across = np.cross(_Z, door.axis)
    R, face = np.stack([door.axis, across, _Z], axis=1), door.solids[0]
    half = matmul(np.abs(matmul(R.T, face.T[:3, :3])), face.half_m)
    inner = np.array([door.position / 2, half[1] - PART.panel_m, half[2] - PART.panel_m / 2])
    middle = face.T[:3, 3] - door.axis * (half[0] + inner[0]) + _Z * PART.panel_m / 2  # it has a bottom
    return Solid("box", inner, kin.transform(R, middle))


def _headings(steep: Array) -> list[float]:
    """Angles [rad], modulo a right angle, along which points lie in rows, the sharpest first."""
    angles = np.radians(np.arange(0.0, 90.0, _LEAF.turn_deg))
    sharp = _in_step(steep, np.cos(angles), np.sin(angles), _LEAF.row_m)
    out: list[int] = []
    for i in np.argsort(-sharp):
        if all(min(abs(i - j), len(angles) - abs(i - j)) > _LEAF.apart_deg / _LEAF.turn_deg for j in out):
            out.append(int(i))
    return [float(angles[i]) for i in out[: _LEAF.headings]]


@compiled_later
def _in_step(points, c, s, row_m):  # type: ignore
    """(n,) the sum of squared counts of rows of points along two axes that are turned by angles of cosines `c` (n,)."""
    out = np.zeros(len(c))
    row = np.empty(len(points))
    for k in range(len(c)):
        for axis in range(2):
            x, y = (c[k], s[k]) if axis == 0 else (-s[k], c[k])
            for i in range(len(points)):
                row[i] = x * points[i, 0] + y * points[i, 1]
            low = row.min()
            counts = np.zeros(int((row.max() - low) / row_m) + 1)
            for i in range(len(points)):
                counts[int((row[i] - low) / row_m)] += 1.0
            for count in counts:
                out[k] += count * count
    return out


def _steep(points: Array) -> NDArray[np.bool_]:
    """(n,) bool: points that are not on level faces."""
    k = np.floor((points[:, 2] - points[:, 2].min()) / _LEAF.row_m).astype(int)
    counts = np.bincount(k)
    return np.asarray(counts[k] < max(_LEAF.level * np.median(counts[counts > 0]), _LEAF.least_points / 4))


def _explained(
    points: Array, steep: NDArray[np.bool_], eye: Array, out: Array, most: float
) -> tuple[float, OpenLeaf | None]:
    """Points explained by a body facing `out` with its open part (0 if surely not more than `most`), and that part.

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
    if front is None or matmul(eye, out) < front + _LEAF.beside_m or front - percentile(suz[:, 0], 1) < _LEAF.deep_m:
        return 0.0, None
    of_body = suz[:, 0] <= front + _LEAF.before_m
    body, ahead = suz[of_body], suz[~of_body]
    explained = float(_in_rows(suz[of_body & steep]))
    if explained + len(ahead) <= most:
        return 0.0, None
    ahead = main_cluster(ahead) if len(ahead) >= _LEAF.least_points else ahead[:0]
    if len(ahead) < _LEAF.least_points or percentile(ahead[:, 0], 98) - front < _LEAF.reach_m:
        return _LEAF.dull * explained, None
    box = percentile(body, [1, 99])
    ways = [
        _drawer(ahead, front, box),
        *(hinged(ahead, front, box, k) for k in (1, 2) if _thickness(ahead, k) < _LEAF.thin_m),
    ]
    able = [way for way in ways if way is not None]
    if not able:
        return _LEAF.dull * explained, None
    door, share = max(able, key=lambda way: way[1])
    deeper, solid = _opening(door, body, front) if door.kind == "hinge" else (0, 0)
    if solid > deeper:
        return _LEAF.dull * explained, None
    R = np.stack([out, across, _Z], axis=1)
    T = np.eye(4)
    T[:3, :3] = R
    solids = tuple(s.moved(T) for s in door.solids)
    origin, axis = matmul(R, door.origin), matmul(R, door.axis)
    door = Door(door.name, door.kind, origin, axis, door.position, door.limit, None, solids)
    return explained + share * len(ahead), OpenLeaf(door, out, front)


def _opening(door: Door, body: Array, front: float) -> tuple[int, int]:
    """How many points are behind the closed place of a hinged door, and how many are in it, in (s, u, z)."""
    R = Rotation.from_rotvec(-door.axis * door.position).as_matrix()
    shut = matmul(kin.transform(R, door.origin - matmul(R, door.origin)), door.solids[0].T)
    half = door.solids[0].half_m
    local = np.abs(matmul(body - shut[:3, 3], shut[:3, :3]))
    behind = body[(local[:, 0] < _LEAF.inner * half[0]) & (local[:, 2] < _LEAF.inner * half[2])]
    deeper = int((behind[:, 0] < front - _LEAF.before_m).sum())
    return deeper, len(behind) - deeper


def _in_rows(body: Array) -> int:
    """How many points are in the fullest rows along the first two axes."""
    own = np.zeros(len(body), bool)
    if not len(body):
        return 0
    for axis in (0, 1):
        k = np.floor((body[:, axis] - body[:, axis].min()) / _LEAF.row_m).astype(int)
        own |= np.isin(k, np.argsort(-np.bincount(k))[: _LEAF.rows])
    return int(own.sum())


def front_of(suz: Array) -> float | None:
    """Where the body ends, along the first axis."""
    k = np.floor(suz[:, 0] / _LEAF.slice_m).astype(int)
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
    last = int(np.flatnonzero(areas >= _LEAF.body * areas.max()).max())
    # Bars of what is closed reach out, too, and lie far apart: the face that they stand on has many times their points.
    near = [_fullest(suz[(k - first >= last - back) & (k - first <= last + 1), 0]) for back in (1, _LEAF.bars)]
    return near[1][0] if near[1][1] > _LEAF.face * near[0][1] else near[0][0]


def _span(values: Array) -> float:
    """From the 3rd to the 97th percentile."""
    low, high = percentile(values, [3, 97])
    return float(high - low)


def _fullest(values: Array) -> tuple[float, int]:
    """The value that most are near to, and how many."""
    counts, edges = np.histogram(values, np.arange(values.min(), values.max() + 0.01, 0.005))
    return float(edges[int(counts.argmax())] + 0.0025), int(counts.max())


def _thickness(ahead: Array, axis: int) -> float:
    """How thick slices are along an axis, the median."""
    k = np.floor(ahead[:, 0] / _LEAF.slice_m).astype(int)
    spans = [np.ptp(percentile(own[:, axis], [5, 95])) for i in np.unique(k) if len(own := ahead[k == i]) >= 8]
    return float(np.median(spans)) if spans else 0.0


def hinged(ahead: Array, front: float, body: Array, k: int) -> tuple[Door, float] | None:
    """A sheet on a hinge at the front; `k` is its thin axis. In (s, u, z)."""
    rng = np.random.default_rng(0)
    flat = ahead[:, [0, k]]
    normal, at = _sheet(flat, rng.integers(len(flat), size=(150, 2)), _LEAF.sheet_m / 2)
    own = np.abs(matmul(flat, normal) - at) < _LEAF.sheet_m
    share = float(own.mean())
    if share < _LEAF.on_sheet or abs(normal[1]) < 0.05:
        return None
    middle, (_, (t, _)) = flat[own].mean(0), principal_axes(flat[own])
    t = t * np.sign(t[0])  # from the hinge to the free edge
    if t[0] < 0.1:
        return None
    hinge = middle + t * (front - middle[0]) / t[0]
    width = float(percentile(matmul(flat[own] - hinge, t), 99))
    low, high = body[:, k]
    inward = 1.0 if hinge[1] + width - high < low - (hinge[1] - width) else -1.0
    angle = float(np.arctan2(t[0], inward * t[1]))
    if not _LEAF.least_rad < angle < (_LEAF.most_rad if k == 1 else _LEAF.most_flap_rad):
        return None
    other = 3 - k
    span = percentile(ahead[own][:, other], [1, 99])
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
    half = np.array([width, PART.panel_m, float(np.ptp(span))]) / 2
    limit = max(PART.upright_rad if k == 1 else PART.flap_rad, angle)
    return Door("leaf", "hinge", origin, axis, angle, limit, None, (Solid("box", half, T),)), share


@compiled_later
def _sheet(points, pairs, off_m):  # type: ignore
    """Normal (2,) and distance of the line through a pair of points (n, 2) that most of them are near to."""
    best, normal, at = 0, np.zeros(2), 0.0
    for a, b in pairs:
        x, y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        length = math.sqrt(x * x + y * y)
        if length < 0.05:
            continue
        u, v, near = -y / length, x / length, 0
        for k in range(points.shape[0]):
            near += abs((points[k, 0] - points[a, 0]) * u + (points[k, 1] - points[a, 1]) * v) < off_m
        if near > best:
            best, normal[0], normal[1], at = near, u, v, points[a, 0] * u + points[a, 1] * v
    return normal, at


def _drawer(ahead: Array, front: float, body: Array) -> tuple[Door, float] | None:
    """What is drawn out of a front, in (s, u, z), and the share of points on its faces."""
    k = np.floor(ahead[:, 0] / _LEAF.slice_m).astype(int)
    areas = {
        i: _span(own[:, 1]) * _span(own[:, 2])
        for i in np.unique(k) if len(own := ahead[(k == i) | (k == i + 1)]) >= FEWEST
    }  # fmt: skip
    most = max(areas.values(), default=0.0)
    last = max((i for i, area in areas.items() if area > 0.6 * most), default=int(k.max()))
    own = ahead[(k >= last) & (k <= last + 1)]
    face = float(np.median(own[:, 0]))
    low, high = percentile(own[:, 1:], [2, 98])
    T = np.eye(4)
    T[:3, 3] = [face - PART.panel_m / 2, *((low + high) / 2)]
    half = np.array([PART.panel_m, *(high - low)]) / 2
    drawn = face - front
    if not _LEAF.reach_m / 2 < drawn < _LEAF.farthest_m or high[1] - low[1] > _LEAF.as_tall * np.ptp(body[:, 2]):
        return None
    off = [np.abs(ahead[:, 0] - face), *np.abs(ahead[:, 1:] - low).T, *np.abs(ahead[:, 1:] - high).T]
    share = _LEAF.rarer * float((np.min(off, axis=0) < _LEAF.sheet_m).mean())
    solids = (Solid("box", half, T),)
    out = np.array([1.0, 0.0, 0.0])
    return Door("leaf", "slide", T[:3, 3].copy(), out, drawn, max(PART.slide_m, drawn), None, solids), share
