"""Trunks: from a robot's four torso joints to the place, height, yaw and pitch of its chest.

Planning thinks in postures, which mean the same for every robot; what is felt and commanded are joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array

_ROUNDING = 1e-9  # [rad] that a joint at its limit may be computed beyond it


class Trunk(Protocol):
    """What carries the chest.

    A posture is lift [m], yaw, pitch, head tilt [rad]: how high the chest is above its lowest, which way it is turned,
    how far it is bent forward, and the head against it. At one lift the shoulders of all upright robots are about
    equally high, 0.78 m and the lift.
    """

    @property
    def joint_limits(self) -> Array:
        """(4, 2) lowest and highest joint positions [m or rad]; both 0 where there is no such joint."""
        ...

    @property
    def limits(self) -> Array:
        """(4, 2) lowest and highest of postures; within them each lift goes with each pitch."""
        ...

    def posture(self, joints: Array) -> Array:
        """(..., 4) the posture that joints (..., 4) are in."""
        ...

    def joints(self, posture: Array, near: Array | None = None) -> Array:
        """(..., 4) joints for postures (..., 4) within the limits; of several those nearest to joints (4,)."""
        ...

    def chest(self, joints: Array) -> Array:
        """T_base_chest (..., 4, 4)."""
        ...

    def links(self, joints: Array) -> Array:
        """T_base_link (F, 4, 4), at joints (4,), of the parts between base and chest that move."""
        ...


@dataclass(frozen=True, eq=False)
class LiftTrunk:
    """A lift, then yaw, then pitch, then the head's tilt: its joints are its posture.

    Attributes:
        waist: (3,) where the lift's zero is in the base frame [m].
        chest_m: How far the chest's origin is above that of the lift.
        limits: (4, 2) [m, rad]; 0, 0 for a joint that it does not have.
    """

    waist: Array
    chest_m: float
    limits: Array

    @property
    def joint_limits(self) -> Array:
        """The same."""
        return self.limits

    def posture(self, joints: Array) -> Array:
        """The same numbers."""
        return np.array(joints, float)

    def joints(self, posture: Array, near: Array | None = None) -> Array:
        """The same numbers."""
        return np.array(posture, float)

    def chest(self, joints: Array) -> Array:
        """T_base_chest (..., 4, 4) of lift, yaw, pitch (..., >= 3)."""
        joints = np.asarray(joints, float)
        yaw, pitch = joints[..., 1], joints[..., 2]
        c, s, ahead, aside = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
        T = np.zeros((*joints.shape[:-1], 4, 4))  # a turn about z, then one about y: searches ask this very often
        T[..., 0, 0], T[..., 0, 1], T[..., 0, 2] = ahead * c, -aside, ahead * s
        T[..., 1, 0], T[..., 1, 1], T[..., 1, 2] = aside * c, ahead, aside * s
        T[..., 2, 0], T[..., 2, 2] = -s, c
        T[..., 0, 3], T[..., 1, 3] = self.waist[:2]
        T[..., 2, 3] = self.waist[2] + joints[..., 0] + self.chest_m
        T[..., 3, 3] = 1.0
        return T

    def links(self, joints: Array) -> Array:
        """One link: the carriage on the column, below the turning part."""
        return kin.transform(np.eye(3), self.waist + [0.0, 0.0, float(joints[0])])[None]


@dataclass(frozen=True, eq=False)
class FoldingTrunk:
    """Hip, knee and waist that pitch in one plane, then a yaw about the bent trunk's axis; the head is fixed.

    Joints: hip and knee bend forward, the waist (positive) back: pitch = hip + knee - waist. With three joints in a
    plane the chest's x is free where its height and pitch are given. Our choice: it is as near to what it was, or to
    `forward_m`, as the joints reach, with the knee in front (knee <= 0): neighboring postures have neighboring joints.

    Attributes:
        hip: (2,) x and z of the hip in the base frame [m].
        thigh_m, shin_m, neck_m: Hip to knee, knee to waist, waist to the chest's origin (up the bent trunk).
        forward_m: x of the chest that is aimed at where nothing is said of what it was.
        ground_m: z of the chest at a lift of 0.
        joint_limits: (4, 2) [rad].
        limits: (4, 2) of postures; that of the tilt is 0, 0.
    """

    hip: Array
    thigh_m: float
    shin_m: float
    neck_m: float
    forward_m: float
    ground_m: float
    joint_limits: Array
    limits: Array

    def posture(self, joints: Array) -> Array:
        """The chest's height above `ground_m`, yaw, pitch, and 0."""
        joints = np.asarray(joints, float)
        out = np.zeros(joints.shape)
        out[..., 0] = self._place(joints)[1] - self.ground_m
        out[..., 1] = joints[..., 3]
        out[..., 2] = joints[..., 0] + joints[..., 1] - joints[..., 2]
        return out

    def joints(self, posture: Array, near: Array | None = None) -> Array:
        """Joints with the chest as far forward as at `near`, if possible; the posture is clipped to the limits."""
        forward = self.forward_m if near is None else float(self._place(np.asarray(near, float))[0])
        posture = np.clip(np.asarray(posture, float), *self.limits.T)
        yaw, pitch = posture[..., 1], posture[..., 2]
        a, b = self.thigh_m, self.shin_m
        up = self.ground_m + posture[..., 0] - self.hip[1] - self.neck_m * np.cos(pitch)  # of the waist above the hip
        aim = forward - self.hip[0] - self.neck_m * np.sin(pitch)  # and before it
        # The nearest place has the waist where it is aimed at, or one of the joints at its limit.
        ahead = np.stack(np.broadcast_arrays(aim, *self._at_limits(up, pitch)))
        cosine = (ahead**2 + up**2 - a**2 - b**2) / (2 * a * b)
        knee = -np.arccos(np.clip(cosine, -1.0, 1.0))
        hip = np.arctan2(ahead, up) - np.arctan2(b * np.sin(knee), a + b * np.cos(knee))
        found = np.stack([hip, knee, hip + knee - pitch, np.broadcast_to(yaw, hip.shape)], -1)
        low, high = self.joint_limits.T
        able = (np.abs(cosine) <= 1 + _ROUNDING) & ((low - _ROUNDING <= found) & (found <= high + _ROUNDING)).all(-1)
        best = np.where(able, np.abs(ahead - aim), np.inf).argmin(0)
        return np.clip(np.take_along_axis(found, best[None, ..., None], 0)[0], low, high)

    def _at_limits(self, up: Array, pitch: Array) -> Iterator[Array]:
        """How far before the hip the waist is, so far up, with one joint at a limit; nan where it cannot be."""
        a, b = self.thigh_m, self.shin_m
        hips, knees, waists = self.joint_limits[:3]
        with np.errstate(invalid="ignore"):
            for hip in hips:
                beyond = np.sqrt(b**2 - (up - a * np.cos(hip)) ** 2)
                yield a * np.sin(hip) + beyond
                yield a * np.sin(hip) - beyond
            for knee in (knees[0], 0.0):
                beyond = np.sqrt(a**2 + b**2 + 2 * a * b * np.cos(knee) - up**2)
                yield beyond
                yield -beyond
            for waist in waists:
                lean = pitch + waist
                beyond = np.sqrt(a**2 - (up - b * np.cos(lean)) ** 2)
                yield b * np.sin(lean) + beyond
                yield b * np.sin(lean) - beyond

    def chest(self, joints: Array) -> Array:
        """T_base_chest (..., 4, 4)."""
        joints = np.asarray(joints, float)
        pitch, yaw = joints[..., 0] + joints[..., 1] - joints[..., 2], joints[..., 3]
        c, s, ahead, aside = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
        T = np.zeros((*joints.shape[:-1], 4, 4))  # a turn about y, then one about z: searches ask this very often
        T[..., 0, 0], T[..., 0, 1], T[..., 0, 2] = c * ahead, -c * aside, s
        T[..., 1, 0], T[..., 1, 1] = aside, ahead
        T[..., 2, 0], T[..., 2, 1], T[..., 2, 2] = -s * ahead, s * aside, c
        T[..., 0, 3], T[..., 2, 3] = self._place(joints)
        T[..., 3, 3] = 1.0
        return T

    def links(self, joints: Array) -> Array:
        """Thigh at the hip, shin at the knee, waist at the waist; z up along each."""
        hip, knee, waist = np.asarray(joints, float)[:3]
        lean = np.array([hip, hip + knee, hip + knee - waist])
        steps = np.array([self.thigh_m, self.shin_m])[:, None] * np.stack([np.sin(lean[:2]), np.cos(lean[:2])], -1)
        xz = self.hip + np.concatenate([np.zeros((1, 2)), steps.cumsum(0)])
        return kin.transform(kin.rot_y(lean), np.stack([xz[:, 0], np.zeros(3), xz[:, 1]], -1))

    def _place(self, joints: Array) -> tuple[Array, Array]:
        """x and z of the chest, each (...)."""
        thigh = joints[..., 0]
        shin = thigh + joints[..., 1]
        neck = shin - joints[..., 2]
        a, b, c = self.thigh_m, self.shin_m, self.neck_m
        x = self.hip[0] + a * np.sin(thigh) + b * np.sin(shin) + c * np.sin(neck)
        z = self.hip[1] + a * np.cos(thigh) + b * np.cos(shin) + c * np.cos(neck)
        return x, z
