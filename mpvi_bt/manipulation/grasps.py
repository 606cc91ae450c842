"""Grasp candidates of a two-finger hand on things of known shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpvi_bt.manipulation.scene import Scene
from mpvi_bt.robot.kinematics import hand_rotation, inverse, transform
from mpvi_bt.robot.solids import Array, Solid

MAX_WIDTH_M = 0.086  # what 10 cm of opening takes with a margin
_PALM_M = 0.038  # how far behind the tcp a thing may reach before it meets the palm
_TIP_M = 0.016  # the fingertips reach this far past the tcp, with a margin
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Grasp:
    """One way to take hold of a thing.

    Attributes:
        T_world_tcp: (4, 4) where the hand closes.
        tilt_rad: Of the approach from straight down; pi/2 is level.
        cost: Preference; smaller is better.
    """

    T_world_tcp: Array
    tilt_rad: float
    cost: float


def grasps(scene: Scene, name: str, bearing: float) -> list[Grasp]:
    """Candidates for a thing, the handles' first if it has any.

    Args:
        scene: Where the thing is.
        name: The thing.
        bearing: Heading [rad] from the robot to it; hands come from the robot's side.
    """
    bars = scene.handles(name)
    if bars:
        return [g for bar in bars for g in _on_bar(bar.center, bar.axis, bearing)]
    return _pinches(scene.pose(name), list(scene.solids(name)), bearing)


def _on_bar(center: Array, axis: Array, bearing: float) -> list[Grasp]:
    """From above or slantwise, closing across the bar."""
    across = np.cross(axis, _UP)
    if np.linalg.norm(across) < 0.5:  # an upright bar: level, at several headings
        return [_grasp(np.pi / 2, bearing + a, center, 0.5 * abs(a)) for a in (0.0, 0.4, -0.4, 0.8, -0.8)]
    out = []
    for sign in (1.0, -1.0):
        R = hand_rotation(-_UP, sign * across)
        out.append(Grasp(transform(R, center), 0.0, 0.0))
    return out


def _pinches(T: Array, solids: list[Solid], bearing: float) -> list[Grasp]:
    """Between two sides, from straight above to level."""
    frame = inverse(T)
    corners = np.stack([s.moved(frame).aabb() for s in solids])
    low, high = corners[:, 0].min(0), corners[:, 1].max(0)
    size, middle = high - low, T[:3, :3] @ ((low + high) / 2) + T[:3, 3]
    up = int(np.abs(T[2, :3]).argmax())
    flat = [i for i in range(3) if i != up]
    height, top, bottom = size[up], middle[2] + size[up] / 2, middle[2] - size[up] / 2
    spheres = all(s.kind == "sphere" for s in solids)
    upright = all(s.kind == "cylinder" and abs(s.T[2, 2]) > 0.95 for s in solids)
    round_ = spheres or upright
    out: list[Grasp] = []
    headings: list[tuple[float, float]] = []  # heading of the approach, half width across it
    if round_:
        if size[flat[0]] > MAX_WIDTH_M:
            return []
        headings = [(bearing + a, size[flat[0]] / 2) for a in (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)]
    else:
        for i, j in (flat, flat[::-1]):
            if size[i] <= MAX_WIDTH_M:
                closing = T[:3, i]
                heading = float(np.arctan2(-closing[0], closing[1]))
                headings += [(heading, size[j] / 2), (heading + np.pi, size[j] / 2)]
    for heading, radius in headings:
        aside = abs(float(np.arctan2(np.sin(heading - bearing), np.cos(heading - bearing))))
        for tilt in (0.0, 0.45, 0.9, 1.3):
            if tilt > 0.2 and (height < 0.035 or aside > 1.6):
                continue
            z = top - max(0.012, (_PALM_M - radius * np.sin(tilt)) / max(np.cos(tilt), 0.3))
            z = float(
                np.clip(
                    max(z, bottom + 0.45 * height),
                    bottom + _TIP_M + 0.03 * np.sin(tilt),
                    max(top - 0.012, bottom + _TIP_M),
                )
            )
            approach = np.array([np.cos(heading) * np.sin(tilt), np.sin(heading) * np.sin(tilt), -np.cos(tilt)])
            over = max(0.0, radius * np.sin(tilt) + (top - z) * np.cos(tilt) - _PALM_M + 0.004)
            if over > 0.02 or (tilt > 0.2 and z < bottom + _TIP_M):
                continue
            p = np.array([middle[0], middle[1], z]) - over * approach
            out.append(_grasp(tilt, heading, p, 0.3 * aside + 0.4 * tilt))
    return out


def _grasp(tilt: float, heading: float, p: Array, cost: float) -> Grasp:
    approach = np.array([np.cos(heading) * np.sin(tilt), np.sin(heading) * np.sin(tilt), -np.cos(tilt)])
    closing = np.array([-np.sin(heading), np.cos(heading), 0.0])
    return Grasp(transform(hand_rotation(approach, closing), p), tilt, cost)
