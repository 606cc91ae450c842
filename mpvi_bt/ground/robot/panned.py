"""Compiled loops over postures of a `PannedArm`: its frames, and its inverse with the pan as the free angle.

`arms` says what each one computes; here shapes are taken to be right.
"""

from __future__ import annotations

import math

import numpy as np

from mpvi_bt.ground.compiled import compiled
from mpvi_bt.ground.geometry.kernels import (
    copied,
    distance,
    doubled,
    framed,
    identity,
    integer,
    leaps,
    narrowed,
    rotate,
    shifted,
)

WAYS = 8  # postures at one pan: two bends of the elbow, two of the shoulder, two of the wrist


@compiled
def arm_frames(q, shoulder, offset, upper_arm, forearm, tcp):  # type: ignore
    """(n, 4, 4, 4) frames of shoulder, upper arm, forearm and tcp in the chest frame."""
    n = q.shape[0]
    out = np.zeros((n, 4, 4, 4))
    A, B = np.empty((3, 3)), np.empty((3, 3))
    p = np.empty(3)
    for k in range(n):
        identity(A)
        rotate(A, integer(2), math.cos(q[k, 0]), math.sin(q[k, 0]), B)
        copied(shoulder, p)
        for frame in range(4):
            if frame == 1:
                for i in range(3):
                    p[i] += B[i, 0] * offset[0] + B[i, 2] * offset[2]
                rotate(B, integer(1), math.cos(q[k, 1]), math.sin(q[k, 1]), A)
                rotate(A, integer(0), math.cos(q[k, 2]), math.sin(q[k, 2]), B)
            elif frame == 2:
                shifted(p, upper_arm, B, integer(0))
                rotate(B, integer(1), math.cos(q[k, 3]), math.sin(q[k, 3]), A)
                rotate(A, integer(0), math.cos(q[k, 4]), math.sin(q[k, 4]), B)
            elif frame == 3:
                shifted(p, forearm, B, integer(0))
                rotate(B, integer(1), math.cos(q[k, 5]), math.sin(q[k, 5]), A)
                rotate(A, integer(0), math.cos(q[k, 6]), math.sin(q[k, 6]), B)
                shifted(p, tcp, B, integer(0))
                for i in range(3):
                    B[i, 0], B[i, 2] = -B[i, 2], B[i, 0]  # the fingers along z
            framed(B, p, out[k, frame])
    return out


@compiled
def _posture(pan, way, T, shoulder, offset, a, b, tcp, limits, q):  # type: ignore
    """Write the posture at one pan in one of the ways; whether there is one, within limits."""
    if not limits[0, 0] <= pan <= limits[0, 1]:
        return False
    c, s = math.cos(pan), math.sin(pan)
    # The wrist, seen from the lift joint in the frame that turns with the pan.
    x = T[0, 3] - tcp * T[0, 2] - shoulder[0]
    y = T[1, 3] - tcp * T[1, 2] - shoulder[1]
    z = T[2, 3] - tcp * T[2, 2] - shoulder[2]
    u, v, w = c * x + s * y - offset[0], -s * x + c * y, z - offset[2]
    cosine = (u * u + v * v + w * w - a * a - b * b) / (2 * a * b)
    if abs(cosine) > 1.0:
        return False
    elbow = math.acos(cosine)
    if way & 1:
        elbow = -elbow
    along, up = a + b * math.cos(elbow), -b * math.sin(elbow)
    if abs(up) < 1e-9 or abs(v) > abs(up):
        return False
    roll = math.asin(-v / up)
    if way & 2:
        roll = math.pi - roll if roll > 0 else -math.pi - roll
    q[0], q[2], q[3] = pan, roll, elbow
    lift = math.atan2(math.cos(roll) * up, along) - math.atan2(w, u)
    q[1] = math.atan2(math.sin(lift), math.cos(lift))
    A, B = np.empty((3, 3)), np.empty((3, 3))
    identity(A)
    rotate(A, integer(2), c, s, B)
    rotate(B, integer(1), math.cos(q[1]), math.sin(q[1]), A)
    rotate(A, integer(0), math.cos(roll), math.sin(roll), B)
    rotate(B, integer(1), math.cos(elbow), math.sin(elbow), A)
    m00, m10, m20, m01, m02 = 0.0, 0.0, 0.0, 0.0, 0.0  # of the hand as the forearm sees it, x along the fingers
    for i in range(3):
        m00 += A[i, 0] * T[i, 2]
        m10 += A[i, 1] * T[i, 2]
        m20 += A[i, 2] * T[i, 2]
        m01 += A[i, 0] * T[i, 1]
        m02 -= A[i, 0] * T[i, 0]
    wrist = math.acos(min(1.0, max(-1.0, m00)))
    sign = 1.0
    if way & 4:
        wrist, sign = -wrist, -1.0
    q[4], q[5], q[6] = math.atan2(sign * m10, -sign * m20), wrist, math.atan2(sign * m01, sign * m02)
    for j in range(1, 7):  # noqa: SIM110
        if not limits[j, 0] <= q[j] <= limits[j, 1]:
            return False
    return True


