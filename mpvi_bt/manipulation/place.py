"""Let go of a held thing: over a container, or on a surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mpvi_bt.manipulation.stance import Held, Option
from mpvi_bt.manipulation.work import Words, Work, other, upright_options
from mpvi_bt.robot import arm_motion, r1
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.motion import Actions, MotionFailure
from mpvi_bt.robot.protocol import Side
from mpvi_bt.robot.solids import Array, Solid

_OVER_RIM_M = 0.02  # between the lowest point of the thing and the rim
_FALL_M = 0.008  # to spare on every side of a thing that falls into a container
_ELSEWHERE = 0.05  # between two poses, in any number of their matrices [m or the sine of a turn]
_CLEAR_M = 0.04  # between things on a surface
_HEADROOM_M = 0.35  # above a spot, for the thing and the hand
_BEST_RELEASES = 80  # tried of each pose of the container
_TILTS = (0.0, 0.35, -0.35, 0.7)
_TURNS = tuple(np.arange(-3.0, 3.01, 0.5))


def place_in(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Let go of the held `words["object"]` in `words["container"]`, which stands somewhere or hangs in the other hand.

    Raises:
        MotionFailure: "not_held", "unknown_object", "not_a_container",
            "no_release", "no_stance", "not_released", "missed", or a motion's own reason.
    """
    side = work.hand_with(words["object"], words.get("hand"))
    container = work.nearest(words["container"])
    held = work.held()[side]
    volumes = work.scene.volumes(container)
    if not volumes:
        raise MotionFailure("not_a_container")
    releases = list(_releases(work, held, side, max(volumes, key=lambda v: float(np.prod(v.half_m))), container))
    if work.scene.holding(other(side)) == container:
        yield from _reach_over(work, side, releases, container)
        yield from work.look_at(container)
        yield from _let_go(work, side)
    else:
        search = work.search(side, {container})
        search.tried.extend(tried)
        options = upright_options(releases, above_m=0.10, contact=2)
        stance = search.find(work.scene.pose(container)[:2, 3], options)
        if stance is None:
            raise MotionFailure("no_stance")
        tried.append(stance.base)
        yield from work.take_up(stance, search)
        yield from work.lines(side, stance, [1])
        yield from work.look_at(container)
        yield from _let_go(work, side)
        yield from work.rise(side)
    missed = held.name not in work.scene.within(container)
    yield from work.settle(without={held.name})
    if missed:
        raise MotionFailure("missed")


