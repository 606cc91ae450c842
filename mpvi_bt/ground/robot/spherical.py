"""Compiled loops over postures of a `SphericalArm`: its frames, and its inverse with the swivel as the free angle.

`arms` says what each one computes; here shapes are taken to be right. `roll` is the axis of the last joint: 2 for a
wrist about z, y, z and 0 for one about z, y, x.
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


@compiled
def arm_frames(q, shoulder, upper_arm, forearm, tcp, roll):  # type: ignore
    """(n, 3, 4, 4) frames of upper arm, forearm and tcp in the chest frame."""
    n = q.shape[0]
    out = np.zeros((n, 3, 4, 4))
    A, B = np.empty((3, 3)), np.empty((3, 3))
    p = np.empty(3)
    for k in range(n):
        identity(A)
        copied(shoulder, p)
        rotate(A, integer(1), math.cos(q[k, 0]), math.sin(q[k, 0]), B)
        rotate(B, integer(0), math.cos(q[k, 1]), math.sin(q[k, 1]), A)
        rotate(A, integer(2), math.cos(q[k, 2]), math.sin(q[k, 2]), B)
        for frame in range(3):
            if frame == 1:
                shifted(p, -upper_arm, B, integer(2))
                rotate(B, integer(1), math.cos(q[k, 3]), math.sin(q[k, 3]), A)
                rotate(A, integer(2), math.cos(q[k, 4]), math.sin(q[k, 4]), B)
            elif frame == 2:
                shifted(p, -forearm, B, integer(2))
                rotate(B, integer(1), -math.cos(q[k, 5]), -math.sin(q[k, 5]), A)  # half a turn more
                turn = q[k, 6] if roll == 2 else -q[k, 6]
                rotate(A, roll, math.cos(turn), math.sin(turn), B)
                shifted(p, tcp, B, integer(2))
            framed(B, p, out[k, frame])
    return out


@compiled
def _prepared(T, shoulder, a, b, tcp, bend):  # type: ignore
    """What every swivel of one target has in common: whether in reach, elbow, direction of the wrist, first turn.

    The elbow bends forward (negative) if `bend` is 0, backward if it is 1.
    """
    axis, shortest, to = np.empty(3), np.empty((3, 3)), np.empty(3)
    identity(shortest)
    for i in range(3):
        to[i] = T[i, 3] - tcp * T[i, 2] - shoulder[i]
    reach = math.sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2])
    cosine = (reach * reach - a * a - b * b) / (2 * a * b)
    if not (abs(cosine) <= 1.0 and reach > 1e-6):
        return False, 0.0, to, shortest
    q4 = math.acos(cosine) if bend else -math.acos(cosine)
    for i in range(3):
        to[i] /= reach
    # The wrist in the shoulder's own frame, turned the shortest way onto where it has to be.
    x, z = -b * math.sin(q4) / reach, (-a - b * math.cos(q4)) / reach
    axis[0], axis[1], axis[2] = -z * to[1], z * to[0] - x * to[2], x * to[1]
    K = np.zeros((3, 3))
    K[0, 1], K[0, 2], K[1, 2] = -axis[2], axis[1], -axis[0]
    K[1, 0], K[2, 0], K[2, 1] = axis[2], -axis[1], axis[0]
    scale = 1.0 / max(1.0 + x * to[0] + z * to[2], 1e-9)
    for i in range(3):
        for j in range(3):
            square = K[i, 0] * K[0, j] + K[i, 1] * K[1, j] + K[i, 2] * K[2, j]
            shortest[i, j] += K[i, j] + square * scale
    return True, q4, to, shortest


@compiled
def _shoulder(c, s, to, shortest, W, q):  # type: ignore
    """Write the rotation of the shoulder at the swivel of cosine `c` and sine `s` about `to`, and its joint angles."""
    x, y, z, d = to[0], to[1], to[2], 1.0 - c
    for j in range(3):
        u, v, w = shortest[0, j], shortest[1, j], shortest[2, j]
        along = (x * u + y * v + z * w) * d
        W[0, j] = c * u + s * (y * w - z * v) + along * x
        W[1, j] = c * v + s * (z * u - x * w) + along * y
        W[2, j] = c * w + s * (x * v - y * u) + along * z
    q[0] = math.atan2(W[0, 2], W[2, 2])
    q[1] = math.asin(min(1.0, max(-1.0, -W[1, 2])))
    q[2] = math.atan2(W[1, 0], W[1, 1])


@compiled
def _wrist(W, ce, se, T, roll, q):  # type: ignore
    """Write the wrist's joint angles; `ce`, `se` are cosine and sine of the elbow's."""
    v00, v10 = 0.0, 0.0
    v02, v12, v22 = 0.0, 0.0, 0.0
    v20, v21 = 0.0, 0.0
    for i in range(3):
        e0, e1, e2 = ce * W[i, 0] - se * W[i, 2], W[i, 1], se * W[i, 0] + ce * W[i, 2]
        v00 += e0 * T[i, 0]
        v10 += e1 * T[i, 0]
        v02 += e0 * T[i, 2]
        v12 += e1 * T[i, 2]
        v22 += e2 * T[i, 2]
        v20 += e2 * T[i, 0]
        v21 += e2 * T[i, 1]
    if roll == 2:
        q[4] = math.atan2(v12, v02)
        q[5] = math.acos(min(1.0, max(-1.0, v22))) - math.pi
        q[6] = math.atan2(v21, -v20)
    else:
        q[4] = math.atan2(-v10, -v00)
        q[5] = math.asin(min(1.0, max(-1.0, v20)))
        q[6] = math.atan2(v21, -v22)


@compiled
def _other_way(q, first, roll):  # type: ignore
    """Turn three angles from `first` on into the other three of the same rotation."""
    for j in (first, first + 2):
        q[j] = q[j] - math.pi if q[j] > 0 else q[j] + math.pi
    q[first + 1] = -q[first + 1] if first == 4 and roll == 2 else math.pi - q[first + 1]
    if q[first + 1] > math.pi:
        q[first + 1] -= 2 * math.pi


@compiled
def _within(q, limits, first):  # type: ignore
    """Whether three angles from `first` on are within limits, the first after a whole turn if that helps."""
    if q[first] > limits[first, 1] and q[first] - 2 * math.pi >= limits[first, 0]:
        q[first] -= 2 * math.pi
    good = True
    for j in range(first, first + 3):
        good = good and limits[j, 0] <= q[j] <= limits[j, 1]
    return good


@compiled
def arm_inverse(T, shoulder, a, b, tcp, roll, limits, swivels):  # type: ignore
    """Index of the target (m,) and joint angles (m, 7) of every posture within limits, target by target."""
    room, found = max(64, T.shape[0] * 4), 0
    index, out = np.empty(room, np.int64), np.empty((room, 7))
    W, q = np.empty((3, 3)), np.empty(7)
    c, s = np.empty(swivels), np.empty(swivels)
    for i in range(swivels):
        turn = -math.pi + 2 * math.pi * i / swivels
        c[i], s[i] = math.cos(turn), math.sin(turn)
    for k in range(T.shape[0]):
        for bend in range(2):
            good, q4, to, shortest = _prepared(T[k], shoulder, a, b, tcp, bend)
            if not good or not (limits[3, 0] <= q4 <= limits[3, 1]):
                continue
            q[3], ce, se = q4, math.cos(q4), math.sin(q4)
            for i in range(swivels):
                _shoulder(c[i], s[i], to, shortest, W, q)
                ready = False
                for _ in range(2):
                    if _within(q, limits, integer(0)):
                        if not ready:
                            _wrist(W, ce, se, T[k], roll, q)
                            ready = True
                        for _ in range(2):
                            if _within(q, limits, integer(4)):
                                if found == room:
                                    index, out = doubled(index, out)
                                    room *= 2
                                index[found] = k
                                copied(q, out[found])
                                found += 1
                            _other_way(q, integer(4), roll)
                    _other_way(q, integer(0), roll)
    return index[:found], out[:found]


@compiled
def _at_swivel(c, s, way, T, to, ce, se, shortest, roll, limits, near, weights, W, q):  # type: ignore
    """Distance from `near` of the posture at one swivel, split in the way 0..3; it is written to `q`."""
    _shoulder(c, s, to, shortest, W, q)
    if way >= 2:
        _other_way(q, integer(0), roll)
    if not _within(q, limits, integer(0)):
        return np.inf
    _wrist(W, ce, se, T, roll, q)
    if way % 2:
        _other_way(q, integer(4), roll)
    return distance(q, near, weights) if _within(q, limits, integer(4)) else np.inf


@compiled
def _nearest(T, shoulder, a, b, tcp, roll, limits, swivels, near, weights, W, q, best_q):  # type: ignore
    """Whether there is a posture for one target; that nearest to `near` is written: the best swivel, then refined."""
    best = np.inf
    step, at, way, bent = 2 * math.pi / swivels, 0.0, integer(-1), integer(0)
    for bend in range(2):
        good, q4, to, shortest = _prepared(T, shoulder, a, b, tcp, bend)
        if not good or not (limits[3, 0] <= q4 <= limits[3, 1]):
            continue
        q[3], ce, se = q4, math.cos(q4), math.sin(q4)
        for i in range(swivels):
            psi = -math.pi + step * i
            _shoulder(math.cos(psi), math.sin(psi), to, shortest, W, q)
            ready = False
            for first in range(2):
                if _within(q, limits, integer(0)):
                    if not ready:
                        _wrist(W, ce, se, T, roll, q)
                        ready = True
                    for second in range(2):
                        if _within(q, limits, integer(4)):
                            total = distance(q, near, weights)
                            if total < best:
                                best, at, way, bent = total, psi, 2 * first + second, bend
                                copied(q, best_q)
                        _other_way(q, integer(4), roll)
                _other_way(q, integer(0), roll)
    if way < 0:
        return False
    _, q4, to, shortest = _prepared(T, shoulder, a, b, tcp, bent)
    q[3], ce, se = q4, math.cos(q4), math.sin(q4)
    # Between two sampled swivels the distance has one minimum: without it the elbow would follow a line in jerks.
    low, high, ratio = at - step, at + step, (math.sqrt(5.0) - 1) / 2
    while high - low > 1e-5:
        psi, more = high - ratio * (high - low), low + ratio * (high - low)
        one = _at_swivel(math.cos(psi), math.sin(psi), way, T, to, ce, se, shortest, roll, limits, near, weights, W, q)
        if one < best:
            best = one
            copied(q, best_q)
        two = _at_swivel(
            math.cos(more), math.sin(more), way, T, to, ce, se, shortest, roll, limits, near, weights, W, q
        )
        if two < best:
            best = two
            copied(q, best_q)
        low, high = narrowed(low, high, psi, more, one, two, at)
    return True


@compiled
def nearest(T, shoulder, a, b, tcp, roll, limits, swivels, near, weights):  # type: ignore
    """Which targets (n, 4, 4) have a posture, and for each the one (n, 7) nearest to its own `near` (n, 7)."""
    found, out = np.empty(T.shape[0], np.bool_), np.zeros((T.shape[0], 7))
    W, q = np.empty((3, 3)), np.empty(7)
    for k in range(T.shape[0]):
        found[k] = _nearest(T[k], shoulder, a, b, tcp, roll, limits, swivels, near[k], weights, W, q, out[k])
    return found, out


@compiled
def along(T, shoulder, a, b, tcp, roll, limits, swivels, start, weights, leap):  # type: ignore
    """How many targets are reached in turn without a leap, and postures (n, 7), each nearest to the one before."""
    out = np.zeros((T.shape[0], 7))
    W, q = np.empty((3, 3)), np.empty(7)
    for k in range(T.shape[0]):
        near = start if k == 0 else out[k - 1]
        if not _nearest(T[k], shoulder, a, b, tcp, roll, limits, swivels, near, weights, W, q, out[k]):
            return k, out
        if leaps(near, out[k], leap):
            return k, out
    return T.shape[0], out
