"""From the visible points of one thing to its likely shape: a box, an upright cylinder, a ball, a vessel, furniture.

A camera sees a thing from one side and from above. What it hides is filled in by the simplest solid that explains what
it shows and that stands on what is seen around it. Extents are percentiles and fits, never single points: masks bleed
onto the background, and depth is noisy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.finding.shapes.box_lids import raised, without_lid
from mpvi_bt.finding.shapes.furniture_shape import furniture
from mpvi_bt.finding.shapes.outlines import (
    THIN_M,
    Outline,
    circle,
    main_cluster,
    outline,
    support_height,
    thinned,
    trimmed,
)
from mpvi_bt.finding.shapes.shape import SeenBar, Shape, frame, upright_box
from mpvi_bt.finding.shapes.stand_out import stand_out
from mpvi_bt.finding.shapes.waist import waisted
from mpvi_bt.ground.geometry.linear_algebra import least_squares, matmul, norm
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE


@dataclass(frozen=True)
class FitParameters:
    """Which solid explains the points of a thing.

    Our choice, by the needs of a hand and by the noise of depth from 1 m.
    """

    round: float = 0.88  # least filled part of a round outline's rectangle [ratio]; a disc has 0.79, a rectangle 1
    cornered: float = 0.90  # an outline that fills more of its rectangle is not round [ratio]
    wall_m: float = 0.008  # wall thickness of vessels [m]
    furniture_m: float = 0.55  # a longer thing is furniture: faces to put things on [m]
    upright_m: float = 0.9  # a higher thing is furniture [m]
    tray_m: float = 0.25  # but a thing whose top is this low above the floor may be a wide basket or tray [m]
    covered: float = 0.3  # largest covered part of a vessel's opening at the height of the rim [ratio]
    slice_m: float = 0.01  # height of a slice of a thing, from above [m]
    level_m: float = 0.01  # points this close to the height of a cylinder's support are of that support [m]
    shown: int = 10  # with more such points than this the support is seen through the thing
    within: float = 0.85  # radius within which they count [ratio]; masks are rough, and round things jut out over feet
    staves: int = 16  # boxes in the wall of a round vessel
    least_points: int = 5  # fewer points make no solid
    flat_m: float = 0.002  # largest mean distance of points from a flat side [m]
    hand_m: float = 0.09  # widest thing that a hand goes around [m]


_FIT = FitParameters()


def fit(points: Array, around: Array, eye: Array, support: float | None = None) -> Shape | None:
    """The shape of a thing, from its visible points.

    Args:
        points: (n, 3) of its mask, in the world.
        around: (m, 3) of everything near it but the robot.
        eye: (3,) where the camera was that saw it best.
        support: Height of what it stands on [m], if that is known from another view.

    Returns:
        The shape, or None if there is too little to see.
    """
    points = thinned(main_cluster(points))
    if len(points) < _FIT.least_points:
        return None
    low, top = percentile(points, 1), float(percentile(points[:, 2], 99))
    large = np.ptp(percentile(points, [2, 98])[:, :2], axis=0).max() > _FIT.furniture_m
    if (large and top > _FIT.tray_m) or top - low[2] > _FIT.upright_m:
        return furniture(points)
    if support is None:
        support = support_height(points, around, eye)
    up = raised(points, eye)
    if up is not None and len(body := without_lid(points, up)) >= _FIT.least_points:
        below = _small(body, around, eye, support, large)
        if below is not None and below.kind == "vessel":
            return replace(below, solids=(*below.solids, *up.solids))
    return _small(points, around, eye, support, large)


def _small(points: Array, around: Array, eye: Array, support: float, large: bool) -> Shape | None:
    """As `fit`, without a lid, on a support at this height [m]. A `large` thing is furniture if it is not hollow."""
    top = float(percentile(points[:, 2], 99))
    support = min(support, top - 0.004)
    height = top - support
    upper = points[points[:, 2] > min(support + max(0.004, 0.3 * height), top - 0.003)]
    if len(upper) > 30:
        upper = main_cluster(upper)
    seen = outline(trimmed(upper[:, :2]))
    vessel = _vessel(points, seen, support, top) if eye[2] > top + 0.04 else None
    if vessel is not None:
        return vessel
    if large:
        return furniture(points, support)
    grain = DEPTH_NOISE.grain_m * float(np.median(((points - eye) ** 2).sum(1)))
    parts = stand_out(points, top, grain) if float(seen.sides[0]) > _FIT.hand_m else []
    if parts and not _flat_sided(points[points[:, 2] < top - 0.01, :2], grain):
        round_ = points[~np.any(parts, axis=0)]
        body = _column(round_, outline(trimmed(round_[:, :2])), support, top, grain)
        if body is not None:
            return replace(body, solids=(*body.solids, *(_around(points[part]) for part in parts)))
    ball = _ball(points, float(seen.sides[0]), support, top, grain)
    if ball is not None:
        return ball
    column = _column(points, seen, support, top, grain)
    if column is not None and not _seen_through(column, around, eye):
        return column
    if eye[2] < top + 0.04:  # its top is not in view, so its depth is not either
        return upright_box(_deepened(_cornered(trimmed(upper[:, :2])), eye[:2]), support, top)
    return waisted(trimmed(upper[:, :2]), seen, support, top)


def _around(points: Array) -> Solid:
    """The upright box around points (n, 3)."""
    low, high = percentile(points[:, 2], [2, 98])
    (box,) = upright_box(outline(points[:, :2]), float(low), float(high)).solids
    return box


def _flat_sided(xy: Array, grain: float) -> bool:
    """Whether points (n, 2) of the side of a thing lie along the edges of a rectangle."""
    seen = _cornered(trimmed(xy))
    off = np.abs(seen.sides / 2 - np.abs(seen.local(xy))).min(1)
    return float(off.mean()) < _FIT.flat_m + grain


def _cornered(xy: Array) -> Outline:
    """The rectangle whose edges points (n, 2) of its sides are nearest to.

    Two sides make a triangle, around which other rectangles are as small.
    """
    best, found = np.inf, outline(xy)
    for heading in np.arange(0, np.pi / 2, np.pi / 90):
        c, s = np.cos(heading), np.sin(heading)
        local = matmul(xy, np.array([[c, -s], [s, c]]))
        low, high = local.min(0), local.max(0)
        off = float(np.minimum(np.minimum(local - low, high - local).min(1), 0.01).mean())
        if off < best:
            best, (a, b), middle = off, high - low, matmul((high + low) / 2, np.array([[c, s], [-s, c]]))
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
    if matmul(inward, seen.middle - eye) < 0:
        inward = -inward
    middle = seen.middle + inward * (depth - short) / 2
    sides, heading = np.array([long, depth]), seen.heading
    if depth > long:
        sides, heading = sides[::-1], heading + np.pi / 2
    return Outline(middle, sides, heading, 1.0)


def _ball(points: Array, width: float, support: float, top: float, grain: float) -> Shape | None:
    """The far half of a ball is unseen: its outline would be too small and too near."""
    if len(points) < 12:
        return None
    A = np.c_[2 * points, np.ones(len(points))]
    s = least_squares(A, (points**2).sum(1))
    radius = float(np.sqrt(max(s[3] + matmul(s[:3], s[:3]), 1e-8)))
    off = norm(points - s[:3], axis=1) - radius
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
    whole = seen.fill < _FIT.round and long - short < max(0.003, 0.06 * long)
    side = points[(points[:, 2] > support + 0.15 * height) & (points[:, 2] < top - max(0.4 * height, 0.008)), :2]
    bent = False
    if seen.fill < _FIT.cornered and height > 0.03 and len(side) >= 16:
        m, r, noise = circle(side)
        bend = np.arctan2(*(side - m).T[::-1])
        turn = np.angle(np.exp(1j * (bend - np.angle(np.exp(1j * bend).mean()))))
        arc = float(np.ptp(percentile(turn, [3, 97])))
        doubt = 4 * noise / (1 - float(np.cos(arc / 2)) + 1e-6) / float(np.sqrt(len(side)))  # of the radius
        bent = (
            noise < max(0.002, 0.04 * r) + grain and doubt < 0.004 and 0.008 < r < min(0.25, 0.8 * float(long) + 0.004)
        )
        if bent:
            middle, radius = m, r
    if not (whole or bent) and not (seen.fill < _FIT.round and long - short < max(0.012, 0.15 * long)):
        return None
    T = frame(middle, 0.0, support, top)
    return Shape("cylinder", T, (Solid("cylinder", np.array([radius, radius, height / 2]), T),), support)


def _seen_through(column: Shape, around: Array, eye: Array) -> bool:
    """Whether what an upright cylinder would stand on is seen through it (m, 3), as behind the cut of half a pie."""
    (solid,), middle = column.solids, column.T[:3, 3]
    level = around[np.abs(around[:, 2] - column.support_m) < _FIT.level_m]
    halfway = level + (eye - level) * ((middle[2] - level[:, 2]) / (eye[2] - level[:, 2]))[:, None]
    off = np.maximum(*(norm((p - middle)[:, :2], axis=1) for p in (level, halfway)))
    return int((off < _FIT.within * solid.half_m[0]).sum()) > _FIT.shown


def _vessel(points: Array, seen: Outline, support: float, top: float) -> Shape | None:
    """A hollow shape that is open above: walls around an opening with a view of the inside."""
    rim, bar = _rim(points, seen, support, top)
    if seen.sides[1] < 0.045 or rim - support < 0.025:
        return None
    edge = points[(points[:, 2] > rim - min(0.02, 0.3 * (rim - support))) & (points[:, 2] < rim + 0.006), :2]
    if len(edge) < 12:
        return None
    around = outline(trimmed(edge))
    below = points[(points[:, 2] > support + 0.4 * (rim - support)) & (points[:, 2] < rim + 0.006), :2]
    if ((wide := outline(trimmed(below))).sides - around.sides).max() > _FIT.wall_m * 3:
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
    lid = below_rim | (bar is None)  # what is higher, and no bar to carry it by, lies over the opening, too
    covered = int((~low & lid & (off < 0.5)).sum())
    opening = float(np.prod(around.sides / 2)) / THIN_M**2  # points that would cover the middle of it
    most = min(0.04 * len(points), _FIT.covered * opening) + 2
    if int((low & (inward > 0.6 * _FIT.wall_m)).sum()) < 8 or covered > most:
        return None
    bottom = points[(off < 0.6) & (points[:, 2] < rim + 0.006), 2]
    floor = support + _FIT.wall_m
    if len(bottom) > 12:
        floor = float(np.clip(percentile(bottom, 10), floor, rim - 0.01))
        floor = floor if floor < support + 0.35 * (rim - support) else support + _FIT.wall_m
    bars = () if bar is None else (bar,)
    if round_:
        return _round_vessel(middle, radius, support, floor, rim, bars)
    return _square_vessel(around, support, floor, rim, bars)


def _rim(points: Array, seen: Outline, support: float, top: float) -> tuple[float, SeenBar | None]:
    """Height of a vessel's rim, and the bar that spans it higher up, if there is one."""
    edges = np.arange(top + 0.002, support + 0.02, -_FIT.slice_m)
    levels = [points[(points[:, 2] <= high) & (points[:, 2] > high - 2 * _FIT.slice_m), :2] for high in edges]
    enough = max(8.0, 0.3 * float(np.median([len(level) for level in levels] or [0])))
    rim = top
    for high, level in zip(edges, levels, strict=True):
        if len(level) > enough:
            across = percentile(seen.local(level), [3, 97])
            if (np.ptp(across, axis=0) > 0.6 * seen.sides).all():
                rim = min(float(high), top)
                near = points[(points[:, 2] <= rim) & (points[:, 2] > rim - 2 * _FIT.slice_m), 2]
                counts, bins = np.histogram(near, np.arange(rim - 2 * _FIT.slice_m, rim + 0.004, 0.004))
                rim = min(rim, float(bins[np.flatnonzero(counts > 0.3 * counts.max())[-1] + 1]))
                break
    if top - rim < 0.025:
        return top, None
    above = points[points[:, 2] > max(top - 0.03, rim + 0.015)]
    if len(above) < 8:
        return rim, None
    bar = outline(above[:, :2])
    if bar.sides[1] > 0.045 or bar.sides[0] < 0.05 or norm(bar.middle - seen.middle) > 0.5 * seen.sides[1]:
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
    T = frame(around.middle, around.heading, support, rim)
    half = (rim - support) / 2
    solids = [Solid("box", np.array([x / 2, y / 2, (floor - support) / 2]), matmul(T, pose((0, 0, (floor - rim) / 2))))]
    for sign in (-1, 1):
        side = pose((sign * (x - _FIT.wall_m) / 2, 0, 0))
        solids.append(Solid("box", np.array([_FIT.wall_m / 2, y / 2, half]), matmul(T, side)))
        side = pose((0, sign * (y - _FIT.wall_m) / 2, 0))
        solids.append(Solid("box", np.array([x / 2 - _FIT.wall_m, _FIT.wall_m / 2, half]), matmul(T, side)))
    inside = np.array([x / 2 - _FIT.wall_m, y / 2 - _FIT.wall_m, (rim - floor) / 2])
    volume = Solid("box", inside, matmul(T, pose((0, 0, half - (rim - floor) / 2))))
    return Shape("vessel", T, (*solids, *_bar_solids(bars, rim)), support, (volume,), bars)


def _round_vessel(
    middle: Array, radius: float, support: float, floor: float, rim: float, bars: tuple[SeenBar, ...]
) -> Shape:
    """`radius` is that of the middle of its wall."""
    T = frame(middle, 0.0, support, rim)
    half = (rim - support) / 2
    bottom = matmul(T, pose((0, 0, (floor - rim) / 2)))
    solids = [Solid("cylinder", np.array([radius, radius, (floor - support) / 2]), bottom)]
    stave = (radius + _FIT.wall_m / 2) * float(np.tan(np.pi / _FIT.staves))
    for angle in np.arange(_FIT.staves) * (2 * np.pi / _FIT.staves):
        at = pose((radius * np.cos(angle), radius * np.sin(angle), 0), float(angle))
        solids.append(Solid("box", np.array([_FIT.wall_m / 2, stave, half]), matmul(T, at)))
    inner, deep = radius - _FIT.wall_m / 2, (rim - floor) / 2
    volume = Solid("cylinder", np.array([inner, inner, deep]), matmul(T, pose((0, 0, half - deep))))
    return Shape("vessel", T, (*solids, *_bar_solids(bars, rim)), support, (volume,), bars)
