"""Kinematics of the r1: forward by composition, the arms' inverse in closed form.

An arm is spherical - revolute - spherical: its elbow angle follows from the distance of shoulder and wrist, and what is
left is one free angle, the swivel of the elbow about the line between them. Sampling the swivel gives every solution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.robot import r1
from mpvi_bt.robot.protocol import Side
from mpvi_bt.robot.solids import Array, pose


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
    return transform(Rt, -(Rt @ T[..., :3, 3, None])[..., 0])


def wrap(a: Array | float) -> Array:
    """Angles [rad] brought into -pi..pi."""
    return np.arctan2(np.sin(a), np.cos(a))


def hand_rotation(approach: Array | tuple[float, float, float], closing: Array | tuple[float, float, float]) -> Array:
    """(3, 3) rotation of a hand that points along `approach` and closes along `closing` (made orthogonal)."""
    z = np.asarray(approach, float) / np.linalg.norm(approach)
    y = np.asarray(closing, float) - z * (z @ np.asarray(closing, float))
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)


def base(base_pose: Array) -> Array:
    """T_world_base (4, 4) of x, y [m], yaw [rad]."""
    return pose((float(base_pose[0]), float(base_pose[1]), 0.0), float(base_pose[2]))


def chest(torso: Array) -> Array:
    """T_base_chest (..., 4, 4) of lift, waist yaw, waist pitch (..., >= 3)."""
    torso = np.asarray(torso, float)
    turn = rot_z(torso[..., 1])
    up = np.zeros((*torso.shape[:-1], 3))
    up[..., 2] = r1.WAIST_M + torso[..., 0] + r1.CHEST_M
    return transform(turn @ rot_y(torso[..., 2]), up)


def head_camera(torso: Array) -> Array:
    """T_base_camera (4, 4), optical frame, of torso (4,)."""
    T = chest(torso) @ transform(rot_y(float(torso[3])), r1.HEAD_M)
    return T @ transform(LINK_TO_OPTICAL, r1.HEAD_CAMERA_M)


def wrist_camera(torso: Array, q: Array, side: Side) -> Array:
    """T_base_camera (4, 4), optical frame, of torso (4,) and arm (7,)."""
    flange = chest(torso) @ arm(q, side) @ transform(np.eye(3), (0.0, 0.0, -r1.TCP_M))
    return flange @ transform(rot_y(-np.pi / 2 + r1.WRIST_CAMERA_TILT_RAD) @ LINK_TO_OPTICAL, r1.WRIST_CAMERA_M)


# Camera links look along x with z up; an optical frame looks along z with y down.
LINK_TO_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def shoulder(side: Side) -> Array:
    """(3,) shoulder in the chest frame [m]."""
    return r1.SHOULDER_M * [1, r1.SIGN[side], 1]


def arm_frames(q: Array, side: Side) -> tuple[Array, Array, Array]:
    """Poses in the chest frame, each (..., 4, 4): upper arm (at the shoulder), forearm (at the elbow), tcp.

    Args:
        q: (..., 7) joint angles [rad].
        side: Which arm.
    """
    from mpvi_bt.robot import kernels  # numba loads when postures are first worked with

    q = np.asarray(q, float)
    frames = kernels.arm_frames(q.reshape(-1, 7), shoulder(side), r1.UPPER_ARM_M, r1.FOREARM_M, r1.TCP_M)
    frames = frames.reshape(*q.shape[:-1], 3, 4, 4)
    return frames[..., 0, :, :], frames[..., 1, :, :], frames[..., 2, :, :]


def arm(q: Array, side: Side) -> Array:
    """T_chest_tcp (..., 4, 4) of arm angles (..., 7)."""
    return arm_frames(q, side)[2]


def tcp(torso: Array, q: Array, side: Side) -> Array:
    """T_base_tcp (..., 4, 4) of torso (..., >= 3) and arm angles (..., 7)."""
    return chest(torso) @ arm(q, side)


def arm_inverse(T_chest_tcp: Array, side: Side, swivels: int = 36) -> tuple[NDArray[np.intp], Array]:
    """Every arm posture within the joint limits that brings the tcp to a target, at sampled elbow swivels.

    Args:
        T_chest_tcp: (n, 4, 4) targets in the chest frame.
        side: Which arm.
        swivels: Samples of the free angle.

    Returns:
        Index into the targets (m,), ascending, and joint angles (m, 7) [rad]; m may be 0. Exact to rounding.
    """
    from mpvi_bt.robot import kernels

    T = np.ascontiguousarray(T_chest_tcp, float).reshape(-1, 4, 4)
    index, q = kernels.arm_inverse(
        T, shoulder(side), r1.UPPER_ARM_M, r1.FOREARM_M, r1.TCP_M, r1.ARM_LIMITS[side], swivels
    )
    return index, q


def nearest_posture(T_chest_tcp: Array, side: Side, q_near: Array, swivels: int = 72) -> Array | None:
    """The solution (7,) of one target (4, 4) nearest to posture `q_near` (7,), or None if it is out of reach.

    The best of the sampled swivels is refined: along a line the elbow moves evenly, not from sample to sample.
    """
    from mpvi_bt.robot import kernels

    found, q = kernels.nearest(
        np.ascontiguousarray(T_chest_tcp, float), shoulder(side), r1.UPPER_ARM_M, r1.FOREARM_M, r1.TCP_M,
        r1.ARM_LIMITS[side], swivels, np.asarray(q_near, float), _WEIGHTS,
    )  # fmt: skip
    return q if found else None


_WEIGHTS = np.array([1, 1, 1, 1, 0.5, 0.5, 0.3])  # of joints in the distance of postures


def limit_cost(q: Array, side: Side) -> Array:
    """(n,) how far joints of postures (n, 7) are into the last tenths of their ranges, summed, in half ranges."""
    limits = r1.ARM_LIMITS[side]
    return np.asarray(np.maximum(np.abs(q - limits.mean(1)) / (np.ptp(limits, axis=1) / 2) - 0.8, 0).sum(1))


def posture_distance(q: Array, q_near: Array) -> Array:
    """(...,) weighted squared distance of postures (..., 7); the wrist's joints, cheap to turn, count less."""
    return ((q - q_near) ** 2 * _WEIGHTS).sum(-1)