def place_on(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Set the held `words["object"]` down on `words["surface"]`, upright, at a free spot.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_free_spot", "no_stance", "not_released", "missed", or a
            motion's own reason.
    """
    side = work.hand_with(words["object"], words.get("hand"))
    surface = work.nearest(words["surface"])
    held = work.held()[side]
    boxes = np.stack([s.aabb() for s in held.solids])
    radius = float(np.linalg.norm((boxes[:, 1].max(0) - boxes[:, 0].min(0))[:2])) / 2 + _CLEAR_M
    spots = work.scene.spots(surface, radius, _HEADROOM_M, work.motion.felt.base_pose[:2])
    if not spots:
        raise MotionFailure("no_free_spot")
    search = work.search(side, {surface})
    search.tried.extend(tried)
    stance = None
    for spot in spots[:4]:
        stance = search.find(spot[:2], [_onto(work, held, spot, yaw) for yaw in _TURNS])
        if stance is not None:
            break
    if stance is None:
        raise MotionFailure("no_stance")
    tried.append(stance.base)
    yield from work.take_up(stance, search)
    yield from work.lines(side, stance, [1], speed=0.10)
    yield from work.look_at(held.name)
    yield from _let_go(work, side)
    yield from work.lines(side, stance, [2])
    missed = min(solid.aabb()[0, 2] for solid in work.scene.solids(held.name)) < spot[2] - _CLEAR_M
    yield from work.settle(without={held.name, surface})
    if missed:
        raise MotionFailure("missed")


def _let_go(work: Work, side: Side) -> Actions:
    yield from work.motion.grip(side, 1.0, 0.5)
    yield from work.motion.wait(0.5)  # what falls into a deep container needs that long
    if work.motion.felt.gripper_width[side] < r1.FINGER_TRAVEL_M:
        raise MotionFailure("not_released")


def _reach_over(work: Work, side: Side, releases: list[tuple[Array, float]], container: str) -> Actions:
    """Bring the container in the other hand and this hand over it together, the base standing still."""
    before = kin.inverse(work.scene.pose(container))
    motion, hand = work.motion, other(side)
    now, to_base = motion.hand(hand), kin.inverse(work.base)
    chest = kin.inverse(kin.chest(motion.torso))
    best = sorted(releases, key=lambda r: r[1])[:_BEST_RELEASES]
    goals = np.stack([to_base @ T for T, _ in best]) if best else np.zeros((0, 4, 4))
    still = work.body()
    for shown in _presented(now, hand):
        aside = [motion.arm(hand)] if shown is now else arm_motion.plan_level(still, hand, shown)
        if aside is None:
            continue
        body = replace(still, arms={**still.arms, hand: aside[-1]})
        if not body.free(side, motion.arm(side))[0]:
            continue
        at, q = kin.arm_inverse(chest @ shown @ kin.inverse(now) @ goals, side, swivels=24)
        for release in np.unique(at):
            postures = q[at == release]
            near = postures[np.argsort(kin.posture_distance(postures, motion.arm(side)))[:3]]
            for goal in near[body.free(side, near, margin=0.005)]:
                path = arm_motion.plan(body, side, goal, work.rng, iterations=120)
                if path is not None:
                    yield from motion.follow(hand, aside, speed=0.8)
                    yield from motion.follow(side, path, speed=1.0)
                    # Arms give way under a load, by a centimeter; what counts is where the container hangs now.
                    hangs = work.scene.pose(container) @ before @ best[release][0]
                    yield from motion.line(side, kin.inverse(work.base) @ hangs, speed=0.08)
                    return
    raise MotionFailure("no_release")


def present(work: Work, side: Side, turn: int) -> Actions:
    """Hold what a hand has out in front of the body, each `turn` in another pose: what one hides another may show.

    Raises:
        MotionFailure: "no_reach" if there is no other pose to go to.
    """
    now, body = work.motion.hand(side), work.body()
    poses = [T for T in list(_presented(now, side))[1:] if np.abs(T - now).max() > _ELSEWHERE]
    for shown in poses[turn % len(poses) :] + poses[: turn % len(poses)]:
        path = arm_motion.plan_level(body, side, shown)
        if path is not None:
            yield from work.motion.follow(side, path, speed=0.8)
            return
    raise MotionFailure("no_reach")


def _presented(now: Array, hand: Side) -> Iterator[Array]:
    """Poses T_base_tcp to hold a container out to the other hand: where it is, then in front of the body, turned."""
    yield now
    for turn in (0.0, 0.6, -0.6, 1.2, -1.2, 1.57, -1.57):
        for x, y, z in ((0.50, 0.14, 0.72), (0.45, 0.24, 0.72), (0.55, 0.24, 0.72), (0.50, 0.14, 0.82)):
            yield kin.transform(kin.rot_z(turn) @ now[:3, :3], (x, y * r1.SIGN[hand], z))


def _releases(work: Work, held: Held, side: Side, volume: Solid, container: str) -> Iterator[tuple[Array, float]]:
    """Hand poses T_world_tcp from which the thing falls into a container's volume, with a cost.

    The thing's outline, seen from above, has to fit between the walls and past whatever spans the opening, such as a
    handle; its lowest point is over the rim.
    """
    frame, half = kin.inverse(volume.T), volume.half_m
    walls = [s.moved(frame).aabb() for s in work.scene.solids(container)]
    rim = float(volume.T[2, 3] + half[2])
    spanning = [b for b in walls if b[1, 2] > half[2] - 0.03 and (np.abs(b[:, :2]) < half[:2] - 1e-3).any(0).any()]
    lying = [s.moved(frame).aabb() for n in work.scene.within(container) for s in work.scene.solids(n)]
    R_now = (work.base @ kin.tcp(work.motion.felt.torso, work.motion.felt.arm[side], side))[:3, :3]
    for turn in _TURNS:
        for tilt in _TILTS:
            R = kin.rot_z(turn) @ R_now
            sideways = np.cross([0, 0, 1.0], R[:, 2])
            if np.linalg.norm(sideways) > 0.2:
                R = _rotation(sideways, tilt) @ R
            elif tilt:
                continue
            boxes = np.stack([s.moved(kin.transform(R, (0.0, 0.0, 0.0))).aabb() for s in held.solids])
            low, high = boxes[:, 0].min(0), boxes[:, 1].max(0)
            radius = float((high - low)[:2].max()) / 2
            for x, y in _offsets(half[:2] - radius - _FALL_M):
                at = np.array([x, y])
                spare = min([*(_aside(b, at) for b in spanning), *(half[:2] - np.abs(at))]) - radius
                under = max((float(b[1, 2]) for b in lying if _aside(b, at) < radius), default=-float(half[2]))
                if spare < _FALL_M or under + float(high[2] - low[2]) / 2 > half[2] - _FALL_M:
                    continue  # it would catch on something, or come to lie over the rim
                over = volume.T[:3, :3] @ [x, y, 0.0] + volume.T[:3, 3]
                p = np.append(over[:2] - ((low + high) / 2)[:2], rim + _OVER_RIM_M - low[2])
                cost = 10 * max(0.0, 0.025 - spare) + 0.1 * abs(float(turn)) + 2.0 * abs(tilt) + 10 * radius
                yield kin.transform(R, p), cost + 0.5 * float(np.hypot(x, y)) + 0.5 * (under + float(half[2]))


def _aside(box: Array, at: Array) -> float:
    """Distance [m], seen from above, of a place (2,) to an axis-aligned box (2, 3)."""
    return float(np.linalg.norm(np.maximum(np.maximum(box[0, :2] - at, at - box[1, :2]), 0)))


def _offsets(room: Array) -> Iterator[tuple[float, float]]:
    """A grid over +-room (2,) [m], the middle first; nothing if there is none."""
    if (room < 0).any():
        return
    steps = (0.0, 0.35, -0.35, 0.7, -0.7, 1.0, -1.0)
    for fx in steps:
        for fy in steps:
            yield fx * float(room[0]), fy * float(room[1])


def _rotation(axis: Array, angle: float) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix())


def _onto(work: Work, held: Held, spot: Array, yaw: float) -> Option:
    """Set the thing's upright pose onto a spot (3,), turned by `yaw` from how it is held."""
    R = kin.rot_z(yaw) @ work.scene.pose(held.name)[:3, :3]
    up = int(np.abs(R[2]).argmax())
    lean = np.cross(R[:, up] * np.sign(R[2, up]), [0, 0, 1.0])
    if np.linalg.norm(lean) > 1e-6:
        R = _rotation(lean, float(np.arcsin(min(1.0, float(np.linalg.norm(lean)))))) @ R
    lowest = min(
        s.moved(kin.inverse(held.T_tcp_thing)).moved(kin.transform(R, (0.0, 0.0, 0.0))).aabb()[0, 2]
        for s in held.solids
    )
    T_thing = kin.transform(R, spot - [0, 0, lowest - 0.004])
    T = T_thing @ kin.inverse(held.T_tcp_thing)
    over, back = T.copy(), T.copy()
    over[2, 3] += 0.12
    back[:3, 3] -= 0.09 * T[:3, 2]
    return Option(np.stack([over, T, back]), 1, 0.1 * abs(yaw))
