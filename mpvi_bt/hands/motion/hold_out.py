"""Holding out what a hand holds: to the other hand, so that the two meet, or to the head."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side, other
from mpvi_bt.hands.motion.work import Work

LOOKED_AT = 60  # our choice: postures that are looked at closely for one way to hold something out
_ELSEWHERE = 0.05  # our choice: between two poses, in any number of their matrices [m or the sine of a turn]
# Our choice: a grid before the chest and below the eyes, x, y toward the hand's own side, z of the tcp [m],
_BEFORE_HEAD_M = np.array(list(product((0.4, 0.5, 0.6), (0.1, 0.2, 0.3, 0.4), (0.8, 0.9, 1.0, 1.1))))
_HANGS_M = 0.15  # and how far below it what is held hangs [m]

# Which postures (7,) of the coming arm to plan to, the best first, each with the index of what it is to reach: of the
# body that holds out and T_base_tcp (4, 4) of the hand that does, the indices (m,) of what can be reached at all and
# postures (m, 7) that reach it.
Choose = Callable[[Body, Array, NDArray[np.intp], Array], Iterable[tuple[int, Array]]]


@dataclass(frozen=True, eq=False)
class HoldOutParameters:
    """Where a hand holds something out, besides where it has it.

    Attributes:
        turns: About the vertical, from how it is held [rad].
        at: x, y toward the hand's own side, z [m] of the tcp in the base frame.
        swivels: Elbow positions of the coming arm that are looked at.
        iterations: Of planning its way.
    """

    turns: Sequence[float]
    at: Sequence[tuple[float, float, float]]
    swivels: int
    iterations: int

    def poses(self, now: Array, side: Side, robot: RobotModel) -> Iterator[Array]:
        """T_base_tcp (4, 4): as the hand is `now`, then before the body, turned; where the robot's hands meet first."""
        yield now
        for turn in self.turns:
            for x, y, z in (*robot.meets, *self.at):
                yield kin.transform(matmul(kin.rot_z(turn), now[:3, :3]), (x, y * SIGN[side], z))


# Our choice: before the chest, where both arms reach.
VESSEL = HoldOutParameters((0.0, 0.6, -0.6, 1.2, -1.2, 1.57, -1.57),
                ((0.50, 0.14, 0.72), (0.45, 0.24, 0.72), (0.55, 0.24, 0.72), (0.50, 0.14, 0.82)), 24, 120)  # fmt: skip
THING = HoldOutParameters((0.0, 0.6, -0.6, 1.2, -1.2, 1.8, -1.8),
               ((0.48, 0.06, 0.80), (0.55, 0.12, 0.90), (0.45, 0.14, 0.72)), 12, 150)  # fmt: skip


def meet(
    work: Work, holder: Side, places: HoldOutParameters, goals: Array, choose: Choose
) -> Generator[Array, None, int]:
    """Hold out what a hand holds and bring the other hand there, the base standing still.

    Args:
        work: Robot and world.
        holder: The hand that holds out.
        places: Where it may.
        goals: (n, 4, 4) T_holder_tcp: poses of the other hand, one of which is to be reached.
        choose: Which postures the other arm is planned to.

    Returns:
        The index of the goal that the other arm is now planned for.

    Raises:
        MotionFailure: "no_release" if there is no such place, or a motion's own reason.
    """
    motion, comer = work.motion, other(holder)
    now, still = motion.hand(holder), work.body()
    chest = kin.inverse(motion.robot.chest(motion.torso))
    for shown in places.poses(now, holder, motion.robot):
        aside = [motion.arm(holder)] if shown is now else arm_motion.plan_level(still, holder, shown)
        if aside is None:
            continue
        body = replace(still, arms={**still.arms, holder: aside[-1]})
        if not body.free(comer, motion.arm(comer))[0]:
            continue
        at, q = motion.robot.arm_inverse(matmul(chest, shown, goals), comer, swivels=places.swivels)
        for k, goal in choose(body, shown, at, q):
            path = arm_motion.plan(body, comer, goal, work.rng, iterations=places.iterations)
            if path is not None:
                yield from motion.follow(holder, aside, speed=0.8)
                yield from motion.follow(comer, path, speed=1.0)
                return k
    raise MotionFailure("no_release")


def present(work: Work, side: Side, turn: int) -> Actions:
    """Hold what a hand has out in front of the body, each `turn` in another pose: what one hides another may show.

    Where the hand, as it holds the thing, reaches none of the places for vessels, others before the head are tried.

    Raises:
        MotionFailure: "no_reach" if there is no other pose to go to.
    """
    body = work.body()
    for shown in _shown(work, side, turn):
        if (path := arm_motion.plan_level(body, side, shown)) is not None:
            yield from work.motion.follow(side, path, speed=0.8)
            return
    raise MotionFailure("no_reach")


def _shown(work: Work, side: Side, turn: int) -> Iterator[Array]:
    """T_base_tcp (4, 4) other than it is now, each `turn` another one first."""
    now = work.motion.hand(side)
    vessel = [T for T in VESSEL.poses(now, side, work.motion.robot) if np.abs(T - now).max() > _ELSEWHERE]
    yield from _from(vessel, turn)
    yield from _from(_before_the_head(work, side), turn)


def _from(poses: Sequence[Array], turn: int) -> Sequence[Array]:
    """All of them, each `turn` another one first."""
    first = turn % max(len(poses), 1)
    return [*poses[first:], *poses[:first]]


def _before_the_head(work: Work, side: Side) -> list[Array]:
    """T_base_tcp (4, 4) that the arm reaches, those first from which things hang in the middle of the head's view."""
    robot, now, torso = work.motion.robot, work.motion.hand(side), work.motion.torso
    at = _BEFORE_HEAD_M * [1, SIGN[side], 1]
    seen = matmul(at - [0.0, 0.0, _HANGS_M], kin.inverse(robot.head_camera(torso))[:3, :3].T)
    seen += kin.inverse(robot.head_camera(torso))[:3, 3]
    middle = np.argsort(np.abs(np.arctan2(seen[:, :2], seen[:, 2:])).max(1), kind="stable")
    poses = np.stack(
        [kin.transform(matmul(kin.rot_z(turn), now[:3, :3]), p) for p in at[middle] for turn in VESSEL.turns]
    )
    reached, _ = robot.arm_inverse(matmul(kin.inverse(robot.chest(torso)), poses), side, swivels=VESSEL.swivels)
    return [T for T in poses[np.unique(reached)] if np.abs(T - now).max() > _ELSEWHERE]
