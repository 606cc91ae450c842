"""Looking at what a hand holds from each side."""

from __future__ import annotations

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.motion import Actions
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Work

# Our choice, before the chest and in view: how a held thing is turned [rad], and how high it is held out [m],
_SHOWN = ((0.0, 0.75), (1.3, 0.95), (-1.3, 0.85))
_PLACES = ((0.50, 0.10), (0.45, 0.18), (0.55, 0.22), (0.42, 0.05))  # and how far ahead, and toward its own side [m]


def show(work: Work, side: Side) -> Actions:
    """Turn what a hand holds before the head, look at it from each side, and bring it back.

    Poses that are out of reach are left out: what is not seen is not known.
    """
    home = work.motion.hand(side)
    for turn, z in _SHOWN:
        for x, y in _PLACES:
            T = kin.transform(matmul(kin.rot_z(turn * SIGN[side]), home[:3, :3]), (x, y * SIGN[side], z))
            if (path := arm_motion.plan_level(work.body(), side, T)) is not None:
                yield from work.motion.follow(side, path, speed=1.2)
                if (name := work.scene.holding(side)) is not None:
                    yield from look_at(work, name)
                else:
                    yield from work.see("head", side)
                break
    if (path := arm_motion.plan_level(work.body(), side, home)) is not None:
        yield from work.motion.follow(side, path, speed=1.2)
