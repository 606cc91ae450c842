"""Where a held thing would have room: on boards inside a container, on the floor, beside and under other things."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import normalize
from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.finding.shapes.from_above import disc, outline
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.next_to import NEXT_TO_GAP
from mpvi_bt.ground.geometry.next_to import beside as in_line
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.collision import Obstacles, Surroundings
from mpvi_bt.hands.motion.work import EASY_M, NEAR_M, Work
from mpvi_bt.hands.skills.placing import LIES_RAD, TURNS, Pose, leaning, poses

_FLOORS = ("floor", "ground")


@dataclass(frozen=True)
class Clearances:
    """Free room around a payload where it is set down, and its support.

    Our choice, by errors of arms and of boxes about things.
    """

    clear_m: float = 0.03  # clearance of the payload from other things on a surface [m]
    tight_m: float = 0.008  # clearance where there is no more room, such as on a saucer [m]
    floor_m: float = 0.01  # clearance from things on the floor, beside the payload or below the same table [m]
    headroom_m: float = 0.35  # free height above a spot for the payload and the hand [m]
    above_m: float = 0.03  # free height above the payload, where there is no more [m]
    arm_m: float = 0.6  # free height above a payload beside another thing, for the arm that brings it [m]
    levels: int = 4  # heights of the payload that are checked
    feet: float = 0.6  # radius of the ring that has to be supported [ratio of the payload's radius]
    below_m: float = 0.008  # depth below the underside at which support is looked for [m]
    borne_m: float = 0.012  # largest distance to that support [m]
    sunk_m: float = 0.012  # depth below the underside at which support of the outline is looked for [m]
    out_m: float = 0.005  # largest distance to that support, so the largest overhang over an edge [m]


_CLEAR = Clearances()


@dataclass(frozen=True)
class SpotGrid:
    """Which spots are searched.

    Our choice: as fine as a search can afford; each of them costs a search for a stance.
    """

    grid_m: float = 0.06  # distance between spots [m]; on the floor twice that
    spots: int = 4  # spots that are tried of one lean and one headroom
    sectors: int = 12  # directions around a thing for the spots of a payload and for its width
    level_m: float = 0.02  # faces that differ in height by less are one board [m]
    floor_m: tuple[float, float] = (0.45, 0.9)  # nearest and farthest spot on the floor from the base's middle [m]
    best_m: float = 0.6  # most comfortable distance of such a spot [m]
    behind: float = 0.3  # a spot behind the robot counts as twice this farther off [m]
    legs_m: float = 0.03  # radius around a spot below a thing that has to be below it, too [m]; table legs are outside


_GRID = SpotGrid()


@dataclass(frozen=True)
class NextTo:
    """How close to a thing a payload is set down that is to be next to it."""

    touch_m: float = 0.005  # clearance of the payload from the thing [m]; our choice
    gaps_m: tuple[float, ...] = (0.006, 0.012, 0.02, 0.03)  # larger clearances that still count [m]; our choice
    best_m: float = 0.012  # the best of these [m]; our choice
    gap_cost: float = 2.0  # cost of each meter off the best; our choice
    outward: float = 1.0  # cost of each meter of reach away from the thing; a long payload lies along it; our choice
    step_m: float = 0.004  # distance between two places that are checked on the way out [m]; our choice
    beyond_m: float = 0.08  # the way out ends this far beyond touching circles about the two [m]; our choice
    sure: float = 0.75  # part of the gap at which goals still call two things next to each other [ratio]; our choice
    before_m: float = 0.6  # distance from which a thing is taken [m]; our choice


_NEXT_TO = NextTo()
_HERE = np.zeros((1, 3))


def size(solids: Sequence[Solid]) -> tuple[Array, float]:
    """(2, 3) axis-aligned box of solids, and how far they reach sideways from its middle [m]."""
    return bounds(solids), disc(solids)[1]


def on(work: Work, held: Held, surface: str, leans: Sequence[float], inside: bool = False) -> Iterator[list[Pose]]:
    """Poses on a thing's upper faces, one group a spot; `inside`: only in its container volumes.

    Faces with nothing of the thing above them come first, as BEHAVIOR wants it of what lies on top: of a shelf its
    uppermost board. Then those at a comfortable height, and what has room above; inside, the back before the front,
    where things would bar the way to it.
    """
    near = work.motion.felt.base_pose[:2]
    frame = kin.inverse(held.T_tcp_thing)
    for part in ([a for a in leans if abs(a) < LIES_RAD], [a for a in leans if abs(a) >= LIES_RAD]):
        able = [(lean, R) for lean in part if (R := leaning(work, held, lean)) is not None]
        if not able:
            continue
        R = able[0][1]
        box, radius = size([s.moved(matmul(kin.transform(R, (0.0, 0.0, 0.0)), frame)) for s in held.solids])
        done: list[Array] = []
        for headroom in (_CLEAR.headroom_m, float(np.ptp(box, axis=0)[2]) + _CLEAR.above_m):
            for clear in (_CLEAR.clear_m, _CLEAR.tight_m):
                spots = list(work.scene.spots(surface, radius + clear, headroom, near))
                if inside:
                    spots = [s for s in spots if _within(work.scene.volumes(surface), s + [0, 0, 0.02])]
                    spots = [spots[k] for k in _packed(spots, near, 2 * radius + clear)]
                if spots:
                    break
            own = [] if inside else [s.aabb() for s in work.scene.solids(surface)]
            for spot in _by_turns(spots, own)[: _GRID.spots]:
                if all(norm(spot - d) > _GRID.grid_m for d in done):
                    done.append(spot)
                    yield list(poses(work, held, spot, [lean for lean, _ in able]))
        if not done:
            yield from _lengthwise(work, held, surface, R, [lean for lean, _ in able], inside)


def _lengthwise(
    work: Work, held: Held, surface: str, R: Array, leans: Sequence[float], inside: bool
) -> Iterator[list[Pose]]:
    """Poses for what is long, such as a pen on a notebook, where there is no room for it at every turn.

    It is turned as the surface is, and goes to an end of it before its middle, so that another one has room beside it.

    Args:
        work: Robot and world.
        held: What is set down.
        surface: What on.
        R: (3, 3) how it is turned, but for a turn about the vertical.
        leans: Of its poses [rad].
        inside: Only in its container volumes.
    """
    near = work.motion.felt.base_pose[:2]
    solids = [s.moved(matmul(kin.transform(R, (0.0, 0.0, 0.0)), kin.inverse(held.T_tcp_thing))) for s in held.solids]
    (across, wide, long), board = _narrowest(solids), _narrowest(work.scene.solids(surface))[0]
    turns = [turn + (board - across) % (TURNS[1] - TURNS[0]) for turn in TURNS]
    height = float(np.ptp(bounds(solids), axis=0)[2])
    spots = list(work.scene.spots(surface, wide / 2 + _CLEAR.tight_m, height + _CLEAR.above_m, near))
    if inside:
        spots = [s for s in spots if _within(work.scene.volumes(surface), s + [0, 0, 0.02])]
    if not spots:
        return
    at, top = np.stack(spots), Surroundings(work.scene.solids(surface))
    others = work.scene.obstacles(near, NEAR_M, without=work.carried())
    found: dict[int, list[Pose]] = {}
    for pose in poses(work, held, np.zeros(3), leans, turns):
        able = np.flatnonzero(_borne(held, pose, top, at))
        for k in able[_apart(held, pose, others, at[able])]:
            T = pose.T_world_thing.copy()
            T[:3, 3] += at[k]
            found.setdefault(int(k), []).append(Pose(T, pose.cost))
    some = sorted(found)
    for k in _packed([spots[n] for n in some], near, long + _CLEAR.tight_m)[: _GRID.spots]:
        yield found[some[k]]


def _narrowest(solids: Sequence[Solid]) -> tuple[float, float, float]:
    """Bearing in which what solids cover is narrowest [rad], how wide it is there, and across that [m]."""
    angles = np.radians(np.arange(180.0))
    widths = np.ptp(matmul(outline(solids), np.stack([np.cos(angles), np.sin(angles)])), axis=0)
    k = int(widths.argmin())
    return float(angles[k]), float(widths[k]), float(widths[k - 90])


def on_floor(work: Work, held: Held, leans: Sequence[float]) -> Iterator[list[Pose]]:
    """Poses on the free floor around the robot, the nearest first."""
    here = work.motion.felt.base_pose
    steps = np.arange(-_GRID.floor_m[1], _GRID.floor_m[1] + 1e-9, 2 * _GRID.grid_m)
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    far = norm(grid, axis=1)
    grid = grid[(far > _GRID.floor_m[0]) & (far < _GRID.floor_m[1])]
    ahead = matmul(grid, [np.cos(here[2]), np.sin(here[2])]) / norm(grid, axis=1)
    places = here[:2] + grid[np.argsort(np.abs(norm(grid, axis=1) - _GRID.best_m) + _GRID.behind * (1 - ahead))]
    spots = _bare(work, places, size([s.moved(work.hand(held.side)) for s in held.solids])[1])
    for spot in spots[_room(work, held, spots, _CLEAR.clear_m)]:
        yield list(poses(work, held, spot, leans))


def _bare(work: Work, places: Array, radius_m: float) -> Array:
    """Places (n, 2) as spots (m, 3) on the floor, but for those where something flat was put down."""
    spots = np.column_stack([places, np.zeros(len(places))])
    return spots[~work.scene.covered(spots[:, :2], radius_m)]


def is_floor(phrase: str) -> bool:
    """Whether a phrase names a floor, such as "the corridor floor" or "the floor"."""
    return normalize(phrase).split()[-1:] in [[floor] for floor in _FLOORS]


def floor_around(work: Work, phrase: str, radius_m: float, height_m: float, place: Array) -> list[Array]:
    """Free places (3,) on the floor that a phrase names, those nearest to `place` first: of that room if it names one.

    Args:
        work: Robot and world.
        phrase: Such as "the corridor floor".
        radius_m: Of the free disc.
        height_m: Free above it.
        place: (2,) [m] in the world.
    """
    here = work.motion.felt.base_pose[:2]
    steps = np.arange(-NEAR_M, NEAR_M + 1e-9, 2 * _GRID.grid_m)
    places = here + np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    room = normalize(phrase).rpartition(" ")[0]
    rooms = [e for e in work.scene.knowledge().find(room) if e.kind == "room"] if room else []
    if rooms:
        low, high = np.array([e.lowest[:2] for e in rooms]), np.array([e.highest[:2] for e in rooms])
        within = (places[:, None] > low + radius_m) & (places[:, None] < high - radius_m)
        places = places[within.all(-1).any(1)]
    spots = _bare(work, places, radius_m)
    others = work.scene.obstacles(here, NEAR_M + 2 * radius_m, without=work.carried())
    for z in np.linspace(0.02, max(0.04, height_m), 4):
        spots = spots[others.distance(spots + [0.0, 0.0, z]) > radius_m]
    return sorted(spots, key=lambda spot: float(norm(spot[:2] - place)))


def under(work: Work, held: Held, target: str, leans: Sequence[float], by: str | None = None) -> Iterator[list[Pose]]:
    """Poses on the floor below a thing, nothing of which is below them; `by` another thing there if that is said."""
    if by is not None:
        for group in beside(work, held, by, leans):
            at = np.array([pose.T_world_thing[:2, 3] for pose in group])
            if there := [pose for pose, ok in zip(group, _below(work, held, target, at), strict=True) if ok]:
                yield there
    box, _ = size(work.scene.solids(target))
    here = work.motion.felt.base_pose[:2]
    places = np.stack(np.meshgrid(*[np.arange(a, b, _GRID.grid_m) for a, b in box.T[:2]], indexing="ij"), -1).reshape(
        -1, 2
    )
    spots = np.column_stack([places, np.zeros(len(places))])[_below(work, held, target, places)]
    spots = spots[_room(work, held, spots, _CLEAR.floor_m)]
    for spot in spots[np.argsort(norm(spots[:, :2] - here, axis=1))]:
        yield list(poses(work, held, spot, leans))


def _below(work: Work, held: Held, target: str, places: Array) -> NDArray[np.bool_]:
    """(n,) bool: places (n, 2) on the floor that a thing is above, where what is held fits below it."""
    height = float(np.ptp(size([s.moved(work.hand(held.side)) for s in held.solids])[0], axis=0)[2])
    ring = _GRID.legs_m * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    below = np.zeros(len(places), bool)
    for top in (s for s in work.scene.solids(target) if s.aabb()[0, 2] > height):
        around = (places[:, None] + ring).reshape(-1, 2)
        at = np.column_stack([around, np.full(len(around), top.T[2, 3])])
        below |= (Surroundings([top]).distance(at) <= 0).reshape(-1, 4).all(1)
    return below


def beside(work: Work, held: Held, target: str, leans: Sequence[float]) -> Iterator[list[Pose]]:
    """Poses next to a thing on what it stands on, as near as counts; those on the robot's side of it first.

    Poses that are level with a part of the thing come before all others, as BEHAVIOR's predicate requires: beside a leg
    of a table, not between its legs. Of these, poses that do not stand out over an edge come first, as arms brush such
    payloads off. Before what lies on the thing, such as a book on a bed, room is left to stand and take that.
    """
    near = work.motion.felt.base_pose[:2]
    below = work.scene.obstacles(near, NEAR_M, without={held.name, *work.scene.within(held.name)})
    over: list[list[Pose]] = []
    apart: list[list[Pose]] = []
    groups = _all_beside(work, held, target, leans)
    if kept := _lying_on(work, target):
        groups = iter(sorted(groups, key=lambda group: _bars(group, kept)))
    for group in groups:
        level = [pose for pose in group if _level(work, held, pose, target)]
        if firm := [pose for pose in level if _borne(held, pose, below)[0]]:
            yield firm
        elif level:
            over.append(level)
        else:
            apart.append(group)
    yield from over
    yield from apart


def _lying_on(work: Work, target: str) -> list[Array]:
    """Where on a thing others lie or stand: (2,) each."""
    low, high = bounds(work.scene.body(target))
    middle = (low + high)[2] / 2
    centers = [entry.center for entry in work.scene.knowledge() if entry.name != target]
    return [c[:2] for c in centers if c[2] > middle and (low < c)[:2].all() and (c < high)[:2].all()]


def _bars(group: Sequence[Pose], kept: Sequence[Array]) -> bool:
    """Whether poses are where one would stand to reach one of some places (2,)."""
    at = np.mean([pose.T_world_thing[:2, 3] for pose in group], axis=0)
    return bool(min(norm(at - place) for place in kept) < _NEXT_TO.before_m)


def _borne(held: Held, pose: Pose, below: Obstacles, spots: Array = _HERE) -> NDArray[np.bool_]:
    """(n,) bool: whether there is something below all of a thing's outline in a pose, moved by `spots` (n, 3) [m]."""
    frame = kin.inverse(held.T_tcp_thing)
    solids = [s.moved(matmul(pose.T_world_thing, frame)) for s in held.solids]
    edge, z = outline(solids), float(bounds(solids)[0, 2]) - _CLEAR.sunk_m
    rows = spots[:, None] + np.column_stack([edge, np.full(len(edge), z)])
    return np.asarray((spots[:, 2] + z < 0) | (below.distance(rows) < _CLEAR.out_m).all(1))


