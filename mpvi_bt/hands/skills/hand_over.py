"""Passing a thing from one hand to the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.arms import posture_distance
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side, other
from mpvi_bt.hands.motion.approach import FEEL
from mpvi_bt.hands.motion.carry import settle, tuck
from mpvi_bt.hands.motion.hold_out import LOOKED_AT, THING, meet
from mpvi_bt.hands.motion.work import Words, Work


@dataclass(frozen=True)
class Taking:
    """How the other hand takes the payload of a hand."""

    apart_m: float = 0.055  # least distance between the tcps of the two hands [m]; our choice
    opposed: float = -0.3  # cosine between their approaches below which they may be closer; our choice
    deep_m: float = 0.03  # distance that a thing may reach behind the tcp into the taking hand [m]; our choice
    end_m: float = 0.015  # distance from the end of a thing to the nearest place where it is taken [m]; our choice
    # places along it, off its middle [ratio of its free length]; our choice
    along: tuple[float, ...] = (0.0, 0.5, -0.5, 0.9, -0.9)
    short_m: float = 0.02  # least free length for these places [m]; our choice
    angles: int = 16  # directions of the hand, in a turn about its closing axis; our choice
    far_m: float = 0.15  # distance beyond which the hands are no longer in each other's way [m]; our choice
    far_gain: float = 4.0  # gain of a posture per meter of distance up to there; our choice
    palm_m: float = 0.06  # distance of the palm behind the tcp [m]; our choice
    palm_clear_m: float = 0.015  # clearance of the palm from the thing [m]; our choice
    standoff_m: float = 0.10  # standoff of the taking hand before, and of the giving hand after it [m]; our choice
    speed_m_s: float = 0.10  # speed of the taking hand on the last line [m/s]; our choice


_TAKING = Taking()


def hand_over(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Pass the held `words["object"]` to the other hand, or to the hand `words["to_hand"]`.

    Raises:
        MotionFailure: "not_held", "hands_full", "no_grasp", "no_release", "closed_empty", "dropped", or a motion's own
            reason.
    """
    scene, motion = work.scene, work.motion
    wanted = words.get("to_hand")
    alike = {e.name for e in scene.knowledge().find(words["object"])}
    if wanted is not None and any(scene.holding(s) in alike for s in SIDES if s == wanted):
        return  # there already
    giver = work.hand_with(words["object"], other(wanted) if wanted in SIDES else words.get("hand"))
    taker = other(giver)
    held = work.held()
    if taker in held:
        raise MotionFailure("hands_full")
    ways = list(takes(motion.robot.hand, held[giver]))
    if not ways:
        raise MotionFailure("no_grasp")
    yield from motion.grip(taker, 1.0, GRIP.empty_s)
    goals = np.stack(ways)
    k = yield from meet(work, giver, THING, goals, partial(_takeable, work, giver, held[giver], goals))
    # Arms give way under a load; what counts is where the thing is now.
    T = matmul(motion.robot.tcp(motion.felt.torso, motion.felt.arm[giver], giver), goals[k])
    yield from motion.line(taker, T, _TAKING.speed_m_s)
    yield from motion.grip(taker, -1.0, GRIP.take_s)
    yield from motion.wait(0.2)
    if not work.gripped(taker):
        raise MotionFailure("closed_empty")
    if giver in work.grasped:
        work.grasped[taker] = matmul(work.grasped[giver], goals[k][:3, :3])
    yield from motion.grip(giver, 1.0, GRIP.firm_s)
    yield from motion.wait(0.1)
    away = motion.hand(giver)
    away[:3, 3] -= _TAKING.standoff_m * away[:3, 2]
    if arm_motion.trace(motion.robot, motion.torso, giver, motion.arm(giver), away) is not None:
        yield from motion.line(giver, away, FEEL.back_m_s)
    if not work.gripped(taker):
        raise MotionFailure("dropped")
    yield from tuck(work)  # out of the way of the other arm
    yield from settle(work, without={held[giver].name})
    if not work.gripped(taker) or scene.holding(taker) not in alike:
        raise MotionFailure("dropped")


def takes(hand: Hand, held: Held) -> Iterator[Array]:
    """T_giver_taker (4, 4) tcp frames: ways for another hand to take hold of what a hand holds."""
    frame = kin.inverse(held.T_tcp_thing)
    low, high = bounds(s.moved(frame) for s in held.solids)
    size, middle = high - low, (low + high) / 2
    for closing in range(3):
        if size[closing] > hand.widest_m:
            continue
        u, v = (closing + 1) % 3, (closing + 2) % 3
        long = u if size[u] > size[v] else v
        room = float(size[long]) / 2 - _TAKING.end_m
        for angle in np.arange(0, 2 * np.pi, 2 * np.pi / _TAKING.angles):
            approach = np.zeros(3)
            approach[u], approach[v] = np.cos(angle), np.sin(angle)
            sign = np.zeros(3)
            sign[closing] = 1.0
            R = kin.hand_rotation(approach, sign)
            for share in _TAKING.along if room > _TAKING.short_m else (0.0,):
                at = np.zeros(3)
                at[long] = share * room
                # From there back along the approach to the face through which the hand comes in.
                with np.errstate(divide="ignore"):
                    behind = float(((size / 2 + np.sign(approach) * at) / np.abs(approach))[[u, v]].min())
                p = middle + at - approach * max(0.0, behind - _TAKING.deep_m)
                T = matmul(held.T_tcp_thing, kin.transform(R, p))
                if norm(T[:3, 3]) > _TAKING.apart_m or _opposed(T):
                    yield T


def _opposed(T_giver_taker: Array) -> bool:
    """Whether the hands come from so different sides that their fingers can interleave on a small thing."""
    return bool(T_giver_taker[2, 2] < _TAKING.opposed)


def _takeable(
    work: Work, giver: Side, held: Held, goals: Array, body: Body, shown: Array, at: NDArray[np.intp], q: Array
) -> Iterator[tuple[int, Array]]:
    """Postures of the taking arm a standoff before it can close on the thing, far from the giving hand first."""
    taker = other(giver)
    far = norm(goals[at, :3, 3], axis=1)
    cost = posture_distance(q, work.motion.arm(taker)) - _TAKING.far_gain * np.minimum(far, _TAKING.far_m)
    for row in np.argsort(cost)[:LOOKED_AT]:
        if not _closes(body, taker, giver, held, q[row]):
            continue
        before = matmul(shown, goals[at[row]], kin.transform(np.eye(3), (0.0, 0.0, -_TAKING.standoff_m)))
        line = arm_motion.trace(body.robot, body.torso, taker, q[row], before)
        if line is not None and body.free(taker, line[-1])[0]:
            yield int(at[row]), line[-1]


def _closes(body: Body, taker: Side, giver: Side, held: Held, q: Array) -> bool:
    """Whether the taking hand is free of all but the thing itself, and its palm of that, too."""
    bare = replace(body, held={s: load for s, load in body.held.items() if s != giver})
    if not bare.free(taker, q)[0]:
        return False
    T = matmul(kin.inverse(body.robot.tcp(body.torso, body.arms[giver], giver)), body.robot.tcp(body.torso, q, taker))
    palm = T[:3, 3] - _TAKING.palm_m * T[:3, 2]
    return bool(held.load.solids.distance(palm[None])[0] > _TAKING.palm_clear_m)
