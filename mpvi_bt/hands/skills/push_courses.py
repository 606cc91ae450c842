"""Ways to push a door, a drawer or a lid shut with the fist."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mpvi_bt.finding.shapes.moving_parts import Door, lid, moved, outward, panel, turned, upright
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.hands.stance.course import SHORT_M, Course


@dataclass(frozen=True)
class PushPoints:
    """Where and how the fist pushes a face.

    Our choice: near the free edge, where least force is needed, and clear of the bar.
    """

    inset_m: tuple[float, ...] = (0.07, 0.12, 0.2)  # distances of the fist from the free edge [m]
    unseen_m: tuple[float, ...] = (0.18, 0.24)  # the same if the bar is hidden [m]; farther in than bars are
    # the same on a lid, where a finger lies along the face and the palm stays beyond the edge [m]
    lid_m: tuple[float, ...] = (0.03, 0.045)
    widest: float = 1.5  # largest inset [ratio of half the face's width]
    inset_cost: float = 3.0  # cost of each meter of inset beyond the first
    edge_m: float = 0.04  # clearance from the upper and the lower edge [m]
    beside_m: float = 0.09  # distance from the end of the bar to the middle of the fist [m]
    spare_m: float = 0.03  # that distance may be less by this [m]
    across_m: float = 0.06  # and is more by this from the bar's axis [m]; a fist is broader across the bar
    step_m: float = 0.1  # distance from a height beyond the bar's end to the next, safer one [m]
    height_cost: float = 0.1  # added cost of each next height
    # heights to push at if no bar is known, off the middle, where bars are [ratio of half the height]
    off_middle: tuple[float, ...] = (0.6, -0.6)
    # places to push a drawer, sideways from its middle, clear of its bar [ratio of half its width]
    aside: tuple[float, ...] = (0.4, -0.4, 0.6, -0.6, 0.0)
    below: tuple[float, ...] = (0.0, -0.3)  # and up from its middle [ratio of half its height]
    turns: tuple[float, ...] = (0.5, 0.75, 0.3, 0.9)  # hand turn per door turn [ratio]; at half, base and arm share it
    turn_cost: float = 1.5  # cost of each unit off the first of these
    leans_rad: tuple[float, ...] = (0.0, 0.5, -0.5, 1.0, -1.0)  # leans along the hinge while pushing a lid [rad]
    lean_cost: float = 0.3  # cost of each radian of lean
    courses: int = 48  # courses that are checked, the cheapest first
    beyond: float = 0.03  # distance of the fist past a known closed position [rad or m]; arms give way


PUSH = PushPoints()


def pushes(hand: Hand, door: Door, beyond: float = PUSH.beyond) -> list[Course]:
    """Ways to push a door, a flap or a drawer shut with the fist, on its outer face, clear of its bar.

    What turns is pushed near its free edge, what slides anywhere.

    Args:
        hand: What pushes.
        door: As it stands.
        beyond: How far beyond the closed door the fist goes [rad or m] if nothing stops it: arms give way.
    """
    face, shut, out_of = panel(door), moved(door, -door.position), outward(door)
    axes, half = face.T[:3, :3], face.half_m
    through = int(np.abs(matmul(out_of, axes)).argmax())
    rising = -np.abs(axes[2]) if door.kind == "slide" else -np.abs(matmul(door.axis, axes))
    up = int(np.where(np.arange(3) == through, 1.0, rising).argmin())
    wide = 3 - up - through
    center = face.T[:3, 3]
    away = axes[:, wide]
    if door.kind == "hinge":
        away = away * np.sign(float(matmul(center - door.origin, away)))  # from the hinge to the free edge
    rise = axes[:, up] * (1.0 if axes[2, up] >= 0 else -1.0)
    out = []
    for point, bias in _points(door, center, away, rise, float(half[wide]), float(half[up])):
        point = point + out_of * half[through]
        if door.bar is not None and _near_bar(door, point):
            continue
        if lid(door):
            out += [_push(hand, door, point, R, 0.0, beyond, more + bias) for R, more in _from_above(door)]
            continue
        for turn in PUSH.turns if door.kind == "hinge" else (0.0,):
            for flip in (1.0, -1.0):
                straight = kin.hand_rotation(-matmul(shut[:3, :3], out_of), flip * np.cross(rise, out_of))
                cost = PUSH.turn_cost * abs(turn - PUSH.turns[0]) + bias
                out.append(_push(hand, door, point, straight, turn, beyond, cost))
    return sorted(out, key=lambda course: course.cost)[: PUSH.courses]


def _from_above(door: Door) -> Iterator[tuple[Array, float]]:
    """Rotations (3, 3) of a fist that goes down with a lid as it is, the fingertips side by side, with their costs."""
    up = matmul(moved(door, -door.position)[:3, :3], outward(door))
    for lean in PUSH.leans_rad:
        approach, along = np.sin(lean) * door.axis - np.cos(lean) * up, np.cos(lean) * door.axis + np.sin(lean) * up
        for flip in (1.0, -1.0):
            yield kin.hand_rotation(approach, flip * along), PUSH.lean_cost * abs(lean)


def _points(door: Door, center: Array, away: Array, rise: Array, wide: float, high: float) -> list[tuple[Array, float]]:
    """Points [m] in the middle plane of a panel to push it at, with their costs."""
    if door.kind == "slide":
        places = product(PUSH.aside, PUSH.below)
        return [(center + away * u * wide + rise * v * high, abs(u) / 10 + abs(v)) for u, v in places]
    out = [
        (center + away * (wide - inset) + rise * height, PUSH.inset_cost * (inset - _insets(door)[0]) + bias)
        for inset in _insets(door) if inset < wide * PUSH.widest
        for height, bias in _heights(door, center, rise, high)
    ]  # fmt: skip
    if door.bar is None and upright(door):  # bars are about the middle of an edge
        out += [
            (center + away * (wide - inset) + rise * v * high, PUSH.inset_cost * (inset - PUSH.inset_m[0]))
            for inset in PUSH.inset_m[:2] for v in PUSH.off_middle if inset < wide * PUSH.widest
        ]  # fmt: skip
    return out


def _insets(door: Door) -> tuple[float, ...]:
    if lid(door):
        return PUSH.lid_m
    return PUSH.inset_m if door.bar is not None else PUSH.unseen_m


def _heights(door: Door, center: Array, rise: Array, half: float) -> list[tuple[float, float]]:
    """Heights [m] on the panel, from its middle, with their costs: beyond the bar's ends first."""
    at, reach = 0.0, 0.0
    if door.bar is not None:
        at, reach = float(matmul(door.bar.center - center, rise)), door.bar.length_m / 2 + PUSH.beside_m
    wanted = [at + reach, at - reach, at + reach + PUSH.step_m, at - reach - PUSH.step_m, at, 0.0]
    return [(h, PUSH.height_cost * k) for k, h in enumerate(dict.fromkeys(wanted)) if abs(h) < half - PUSH.edge_m]


