"""What networks are told and what they answer, in numpy, alike in training and in acting.

Everything is of the right hand; what the left one is to do is mirrored before and after (`body.py`). n is a number of
moments. A stance says where the robot is to be when its hand closes or opens: base x, y [m], yaw [rad] in the world,
torso (4) and arm (7) joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rotations import rotation
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.learned.mirroring import BODY, SIDE

WAYPOINTS = 8  # of a chunk
STRIDE = 3  # control steps from one to the next: 10 Hz
# Of a waypoint, relative to now: base x, y, yaw; torso; arm; shift and turn of the hand in its frame; gripper.
WAYPOINT = {"base": slice(0, 3), "torso": slice(3, 7), "arm": slice(7, 14), "shift": slice(14, 17),
            "turn": slice(17, 20), "grip": slice(20, 21)}  # fmt: skip
WAYPOINT_SIZE = 21
# What a network's answer of 1 stands for [m, rad]. Our choice.
SCALE = np.array([0.1] * 3 + [0.05, 0.1, 0.1, 0.2] + [0.2] * 7 + [0.06] * 3 + [0.2] * 3 + [0.5])
STANCE = {"base": slice(0, 3), "torso": slice(3, 7), "arm": slice(7, 14)}
STANCE_SIZE = 14
HYPOTHESIS_SIZE = STANCE_SIZE + 9  # a stance, the hand's position, x axis and y axis
FELT_SIZE = 76
# Our choice.
_NEAR = 5.0  # points and ways [m] near the hand are told magnified so,
_MOST = 4.0  # up to so much
_PROPOSER_NEAR = 3.0  # likewise, for the proposer


@dataclass(frozen=True, eq=False)
class Moments:
    """What the robot feels and what it was told last.

    Attributes:
        base: (n, 3) x, y [m], yaw [rad] in the world.
        torso: (n, 4), arm: (n, 7) joints.
        width: (n,) between the fingers [m].
        velocity: (n, 3) of the base in its frame [m/s, rad/s].
        told_torso: (n, 4), told_arm: (n, 7), told_grip: (n,) the commands in force.
    """

    base: Array
    torso: Array
    arm: Array
    width: Array
    velocity: Array
    told_torso: Array
    told_arm: Array
    told_grip: Array

    @cached_property
    def hands(self) -> Array:
        """(n, 4, 4) T_base_hand."""
        return BODY.tcp(self.torso, self.arm, SIDE)

    @cached_property
    def frames(self) -> Array:
        """(n, 4, 4) T_world_base."""
        return bases(self.base)

    @cached_property
    def hands_in_world(self) -> Array:
        """(n, 4, 4) T_world_hand."""
        return matmul(self.frames, self.hands)


def bases(base: Array) -> Array:
    """(n, 4, 4) T_world_base of (n, 3) x, y [m], yaw [rad]."""
    p = np.concatenate([base[..., :2], np.zeros_like(base[..., :1])], -1)
    return kin.transform(kin.rot_z(base[..., 2]), p)


def hand_at(stance: Array) -> Array:
    """(n, 4, 4) T_world_hand of stances (n, 14)."""
    return matmul(bases(stance[..., STANCE["base"]]), BODY.tcp(stance[..., 3:7], stance[..., 7:14], SIDE))


def actor_inputs(now: Moments, stance: Array, points: Array, targets: int) -> tuple[Array, Array]:
    """What the actor is told.

    Args:
        now: n moments.
        stance: (n, 14) that it is to come to.
        points: (n, m, 3) in the world [m].
        targets: How many of them, the first ones, are of the target.

    Returns:
        (n, m, 9) points in the frames of hand, base and the hand at the stance, and (n, 76) all else.
    """
    T_base, T_hand, T_goal = now.frames, now.hands_in_world, hand_at(stance)
    to_hand, to_base, to_goal = (_moved(kin.inverse(T), points) for T in (T_hand, T_base, T_goal))
    near = [np.clip(p * _NEAR, -_MOST, _MOST) for p in (to_hand, to_goal)]
    way = matmul(kin.inverse(T_base), bases(stance[:, :3]))
    yaw = np.arctan2(way[:, 1, 0], way[:, 0, 0])
    told = [
        now.torso, now.arm, (now.told_arm - now.arm) * 10, now.width[:, None] * 10, now.told_grip[:, None],
        now.velocity, _nine(now.hands), np.stack([way[:, 0, 3], way[:, 1, 3], way[:, 0, 0], way[:, 1, 0]], 1),
        stance[:, 3:7] - now.told_torso, stance[:, 7:14] - now.told_arm, stance[:, 7:14],
        _nine(matmul(kin.inverse(T_hand), T_goal)), *(p[:, :targets].mean(1) for p in (to_hand, to_base, to_goal)),
        yaw[:, None] * 5, np.clip(way[:, :2, 3] * 10, -2, 2), norm(way[:, :2, 3])[:, None],
    ]  # fmt: skip
    return np.concatenate([near[0], to_base, near[1]], 2), np.concatenate(told, 1)


def waypoints(now: Moments, base: Array, torso: Array, arm: Array, grip: Array) -> Array:
    """(n, 8, 21) what the actor is to answer.

    Args:
        now: n moments.
        base: (n, 8, 3) where the base will be.
        torso: (n, 8, 4), arm: (n, 8, 7), grip: (n, 8) what will have been commanded.
    """
    way = matmul(kin.inverse(now.frames)[:, None], bases(base))
    moved = np.stack([way[..., 0, 3], way[..., 1, 3], np.arctan2(way[..., 1, 0], way[..., 0, 0])], -1)
    T_told = BODY.tcp(now.told_torso, now.told_arm, SIDE)
    shift = matmul(kin.inverse(T_told)[:, None], BODY.tcp(torso, arm, SIDE))
    turn = rotation(shift[..., :3, :3].reshape(-1, 3, 3)).as_rotvec().reshape(*moved.shape)
    joints = [torso - now.told_torso[:, None], arm - now.told_arm[:, None]]
    return np.concatenate([moved, *joints, shift[..., :3, 3], turn, grip[..., None]], -1)


@dataclass(frozen=True, eq=False)
class TargetFrame:
    """The frame that stances are proposed in: at the target's middle, x from the robot to it, z up.

    Attributes:
        T_world: (n, 4, 4) it; its origin is on the floor.
        bearing: (n,) of its x axis [rad].
        height_m: (n,) of the target's middle.
        told: (n, 4) how far the robot is, how it is turned to the target (sine, cosine), and that height.
    """

    T_world: Array
    bearing: Array
    height_m: Array
    told: Array

    @classmethod
    def of(cls, base: Array, points: Array, targets: int) -> TargetFrame:
        """From bases (n, 3) and points (n, m, 3) in the world, the first `targets` of the target."""
        middle = points[:, :targets].mean(1)
        away = middle[:, :2] - base[:, :2]
        bearing = np.arctan2(away[:, 1], away[:, 0])
        turn = base[:, 2] - bearing
        told = np.stack([norm(away), np.sin(turn), np.cos(turn), middle[:, 2]], 1)
        T = bases(np.stack([middle[:, 0], middle[:, 1], bearing], 1))
        return cls(T, bearing, middle[:, 2], told)

    def points(self, points: Array) -> Array:
        """(n, m, 4) points (n, m, 3) of the world, magnified, and their height."""
        p = _moved(kin.inverse(self.T_world), points) * _PROPOSER_NEAR
        height = p[..., 2:].copy()
        p[..., 2] -= self.height_m[:, None] * _PROPOSER_NEAR
        return np.concatenate([np.clip(p * 4, -_MOST, _MOST), height], 2)

    def hypothesis(self, stance: Array) -> Array:
        """(n, 23) stances (n, 14) of the world in this frame, with the hand's position above the middle and axes."""
        way = matmul(kin.inverse(self.T_world), bases(stance[:, :3]))
        hand = matmul(kin.inverse(self.T_world), hand_at(stance))
        hand[:, 2, 3] -= self.height_m
        yaw = kin.wrap(stance[:, 2] - self.bearing)
        return np.concatenate([way[:, :2, 3], yaw[:, None], stance[:, 3:], _nine(hand)], 1)

    def stance(self, hypothesis: Array) -> tuple[Array, Array]:
        """Of the first moment: stances (k, 14) and hands (k, 4, 4) in the world of hypotheses (k, 23)."""
        T = self.T_world[0]
        at = matmul(T, bases(hypothesis[:, :3]))
        yaw = kin.wrap(hypothesis[:, 2] + self.bearing[0])
        stance = np.concatenate([at[:, :2, 3], yaw[:, None], hypothesis[:, 3:14]], 1)
        x = hypothesis[:, 17:20] / norm(hypothesis[:, 17:20])[:, None]
        y = hypothesis[:, 20:23] - x * (x * hypothesis[:, 20:23]).sum(1, keepdims=True)
        y /= norm(y)[:, None]
        hand = kin.transform(np.stack([x, y, np.cross(x, y)], 2), hypothesis[:, 14:17])
        hand[:, 2, 3] += self.height_m[0]
        return stance, matmul(T, hand)


def _moved(T: Array, points: Array) -> Array:
    """(n, m, 3) points (n, m, 3) by transforms (n, 4, 4)."""
    return matmul(points, np.swapaxes(T[:, :3, :3], 1, 2)) + T[:, None, :3, 3]


def _nine(T: Array) -> Array:
    """(n, 9) position, x axis and y axis of transforms (n, 4, 4)."""
    return np.concatenate([T[:, :3, 3], T[:, :3, 0], T[:, :3, 1]], 1)
