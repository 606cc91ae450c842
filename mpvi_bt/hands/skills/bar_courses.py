"""Ways to hold a door, a drawer or a lid by its bar and swing it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.shapes.moving_parts import Bar, Door, lid, moved, turned, upright
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.hands.stance.course import Course


@dataclass(frozen=True)
class BarGrip:
    """How a hand holds a bar while it leads a door, lid or drawer."""

    short_m: float = 0.11  # standoff of the open hand before the bar [m]; our choice
    along: tuple[float, ...] = (0.0, 0.3, -0.3)  # grip places, from the bar's middle [ratio of its length]; our choice
    along_cost: float = 0.5  # cost of each bar length off the middle; our choice
    turns: tuple[float, ...] = (0.5, 0.3, 0.7)  # hand turn per door turn [ratio]; half is the base's; our choice
    # hand turn per lid turn [ratio]; fingers hold fast, and a loose box would tilt with the hand; our choice
    lid_turns: tuple[float, ...] = (1.0, 0.85, 0.7)
    turn_cost: float = 2.0  # cost of each unit off the first of `turns`; our choice


_GRIP = BarGrip()


def swings(door: Door, bar: Bar, to: float) -> list[Course]:
    """Ways to hold a door by its bar and move it to a position [rad or m]."""
    closed = moved(door, -door.position)[:3, :3]
    outward, along = matmul(closed, bar.outward), matmul(closed, bar.axis)
    out = []
    turns = (0.0,) if door.kind != "hinge" else _GRIP.lid_turns if lid(door) else _GRIP.turns
    for turn in turns:
        for flip in (1.0, -1.0):
            for shift in _GRIP.along:
                straight = kin.hand_rotation(-outward, flip * np.cross(along, outward))
                grip = bar.center + bar.axis * shift * bar.length_m
                cost = _GRIP.turn_cost * abs(turn - turns[0]) + _GRIP.along_cost * abs(shift)
                out.append(_swing(door, grip, straight, turn, to, cost))
    return out


def _swing(door: Door, grip: Array, straight: Array, turn: float, to: float, cost: float) -> Course:
    start = door.position

    def hand(x: float) -> Array:
        at = start + (to - start) * x
        R = straight
        if door.kind == "hinge":
            R = matmul(turned(door.axis, turn * at), straight)
        T = moved(door, at - start)
        return kin.transform(R, matmul(T[:3, :3], grip) + T[:3, 3])

    before = hand(0.0)
    touched = before[:3, 3].copy()

    def carry(x: float) -> Array:
        now = hand(x)[:3, 3]
        yaw = float(np.sign(door.axis[2])) * turn * (to - start) * x if upright(door) else 0.0
        R = kin.rot_z(yaw)
        shift = now - matmul(R, touched)
        return kin.transform(R, shift * [1.0, 1.0, 0.0])

    def moving(x: float) -> list[Solid]:
        T = moved(door, (to - start) * x)
        return [s.moved(T) for s in door.solids]

    before[:3, 3] -= _GRIP.short_m * before[:3, 2]
    z = before[:3, 2]
    return Course(before, hand, carry, moving, float(np.arctan2(z[1], z[0])), cost)
