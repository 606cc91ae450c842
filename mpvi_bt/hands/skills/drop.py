"""Let a held thing fall into what is open above: a bin, a basket, a sink, a drawer, or what the other hand holds."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.finding.shapes.from_above import outline
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.arms import posture_distance
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side, other
from mpvi_bt.hands.motion.approach import close_in, lines, take_up
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.hold_out import VESSEL, meet
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.placing import release
from mpvi_bt.hands.stance.stance import Stance, upright_options
from mpvi_bt.hands.stance.stance_search import Search


@dataclass(frozen=True)
class Falling:
    """Releases that let a payload fall into a container."""

    over_rim_m: float = 0.02  # clearance between the lowest point of the payload and the rim [m]; our choice
    over_lid_m: float = 0.03  # clearance over an open lid or other part above the rim, for every hand [m]; our choice
    most_up_m: float = 0.16  # largest height of the release above `over_rim_m` [m]; long falls may turn; our choice
    heights: int = 4  # heights that are tried between the two; our choice
    fall_m: float = 0.008  # least clearance on every side of the falling payload [m]; our choice
    ample_m: float = 0.025  # clearance beyond which more is no better [m]; our choice
    lean: float = 0.9  # least cosine with the vertical of the axis of a container that is open above; our choice
    rim_m: float = 0.03  # a solid covers the opening if its top is at most this far below the rim [m]; our choice
    cover_m: float = 0.6  # and its underside at most this far above the rim [m]; our choice
    staves: float = 0.5  # parts farther out are a round container's own wall [ratio of its radius]; our choice
    tilts_rad: tuple[float, ...] = (0.0, 0.35, -0.35, 0.7)  # tilts of the payload from how it hangs [rad]; our choice
    turns_rad: tuple[float, ...] = tuple(np.arange(-3.0, 3.01, 0.5))  # turns about the vertical [rad]; our choice
    level: float = 0.2  # sine of the approach from vertical; below it, tilts are about the closing axis; our choice
    # offsets from the middle of the opening [ratio of the free room]; our choice
    off: tuple[float, ...] = (0.0, 0.35, -0.35, 0.7, -0.7, 1.0, -1.0)
    releases: int = 80  # releases that are tried with each pose of the container; our choice
    postures: int = 3  # postures of the arm for each release; our choice
    clear_m: float = 0.005  # clearance between the payloads of both hands [m]; our choice
    above_m: float = 0.10  # height above the release at which the hand comes in [m]; our choice
    lower_m_s: float = 0.08  # lowering speed over a container in the other hand [m/s]; our choice


_FALL = Falling()


@dataclass(frozen=True)
class FallCosts:
    """Costs that make one release worse than another.

    Our choice: most of all what might let the payload catch on the rim.
    """

    narrow: float = 10.0  # cost of each meter of clearance below `ample_m`, and of each meter of sideways reach
    tilt: float = 2.0  # cost of each radian of tilt
    turn: float = 0.1  # cost of each radian of turn about the vertical
    off: float = 0.5  # cost of each meter off the middle, and of each meter of rest above the container's bottom
    up: float = 2.0  # cost of each meter of fall


_COST = FallCosts()


def drop_in(
    work: Work, side: Side, container: str, tried: list[Array], anywhere: bool = False
) -> Generator[Array, None, bool]:
    """Let go over a container that stands somewhere.

    Args:
        work, side: Robot and world, and the hand.
        container: What it is to fall into.
        tried: Base poses that are not to be tried again.
        anywhere: Not only from the best places above it, but from all where the hand fits: a lid that stands open
            bars the way to the best ones, or things lie there already.

    Returns:
        Whether that could be tried; nothing has moved if not: it is covered, too narrow, or out of reach from above.

    Raises:
        MotionFailure: "not_released", or a motion's own reason.
    """

    def find(search: Search, here_first: bool) -> Stance | None:
        found = releases(work, work.load(side), side, container, anywhere)
        options = upright_options(_by_turns(found) if anywhere else found[: _FALL.releases], _FALL.above_m, contact=2)
        if anywhere:
            options = list(islice((option for option in options if search.fits(option)), _FALL.releases))
        if not options:
            return None
        focus = np.mean([o.waypoints[1, :2, 3] for o in options], axis=0)
        return search.find(focus, options, here_first)

    for again in (False, True):
        try:
            stance, search = yield from close_in(work, side, {container}, container, find, tried)
        except MotionFailure as failure:
            if failure.reason != "no_stance" or again:
                raise
            return False
        yield from take_up(work, stance, search)
        yield from lines(work, side, stance, [1])
        yield from look_at(work, container)
        if again or _above(work, side, container):
            break
        with suppress(MotionFailure):  # the container was pushed on the way there
            yield from lines(work, side, stance, [0])
    yield from release(work, side)
    with suppress(MotionFailure):  # it has fallen in all the same
        yield from work.rise(side)
    yield from work.see("head")
    return True


def _above(work: Work, side: Side, container: str) -> bool:
    """Whether what a hand holds is over the opening of a container, as far as that is known now."""
    volumes = [v for v in work.scene.volumes(container) if v.T[2, 2] > _FALL.lean]
    rows = outline([s.moved(work.hand(side)) for s in work.load(side).solids])[None]
    return not volumes or any(
        _spare(v, matmul(rows - v.T[:2, 3], v.T[:2, :2]), np.empty((0, 2, 3)))[0] > 0 for v in volumes
    )


def reach_over(work: Work, side: Side, container: str) -> Actions:
    """Bring the container in the other hand and this hand over it together, the base standing still.

    A container that hangs on a slant stands up above the middle of its rim: where nothing can be let go of right over
    that, it is from farther up, clear of its higher side.

    Raises:
        MotionFailure: "no_release", or a motion's own reason.
    """
    load = work.load(side)
    try:
        yield from _reach_over(work, side, releases(work, load, side, container), container)
    except MotionFailure as failure:
        if failure.reason != "no_release":
            raise
        higher = releases(work, load, side, container, raised=True)
        yield from _reach_over(work, side, _clear_of(work, side, higher), container)


def _clear_of(work: Work, side: Side, releases: Sequence[tuple[Array, float]]) -> list[tuple[Array, float]]:
    """Those in which what this hand holds is clear of what the other one does."""
    theirs, load = work.held()[other(side)].load.solids, work.load(side).load
    to_other = kin.inverse(work.hand(other(side)))
    poses = matmul(to_other, np.stack([T for T, _ in releases])) if releases else np.zeros((0, 4, 4))
    apart = [(theirs.distance(matmul(load.centers, T[:3, :3].T) + T[:3, 3]) - load.radii).min() for T in poses]
    return [release for release, gap in zip(releases, apart, strict=True) if gap > _FALL.clear_m]


def _reach_over(work: Work, side: Side, releases: Sequence[tuple[Array, float]], container: str) -> Actions:
    """Likewise, for these hand poses T_world_tcp (4, 4) with their costs. Raises as `reach_over`."""
    before = kin.inverse(work.scene.pose(container))
    motion, holder = work.motion, other(side)
    from_holder = kin.inverse(matmul(work.base, motion.hand(holder)))
    best = sorted(releases, key=lambda r: r[1])[: _FALL.releases]
    goals = np.stack([matmul(from_holder, T) for T, _ in best]) if best else np.zeros((0, 4, 4))

    def choose(body: Body, shown: Array, at: NDArray[np.intp], q: Array) -> Iterator[tuple[int, Array]]:
        for k in np.unique(at):
            postures = q[at == k]
            near = postures[np.argsort(posture_distance(postures, motion.arm(side)))[: _FALL.postures]]
            yield from ((int(k), posture) for posture in near[body.free(side, near, margin=_FALL.clear_m)])

    k = yield from meet(work, holder, VESSEL, goals, choose)
    # Arms give way under a load, by a centimeter; what counts is where the container hangs now.
    hangs = matmul(work.scene.pose(container), before, best[k][0])
    yield from motion.line(side, matmul(kin.inverse(work.base), hangs), speed=_FALL.lower_m_s)


def releases(work: Work, held: Held, side: Side, container: str, raised: bool = False) -> list[tuple[Array, float]]:
    """Hand poses T_world_tcp from which the thing falls into the container, with a cost, the best first.

    The thing's outline, seen from above, has to fit between the walls and past whatever covers the opening, such as a
    handle or the furniture that a drawer belongs to; its lowest point is over the rim. It has to come to lie below the
    rim. If `raised`, it may be let go of farther up too, and over a heap that ends below the rim, to roll into a gap.
    """
    found: list[tuple[Array, float]] = []
    for volume in work.scene.volumes(container):
        if volume.T[2, 2] > _FALL.lean:
            found += _into(work, held, side, volume, container, raised)
    return sorted(found, key=lambda r: r[1])


def _by_turns(found: Sequence[tuple[Array, float]]) -> list[tuple[Array, float]]:
    """Hand poses, the best first, reordered: the best of each orientation and height, then the second best, and so on.

    The best of all differ by millimeters, and an arm that is barred from one of them is barred from the rest.
    """
    seen: dict[bytes, int] = {}
    ranked = []
    for T, cost in found:
        kind = np.round(np.append(T[:3, :3], T[2, 3]), 2).tobytes()
        ranked.append((seen.get(kind, 0), (T, cost)))
        seen[kind] = seen.get(kind, 0) + 1
    return [pose for _, pose in sorted(ranked, key=lambda r: r[0])]


def _into(
    work: Work, held: Held, side: Side, volume: Solid, container: str, raised: bool
) -> Iterator[tuple[Array, float]]:
    frame, half = kin.inverse(volume.T), volume.half_m
    walls = np.stack([s.moved(frame).aabb() for s in work.scene.solids(container)])
    rim = float(volume.T[2, 3] + half[2])
    low, high = walls[:, 0], walls[:, 1]
    stands = float(high[:, 2].max() - half[2])  # what is open above the rim
    ups = np.linspace(0.0, np.clip(stands + _FALL.over_lid_m, 0.0, _FALL.most_up_m), _FALL.heights if raised else 1)
    across = (high[:, :2] > 1e-3 - half[:2]).all(1) & (low[:, :2] < half[:2] - 1e-3).all(1)
    covers = walls[across & (high[:, 2] > half[2] - _FALL.rim_m) & (low[:, 2] < half[2] + _FALL.cover_m)]
    if volume.kind == "cylinder":
        covers = covers[(np.abs(covers.mean(1)[:, :2]) < _FALL.staves * half[0]).all(1)]
    lying = [s.moved(frame).aabb() for n in work.scene.within(container) for s in work.scene.solids(n)]
    R_now, off = work.hand(side)[:3, :3], np.array(_FALL.off)
    for turn in _FALL.turns_rad:
        for tilt in _FALL.tilts_rad:
            R = matmul(kin.rot_z(turn), R_now)
            sideways = np.cross([0, 0, 1.0], R[:, 2])
            level = float(norm(sideways))
            about = sideways / level if level > _FALL.level else R[:, 1]
            R = matmul(Rotation.from_rotvec(about * tilt).as_matrix(), R)
            hanging = [s.moved(kin.transform(R, (0.0, 0.0, 0.0))) for s in held.solids]
            low, high = bounds(hanging)
            middle, tall = (low + high)[:2] / 2, float(high[2] - low[2])
            edge = matmul(outline(hanging) - middle, volume.T[:2, :2])  # in the volume's frame
            reach = np.ptp(edge, axis=0) / 2
            room = half[:2] - reach - _FALL.fall_m
            if (room < 0).any():
                continue
            grid = np.stack(np.meshgrid(off * room[0], off * room[1], indexing="ij"), -1).reshape(-1, 2)
            rows = grid[:, None] + edge
            spare = _spare(volume, rows, covers)
            onto = _onto(rows, lying, -float(half[2]))
            for at, gap, under in zip(*(values[spare > _FALL.fall_m] for values in (grid, spare, onto)), strict=True):
                if under + (0.0 if raised else tall / 2) > half[2] - _FALL.fall_m:
                    continue  # it would come to lie over the rim; on a heap, in one of its gaps at best
                over = matmul(volume.T[:3, :3], [*at, 0.0]) + volume.T[:3, 3]
                cost = (
                    _COST.narrow * max(0.0, _FALL.ample_m - float(gap))
                    + _COST.turn * abs(float(turn))
                    + _COST.tilt * abs(tilt)
                )
                cost += (
                    _COST.narrow * float(reach.max())
                    + _COST.off * float(np.hypot(*at))
                    + _COST.off * (under + float(half[2]))
                )
                for up in ups:
                    p = np.append(over[:2] - middle, rim + _FALL.over_rim_m + up - low[2])
                    yield kin.transform(R, p), cost + _COST.up * float(up)


def _spare(volume: Solid, rows: Array, covers: Array) -> Array:
    """(n,) how far outlines (n, m, 2) in a volume's frame keep from its walls and from what covers it [m]."""
    if volume.kind == "cylinder":
        spare = volume.half_m[0] - norm(rows, axis=-1).max(1)
    else:
        spare = (volume.half_m[:2] - np.abs(rows)).min((1, 2))
    for cover in covers:
        spare = np.minimum(spare, _apart(rows, cover))
    return np.asarray(spare)


def _onto(rows: Array, lying: Sequence[Array], bottom: float) -> Array:
    """(n,) height [m] of what outlines (n, m, 2) fall onto: boxes (2, 3) that lie in a volume, or its bottom."""
    under = np.full(len(rows), bottom)
    for box in lying:
        under = np.where(_apart(rows, box) < _FALL.fall_m, np.maximum(under, box[1, 2]), under)
    return under


def _apart(rows: Array, box: Array) -> Array:
    """(n,) how far outlines (n, m, 2) keep from a box (2, 3), seen from above [m]."""
    low, high = box[:, :2]
    off = norm(np.maximum(np.maximum(low - rows, rows - high), 0), axis=-1).min(1)
    # An outline that holds the box within it has no point on it, but lies on both sides of it.
    around = ((rows.min(1) < low) & (rows.max(1) > high)).all(1)
    return np.asarray(np.where(around, 0.0, off))