def _apart(held: Held, pose: Pose, others: Obstacles, spots: Array) -> NDArray[np.bool_]:
    """(n,) bool: whether its outline then keeps clear of others, at its foot, its middle and its top."""
    frame = kin.inverse(held.T_tcp_thing)
    solids = [s.moved(matmul(pose.T_world_thing, frame)) for s in held.solids]
    edge, (low, high) = outline(solids), bounds(solids)[:, 2]
    levels = np.linspace(low + _CLEAR.sunk_m, max(high, low + _CLEAR.sunk_m), 3)
    rows = np.concatenate([np.column_stack([edge, np.full(len(edge), z)]) for z in levels])
    return np.asarray((others.distance(spots[:, None] + rows) > _CLEAR.tight_m).all(1))


def _level(work: Work, held: Held, pose: Pose, target: str) -> bool:
    frame = kin.inverse(held.T_tcp_thing)
    mine = [s.moved(matmul(pose.T_world_thing, frame)) for s in held.solids]
    theirs = list(work.scene.body(target))
    return in_line(bounds(mine).mean(0), theirs) or in_line(bounds(theirs).mean(0), mine)


def _all_beside(work: Work, held: Held, target: str, leans: Sequence[float]) -> Iterator[list[Pose]]:
    solids = work.scene.body(target)
    theirs, _ = size(solids)
    floor_z = float(theirs[0, 2])
    tall = float(np.ptp(size([s.moved(work.hand(held.side)) for s in held.solids])[0], axis=0)[2])
    feet, reach = size([s for s in solids if s.aabb()[0, 2] < floor_z + tall])  # of a tree its trunk
    middle = feet.mean(0)
    here = work.motion.felt.base_pose[:2]
    bearing = float(np.arctan2(*(here - middle[:2])[::-1]))
    wall = Surroundings(solids)
    frame = kin.inverse(held.T_tcp_thing)
    mine = [s.moved(frame) for s in held.solids]
    upright = list(poses(work, held, np.array([0.0, 0.0, floor_z]), leans))
    parts = {round(float(s.aabb()[:, 2].mean()), 2) for s in solids}
    angles = 2 * np.pi * np.arange(_GRID.sectors) / _GRID.sectors
    for angle in sorted(angles, key=lambda a: abs(float(kin.wrap(a)))):
        away = np.array([np.cos(bearing + angle), np.sin(bearing + angle), 0.0])
        group = []
        for pose in upright:
            T = pose.T_world_thing.copy()
            box, radius = size([s.moved(T) for s in mine])
            edge = outline([s.moved(T) for s in mine])
            outward = _NEXT_TO.outward * float(np.ptp(matmul(edge, away[:2])))
            levels = np.linspace(box[0, 2] + 0.005, min(box[1, 2], theirs[1, 2] + 0.02), 4)
            tops = [z for z in parts if box[1, 2] < z < box[1, 2] + _CLEAR.arm_m]
            levels = np.append(levels, sorted(tops))
            rows = np.concatenate([np.column_stack([edge, np.full(len(edge), z)]) for z in levels])
            at = np.append(middle[:2], 0.0)
            far = np.arange(0.0, reach + radius + _NEXT_TO.beyond_m, _NEXT_TO.step_m)
            gaps = wall.distance(rows + at + far[:, None, None] * away).min(1)
            touching = np.flatnonzero(gaps < _NEXT_TO.touch_m)
            first = int(touching[-1]) + 1 if len(touching) else 0
            for wanted in _NEXT_TO.gaps_m:
                d = float(far[min(first, len(far) - 1)]) + wanted - _NEXT_TO.touch_m
                moved = box + at + away * d
                if _next_to(moved, theirs):
                    shifted = T.copy()
                    shifted[:3, 3] += at + away * d
                    group.append(Pose(shifted, pose.cost + outward + _NEXT_TO.gap_cost * abs(wanted - _NEXT_TO.best_m)))
        spots = np.array([np.append(p.T_world_thing[:2, 3], floor_z) for p in group]).reshape(-1, 3)
        room = _room(work, held, spots, _CLEAR.floor_m, target) if len(spots) else np.zeros(0, bool)
        group = [p for p, free in zip(group, room, strict=True) if free]
        if group:
            yield group


