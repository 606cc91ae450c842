"""Swing a thing out from what it stands against, like a door: where no finger fits behind it, no hand can close on it.

The closed fingers press on one end of it and move on an arc about the far end: rubber takes the end along. Drawn by its
top a tall thing would fall over; low on its end it does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mpvi_bt.manipulation.motion.approach import approach, arrive, leave, lines, withdraw
from mpvi_bt.manipulation.motion.carry import settle
from mpvi_bt.manipulation.motion.work import Work
from mpvi_bt.manipulation.skills.two_hands import Box, boxes_about
from mpvi_bt.manipulation.stance.stance import Option
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.hand import Hand
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.motion import Actions, MotionFailure
from mpvi_bt.robot.protocol import ActionLayout, Side
from mpvi_bt.robot.solids import Array

_NEAR_M = 1.7
_BEHIND_M = 0.045  # less room than that behind a side is none for a finger
_SUPPORT_M = 0.008
_BEFORE_M = 0.10
_OFF_M = 0.012  # between the fingers and the end of the thing, before and afterward
_PRESS_M = 0.012  # how far beyond its end the hand is told to go, more and more along the arc:
_SLIDES = 0.3  # of the way out, as the thing gives way along the wall
_ARC_RAD = (0.0, 0.2, 0.4, 0.6, 0.8)
_SPEED_M_S = 0.08
_TILTS = (1.2, 0.9, 1.4, 0.6)  # of the approach from straight down
_TURNS = (0.0, 0.3, -0.3, 0.6, -0.6)
_DEPTHS_M = (0.022, 0.03, 0.04)  # of the tcp before the side that touches
_LOW = 0.6  # of the thing's height: higher up it would rather fall over than turn,
_FLAT_M, _EDGE_M = 0.03, 0.006  # but so low down anything turns, as long as the fingers do not slip over its edge


@dataclass(frozen=True, eq=False)
class _Swing:
    """An end of a thing and the far end that it turns about, at the side that touches: corners (2,) in the world."""

    box: Box  # seen from the side that touches: it is to go along its heading
    end: Array
    pivot: Array


def draw_out(work: Work, name: str, side: Side) -> Actions:
    """Swing a thing out by up to 45 degrees with one hand, and fold the arm.

    Args:
        work: Robot and world.
        name: The thing.
        side: The hand.

    Raises:
        MotionFailure: "no_stance" if nothing stands behind it or no end of it is in reach, or a motion's own reason.
    """
    motion = work.motion
    tried: list[Array] = []
    stance, search = yield from approach(work, side, name, lambda: options(work, name), tried)
    yield from motion.grip(side, -1.0, 0.3)
    try:
        stance = yield from arrive(work, stance, search, lambda: options(work, name))
        yield from lines(work, side, stance, [1])
        shift = matmul(kin.inverse(work.base), kin.base(stance.base))
        for T in stance.waypoints[2:-1]:
            yield from motion.line(side, matmul(shift, T), _SPEED_M_S, give_rad=np.inf)
        motion.action[ActionLayout.ARM[side]] = motion.felt.arm[side]
        yield from lines(work, side, stance, [len(stance.waypoints) - 1])
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from leave(work, stance)
    yield from motion.grip(side, 1.0, 0.3)
    yield from settle(work, without={name})


def options(work: Work, name: str) -> list[Option]:
    """Ways to swing a thing out. Raises MotionFailure "no_stance" where nothing stands behind it."""
    out = [option for swing in _swings(work, name) for option in _ways(work.motion.robot.hand, swing)]
    if not out:
        raise work.no_stance()  # with what the search for a grasp of it died of
    return out


def _swings(work: Work, name: str) -> Iterator[_Swing]:
    near = work.scene.obstacles(work.motion.felt.base_pose[:2], _NEAR_M, without=work.along(name))
    for box in boxes_about(work.scene.pose(name), list(work.scene.solids(name))):
        ahead = np.array([np.cos(box.heading), np.sin(box.heading), 0.0])
        back = box.middle - ahead * box.length / 2
        heights = np.array([[0.0, 0.0, z * box.height] for z in (-0.2, 0.2, 0.4)])
        if (near.distance(back - ahead * _BEHIND_M / 2 + heights) > _BEHIND_M / 2).all():
            continue
        across = np.array([-ahead[1], ahead[0], 0.0]) * box.width / 2
        for sign in (1.0, -1.0):
            swing = _Swing(box, (back + sign * across)[:2], (back - sign * across)[:2])
            out = matmul(kin.rot_z(-sign * _ARC_RAD[-1]), box.middle - back + sign * across)
            below = np.append(swing.pivot + out[:2], box.bottom - _SUPPORT_M)
            if below[2] < 0 or near.distance(below) <= 2 * _SUPPORT_M:
                yield swing


def _ways(hand: Hand, swing: _Swing) -> Iterator[Option]:
    box = swing.box
    ahead = np.array([np.cos(box.heading), np.sin(box.heading), 0.0])
    radial = np.append(swing.end - swing.pivot, 0.0)
    radial /= norm(radial)
    turning = float(np.sign(np.cross(radial, ahead)[2]))
    for tilt in _TILTS:
        z = box.bottom + max(hand.lowest(tilt), min(0.02, 0.5 * box.height))
        if z > box.bottom + max(_LOW * box.height, min(_FLAT_M, box.height - _EDGE_M)):
            continue
        s, c = float(np.sin(tilt)), float(np.cos(tilt))
        for turn in _TURNS:
            approach = -s * matmul(kin.rot_z(turn), ahead) + [0, 0, -c]
            for depth in (d for d in _DEPTHS_M if d <= box.length):
                start = np.append(swing.end, z) + ahead * depth + radial * hand.closed_half_m
                R = kin.hand_rotation(approach, matmul(kin.rot_z(turn), radial))
                arm = start[:2] - swing.pivot
                points = [start - _BEFORE_M * approach + radial * _OFF_M, start + radial * _OFF_M]
                for angle in _ARC_RAD:
                    out = matmul(kin.rot_z(turning * angle)[:2, :2], arm)
                    slid = radial * (_PRESS_M + _SLIDES * angle * box.width)
                    points.append(np.append(swing.pivot + out, z) - slid)
                off = matmul(kin.rot_z(turning * _ARC_RAD[-1]), radial)
                points.append(points[-1] + 0.03 * off + 0.5 * _BEFORE_M * ahead)
                waypoints = np.stack([kin.transform(R, p) for p in points])
                yield Option(waypoints, 1, 0.3 * abs(turn) + 0.2 * abs(tilt - 1.2) + 5.0 * depth, opening_m=0.0)
