"""Collision-free motion of one arm: RRT-Connect in joint space, or straight lines that keep the payload level."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rotations import angle, between, matrices, quaternion
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import NOTHING, Body
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.protocol import Side

_STEP_RAD = 2.0  # how far a tree grows at once, if the way is free
_LEAST_RAD = 0.1  # a shorter step is none
# Our choice: in the first part of its steps a tree grows toward the other tree's root, in the second toward postures
# about the straight line from start to goal, with this spread. In the rest it grows toward any posture in the limits.
_ROOT, _ABOUT_LINE, _SPREAD_RAD = 0.15, 0.7, 1.0
_CHECK_RAD = 0.07  # spacing of the checks along an edge
_SWING_M = 0.03  # what hangs from a hand swings that far while torso and arms move
_CORNERS_M = 0.015  # the spheres that cover what is held leave out its corners by nearly as much
_SWEEP_LEAP_RAD = 0.7  # likewise while the torso moves
_LEAP_RAD = 0.45  # between neighbors of a line; more is another elbow


def plan(
    body: Body, side: Side, goal: Array, rng: np.random.Generator, margin: float = 0.0, iterations: int = 400,
    start: Array | None = None,
) -> list[Array] | None:  # fmt: skip
    """A free path for arm `side` from where it is to posture `goal`.

    Args:
        body: The robot's posture and surroundings; everything but this arm stays.
        side: The arm that moves.
        goal: (7,) [rad].
        rng: Randomness of the search.
        margin: Distance to keep from the surroundings [m], given up near the start if that is nearer already.
        iterations: Growth steps before giving up.
        start: (7,) instead of the posture in `body`.

    Returns:
        Postures (7,) from start to goal, or None if none was found.
    """
    begin = np.asarray(body.arms[side] if start is None else start, float)
    # Where the arm stands is where it stands: a start in slight contact must not forbid every motion.
    around, itself = body.clearance(side, begin[None])
    slack = float(min(0.0, around[0] - margin, itself[0])) - 1e-6

    def reach(a: Array, b: Array) -> float:
        n = max(2, int(np.ceil(np.abs(b - a).max() / _CHECK_RAD)))
        q = a + (b - a) * np.linspace(0, 1, n + 1)[1:, None]
        around, itself = body.clearance(side, q)
        near_start = np.abs(q - begin).max(1) < 0.3
        floor = np.where(near_start, slack, 0.0)
        free = (around - margin > floor) & (itself > floor)
        return 1.0 if free.all() else float(np.argmin(free)) / n

    goal = np.asarray(goal, float)
    if not reach(goal, goal):
        return None
    if reach(begin, goal) == 1.0:
        return [begin, goal]
    limits = body.robot.arms[side].limits
    trees, parents = [[begin], [goal]], [[-1], [-1]]
    for i in range(iterations):
        this, that = i % 2, 1 - i % 2
        toward = _sampled(begin, goal, limits, trees[that][0], rng)
        new = _grow(trees[this], parents[this], toward, reach)
        if new is None:
            continue
        while (reached := _grow(trees[that], parents[that], new, reach)) is not None:
            if np.allclose(reached, new):
                halves = (_trace(trees[this], parents[this]), _trace(trees[that], parents[that]))
                first, second = halves if this == 0 else halves[::-1]
                return _shortened(first[::-1] + second[1:], reach, rng)
    return None


def _sampled(start: Array, goal: Array, limits: Array, root: Array, rng: np.random.Generator) -> Array:
    """A posture (7,) for a tree to grow toward."""
    kind = rng.random()
    if kind < _ROOT:
        return root
    if kind < _ROOT + _ABOUT_LINE:
        on_line = start + (goal - start) * rng.random()
        return np.clip(on_line + rng.normal(0.0, _SPREAD_RAD, len(goal)), limits[:, 0], limits[:, 1])
    return rng.uniform(limits[:, 0], limits[:, 1])


def plan_level(body: Body, side: Side, T_base_tcp: Array, start: Array | None = None) -> list[Array] | None:
    """A free path of arm `side` to a hand pose along straight lines; the payload is never tipped.

    The direct line is tried first, then detours over a point above, before or beside the way.

    Args:
        body: The robot's posture and surroundings; everything but this arm stays.
        side: The arm that moves.
        T_base_tcp: (4, 4) the goal, tilted like the present hand pose.
        start: (7,) instead of the posture in `body`.

    Returns:
        Postures (7,), or None if none of these ways is free.
    """
    begin = np.asarray(body.arms[side] if start is None else start, float)
    now = body.robot.tcp(body.torso, begin, side)
    middle = (now[:3, 3] + T_base_tcp[:3, 3]) / 2
    for detour in _DETOURS:
        via = now.copy()
        via[:3, 3] = middle + detour * [1, SIGN[side], 1]
        path = [begin]
        for goal in [T_base_tcp] if not detour.any() else [via, T_base_tcp]:
            leg = _line(body, side, path[-1], goal)
            if leg is None:
                break
            path += leg
        else:
            return path
    return None


# Of the middle of the way, y toward the arm's own side [m].
_DETOURS = np.array([(0.0, 0, 0), (0, 0, 0.15), (0.15, 0, 0), (0.15, 0, 0.15), (0.1, 0.15, 0), (0, 0.15, 0.1),
                     (0, 0, 0.3),                     (0.2, 0.15, 0.15), (0, 0, -0.15), (0.25, 0, -0.1)])  # fmt: skip


Reach = Callable[[Array, Array], float]  # how much of the way between two postures is free, 1 if all of it is
HandPath = Callable[[Array], Array]  # shares (n,) of the way, 0..1, to T_base_tcp (n, 4, 4)


def stay(T_base_tcp: Array) -> HandPath:
    """The path of a hand that keeps its pose."""
    return lambda shares: np.broadcast_to(T_base_tcp, (len(shares), 4, 4))


def glide(start: Array, goal: Array, detour: Array | None = None) -> HandPath:
    """The path from pose to pose (4, 4), over a point that lies off the middle of the way by `detour` (3,) [m]."""
    first, last = start[:3, 3], goal[:3, 3]
    ends = quaternion(start[:3, :3]), quaternion(goal[:3, :3])
    via = (first + last) / 2 + (np.zeros(3) if detour is None else detour)

    def path(shares: Array) -> Array:
        u = shares[:, None]
        p = np.where(u < 0.5, first + (via - first) * 2 * u, via + (last - via) * (2 * u - 1))
        return kin.transform(matrices(between(*ends, shares)), p)

    return path


def sweep(
    body: Body, torso: Array, hands: Mapping[Side, HandPath], samples: int = 12
) -> dict[Side, list[Array]] | None:
    """Postures of the arms while the torso moves to `torso` and hands follow their paths.

    Args:
        body: The robot as it stands. What is too near at the start may be left, not come nearer.
        torso: (4,) where the torso goes.
        hands: Paths in the base frame; the other arms ride along.
        samples: Postures that are checked.

    Returns:
        For each hand `samples` + 1 postures (7,), evenly spaced from the present one on, or None if an arm would have
        to leap or something would touch.
    """
    if trunk_touching(body, torso, samples) is not None:  # what is cheap to refute comes first
        return None
    arms = swing(body, torso, hands, samples)
    return arms if arms is not None and touching(body, torso, arms, samples) is None else None


def swing(
    body: Body, torso: Array, hands: Mapping[Side, HandPath], samples: int = 12
) -> dict[Side, list[Array]] | None:
    """As `sweep`, whatever stands around: None if an arm would have to leap or the robot would touch itself."""
    out: dict[Side, list[Array]] = {}
    shares, torsos = np.linspace(0, 1, samples + 1)[1:], _torsos(body.torso, torso, samples)[1:]
    chests = kin.inverse(body.robot.chest(torsos))
    for side, path in hands.items():  # what is cheap to refute comes first
        q = body.robot.postures_along(matmul(chests, path(shares)), side, body.arms[side], _SWEEP_LEAP_RAD)
        if q is None:
            return None
        out[side] = [body.arms[side], *q]
    # The arms have to come clear of each other, whatever they start from.
    before = {s: min(0.0, float(body.amid(NOTHING).clearance(s, q)[1][0])) - 1e-6 for s, q in body.arms.items()}
    for k, (u, now) in enumerate(zip(shares, torsos, strict=True), 1):
        moved = replace(body, torso=now, arms={**body.arms, **{s: q[k] for s, q in out.items()}}, around=NOTHING)
        for side, q in moved.arms.items():
            apart = before[side] if u < 0.3 else _SWING_M if side in body.held else 0.0
            if moved.clearance(side, q)[1][0] <= apart:
                return None
    return out


def trunk_touching(body: Body, torso: Array, samples: int = 12) -> Body | None:
    """The body where head or chest meet something while the torso moves to `torso`; None if they do not.

    They may leave what they touch, not come nearer, and have to be clear at the end.
    """
    start, end = np.asarray(body.torso, float), np.asarray(torso, float)
    centers, radii = _trunk_way(body.robot, start.tobytes(), end.tobytes(), samples)
    gaps = body.around.distance(centers) - radii
    least = np.vstack([np.tile(np.minimum(gaps[0], 0.0) - 1e-6, (samples - 1, 1)), np.zeros_like(gaps[:1])])
    met = (gaps[1:] <= least).any(1)
    return replace(body, torso=_torsos(start, end, samples)[1 + int(met.argmax())]) if met.any() else None


@lru_cache(maxsize=512)
def _trunk_way(robot: RobotModel, start: bytes, end: bytes, samples: int) -> tuple[Array, Array]:
    """Spheres about the trunk, centers (samples + 1, n, 3) and radii (n,): searches ask the same at every base pose."""
    torsos = _torsos(np.frombuffer(start), np.frombuffer(end), samples)
    spheres = [Body(robot, torso, {}).trunk for torso in torsos]
    return np.stack([centers for centers, _ in spheres]), spheres[0][1]


def touching(body: Body, torso: Array, arms: Mapping[Side, Sequence[Array]], samples: int = 12) -> Body | None:
    """The body where arms meet something in the motion found by `swing`; None if they do not.

    They may not reduce a distance that is already small.
    """
    torsos = _torsos(body.torso, torso, samples)
    chests, met = body.robot.chest(torsos), np.zeros(samples, bool)
    for side, still in body.arms.items():
        gaps = body.distances(side, np.array(arms.get(side, [still] * (samples + 1))), chests)
        met |= gaps[1:] <= min(_CORNERS_M if side in body.held else 0.0, gaps[0]) - 1e-6
    if not met.any():
        return None
    k = 1 + int(met.argmax())
    return replace(body, torso=torsos[k], arms={**body.arms, **{s: q[k] for s, q in arms.items()}})


def _torsos(start: Array, end: Array, samples: int) -> Array:
    """(samples + 1, 4) torsos on the way from one to another, both of them among these."""
    return np.asarray(start, float) + (np.asarray(end, float) - start) * np.linspace(0, 1, samples + 1)[:, None]


def trace(robot: RobotModel, torso: Array, side: Side, start: Array, T_base_tcp: Array) -> list[Array] | None:
    """Postures (7,) that bring the hand from posture `start` along a straight line to a pose, without a leap.

    Returns:
        The postures, start first, at most 2.5 cm apart, or None if the arm cannot stay on the line.
    """
    first = robot.tcp(torso, start, side)
    length = float(norm(T_base_tcp[:3, 3] - first[:3, 3]))
    ends = quaternion(first[:3, :3]), quaternion(T_base_tcp[:3, :3])
    n = max(2, int(np.ceil(max(length / 0.025, angle(*ends) / 0.1))))
    shares = np.linspace(0, 1, n + 1)[1:]
    at = first[:3, 3] + (T_base_tcp[:3, 3] - first[:3, 3]) * shares[:, None]
    line = matmul(kin.inverse(robot.chest(torso)), kin.transform(matrices(between(*ends, shares)), at))
    q = robot.postures_along(line, side, start, _LEAP_RAD)
    return None if q is None else [start, *q]


def _line(body: Body, side: Side, start: Array, goal: Array) -> list[Array] | None:
    path = trace(body.robot, body.torso, side, start, goal)
    if path is None:
        return None
    around, itself = body.clearance(side, np.array(path))
    worst = np.minimum(around, itself)
    # A start in slight contact may be left, not made worse.
    return path[1:] if (worst[1:] > min(0.0, float(worst[0]) - 1e-6)).all() and worst[-1] > 0 else None


def _grow(tree: list[Array], parent: list[int], toward: Array, reach: Reach) -> Array | None:
    """Add a node as far toward a posture as a step goes and the way is free; None if that is nowhere."""
    nearest = int(((np.array(tree) - toward) ** 2).sum(1).argmin())
    step = toward - tree[nearest]
    length = float(norm(step))
    if length < 1e-9:
        return None
    new = toward if length < _STEP_RAD else tree[nearest] + step / length * _STEP_RAD
    free = reach(tree[nearest], new)
    if free < 1.0:  # up to what is in the way: where all is narrow no whole step may be free
        new = tree[nearest] + (new - tree[nearest]) * free
        if np.abs(new - tree[nearest]).max() < _LEAST_RAD:
            return None
    tree.append(new)
    parent.append(nearest)
    return new


def _trace(tree: list[Array], parent: list[int]) -> list[Array]:
    path, i = [], len(tree) - 1
    while i >= 0:
        path.append(tree[i])
        i = parent[i]
    return path


def _shortened(path: list[Array], reach: Reach, rng: np.random.Generator) -> list[Array]:
    for _ in range(25):
        if len(path) < 3:
            break
        i, j = sorted(rng.choice(len(path), 2, replace=False))
        if j - i > 1 and reach(path[i], path[j]) == 1.0:
            path = path[: i + 1] + path[j:]
    return path