def _near_bar(door: Door, point: Array) -> bool:
    bar = door.bar
    assert bar is not None
    off = point - bar.center
    beyond = max(0.0, abs(float(matmul(off, bar.axis))) - bar.length_m / 2)
    flat = off - bar.axis * float(matmul(off, bar.axis)) - bar.outward * float(matmul(off, bar.outward))
    return bool(np.hypot(beyond, max(0.0, float(norm(flat)) - PUSH.across_m)) < PUSH.beside_m - PUSH.spare_m)


def _push(shape: Hand, door: Door, point: Array, straight: Array, turn: float, beyond: float, cost: float) -> Course:
    start, face = door.position, outward(door)

    def hand(x: float) -> Array:
        at = start - (start + beyond) * x
        R = straight
        if door.kind == "hinge":
            R = matmul(turned(door.axis, turn * at), straight)
        T = moved(door, at - start)
        out = matmul(T[:3, :3], face)
        aside = shape.finger_half_m * float(norm(np.cross(out, R[:, 2])))  # a finger that lies along the face
        return kin.transform(R, matmul(T[:3, :3], point) + T[:3, 3] - shape.tip_m * R[:, 2] + aside * out)

    before = hand(0.0)
    touched = before[:3, 3].copy()

    def carry(x: float) -> Array:
        yaw = -float(np.sign(door.axis[2])) * turn * (start + beyond) * x if upright(door) else 0.0
        R = kin.rot_z(yaw)
        return kin.transform(R, (hand(x)[:3, 3] - matmul(R, touched)) * [1.0, 1.0, 0.0])

    def moving(x: float) -> Sequence[Solid]:
        T = moved(door, -start * x)
        return [s.moved(T) for s in door.solids]

    before[:3, 3] -= SHORT_M * before[:3, 2]
    return Course(before, hand, carry, moving, float(np.arctan2(before[1, 2], before[0, 2])), cost)
