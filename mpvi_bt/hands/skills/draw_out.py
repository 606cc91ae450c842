"""Swing a thing out from what it stands against, like a door: where no finger fits behind it, no hand can close on it.

The closed fingers press on one end of it and move on an arc about the far end: rubber takes the end along. Drawn by its
top a tall thing would fall over; low on its end it does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.approach import approach, arrive, leave, lines, withdraw
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.work import NEAR_M, Work
from mpvi_bt.hands.skills.box_grip import Box, boxes_about
from mpvi_bt.hands.stance.stance import Option


@dataclass(frozen=True)
class DrawingOut:
    """How a thing is swung out from the wall it stands against.

    Our choice, by books, boards and boxes at walls.
    """

    behind_m: float = 0.045  # width that a finger needs behind the thing [m]
    # heights at which that width is checked, from the middle [ratio of the thing's height]
    behind_at: tuple[float, ...] = (-0.2, 0.2, 0.4)
    support_m: float = 0.008  # depth below the underside at which support of the free end is looked for [m]
    # angles of the hand about the far end [rad]; at the last, fingers fit behind the thing
    arc_rad: tuple[float, ...] = (0.0, 0.2, 0.4, 0.6, 0.8)
    speed_m_s: float = 0.08  # speed of the hand [m/s]; slow enough for rubber fingertips to hold by friction
    before_m: float = 0.10  # standoff of the hand before the end of the thing, along its approach [m]
    off_m: float = 0.012  # clearance of the fingers from the end before and after the push [m]
    press_m: float = 0.012  # target of the hand inside the end [m]; the arm's give turns it into force
    slides: float = 0.3  # depth added per radian of the arc, as the thing slides along the wall [ratio of its width]
    away_m: float = 0.03  # retreat of the hand from the end after the arc [m]
    tilts_rad: tuple[float, ...] = (1.2, 0.9, 1.4, 0.6)  # tilts of the approach from straight down, best first [rad]
    tilt_cost: float = 0.2  # cost of each radian off the best
    turns_rad: tuple[float, ...] = (0.0, 0.3, -0.3, 0.6, -0.6)  # turns of the hand about the vertical [rad]
    turn_cost: float = 0.3  # cost of each radian of turn
    depths_m: tuple[float, ...] = (0.022, 0.03, 0.04)  # distances of the tcp before the side that is pressed [m]
    depth_cost: float = 5.0  # cost of each meter of that distance
    above_m: float = 0.02  # height of the tcp above the underside, if there is room [m]; at most half the thing
    low: float = 0.6  # largest height of the tcp [ratio of the thing's height]; pushed higher up, a thing falls over
    flat_m: float = 0.03  # height up to which nothing falls over [m]
    edge_m: float = 0.006  # least distance of the fingers below a flat thing's upper edge, or they slip over it [m]


_DRAW = DrawingOut()


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
    yield from motion.grip(side, -1.0, GRIP.empty_s)
    try:
        stance = yield from arrive(work, stance, search, lambda: options(work, name))
        yield from lines(work, side, stance, [1])
        shift = matmul(kin.inverse(work.base), kin.base(stance.base))
        for T in stance.waypoints[2:-1]:
            yield from motion.line(side, matmul(shift, T), _DRAW.speed_m_s, give_rad=np.inf)
        motion.action[motion.layout.arm[side]] = motion.felt.arm[side]
        yield from lines(work, side, stance, [len(stance.waypoints) - 1])
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from leave(work, stance)
    yield from motion.grip(side, 1.0, GRIP.empty_s)
    yield from settle(work, without={name})


def options(work: Work, name: str) -> list[Option]:
    """Ways to swing a thing out. Raises MotionFailure "no_stance" where nothing stands behind it."""
    out = [option for swing in _swings(work, name) for option in _ways(work.motion.robot.hand, swing)]
    if not out:
        raise work.no_stance()  # with what the search for a grasp of it died of
    return out


def _swings(work: Work, name: str) -> Iterator[_Swing]:
    near = work.scene.obstacles(work.motion.felt.base_pose[:2], NEAR_M, without=work.along(name))
    for box in boxes_about(work.scene.pose(name), list(work.scene.solids(name))):
        ahead = np.array([np.cos(box.heading), np.sin(box.heading), 0.0])
        back = box.middle - ahead * box.length / 2
        heights = np.array([[0.0, 0.0, z * box.height] for z in _DRAW.behind_at])
        if (near.distance(back - ahead * _DRAW.behind_m / 2 + heights) > _DRAW.behind_m / 2).all():
            continue
        across = np.array([-ahead[1], ahead[0], 0.0]) * box.width / 2
        for sign in (1.0, -1.0):
            swing = _Swing(box, (back + sign * across)[:2], (back - sign * across)[:2])
            out = matmul(kin.rot_z(-sign * _DRAW.arc_rad[-1]), box.middle - back + sign * across)
            below = np.append(swing.pivot + out[:2], box.bottom - _DRAW.support_m)
            if below[2] < 0 or near.distance(below) <= 2 * _DRAW.support_m:
                yield swing


def _ways(hand: Hand, swing: _Swing) -> Iterator[Option]:
    box = swing.box
    ahead = np.array([np.cos(box.heading), np.sin(box.heading), 0.0])
    radial = np.append(swing.end - swing.pivot, 0.0)
    radial /= norm(radial)
    turning = float(np.sign(np.cross(radial, ahead)[2]))
    for tilt in _DRAW.tilts_rad:
        z = box.bottom + max(hand.lowest(tilt), min(_DRAW.above_m, 0.5 * box.height))
        if z > box.bottom + max(_DRAW.low * box.height, min(_DRAW.flat_m, box.height - _DRAW.edge_m)):
            continue
        s, c = float(np.sin(tilt)), float(np.cos(tilt))
        for turn in _DRAW.turns_rad:
            approach = -s * matmul(kin.rot_z(turn), ahead) + [0, 0, -c]
            for depth in (d for d in _DRAW.depths_m if d <= box.length):
                start = np.append(swing.end, z) + ahead * depth + radial * hand.closed_half_m
                R = kin.hand_rotation(approach, matmul(kin.rot_z(turn), radial))
                arm = start[:2] - swing.pivot
                points = [start - _DRAW.before_m * approach + radial * _DRAW.off_m, start + radial * _DRAW.off_m]
                for angle in _DRAW.arc_rad:
                    out = matmul(kin.rot_z(turning * angle)[:2, :2], arm)
                    slid = radial * (_DRAW.press_m + _DRAW.slides * angle * box.width)
                    points.append(np.append(swing.pivot + out, z) - slid)
                off = matmul(kin.rot_z(turning * _DRAW.arc_rad[-1]), radial)
                points.append(points[-1] + _DRAW.away_m * off + 0.5 * _DRAW.before_m * ahead)
                waypoints = np.stack([kin.transform(R, p) for p in points])
                turned = _DRAW.turn_cost * abs(turn) + _DRAW.tilt_cost * abs(tilt - _DRAW.tilts_rad[0])
                yield Option(waypoints, 1, turned + _DRAW.depth_cost * depth, opening_m=0.0)
