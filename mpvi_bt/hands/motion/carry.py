"""Carrying: the empty arms folded, what is held upright at the chest, and a little room made for that."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, product, tee

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body, Load
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.stance.glance import TOUCH_M
from mpvi_bt.hands.stance.refusals import Refusals, deepest
from mpvi_bt.hands.stance.site import base_clear


@dataclass(frozen=True)
class CarryParameters:
    """How payloads are carried.

    Our choice: a payload keeps clear of things around it if it can; arms give way, and what hooks on a chair is lost.
    """

    fold_clear_m: float = 0.02  # closer clearance allowed between two checks of a path [m]
    back_m: tuple[float, float] = (0.35, 0.2)  # distances to back off [m]
    back_rad: tuple[float, ...] = (0.0, 0.25, -0.25, 0.5, -0.5)  # directions of backing off, from straight back [rad]
    # directions if none of those is free, as before a trunk that stands obliquely [rad]
    aside_rad: tuple[float, ...] = (0.8, -0.8, 1.1, -1.1)
    step_m: float = 0.15  # step back after a failure [m]
    shrunk_m: float = 0.001  # a load is taken to be this much smaller than the room around it [m]
    out_rad: float = 0.05  # an empty arm this far off its posture for traveling is out [rad]
    drawn_m: tuple[float, float] = (0.12, 0.06)  # retreat along the fingers from a payload just released [m]
    height_m: float = 0.80  # height of a payload above the floor [m]
    clear_m: tuple[float, float] = (0.03, 0.0)  # clearances of a payload, the best first [m]
    checked: int = 25  # hand poses that are checked
    straightened: int = 100  # hand poses from which the torso is checked to straighten up
    swung: int = 3  # hand poses that a long motion is planned for


_CARRY = CarryParameters()
# Off the middle of a hand's way home, y toward its own side [m]. Our choice: straight first, then
# around and over what is beside it.
_DETOURS = np.array([(0.0, 0, 0), (0, 0.12, 0), (0, 0, 0.2), (0, 0.25, 0), (0.15, 0.15, 0), (0, 0.25, -0.2)])
# Where to carry things: x, y toward the own side, z [m] and a turn about the vertical [rad]. Our choice: a grid before
# the chest, within the base's outline or close to it.
_CARRIES = np.array(list(product(
    (0.28, 0.33, 0.38, 0.43, 0.49), (0.02, 0.08, 0.14, 0.20, 0.28), (0.72, 0.80, 0.88, 0.98),
    (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2, 1.57, -1.57, 2.2, -2.2, 3.1),
)))  # fmt: skip


def settle(work: Work, without: Collection[str] = ()) -> Actions:
    """Fold the empty arms and bring what is held to the chest, upright, the torso as for traveling.

    A body that is too low for its arms to hang rises first. Where there is no room for it, or an arm meets what nobody
    knows of, it is done from a little farther back; what no level way leads home for, such as out of a bin in the other
    hand, may tip on its way if nothing is in it. With nothing held a robot that takes itself to be in something then
    straightens up all the same, and feels what it meets.

    Args:
        work: Robot and world.
        without: Things that the hands may be in touch with at first.

    Raises:
        MotionFailure: "no_fold" or "no_carry" if no such posture can be reached, or a motion's own reason.
    """
    try:
        yield from _settle(work, without)
    except MotionFailure:
        yield from back_off(work)
        yield from _swing_home(work, without)
        yield from _settle(work, without, feeling=True)


def _settle(work: Work, without: Collection[str], feeling: bool = False) -> Actions:
    held, straight = work.held(), upright(work)
    low = not Body(work.motion.robot, work.motion.torso, work.motion.robot.travel_arm).all_free()
    if low and (arms := _homeward(work, straight, without)) is not None:  # hanging arms would be in the base
        yield from work.motion.stand(straight, arms)
    for side in (s for s in work.motion.robot.sides if s not in held):
        if np.abs(work.motion.arm(side) - work.motion.robot.travel_arm[side]).max() > 0.02:
            # a base that has come to stand against a wall does not fold by what it takes the wall to be
            with work.scene.trusting() if feeling else nullcontext():
                path = work.once(("fold", side, feeling, *sorted(without)), partial(_fold, work, side, without))
            if path is None:
                raise MotionFailure("no_fold")
            yield from work.motion.follow(side, path)
    arms = _homeward(work, straight, without)
    if arms is None and (held or not feeling):
        raise work.refused("no_carry", _way_home(work, straight, without)[1])
    yield from work.motion.stand(straight, arms)


def come_out(work: Work) -> Actions:
    """Fold the empty arms that are out: who was told something else in the middle of a skill left them where they were.

    The base would drag them through what they reach into. Where they cannot be folded they stay as they are.
    """
    held, home = work.held(), work.motion.robot.travel_arm
    out = [s for s in home if s not in held and np.abs(work.motion.arm(s) - home[s]).max() > _CARRY.out_rad]
    if not out or work.scene.between() is not None:
        return
    with suppress(MotionFailure):
        for side in out:
            if work.gripped(side):
                yield from work.motion.grip(side, 1.0, GRIP.clear_s)
            yield from _draw_off(work, side)
        yield from settle(work)


def _draw_off(work: Work, side: Side) -> Actions:
    """Draw a hand that is close to something back along its fingers, as far as there is room for it."""
    body = work.body()
    if body.free(side, body.arms[side], _CARRY.fold_clear_m)[0]:
        return
    for by in _CARRY.drawn_m:
        T = work.motion.hand(side)
        T[:3, 3] -= by * T[:3, 2]
        line = arm_motion.trace(body.robot, body.torso, side, body.arms[side], T)
        if line is not None and body.free(side, np.stack(line), -TOUCH_M, grasping=True).all():
            yield from work.motion.line(side, T)
            return


def _fold(work: Work, side: Side, without: Collection[str]) -> list[Array] | None:
    """A path home for an empty arm, well clear of the things `without` too if it can be: they stand loose."""
    now, home = work.motion.arm(side), work.motion.robot.travel_arm[side]
    for spared, margin in (((), _CARRY.fold_clear_m), ((), 0.0), (without, 0.0)):
        path = arm_motion.plan(work.body(spared), side, home, work.rng, margin, start=now)
        if path is not None:
            return path
    return None


def upright(work: Work) -> Array:
    """(4,) the torso as for traveling, but for the head's tilt."""
    robot = work.motion.robot
    posture = robot.trunk.posture(robot.travel_torso)
    return robot.trunk.joints(np.append(posture[:3], work.motion.posture[3]))


