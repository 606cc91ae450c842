"""The bare hand as spheres in its tcp frame: where it cannot be is known before any arm is thought of."""

from __future__ import annotations

import numpy as np

from mpvi_bt.robot import r1
from mpvi_bt.robot.solids import Array

FULL_M = 2 * r1.FINGER_TRAVEL_M  # opening between the fingers
_PALM = [(0.0, y, 0.085 - r1.TCP_M, 0.030) for y in (-0.06, -0.02, 0.02, 0.06)]
_FINGER_Z_M = np.array([0.125, 0.143, 0.161]) - r1.TCP_M  # of spheres along a finger
_FINGER_M = 0.009  # their radius
_FINGER_HALF_M = 0.0065  # half a finger's thickness: from its pad to the spheres' centers


def spheres(opening_m: float | None) -> tuple[Array, Array]:
    """Centers (n, 3) and radii (n,) [m] of the palm, and of the fingers unless `opening_m` is None."""
    rows = list(_PALM)
    if opening_m is not None:
        y = opening_m / 2 + _FINGER_HALF_M
        rows += [(0.0, sign * y, float(z), _FINGER_M) for sign in (-1, 1) for z in _FINGER_Z_M]
    table = np.array(rows)
    return table[:, :3], table[:, 3]


def opened(width_m: float) -> float:
    """The gripper command, -1 closed ... 1 open, of an opening."""
    return float(np.clip(2 * width_m / FULL_M - 1, -1.0, 1.0))
