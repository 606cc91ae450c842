"""Compiled loops: what the inverses of arms share, distances of spheres to solids and the robot, turns, paths' times.

Planning asks these thousands of times a second, one or a few postures at a time, where array expressions cost mostly
their own overhead. `collision` and `timing` say what each one computes; here shapes are taken to be right.

The first run on a machine waits until all are compiled. So they are written to compile fast: loops over single numbers
take a third of the time of slices and array expressions, and a constant argument is an `integer`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mpvi_bt.ground.compiled import compiled

integer: Any = np.int64  # integer(2) is an argument like any other; for each plain constant numba compiles a loop anew


@compiled
def identity(R):  # type: ignore
    """Write the rotation by nothing."""
    for i in range(3):
        for j in range(3):
            R[i, j] = 1.0 if i == j else 0.0


@compiled
def framed(R, p, out):  # type: ignore
    """Write the frame (4, 4) of a rotation and a place; its last row is zeros so far."""
    for i in range(3):
        for j in range(3):
            out[i, j] = R[i, j]
        out[i, 3] = p[i]
    out[3, 3] = 1.0


@compiled
def shifted(p, by, R, axis):  # type: ignore
    """Move a place by so much along an axis of a rotation."""
    for i in range(3):
        p[i] += by * R[i, axis]


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
def distance(q, near, weights):  # type: ignore
    """Weighted squared distance of two postures."""
    total = 0.0
    for j in range(7):
        total += weights[j] * (q[j] - near[j]) ** 2
    return total


@compiled
def leaps(q, after, leap):  # type: ignore
    """Whether a joint turns by more than `leap` [rad] from one posture to another."""
    for j in range(7):  # noqa: SIM110
        if abs(after[j] - q[j]) > leap:
            return True
    return False


@compiled
def copied(values, out):  # type: ignore
    """Write values (n,) to `out`."""
    for k in range(values.shape[0]):
        out[k] = values[k]


@compiled
def doubled(index, out):  # type: ignore
    """The same index (m,) and postures (m, 7), with as much room again behind them."""
    room = index.shape[0]
    longer, wider = np.empty(2 * room, np.int64), np.empty((2 * room, 7))
    for k in range(room):
        longer[k] = index[k]
        copied(out[k], wider[k])
    return longer, wider


@compiled
def narrowed(low, high, left, right, one, two, at):  # type: ignore
    """The interval that a golden section goes on with, `one` and `two` being the costs at `left` and at `right`.

    Where both are infinite, out of reach or limits, it is the part toward `at`, where there is a posture.
    """
    if one == np.inf and two == np.inf:
        if at < left:
            return low, left
        if at > right:
            return right, high
        return left, right
    return (low, right) if one < two else (left, high)


@compiled
def sphere_centers(frames, chest, centers, link):  # type: ignore
    """(n, m, 3) centers in the base frame of spheres (m, 3) in the frame of their link, and (n, 4, 4) T_base_tcp.

    `chest` is T_base_chest of each posture, or of all of them: (n, 4, 4) or (1, 4, 4).
    """
    n, m, parts = frames.shape[0], centers.shape[0], frames.shape[1]
    out, hands = np.empty((n, m, 3)), np.zeros((n, 4, 4))
    F = np.empty((parts, 3, 4))
    for k in range(n):
        C = chest[min(k, chest.shape[0] - 1)]
        for f in range(parts):
            for i in range(3):
                for j in range(4):
                    F[f, i, j] = (
                        C[i, 0] * frames[k, f, 0, j] + C[i, 1] * frames[k, f, 1, j] + C[i, 2] * frames[k, f, 2, j]
                    )
                F[f, i, 3] += C[i, 3]
        for i in range(3):
            copied(F[parts - 1, i], hands[k, i])
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
    p, radii, first_hand, own, hands, chest, boxes, boxes_from, columns, base, fold, p2, r2, theirs, links, mine
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
        columns: (c, 6) likewise in the base frame.
        base: (2,) radius and height of the base.
        fold: How near the hand may come to the middle of its own shoulder.
        p2: (k, 3) spheres of the other arm and of the trunk's links.
        r2: (k,) their radii.
        theirs: What the other hand holds, in the base frame: inverse poses, half extents, which are round.
        links: The trunk's links, likewise.
        mine: What this hand holds, likewise in its tcp frame.
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
            for j in range(columns.shape[0]):
                best = min(best, _to_box(x, y, z, columns[j]) - r)
            beside, above = max(math.sqrt(x * x + y * y) - base[0], 0.0), max(z - base[1], 0.0)
            best = min(best, math.sqrt(beside * beside + above * above) - r)
            best = min(best, _to_solids(x, y, z, theirs[0], theirs[1], theirs[2], 9.0) - r)
            if s >= own:
                continue
            best = min(best, _to_solids(x, y, z, links[0], links[1], links[2], 9.0) - r)
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
def quaternion(R):  # type: ignore
    """(4,) x, y, z, w, not normalized, of a rotation (3, 3): from the largest of the four, see `rotations`."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    largest = max(R[0, 0], R[1, 1], R[2, 2], trace)
    q = np.empty(4)
    if largest == trace:
        q[0], q[1], q[2], q[3] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + trace
    elif largest == R[0, 0]:
        q[0], q[1] = 1.0 + R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0]
        q[2], q[3] = R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]
    elif largest == R[1, 1]:
        q[0], q[1] = R[0, 1] + R[1, 0], 1.0 + R[1, 1] - R[0, 0] - R[2, 2]
        q[2], q[3] = R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]
    else:
        q[0], q[1] = R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
        q[2], q[3] = 1.0 + R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]
    return q