def _homeward(work: Work, torso: Array, without: Collection[str]) -> dict[Side, list[Array]] | None:
    """Postures of the arms that hold something, while the torso goes to its travel posture.

    What can stay where it is stays; of two things held the one in the lower hand, just picked up, moves first.
    """
    return _way_home(work, torso, without)[0]


def _way_home(work: Work, torso: Array, without: Collection[str]) -> tuple[dict[Side, list[Array]] | None, Refusals]:
    """As `_homeward`, with what ways there died of."""
    return work.once(("home", torso.tobytes(), *sorted(without)), partial(_searched, work, torso, without))


def _searched(work: Work, torso: Array, without: Collection[str]) -> tuple[dict[Side, list[Array]] | None, Refusals]:
    body, base, refusals = work.body(without), work.base, Refusals()

    def meets(met: Body) -> None:
        refusals.add("in the way", lambda: deepest(met.around, *met.whole(), base))

    if (met := arm_motion.trunk_touching(body, torso)) is not None:  # whatever the hands do
        meets(met)
        return None, refusals

    def swept(hands: Mapping[Side, arm_motion.HandPath]) -> dict[Side, list[Array]] | None:
        if (arms := arm_motion.swing(body, torso, hands)) is None:
            refusals.add("arm cannot follow")
        elif (met := arm_motion.touching(body, torso, arms)) is not None:
            meets(met)
        else:
            return arms
        return None

    hands = {s: arm_motion.stay(work.motion.hand(s)) for s in body.held}
    if (found := swept(hands)) is not None:
        return found, refusals
    sides = sorted(body.held, key=lambda s: float(work.motion.hand(s)[2, 3]))
    home = replace(body, torso=torso)
    ends = {side: tee(_ends(work, side, home), len(_CARRY.clear_m)) for side in sides}
    for (k, margin), side in product(enumerate(_CARRY.clear_m), sides):
        checked, left = 0, len(_CARRIES)
        for T, room in ends[side][k]:
            left -= 1
            if room <= margin:
                refusals.add("no room for a hand")
                continue
            for detour in _DETOURS:
                found = swept({**hands, side: arm_motion.glide(work.motion.hand(side), T, detour * [1, SIGN[side], 1])})
                if found is not None and (not margin or home.free(side, found[side][-1], margin)[0]):
                    return found, refusals
            checked += 1
            if checked >= _CARRY.checked:
                break
        refusals.add("not looked at", count=0 if margin else left)
    return None, refusals


