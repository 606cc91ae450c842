"""Where a base is, by how fast it went."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.solids import Array


def moved(pose: Array, velocity: Array, seconds: float) -> Array:
    """(3,) x, y [m], yaw [rad] of a base after a while.

    Args:
        pose: (3,) before.
        velocity: (3,) vx, vy [m/s], yaw rate [rad/s] in the base frame, throughout.
        seconds: How long. Exact for a straight drive and for a turn on the spot; a curve is taken for its chord.
    """
    turn = velocity[2] * seconds
    heading = pose[2] + turn / 2
    c, s = np.cos(heading), np.sin(heading)
    vx, vy = velocity[:2] * seconds
    return np.array([pose[0] + c * vx - s * vy, pose[1] + s * vx + c * vy, wrap(pose[2] + turn)])