@compiled
def quaternions(R):  # type: ignore
    """(n, 4) the same of n rotations (n, 3, 3)."""
    out = np.empty((R.shape[0], 4))
    for k in range(R.shape[0]):
        copied(quaternion(R[k]), out[k])
    return out


@compiled
def normalized(q):  # type: ignore
    """(4,) the quaternion of length 1."""
    out, length = np.empty(4), math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(4):
        out[k] = q[k] / length
    return out


@compiled
def product(p, q):  # type: ignore
    """(4,) normalized product of quaternions: q, then p."""
    out = np.empty(4)
    out[0] = p[3] * q[0] + q[3] * p[0] + (p[1] * q[2] - p[2] * q[1])
    out[1] = p[3] * q[1] + q[3] * p[1] + (p[2] * q[0] - p[0] * q[2])
    out[2] = p[3] * q[2] + q[3] * p[2] + (p[0] * q[1] - p[1] * q[0])
    out[3] = p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2]
    return normalized(out)


@compiled
def turn(p, q):  # type: ignore
    """(4,) the quaternion that leads from p to q, the short way: w is not negative."""
    back = np.empty(4)
    for k in range(3):
        back[k] = p[k] * -1.0
    back[3] = p[3]
    d = product(back, q)
    for k in (3, 0, 1, 2):
        if d[k] > 0.0:
            return d
        if d[k] < 0.0:
            for j in range(4):
                d[j] = -d[j]
            return d
    return d


@compiled
def turned(p, q, shares):  # type: ignore
    """(n, 4) unit quaternions on the short way from p to q: see `rotations`."""
    d = turn(p, q)
    angle = 2.0 * math.atan2(math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), d[3])
    square = angle * angle
    scale = 2.0 + square / 12.0 + 7.0 * square * square / 2880.0 if angle <= 1e-3 else angle / math.sin(angle / 2.0)
    out = np.empty((shares.shape[0], 4))
    part = np.empty(4)
    for k in range(shares.shape[0]):
        x, y, z = scale * d[0] * shares[k], scale * d[1] * shares[k], scale * d[2] * shares[k]
        half = math.sqrt(x * x + y * y + z * z)
        square = half * half
        by = 0.5 - square / 48.0 + square * square / 3840.0 if half <= 1e-3 else math.sin(half / 2.0) / half
        part[0], part[1], part[2], part[3] = x * by, y * by, z * by, math.cos(half / 2.0)
        copied(product(p, part), out[k])
    return out


@compiled
def matrices(q):  # type: ignore
    """(n, 3, 3) rotations of unit quaternions (n, 4)."""
    out = np.empty((q.shape[0], 3, 3))
    for k in range(q.shape[0]):
        x, y, z, w = q[k, 0], q[k, 1], q[k, 2], q[k, 3]
        xx, yy, zz, ww = x * x, y * y, z * z, w * w
        out[k, 0, 0], out[k, 0, 1], out[k, 0, 2] = xx - yy - zz + ww, 2 * (x * y - z * w), 2 * (x * z + y * w)
        out[k, 1, 0], out[k, 1, 1], out[k, 1, 2] = 2 * (x * y + z * w), -xx + yy - zz + ww, 2 * (y * z - x * w)
        out[k, 2, 0], out[k, 2, 1], out[k, 2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), -xx - yy + zz + ww
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