def _ends(work: Work, side: Side, home: Body) -> Iterator[tuple[Array, float]]:
    """Poses (4, 4) in the base frame to carry what `side` holds, the best first, and how clear it is there [m].

    -inf where the arm does not reach, or would meet the robot itself.
    """
    now = work.motion.arm(side)
    for T in _carries(work, side, home):
        q = home.robot.nearest_posture(matmul(home.from_chest, T), side, now)
        if q is None:
            yield T, -np.inf
            continue
        around, itself = home.clearance(side, q)
        yield T, float(around[0]) if itself[0] > 0 else -np.inf


def _swing_home(work: Work, without: Collection[str]) -> Actions:
    """Bring things that no level way leads home for to where they can be carried by any way, unless they are filled.

    There they hang level once the torso has straightened up, which it then does.
    """
    straight = upright(work)
    for side, held in work.held().items():
        if _homeward(work, straight, without) is not None:
            return
        if held.laden:
            continue
        path = work.once(("swing", side, *sorted(without)), partial(_swung, work, side, without))
        if path is not None:
            yield from work.motion.follow(side, path)
            arms = _straightens(work, work.body(without), side, work.motion.arm(side))
            yield from work.motion.stand(straight, arms or {})


def _swung(work: Work, side: Side, without: Collection[str]) -> list[Array] | None:
    """A path of an arm, by any way, to where its hand can be while the torso straightens up."""
    body = work.body(without)
    home = matmul(kin.inverse(body.robot.chest(upright(work))), _carries(work, side, body))
    ends = (body.robot.nearest_posture(T, side, work.motion.arm(side)) for T in home)
    free = (q for q in ends if q is not None and body.free(side, q)[0])
    free = (q for q in islice(free, _CARRY.straightened) if _straightens(work, body, side, q) is not None)
    paths = (arm_motion.plan(body, side, q, work.rng) for q in islice(free, _CARRY.swung))
    return next((path for path in paths if path is not None), None)


def _straightens(work: Work, body: Body, side: Side, q: Array) -> dict[Side, list[Array]] | None:
    """Postures of what the other hand holds while the torso straightens up with arm `side` in posture `q` (7,)."""
    hands = {s: arm_motion.stay(work.motion.hand(s)) for s in body.held if s != side}
    return arm_motion.sweep(replace(body, arms={**body.arms, side: q}), upright(work), hands)


def tuck(work: Work) -> Actions:
    """Bring what is held closer to the body, for driving."""
    body = work.body()
    for side in body.held:
        arms = {s: work.motion.arm(s) for s in work.motion.robot.sides}
        now, checked = work.motion.hand(side), 0
        body = replace(body, arms=arms)
        for T in _carries(work, side, body):
            if norm(T[:3, 3] - now[:3, 3]) < 0.03 or checked >= _CARRY.checked:
                break  # as good as home
            T_chest_tcp = matmul(kin.inverse(body.robot.chest(work.motion.torso)), T)
            q = body.robot.nearest_posture(T_chest_tcp, side, arms[side])
            if q is None or not body.free(side, q, _CARRY.clear_m[0])[0]:
                continue
            path = arm_motion.plan_level(body, side, T)
            if path is not None and body.free(side, path[-1], _CARRY.clear_m[0])[0]:  # with its elbow elsewhere
                yield from work.motion.follow(side, path, speed=1.0)
                break
            checked += 1


