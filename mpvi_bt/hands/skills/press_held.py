"""Press a switch of what the other hand holds, such as the button of a spray bottle."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.arms import posture_distance
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side, other
from mpvi_bt.hands.motion.approach import FEEL
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.hold_out import LOOKED_AT, THING, meet
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.stance.stance import Option


def press_held(work: Work, holder: Side, ways: Sequence[Option], fold: bool = True) -> Actions:
    """Press with the hand that is free what a hand holds.

    Args:
        work: Robot and world.
        holder: The hand that holds it.
        ways: Of the free hand: before the switch, and on it.
        fold: Whether both arms fold afterwards; else only the one that pressed comes away.

    Raises:
        MotionFailure: "hands_full", "no_switch", "no_release" if the hands cannot meet, or a motion's own reason.
    """
    motion, comer = work.motion, other(holder)
    if work.scene.holding(comer) is not None:
        raise MotionFailure("hands_full")
    yield from motion.grip(comer, -1.0, GRIP.empty_s)
    way = yield from _straightest(work, holder, ways)
    yield from motion.wait(FEEL.calm_s)
    # Arms give way under a load; what counts is where the thing is now.
    T = matmul(motion.robot.tcp(motion.felt.torso, motion.felt.arm[holder], holder), way)
    name = work.load(holder).name
    before = work.scene.is_on(name)
    # One that is known to have turned is left at once: a hand that springs back from the contact would turn it again.
    for action in chain(motion.line(comer, T[1], FEEL.speed_m_s, until_contact=True), motion.wait(FEEL.pressed_s)):
        yield action
        if work.scene.is_on(name) != before:
            break
    yield from motion.line(comer, T[0], FEEL.back_m_s)
    yield from motion.grip(comer, 1.0, GRIP.empty_s)
    if fold:
        yield from settle(work, without=set())


def _straightest(work: Work, holder: Side, ways: Sequence[Option]) -> Generator[Array, None, Array]:
    """Bring the hands together for the cheapest of some ways: a slanting push turns the thing in its holder's hand.

    Returns:
        (2, 4, 4) T_holder_tcp of the way that was taken, the free hand being where it begins.

    Raises:
        MotionFailure: As `meet`.
    """
    still = [way for way in ways if not way.run_up_m]
    costs = sorted({way.cost for way in still})
    for cost in costs:
        some = np.stack([way.waypoints for way in still if way.cost == cost])
        goals = matmul(kin.inverse(work.hand(holder)), some)
        try:
            k = yield from meet(work, holder, THING, goals[:, 0], partial(_in_line, work, other(holder), goals[:, 1]))
        except MotionFailure as failure:
            if failure.reason != "no_release" or cost == costs[-1]:
                raise
        else:
            return np.asarray(goals[k])
    raise MotionFailure("no_switch")


def _in_line(
    work: Work, comer: Side, touches: Array, body: Body, shown: Array, at: NDArray[np.intp], q: Array
) -> Iterator[tuple[int, Array]]:
    """Postures of the free arm before the switch from where a straight line leads onto it, the nearest first."""
    cost = posture_distance(q, work.motion.arm(comer))
    for row in np.argsort(cost)[:LOOKED_AT]:
        if not body.free(comer, q[row])[0]:
            continue
        line = arm_motion.trace(body.robot, body.torso, comer, q[row], matmul(shown, touches[at[row]]))
        if line is not None:
            yield int(at[row]), q[row]