@compiled
def arm_inverse(T, shoulder, offset, a, b, tcp, limits, pans):  # type: ignore
    """Index of the target (m,) and joint angles (m, 7) of every posture within limits, target by target."""
    room, found = max(64, T.shape[0] * 4), 0
    index, out = np.empty(room, np.int64), np.empty((room, 7))
    q = np.empty(7)
    step = (limits[0, 1] - limits[0, 0]) / pans
    for k in range(T.shape[0]):
        for i in range(pans):
            pan = limits[0, 0] + step * (i + 0.5)
            for way in range(WAYS):
                if _posture(pan, way, T[k], shoulder, offset, a, b, tcp, limits, q):
                    if found == room:
                        index, out = doubled(index, out)
                        room *= 2
                    index[found] = k
                    copied(q, out[found])
                    found += 1
    return index[:found], out[:found]


@compiled
def _off(pan, way, T, shoulder, offset, a, b, tcp, limits, near, weights, q):  # type: ignore
    if not _posture(pan, way, T, shoulder, offset, a, b, tcp, limits, q):
        return np.inf
    return distance(q, near, weights)


@compiled
def _nearest(T, shoulder, offset, a, b, tcp, limits, pans, near, weights, q, best_q):  # type: ignore
    """Whether there is a posture for one target; the one nearest to `near` is written: the best pan, then refined."""
    best = np.inf
    step, at, way = (limits[0, 1] - limits[0, 0]) / pans, 0.0, integer(-1)
    for i in range(-1, pans):
        pan = near[0] if i < 0 else limits[0, 0] + step * (i + 0.5)  # along a line it hardly changes
        for one in range(WAYS):
            total = _off(pan, one, T, shoulder, offset, a, b, tcp, limits, near, weights, q)
            if total < best:
                best, at, way = total, pan, one
                copied(q, best_q)
    if way < 0:
        return False
    low, high, ratio = at - step, at + step, (math.sqrt(5.0) - 1) / 2
    while high - low > 1e-5:
        left, right = high - ratio * (high - low), low + ratio * (high - low)
        one = _off(left, way, T, shoulder, offset, a, b, tcp, limits, near, weights, q)
        if one < best:
            best = one
            copied(q, best_q)
        two = _off(right, way, T, shoulder, offset, a, b, tcp, limits, near, weights, q)
        if two < best:
            best = two
            copied(q, best_q)
        low, high = narrowed(low, high, left, right, one, two, at)
    return True


@compiled
def nearest(T, shoulder, offset, a, b, tcp, limits, pans, near, weights):  # type: ignore
    """Which targets (n, 4, 4) have a posture, and for each the one (n, 7) nearest to its own `near` (n, 7)."""
    found, out, q = np.empty(T.shape[0], np.bool_), np.zeros((T.shape[0], 7)), np.empty(7)
    for k in range(T.shape[0]):
        found[k] = _nearest(T[k], shoulder, offset, a, b, tcp, limits, pans, near[k], weights, q, out[k])
    return found, out


@compiled
def along(T, shoulder, offset, a, b, tcp, limits, pans, start, weights, leap):  # type: ignore
    """How many targets are reached in turn without a leap, and postures (n, 7), each nearest to the one before."""
    out, q = np.zeros((T.shape[0], 7)), np.empty(7)
    for k in range(T.shape[0]):
        near = start if k == 0 else out[k - 1]
        if not _nearest(T[k], shoulder, offset, a, b, tcp, limits, pans, near, weights, q, out[k]):
            return k, out
        if leaps(near, out[k], leap):
            return k, out
    return T.shape[0], out