def _next_to(box: Array, other: Array) -> bool:
    """Whether two boxes (2, 3) are near enough for their size, with a margin."""
    gap = np.maximum(0.0, np.maximum(box[0], other[0]) - np.minimum(box[1], other[1]))
    return bool(norm(gap) < _NEXT_TO.sure * NEXT_TO_GAP * np.mean(np.ptp(box, axis=0) + np.ptp(other, axis=0)))


def _room(work: Work, held: Held, spots: Array, clear_m: float, beside: str | None = None) -> NDArray[np.bool_]:
    """(n,) bool: spots (n, 3) that carry the thing and have room for it, upright."""
    if not len(spots):
        return np.zeros(0, bool)
    box, radius = size([s.moved(work.hand(held.side)) for s in held.solids])
    carried = {held.name, *work.scene.within(held.name)}
    near = work.motion.felt.base_pose[:2]
    others = work.scene.obstacles(near, NEAR_M, without=carried, beside=beside)
    below = work.scene.obstacles(near, NEAR_M, without=carried)
    ring = np.array([(np.cos(a), np.sin(a), 0.0) for a in 2 * np.pi * np.arange(_GRID.sectors) / _GRID.sectors])
    heights = np.linspace(clear_m + 0.01, max(clear_m + 0.02, float(np.ptp(box, axis=0)[2])), _CLEAR.levels)
    rings = np.concatenate([radius * share * ring for share in (1.0, 0.5)] + [np.zeros((1, 3))])
    body = (rings[None] + np.array([[0.0, 0.0, z] for z in heights])[:, None]).reshape(-1, 3)
    free = (others.distance(spots[:, None] + body) > clear_m).all(1)
    feet = spots[:, None] + _CLEAR.feet * radius * ring - [0, 0, _CLEAR.below_m]
    return np.asarray(free & ((spots[:, 2] < 0.01) | (below.distance(feet) < _CLEAR.borne_m).all(1)))


