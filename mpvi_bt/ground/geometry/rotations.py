"""Quaternions (x, y, z, w) of rotation matrices, and turns between two of them.

scipy has the same, to the bit, but its way from a matrix takes an SVD, by BLAS (see `linear_algebra`), and for a turn,
of which searches ask for thousands, it takes a hundred times as long.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.ground.geometry import kernels
from mpvi_bt.ground.geometry.solids import Array


def rotation(R: Array) -> Rotation:
    """scipy's rotation of matrices (3, 3) or (n, 3, 3) that are orthogonal but for rounding."""
    if R.ndim == 2:
        return Rotation.from_quat(kernels.quaternion(R))
    return Rotation.from_quat(kernels.quaternions(R))


def quaternion(R: Array) -> Array:
    """(4,) unit quaternion of a rotation (3, 3) (Shepperd, "Quaternion from rotation matrix", 1978)."""
    return np.asarray(kernels.normalized(kernels.quaternion(R)))


def angle(p: Array, q: Array) -> float:
    """Of the turn [rad] between two unit quaternions (4,), at the most pi."""
    x, y, z, w = kernels.turn(p, q)
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), w)


def between(p: Array, q: Array, shares: Array) -> Array:
    """(n, 4) unit quaternions at shares (n,) of the short way from one to another, at an even pace."""
    return np.asarray(kernels.turned(p, q, np.asarray(shares, float)))


def matrices(q: Array) -> Array:
    """(n, 3, 3) rotations of unit quaternions (n, 4)."""
    return np.asarray(kernels.matrices(q))
