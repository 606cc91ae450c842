"""Compiled loops over postures: the arm's frames, its inverse, and how far spheres are from solids and the robot.

Planning asks these thousands of times a second, one or a few postures at a time, where array expressions cost mostly
their own overhead. `kinematics` and `collision` say what each one computes; here shapes are taken to be right.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np


def compiled(function: Any) -> Any:
    """The function, compiled on first use; numba keeps it beside this file or in the user's cache folder."""
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that can be written: compile anew in each process
        return numba.njit(error_model="numpy")(function)


@compiled
def rotate(R, axis, c, s, out):  # type: ignore
    """Write R times the rotation about one of its axes by the angle of cosine `c` and sine `s`."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    for row in range(3):
        out[row, axis] = R[row, axis]
        u, v = R[row, i], R[row, j]
        out[row, i] = u * c + v * s
        out[row, j] = v * c - u * s


@compiled
def arm_frames(q, shoulder, upper_arm, forearm, tcp):  # type: ignore
    """(n, 3, 4, 4) frames of upper arm, forearm and tcp in the chest frame."""
    n = q.shape[0]
    out = np.zeros((n, 3, 4, 4))
    A, B = np.empty((3, 3)), np.empty((3, 3))
    p = np.empty(3)
    for k in range(n):
        A[:] = np.eye(3)
        rotate(A, 1, math.cos(q[k, 0]), math.sin(q[k, 0]), B)
        rotate(B, 0, math.cos(q[k, 1]), math.sin(q[k, 1]), A)
        rotate(A, 2, math.cos(q[k, 2]), math.sin(q[k, 2]), B)
        p[:] = shoulder
        for frame in range(3):
            if frame == 1:
                p -= upper_arm * B[:, 2]
                rotate(B, 1, math.cos(q[k, 3]), math.sin(q[k, 3]), A)
                rotate(A, 2, math.cos(q[k, 4]), math.sin(q[k, 4]), B)
            elif frame == 2:
                p -= forearm * B[:, 2]
                rotate(B, 1, -math.cos(q[k, 5]), -math.sin(q[k, 5]), A)  # half a turn more
                rotate(A, 2, math.cos(q[k, 6]), math.sin(q[k, 6]), B)
                p += tcp * B[:, 2]
            out[k, frame, :3, :3] = B
            out[k, frame, :3, 3] = p
            out[k, frame, 3, 3] = 1.0
    return out


@compiled
def _prepared(T, shoulder, a, b, tcp):  # type: ignore
    """What every swivel of one target has in common: whether in reach, elbow, direction of the wrist, first turn."""
    axis, shortest = np.empty(3), np.eye(3)
    to = np.empty(3)
    for i in range(3):
        to[i] = T[i, 3] - tcp * T[i, 2] - shoulder[i]
    reach = math.sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2])
    cosine = (reach * reach - a * a - b * b) / (2 * a * b)
    if not (abs(cosine) <= 1.0 and reach > 1e-6):
        return False, 0.0, to, shortest
    q4 = -math.acos(cosine)
    to /= reach
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
def _wrist(W, ce, se, T, q):  # type: ignore
    """Write the wrist's joint angles; `ce`, `se` are cosine and sine of the elbow's."""
    v02, v12, v22 = 0.0, 0.0, 0.0
    v20, v21 = 0.0, 0.0
    for i in range(3):
        e0, e1, e2 = ce * W[i, 0] - se * W[i, 2], W[i, 1], se * W[i, 0] + ce * W[i, 2]
        v02 += e0 * T[i, 2]
        v12 += e1 * T[i, 2]
        v22 += e2 * T[i, 2]
        v20 += e2 * T[i, 0]
        v21 += e2 * T[i, 1]
    q[4] = math.atan2(v12, v02)
    q[5] = math.acos(min(1.0, max(-1.0, v22))) - math.pi
    q[6] = math.atan2(v21, -v20)


@compiled
def _other_way(q, first):  # type: ignore
    """Turn three angles from `first` on into the other three of the same rotation."""
    for j in (first, first + 2):
        q[j] = q[j] - math.pi if q[j] > 0 else q[j] + math.pi
    q[first + 1] = -q[first + 1] if first == 4 else math.pi - q[first + 1]
    if q[first + 1] > math.pi:
        q[first + 1] -= 2 * math.pi


@compiled
def _within(q, limits, first):  # type: ignore
    good = True
    for j in range(first, first + 3):
        good = good and limits[j, 0] <= q[j] <= limits[j, 1]
    return good


@compiled
def arm_inverse(T, shoulder, a, b, tcp, limits, swivels):  # type: ignore
    """Index of the target (m,) and joint angles (m, 7) of every posture within limits, target by target."""
    room, found = max(64, T.shape[0] * 4), 0
    index, out = np.empty(room, np.int64), np.empty((room, 7))
    W, q = np.empty((3, 3)), np.empty(7)
    turn = -math.pi + 2 * math.pi * np.arange(swivels) / swivels
    c, s = np.cos(turn), np.sin(turn)
    for k in range(T.shape[0]):
        good, q4, to, shortest = _prepared(T[k], shoulder, a, b, tcp)
        if not good or not (limits[3, 0] <= q4 <= limits[3, 1]):
            continue
        q[3], ce, se = q4, math.cos(q4), math.sin(q4)
        for i in range(swivels):
            _shoulder(c[i], s[i], to, shortest, W, q)
            ready = False
            for _ in range(2):
                if _within(q, limits, 0):
                    if not ready:
                        _wrist(W, ce, se, T[k], q)
                        ready = True
                    for _ in range(2):
                        if _within(q, limits, 4):
                            if found == room:
                                more, wider = np.empty(2 * room, np.int64), np.empty((2 * room, 7))
                                more[:room], wider[:room] = index, out
                                index, out, room = more, wider, 2 * room
                            index[found] = k
                            out[found] = q
                            found += 1
                        _other_way(q, 4)
                _other_way(q, 0)
    return index[:found], out[:found]


@compiled
def distance(q, near, weights):  # type: ignore
    """Weighted squared distance of two postures."""
    total = 0.0
    for j in range(7):
        total += weights[j] * (q[j] - near[j]) ** 2
    return total


@compiled
def _at_swivel(c, s, way, T, to, ce, se, shortest, limits, near, weights, W, q):  # type: ignore
    """Distance from `near` of the posture at one swivel, split in the way 0..3; it is written to `q`."""
    _shoulder(c, s, to, shortest, W, q)
    if way >= 2:
        _other_way(q, 0)
    if not _within(q, limits, 0):
        return np.inf
    _wrist(W, ce, se, T, q)
    if way % 2:
        _other_way(q, 4)
    return distance(q, near, weights) if _within(q, limits, 4) else np.inf


@compiled
def nearest(T, shoulder, a, b, tcp, limits, swivels, near, weights):  # type: ignore
    """Whether there is a posture for one target, and the one nearest to `near`: the best swivel, then refined."""
    best, best_q = np.inf, np.zeros(7)
    W, q = np.empty((3, 3)), np.empty(7)
    good, q4, to, shortest = _prepared(T, shoulder, a, b, tcp)
    if not good or not (limits[3, 0] <= q4 <= limits[3, 1]):
        return False, best_q
    q[3], ce, se = q4, math.cos(q4), math.sin(q4)
    step, at, way = 2 * math.pi / swivels, 0.0, -1
    for i in range(swivels):
        psi = -math.pi + step * i
        _shoulder(math.cos(psi), math.sin(psi), to, shortest, W, q)
        ready = False
        for first in range(2):
            if _within(q, limits, 0):
                if not ready:
                    _wrist(W, ce, se, T, q)
                    ready = True
                for second in range(2):
                    if _within(q, limits, 4):
                        total = distance(q, near, weights)
                        if total < best:
                            best, at, way = total, psi, 2 * first + second
                            best_q[:] = q
                    _other_way(q, 4)
            _other_way(q, 0)
    if way < 0:
        return False, best_q
    # Between two sampled swivels the distance has one minimum: without it the elbow would follow a line in jerks.
    low, high, ratio = at - step, at + step, (math.sqrt(5.0) - 1) / 2
    while high - low > 1e-5:
        psi, more = high - ratio * (high - low), low + ratio * (high - low)
        one = _at_swivel(math.cos(psi), math.sin(psi), way, T, to, ce, se, shortest, limits, near, weights, W, q)
        if one < best:
            best = one
            best_q[:] = q
        two = _at_swivel(math.cos(more), math.sin(more), way, T, to, ce, se, shortest, limits, near, weights, W, q)
        if two < best:
            best = two
            best_q[:] = q
        if one == np.inf and two == np.inf:  # both beyond a limit: toward the sampled one, which is within
            if at < psi:
                high = psi
            elif at > more:
                low = more
            else:
                low, high = psi, more
        elif one < two:
            high = more
        else:
            low = psi
    return True, best_q


@compiled
def sphere_centers(frames, chest, centers, link):  # type: ignore
    """(n, m, 3) centers in the base frame of spheres (m, 3) in the frame of their link, and (n, 4, 4) T_base_tcp."""
    n, m, parts = frames.shape[0], centers.shape[0], frames.shape[1]
    out, hands = np.empty((n, m, 3)), np.zeros((n, 4, 4))
    F = np.empty((parts, 3, 4))
    for k in range(n):
        for f in range(parts):
            for i in range(3):
                for j in range(4):
                    F[f, i, j] = (
                        chest[i, 0] * frames[k, f, 0, j]
                        + chest[i, 1] * frames[k, f, 1, j]
                        + chest[i, 2] * frames[k, f, 2, j]
                    )
                F[f, i, 3] += chest[i, 3]
        hands[k, :3] = F[parts - 1]
        hands[k, 3, 3] = 1.0
        for s in range(m):
            x, y, z, f = centers[s, 0], centers[s, 1], centers[s, 2], link[s]
            for i in range(3):
                out[k, s, i] = F[f, i, 0] * x + F[f, i, 1] * y + F[f, i, 2] * z + F[f, i, 3]
    return out, hands


@compiled
def _to_solids(x, y, z, inverse, half, is_round, best):  # type: ignore
    """Distance of a point to the nearest solid, or `best` if that is less."""
    for s in range(half.shape[0]):
        u = inverse[s, 0, 0] * x + inverse[s, 0, 1] * y + inverse[s, 0, 2] * z + inverse[s, 0, 3]
        v = inverse[s, 1, 0] * x + inverse[s, 1, 1] * y + inverse[s, 1, 2] * z + inverse[s, 1, 3]
        w = abs(inverse[s, 2, 0] * x + inverse[s, 2, 1] * y + inverse[s, 2, 2] * z + inverse[s, 2, 3]) - half[s, 2]
        if w >= best:
            continue
        if is_round[s]:
            u, v = math.sqrt(u * u + v * v) - half[s, 0], 0.0
        else:
            u, v = abs(u) - half[s, 0], abs(v) - half[s, 1]
        u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
        square = u * u + v * v + w * w
        if square < best * best:
            best = math.sqrt(square)
    return best


@compiled
def solids_distance(p, inverse, half, is_round):  # type: ignore
    """(n,) distance of points (n, 3) to the nearest solid, 9 if none is nearer."""
    out = np.empty(p.shape[0])
    for k in range(p.shape[0]):
        out[k] = _to_solids(p[k, 0], p[k, 1], p[k, 2], inverse, half, is_round, 9.0)
    return out


@compiled
def _to_box(x, y, z, box):  # type: ignore
    u = max(abs(x - box[0]) - box[3], 0.0)
    v = max(abs(y - box[1]) - box[4], 0.0)
    w = max(abs(z - box[2]) - box[5], 0.0)
    return math.sqrt(u * u + v * v + w * w)


@compiled
def self_distance(  # type: ignore
    p, radii, first_hand, own, hands, chest, boxes, boxes_from, lift_box, base, fold, p2, r2, mine, theirs
):
    """(n,) how far an arm's spheres p (n, m, 3) keep from the robot: see `collision.Body.clearance`.

    Args:
        p: Centers in the base frame; the first two lie in the shoulder, from `own` on they belong to what is held.
        radii: (m,).
        first_hand: The first sphere of the hand.
        own: How many of the spheres are the arm's own.
        hands: (n, 4, 4) T_base_tcp.
        chest: (4, 4) base to chest.
        boxes: (b, 6) center and half extents in the chest frame.
        boxes_from: (b,) the first of the spheres that may not touch each.
        lift_box: (6,) in the base frame.
        base: (2,) radius and height of the base.
        fold: How near the hand may come to the middle of its own shoulder.
        p2: (k, 3) spheres of the other arm.
        r2: (k,) their radii.
        mine: What this hand holds, in its tcp frame: inverse poses, half extents, which are round.
        theirs: What the other hand holds, likewise in the base frame.
    """
    n, m = radii.shape[0], p.shape[0]
    out = np.empty(m)
    for k in range(m):
        best = np.inf
        for s in range(1, n):
            x, y, z, r = p[k, s, 0], p[k, s, 1], p[k, s, 2], radii[s]
            u = chest[0, 0] * x + chest[0, 1] * y + chest[0, 2] * z + chest[0, 3]
            v = chest[1, 0] * x + chest[1, 1] * y + chest[1, 2] * z + chest[1, 3]
            w = chest[2, 0] * x + chest[2, 1] * y + chest[2, 2] * z + chest[2, 3]
            for j in range(boxes.shape[0]):
                if s >= boxes_from[j]:
                    best = min(best, _to_box(u, v, w, boxes[j]) - r)
            if s < 2:
                continue
            best = min(best, _to_box(x, y, z, lift_box) - r)
            beside, above = max(math.sqrt(x * x + y * y) - base[0], 0.0), max(z - base[1], 0.0)
            best = min(best, math.sqrt(beside * beside + above * above) - r)
            best = min(best, _to_solids(x, y, z, theirs[0], theirs[1], theirs[2], 9.0) - r)
            if s >= own:
                continue
            for j in range(p2.shape[0]):
                dx, dy, dz = x - p2[j, 0], y - p2[j, 1], z - p2[j, 2]
                best = min(best, math.sqrt(dx * dx + dy * dy + dz * dz) - r - r2[j])
            if s >= first_hand:
                for j in range(2):
                    dx, dy, dz = x - p[k, j, 0], y - p[k, j, 1], z - p[k, j, 2]
                    best = min(best, math.sqrt(dx * dx + dy * dy + dz * dz) - fold)
        if mine[1].shape[0]:
            T = hands[k]
            for j in range(p2.shape[0]):
                dx, dy, dz = p2[j, 0] - T[0, 3], p2[j, 1] - T[1, 3], p2[j, 2] - T[2, 3]
                u = T[0, 0] * dx + T[1, 0] * dy + T[2, 0] * dz
                v = T[0, 1] * dx + T[1, 1] * dy + T[2, 1] * dz
                w = T[0, 2] * dx + T[1, 2] * dy + T[2, 2] * dz
                best = min(best, _to_solids(u, v, w, mine[0], mine[1], mine[2], 9.0) - r2[j])
        out[k] = best
    return out


@compiled
def fastest(at, first, second, speed, acceleration):  # type: ignore
    """(n,) times [s] at places `at` (n,) of a path with derivatives (n, J), from rest to rest: see `timing`."""
    n, joints = first.shape
    square = np.empty(n)  # of the speed along the path
    for i in range(n):
        most = np.inf
        for j in range(joints):
            v = abs(first[i, j])
            if v > 1e-9:
                most = min(most, (speed[j] / v) ** 2)
            k = abs(second[i, j])
            if k > 1e-9:
                most = min(most, 0.5 * acceleration[j] / k)  # the other half is left for speeding up and slowing down
        square[i] = most
    square[0] = 0.0
    square[n - 1] = 0.0
    for way in range(2):
        for step in range(n - 1):
            i = step if way == 0 else n - 1 - step
            k = i + 1 if way == 0 else i - 1
            most = np.inf
            for j in range(joints):
                v = abs(first[i, j]) + 1e-12
                most = min(most, max(0.0, acceleration[j] - abs(second[i, j]) * square[i]) / v)
            square[k] = min(square[k], square[i] + 2 * most * abs(at[k] - at[i]))
    times = np.zeros(n)
    for i in range(1, n):
        pace = math.sqrt(square[i]) + math.sqrt(square[i - 1])
        times[i] = times[i - 1] + 2 * (at[i] - at[i - 1]) / max(pace, 1e-6)
    return times
