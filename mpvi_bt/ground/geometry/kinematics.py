"""Rotations and rigid transforms, and how hands and bases are posed."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, pose


def rot_x(a: Array | float) -> Array:
    """(..., 3, 3) rotation by `a` [rad] about x."""
    return _about(a, 0)


def rot_y(a: Array | float) -> Array:
    """(..., 3, 3) rotation by `a` [rad] about y."""
    return _about(a, 1)


def rot_z(a: Array | float) -> Array:
    """(..., 3, 3) rotation by `a` [rad] about z."""
    return _about(a, 2)


def _about(a: Array | float, axis: int) -> Array:
    a = np.asarray(a, float)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((*a.shape, 3, 3))
    R[..., axis, axis] = 1.0
    R[..., i, i] = R[..., j, j] = np.cos(a)
    R[..., j, i] = np.sin(a)
    R[..., i, j] = -R[..., j, i]
    return R


def transform(R: Array, p: Array | tuple[float, float, float]) -> Array:
    """(..., 4, 4) from rotations (..., 3, 3) and positions (..., 3) [m]."""
    p = np.asarray(p, float)
    single = R.ndim == 2 and p.ndim == 1  # most are, and numpy takes long to see it
    T = np.zeros((4, 4) if single else (*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T


def inverse(T: Array) -> Array:
    """(..., 4, 4) inverse of rigid transforms."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(Rt, -matmul(Rt, T[..., :3, 3, None])[..., 0])


def wrap(a: Array | float) -> Array:
    """Angles [rad] brought into -pi..pi."""
    return np.arctan2(np.sin(a), np.cos(a))


def hand_rotation(approach: Array | tuple[float, float, float], closing: Array | tuple[float, float, float]) -> Array:
    """(3, 3) rotation of a hand that points along `approach` and closes along `closing` (made orthogonal)."""
    z = np.asarray(approach, float) / norm(approach)
    y = np.asarray(closing, float) - z * matmul(z, np.asarray(closing, float))
    y /= norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)


def base(base_pose: Array) -> Array:
    """T_world_base (4, 4) of x, y [m], yaw [rad]."""
    return pose((float(base_pose[0]), float(base_pose[1]), 0.0), float(base_pose[2]))


# Camera links look along x with z up; an optical frame looks along z with y down.
LINK_TO_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
