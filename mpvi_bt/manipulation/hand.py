"""The bare hand as spheres in its tcp frame: where it cannot be is known before any arm is thought of."""

from __future__ import annotations

import numpy as np

from mpvi_bt.robot.r1 import R1
from mpvi_bt.robot.solids import Array

FULL_M = 2 * R1.finger_travel_m  # opening between the fingers
_PALM = [(0.0, y, 0.085 - R1.tcp_m, 0.030) for y in (-0.06, -0.02, 0.02, 0.06)]
_FINGER_Z_M = np.array([0.125, 0.143, 0.161]) - R1.tcp_m  # of spheres along a finger
_FINGER_M = 0.009  # their radius
_FINGER_HALF_M = 0.0065  # half a finger's thickness: from its pad to the spheres' centers
CLOSED_HALF_M = 2 * _FINGER_HALF_M  # from the tcp to the outside of closed fingers


def palm() -> tuple[Array, Array]:
    """Centers (n, 3) and radii (n,) [m] of spheres that stand for the palm; they reach a little beyond it."""
    table = np.array(_PALM)
    return table[:, :3], table[:, 3]


def fingers(opening_m: float) -> tuple[Array, Array]:
    """Centers (n, 3) and radii (n,) [m] of spheres in the fingers of a hand that is so far open."""
    y = opening_m / 2 + _FINGER_HALF_M
    centers = np.array([(0.0, sign * y, z) for sign in (-1, 1) for z in _FINGER_Z_M])
    return centers, np.full(len(centers), _FINGER_M)


def opened(width_m: float) -> float:
    """The gripper command, -1 closed ... 1 open, of an opening."""
    return float(np.clip(2 * width_m / FULL_M - 1, -1.0, 1.0))