def _within(volumes: Sequence[Solid], p: Array) -> bool:
    return any((np.abs(matmul(kin.inverse(v.T)[:3], np.append(p, 1.0))) <= v.half_m).all() for v in volumes)


def _packed(spots: Sequence[Array], near: Array, apart: float) -> list[int]:
    """The order in which to fill spots (3,) of a compartment or a surface from `near` (2,): back and corners first.

    A payload takes up all spots nearer than `apart` [m] to its own; in a corner these are the fewest. Spots that are at
    least `apart` from all before them come first: where one is out of reach, its neighbors mostly are, too. Every
    second spot is the nearest one that is left, in case no arm reaches the back.
    """
    if not spots:
        return []
    at = np.stack(spots)
    bars = (norm(at[:, None] - at, axis=2) < apart).mean(1)
    far = norm(at[:, :2] - near, axis=1)
    ranked = np.argsort(bars - far, kind="stable").tolist()
    first: list[int] = []
    for k in ranked:
        if (norm(at[first] - at[k], axis=1) >= apart).all():
            first.append(k)
    first += [k for k in ranked if k not in first]
    nearest = np.argsort(far, kind="stable").tolist()
    order = [k for pair in zip(first, nearest, strict=True) for k in pair]
    return list(dict.fromkeys(order))


def _by_turns(spots: Sequence[Array], own: Sequence[Array]) -> list[Array]:
    """Spots in their order, but one of each height after the other: first those that none of `own` (2, 3) is above."""
    levels: dict[tuple[bool, int], list[Array]] = {}
    for spot in spots:
        covered = any(
            b[0, 2] > spot[2] + _GRID.level_m and (b[0] < spot)[:2].all() and (spot < b[1])[:2].all() for b in own
        )
        levels.setdefault((covered, round(float(spot[2]) / _GRID.level_m)), []).append(spot)
    ranked = [levels[k] for k in sorted(levels, key=lambda k: (k[0], abs(k[1] * _GRID.level_m - EASY_M)))]
    rounds = range(max(map(len, ranked), default=0))
    return [level[k] for k in rounds for level in ranked if k < len(level)]
