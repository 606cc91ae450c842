"""Lids on top of boxes, as they show from outside: a level face with a bar before one edge, or a sheet that stands up.

Lids hang on the edge across from their bar. One that lies is told by that bar; one that stands open by what rises above
the body from one of its edges, whether its bar is seen or not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.shapes.moving_parts import PART, Door
from mpvi_bt.finding.shapes.open_leaves import FEWEST, front_of, hinged
from mpvi_bt.finding.shapes.outlines import main_cluster, outline, thinned, trimmed
from mpvi_bt.finding.shapes.shape import SeenBar
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Surroundings


@dataclass(frozen=True)
class LidParameters:
    """How a lid is found.

    Our choice, by the boxes and laptops of the simulated houses: a lid is a sheet of about the size of what it closes.
    """

    bar_radius_m: float = 0.007  # radius of the bar that it is held by [m]
    sampled: int = 3000  # points that are enough to find an open lid
    slice_m: float = 0.012  # width of a slice of a lid, and of a cell across it [m]; slanted points are no sparser
    full: float = 0.5  # least filled cells of a lid's slice [ratio of the usual slice]; before its bar there is a gap
    off_m: tuple[float, float] = (0.022, 0.08)  # least and largest standoff of a bar from the lid's edge [m]
    long: tuple[float, float] = (0.15, 0.97)  # least and largest length of a bar [ratio of the lid's width]
    off_middle: float = 0.15  # largest offset of a bar from the lid's middle [ratio of the lid's width]
    bar_points: int = 6  # fewer points make no bar
    least_m: float = 0.06  # least size of a lid, and least height of its container [m]
    level_m: float = 0.010  # distance from the face of a level lid to its points [m]
    bar_below_m: float = 0.03  # distance from that face down to points of its bar [m]
    before_m: float = 0.03  # points this far above the rim are not of the body [m]
    own_m: float = 0.02  # points this close to a lid's solids are its own [m]
    above: float = 0.03  # largest share of a thing's points above a closed lid [ratio]
    lowest_m: float = 0.015  # least height of the body below an open lid, such as that of a laptop [m]
    at_edge_m: float = 0.06  # largest distance of the hinge from an edge of the body [m]
    as_deep: tuple[float, float] = (0.6, 1.5)  # least and largest depth of a lid [ratio of the body's]
    as_wide: float = 0.6  # least width of a lid [ratio of the body's]


_LID = LidParameters()
_Z = np.array([0.0, 0.0, 1.0])


def lid(points: Array, eye: Array) -> Door | None:
    """The lid of a thing that is no furniture, closed or open.

    Args:
        points: (n, 3) of it, in the world [m].
        eye: (3,) where they were seen from.

    Returns:
        None if none shows.
    """
    points = thinned(main_cluster(points))
    return _best(_lying(points)) if (up := raised(points, eye)) is None else up


def raised(points: Array, eye: Array) -> Door | None:
    """As `lid`, for an open lid, from thinned points of one cluster."""
    if len(points) < FEWEST:
        return None
    if len(points) > _LID.sampled:
        points = points[np.random.default_rng(0).choice(len(points), _LID.sampled, replace=False)]
    return _best(_standing(points, eye, outline(trimmed(points[:, :2])).heading))


def without_lid(points: Array, door: Door) -> Array:
    """Points (n, 3) of a thing, without those on its open lid and on the bar of the lid."""
    return points[Surroundings(door.solids).distance(points) > _LID.own_m]


def _best(found: Iterable[tuple[Door, float]]) -> Door | None:
    return max(found, key=lambda f: f[1], default=(None, 0.0))[0]


def _standing(points: Array, eye: Array, yaw: float) -> Iterator[tuple[Door, float]]:
    """Lids that are open, with how many points are on them; the body's sides are at an angle `yaw` [rad]."""
    for axis in (np.array([np.cos(a), np.sin(a), 0.0]) for a in (yaw, yaw + np.pi / 2)):
        rising = matmul(points, np.stack([_Z, axis, np.cross(_Z, axis)], axis=1))
        if (rim := front_of(rising)) is None:
            continue
        of_body = rising[:, 0] < rim + _LID.before_m
        body, above = rising[of_body], main_cluster(rising[~of_body])
        if min(len(body), len(above)) < FEWEST:
            continue
        box = percentile(body, [2, 98])
        if rim - box[0, 0] < _LID.lowest_m or (way := hinged(above, rim, box, 1)) is None:
            continue
        sheet, share = way
        inward = -float(sheet.axis[2])  # 1 where the closed lid lies along `axis` from its hinge, else -1
        R = np.stack([inward * axis, np.cross(_Z, inward * axis), _Z], axis=1)
        hinge = np.array([inward * sheet.origin[1], inward * sheet.origin[2], rim])
        opened = _about_hinge(sheet.position)
        if matmul(matmul(eye, R) - hinge, opened[:, 2]) > 0:  # its outer face is seen
            hinge = hinge - PART.panel_m * opened[:, 2]
        flat = matmul(matmul(points, R) - hinge, opened)  # as if it were closed
        near = flat[(np.abs(flat[:, 2]) < _LID.bar_below_m) & (flat[:, 0] > _LID.before_m)]
        edge, bar = _edge(near, near)
        size = np.array([edge, float(np.ptp(percentile(near[:, 1], [1, 99])))])
        deep, wide = np.ptp(box, axis=0)[1:]
        back = box[0, 1] if inward > 0 else -box[1, 1]
        as_deep = _LID.as_deep[0] * deep < edge < _LID.as_deep[1] * deep
        if as_deep and size[1] > _LID.as_wide * wide and abs(hinge[0] - back) < _LID.at_edge_m:
            at = None if bar is None else np.append(bar[0], hinge + matmul(opened, bar[1:]))
            yield _door(R, hinge, size, sheet.position, at), share * len(above)


