"""Let a held thing fall into what is open above: a bin, a basket, a sink, a drawer, or what the other hand holds."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mpvi_bt.manipulation.motion.approach import close_in, lines, take_up
from mpvi_bt.manipulation.motion.gaze import look_at
from mpvi_bt.manipulation.motion.hold_out import VESSEL, meet
from mpvi_bt.manipulation.motion.work import Work
from mpvi_bt.manipulation.skills.placing import release
from mpvi_bt.manipulation.stance.stance import Stance, upright_options
from mpvi_bt.manipulation.stance.stance_search import Search
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.arms import posture_distance
from mpvi_bt.robot.collision import Body
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.motion import Actions, MotionFailure
from mpvi_bt.robot.protocol import Side, other
from mpvi_bt.robot.solids import Array, Solid, bounds
from mpvi_bt.scene.held import Held
from mpvi_bt.shapes.from_above import outline

_OVER_RIM_M = 0.02  # between the lowest point of the thing and the rim,
_OVER_LID_M = 0.03  # or what stands up above that, such as a lid that is open: above it there is room for every hand
_MOST_UP_M = 0.16  # farther up than the gap over the rim, at the most: our choice, as what falls far may turn
_HEIGHTS = 4  # from the one to the other
_FALL_M = 0.008  # to spare on every side of a thing that falls into a container
_CLEAR_M = 0.005  # what one hand holds keeps from what the other does
_COVER_M = 0.6  # what is that much higher than a rim does not cover it
_BEST_RELEASES = 80  # tried of each pose of the container,
_NEAREST = 3  # and as many postures of the arm for each
_UPRIGHT = 0.9  # a container whose axis is farther from the vertical is not open above
_TILTS = (0.0, 0.35, -0.35, 0.7)
_TURNS = tuple(np.arange(-3.0, 3.01, 0.5))
_STEPS = np.array([0.0, 0.35, -0.35, 0.7, -0.7, 1.0, -1.0])


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
        options = upright_options(_by_turns(found) if anywhere else found[:_BEST_RELEASES], 0.10, contact=2)
        if anywhere:
            options = list(islice((option for option in options if search.fits(option)), _BEST_RELEASES))
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
    volumes = [v for v in work.scene.volumes(container) if v.T[2, 2] > _UPRIGHT]
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
    return [release for release, gap in zip(releases, apart, strict=True) if gap > _CLEAR_M]


def _reach_over(work: Work, side: Side, releases: Sequence[tuple[Array, float]], container: str) -> Actions:
    """Likewise, for these hand poses T_world_tcp (4, 4) with their costs. Raises as `reach_over`."""
    before = kin.inverse(work.scene.pose(container))
    motion, holder = work.motion, other(side)
    from_holder = kin.inverse(matmul(work.base, motion.hand(holder)))
    best = sorted(releases, key=lambda r: r[1])[:_BEST_RELEASES]
    goals = np.stack([matmul(from_holder, T) for T, _ in best]) if best else np.zeros((0, 4, 4))

    def choose(body: Body, shown: Array, at: NDArray[np.intp], q: Array) -> Iterator[tuple[int, Array]]:
        for k in np.unique(at):
            postures = q[at == k]
            near = postures[np.argsort(posture_distance(postures, motion.arm(side)))[:_NEAREST]]
            yield from ((int(k), posture) for posture in near[body.free(side, near, margin=_CLEAR_M)])

    k = yield from meet(work, holder, VESSEL, goals, choose)
    # Arms give way under a load, by a centimeter; what counts is where the container hangs now.
    hangs = matmul(work.scene.pose(container), before, best[k][0])
    yield from motion.line(side, matmul(kin.inverse(work.base), hangs), speed=0.08)


def releases(work: Work, held: Held, side: Side, container: str, raised: bool = False) -> list[tuple[Array, float]]:
    """Hand poses T_world_tcp from which the thing falls into the container, with a cost, the best first.

    The thing's outline, seen from above, has to fit between the walls and past whatever covers the opening, such as a
    handle or the furniture that a drawer belongs to; its lowest point is over the rim. It has to come to lie below the
    rim. If `raised`, it may be let go of farther up too, and over a heap that ends below the rim, to roll into a gap.
    """
    found: list[tuple[Array, float]] = []
    for volume in work.scene.volumes(container):
        if volume.T[2, 2] > _UPRIGHT:
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
    ups = np.linspace(0.0, np.clip(stands + _OVER_LID_M, 0.0, _MOST_UP_M), _HEIGHTS if raised else 1)
    across = (high[:, :2] > 1e-3 - half[:2]).all(1) & (low[:, :2] < half[:2] - 1e-3).all(1)
    covers = walls[across & (high[:, 2] > half[2] - 0.03) & (low[:, 2] < half[2] + _COVER_M)]
    if volume.kind == "cylinder":
        covers = covers[(np.abs(covers.mean(1)[:, :2]) < 0.5 * half[0]).all(1)]  # its own staves stand around it
    lying = [s.moved(frame).aabb() for n in work.scene.within(container) for s in work.scene.solids(n)]
    R_now = work.hand(side)[:3, :3]
    for turn in _TURNS:
        for tilt in _TILTS:
            R = matmul(kin.rot_z(turn), R_now)
            sideways = np.cross([0, 0, 1.0], R[:, 2])
            level = float(norm(sideways))
            about = sideways / level if level > 0.2 else R[:, 1]  # what points down is tilted about its closing axis
            R = matmul(Rotation.from_rotvec(about * tilt).as_matrix(), R)
            hanging = [s.moved(kin.transform(R, (0.0, 0.0, 0.0))) for s in held.solids]
            low, high = bounds(hanging)
            middle, tall = (low + high)[:2] / 2, float(high[2] - low[2])
            edge = matmul(outline(hanging) - middle, volume.T[:2, :2])  # in the volume's frame
            reach = np.ptp(edge, axis=0) / 2
            room = half[:2] - reach - _FALL_M
            if (room < 0).any():
                continue
            grid = np.stack(np.meshgrid(_STEPS * room[0], _STEPS * room[1], indexing="ij"), -1).reshape(-1, 2)
            rows = grid[:, None] + edge
            spare = _spare(volume, rows, covers)
            onto = _onto(rows, lying, -float(half[2]))
            for at, gap, under in zip(*(values[spare > _FALL_M] for values in (grid, spare, onto)), strict=True):
                if under + (0.0 if raised else tall / 2) > half[2] - _FALL_M:
                    continue  # it would come to lie over the rim; on a heap, in one of its gaps at best
                over = matmul(volume.T[:3, :3], [*at, 0.0]) + volume.T[:3, 3]
                cost = 10 * max(0.0, 0.025 - float(gap)) + 0.1 * abs(float(turn)) + 2.0 * abs(tilt)
                cost += 10 * float(reach.max()) + 0.5 * float(np.hypot(*at)) + 0.5 * (under + float(half[2]))
                for up in ups:
                    p = np.append(over[:2] - middle, rim + _OVER_RIM_M + up - low[2])
                    yield kin.transform(R, p), cost + 2.0 * float(up)


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
        under = np.where(_apart(rows, box) < _FALL_M, np.maximum(under, box[1, 2]), under)
    return under


def _apart(rows: Array, box: Array) -> Array:
    """(n,) how far outlines (n, m, 2) keep from a box (2, 3), seen from above [m]."""
    low, high = box[:, :2]
    off = norm(np.maximum(np.maximum(low - rows, rows - high), 0), axis=-1).min(1)
    # An outline that holds the box within it has no point on it, but lies on both sides of it.
    around = ((rows.min(1) < low) & (rows.max(1) > high)).all(1)
    return np.asarray(np.where(around, 0.0, off))