def draw_in(work: Work) -> Actions:
    """Bring what one hand holds to where it is carried: who was told something else meanwhile holds it far out.

    From there the torso could not be lowered before furniture. Two hands that are full may be at work on one another.
    """
    yield from unwedge(work)
    if len(work.held()) == 1:
        with suppress(MotionFailure):
            yield from tuck(work)


def unwedge(work: Work) -> Actions:
    """Where what is held hangs so near the body that the torso could not move, bring it to the chest."""
    body = work.body()
    hands = {s: arm_motion.stay(work.motion.hand(s)) for s in body.held}
    if arm_motion.sweep(body, work.motion.torso, hands, samples=1) is None:
        with suppress(MotionFailure):
            yield from settle(work)


def back_off(work: Work) -> Actions:
    """A little back as it stands, straight or obliquely where something is in the way of what is held.

    Where that is not free it goes less far; where it cannot move at all, nowhere. What it touches it may leave.
    """
    here, body, near = work.motion.felt.base_pose, work.body(), work.near()
    body = body.amid(body.around, {side: _as_it_hangs(work, side, body) for side in body.held})
    least = np.minimum(_gaps(body), 0.0) - 1e-6
    for by, turn in (*product(_CARRY.back_m, _CARRY.back_rad), *product(_CARRY.back_m, _CARRY.aside_rad)):
        back = np.array([-np.cos(here[2] + turn), -np.sin(here[2] + turn), 0.0]) * by
        around = (near.seen_from(kin.base(here + back * u)) for u in (0.2, 0.4, 0.6, 0.8, 1.0))
        if all((_gaps(body.amid(a)) > least).all() for a in around):
            yield from work.motion.drive(here + back)
            return


def step_back(work: Work) -> Actions:
    """A small step straight back, if the base is clear of everything there: against a wall it would be stuck."""
    here = work.motion.felt.base_pose
    step = -_CARRY.step_m * np.array([np.cos(here[2]), np.sin(here[2]), 0.0])
    if all(base_clear(work.motion.robot, work.near().seen_from(kin.base(here + share * step))) for share in (0.5, 1.0)):
        yield from work.motion.drive(here + step)


def _gaps(body: Body) -> Array:
    """(n,) how far base, trunk and arms keep from things [m]; a hand may touch what it takes something from."""
    standing = body.robot.hull.standing
    base = body.around.distance(standing[:, :3]) - standing[:, 3]
    arms = [body.distance(s, q, s in body.held) + (TOUCH_M if s in body.held else 0.0) for s, q in body.arms.items()]
    return np.concatenate([base, body.trunk_gaps(), arms])


def _as_it_hangs(work: Work, side: Side, body: Body) -> Load:
    """What a hand holds, no larger than the room where it is now: a little above a board its spheres reach into it."""
    T, load = work.motion.hand(side), body.held[side]
    return load.within(body.around.distance(matmul(load.centers, T[:3, :3].T) + T[:3, 3]) - _CARRY.shrunk_m)


def _carries(work: Work, side: Side, body: Body) -> Array:
    """(n, 4, 4) T_base_tcp to carry what `side` holds, tilted as now, the most compact first."""
    now, load = work.motion.hand(side), body.held[side]
    x, y, z, yaw = _CARRIES.T
    T = kin.transform(matmul(kin.rot_z(yaw * SIGN[side]), now[:3, :3]), np.stack([x, y * SIGN[side], z], -1))
    far = np.hypot(*np.moveaxis(matmul(load.centers, np.swapaxes(T[:, :2, :3], 1, 2)) + T[:, None, :2, 3], -1, 0))
    cost = (far + load.radii).max(1) + 0.05 * np.abs(yaw) + 0.2 * np.abs(z - _CARRY.height_m)
    return np.asarray(T[np.argsort(cost, kind="stable")])