def _lying(points: Array) -> Iterator[tuple[Door, float]]:
    """Lids that are closed, by their bars, with how many points are on them."""
    if len(points) < FEWEST:
        return
    counts, edges = np.histogram(points[:, 2], np.arange(points[:, 2].min(), points[:, 2].max() + 0.01, 0.005))
    k = int(counts.argmax())
    top = float(np.median(points[np.abs(points[:, 2] - edges[k] - 0.0025) < 0.005, 2]))
    bottom = float(percentile(points[:, 2], 1))
    if top - bottom < _LID.least_m or (points[:, 2] > top + _LID.bar_below_m).mean() > _LID.above:
        return
    yaw = outline(trimmed(points[np.abs(points[:, 2] - top) < _LID.level_m, :2])).heading
    for free in (np.array([np.cos(a), np.sin(a), 0.0]) for a in yaw + np.arange(4) * np.pi / 2):
        across = np.cross(_Z, free)
        local = matmul(points, np.stack([free, across, _Z], axis=1)) - [0.0, 0.0, top]
        near = local[(local[:, 2] > -_LID.bar_below_m) & (local[:, 2] < _LID.level_m)]
        face = near[near[:, 2] > -_LID.level_m]
        edge, bar = _edge(face, near)
        if bar is None:
            continue
        face = face[face[:, 0] < edge]
        low, high = percentile(face, [1, 99])
        size = np.array([edge - low[0], high[1] - low[1]])
        if size.min() < _LID.least_m:
            continue
        hinge = np.array([low[0], (low[1] + high[1]) / 2, top - PART.panel_m])
        R = np.stack([free, across, _Z], axis=1)
        bar = bar + [0.0, 0.0, 0.0, top]
        yield _door(R, hinge, size, 0.0, bar), float(len(face))


def _edge(face: Array, near: Array) -> tuple[float, Array | None]:
    """End of a lid along the first axis, and length and middle (4,) of the bar before the end, if one is seen.

    Args:
        face: (n, 3) points of the lid, along it from the hinge, across and out of it [m].
        near: (m, 3) of it and what is about as high.
    """
    if len(face) < FEWEST:
        return 0.0, None
    start = float(percentile(face[:, 0], 1))
    k, cell = ((near[:, 0] - start) / _LID.slice_m).astype(int), np.floor(near[:, 1] / _LID.slice_m).astype(int)
    filled = np.array([len(np.unique(cell[k == i])) for i in range(max(int(k.max()) + 1, 1))])
    full = np.flatnonzero(filled > _LID.full * percentile(filled[filled > 0], 75))
    gaps = np.flatnonzero(np.diff(full) > 1)
    last = int(full[gaps[-1]] if len(gaps) else full[-1])
    edge = start + (last + 1) * _LID.slice_m
    beyond = near[near[:, 0] > edge + _LID.slice_m]
    if len(beyond) < _LID.bar_points or len(gaps) > 1:  # with more gaps the face is too sparse to tell
        return edge, None
    reach = float(percentile(beyond[:, 0], 95))
    outer = beyond[beyond[:, 0] > reach - 2 * _LID.bar_radius_m]
    low, high = percentile(outer, [3, 97])
    sides, long = percentile(face[:, 1], [1, 99]), float(high[1] - low[1])
    if not (_LID.off_m[0] < reach - edge < _LID.off_m[1] and _LID.long[0] < long / float(np.ptp(sides)) < _LID.long[1]):
        return edge, None
    if abs(float(low[1] + high[1] - sides.sum())) / 2 > _LID.off_middle * float(np.ptp(sides)):
        return edge, None
    return edge, np.array([long, reach - _LID.bar_radius_m, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2])


def _about_hinge(angle: float) -> Array:
    """(3, 3) the axes of a lid that is open by an angle [rad], in those of the closed one."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _door(R: Array, hinge: Array, size: Array, angle: float, bar: Array | None) -> Door:
    """A lid from where it hangs.

    Args:
        R: (3, 3) axes as columns: from the hinge to the free edge where it is closed, along the hinge, and up.
        hinge: (3,) its middle, along these.
        size: (2,) from the hinge to the free edge, and along the hinge [m].
        angle: How far it is open [rad].
        bar: (4,) its length and, along these axes, its middle, where it is now; None if it is not seen.
    """
    turned = matmul(R, _about_hinge(angle))
    origin = matmul(R, hinge)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turned, origin + matmul(turned, [size[0] / 2, 0.0, PART.panel_m / 2])
    solids = [Solid("box", np.array([*size, PART.panel_m]) / 2, T)]
    seen = None
    if bar is not None:
        seen = SeenBar(matmul(R, bar[1:]), R[:, 1].copy(), turned[:, 0].copy(), float(bar[0]))
        T_bar = np.eye(4)
        T_bar[:3, :3], T_bar[:3, 3] = np.stack([turned[:, 2], turned[:, 0], R[:, 1]], axis=1), seen.center
        solids.append(Solid("cylinder", np.array([_LID.bar_radius_m, _LID.bar_radius_m, seen.length_m / 2]), T_bar))
    return Door("lid", "hinge", origin, -R[:, 1], angle, max(PART.upright_rad, angle), seen, tuple(solids))
