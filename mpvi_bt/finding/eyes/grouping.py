"""From answers by pixel to segments: connected pixels of one kind, and movable things that touch told apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.eyes.eyes_layers import CELL_PX, COVERS, OFFSET_PX
from mpvi_bt.finding.eyes.inputs import Planes
from mpvi_bt.ground.compiled import compiled_later

Labels = NDArray[np.int32]
MOVABLE = COVERS.index("movable")
# All our choice.
LEAST_PX = 8  # a segment of fewer pixels is left out
_STILL_GAP = (0.15, 0.06)  # neighbors of one kind whose depth differs by more [m, and part of it] are two things
_MOVABLE_GAP = (0.04, 0.04)
_CENTER = -1.2  # least logit of a center
_SHARE = 0.12  # of connected movable pixels, the least that a center of its own gets
_STILL_PX = 120  # a smaller segment of furniture joins its neighbor with the longest common border
_STILL_LEAST_PX = 24  # or is left out, if it is smaller than this and borders on none
_WITHIN_PX, _WITHIN = 3000, 0.5  # one of fewer pixels, so much of whose border is with a larger one, is a part of that
_FLUSH = (0.03, 0.03)  # if their depth differs by no more there [m, and part of it]
_OWN = (0.08, 0.05)  # so far from its cell's depth [m, and part of it] a pixel may be of a neighboring cell


def still_segments(kinds: Labels, depth: NDArray[np.float32], whole: Labels) -> tuple[Labels, Labels]:
    """Segments of what stays where it is.

    Args:
        kinds: (H, W) kind of each pixel, 0 for none.
        depth: (H, W) [m].
        whole: Kinds of which all pixels are one segment.

    Returns:
        (H, W) segments, counted from 1, and (n,) their kinds.
    """
    parts = np.zeros(kinds.shape, np.int32)
    kinds, whole = np.ascontiguousarray(kinds, np.int32), np.asarray(whole, np.int32)
    found = np.asarray(_components(kinds, depth, *_STILL_GAP, whole, parts), np.int32)
    number = np.zeros(len(found) + 1, np.int32)
    _merge(parts, depth, np.isin(found, whole), number)
    kept = np.unique(number)
    place = np.zeros(len(found) + 1, np.int32)
    place[kept] = np.arange(len(kept)) if kept[0] == 0 else np.arange(1, len(kept) + 1)
    return place[number][parts], found[kept[kept > 0] - 1]


def movable_segments(
    movable: NDArray[np.bool_], depth: NDArray[np.float32], near: Planes, way: Planes
) -> tuple[Labels, int]:
    """Movable things: (H, W) segments, counted from 1, and how many.

    Args:
        movable: (H, W) pixels that something movable covers.
        depth: (H, W) [m].
        near, way: As of `Answers`.
    """
    parts = np.zeros(movable.shape, np.int32)
    count = len(
        _components(movable.astype(np.int32), depth, *_MOVABLE_GAP, np.zeros(0, np.int32), parts)  # of one kind
    )
    out = np.zeros(movable.shape, np.int32)
    return out, int(_split(parts, count, np.ascontiguousarray(near), np.ascontiguousarray(way), out))


def sharpened(cells: Labels, allowed: NDArray[np.bool_], depth: NDArray[np.float32]) -> Labels:
    """(H, W) the value of each pixel's cell, or of a neighboring cell whose depth is far nearer to the pixel's.

    Args:
        cells: (h, w) a value of each cell, 0 for none.
        allowed: (H, W) pixels that are given a value; all others get 0.
        depth: (H, W) [m].
    """
    out = np.zeros(depth.shape, np.int32)
    _sharpen(np.ascontiguousarray(cells, np.int32), allowed, depth, out)
    return out


def _components_loops(
    kinds: Labels, depth: NDArray[np.float32], gap: float, gap_share: float, whole: Labels, out: Labels
) -> list[np.int64]:
    """Number connected pixels of one kind in `out`, in the order of their first pixels; the kinds of the segments."""
    h, w = kinds.shape
    stack = np.empty(h * w, np.int64)
    found = [np.int64(0)]
    own = np.zeros(kinds.max() + 2, np.int32)  # the segment of a kind that is whole
    for start in range(h * w):
        kind = kinds[start // w, start % w]
        if kind == 0 or out[start // w, start % w] != 0:
            continue
        is_whole = False
        for k in range(len(whole)):
            is_whole |= whole[k] == kind
        if is_whole and own[kind] > 0:
            number = own[kind]
        else:
            found.append(np.int64(kind))
            number = len(found) - 1
            if is_whole:
                own[kind] = number
        out[start // w, start % w] = number
        stack[0], top, first = start, 1, 0
        count = 0
        while first < top:
            at = stack[first]
            first += 1
            count += 1
            i, j = at // w, at % w
            d = depth[i, j]
            for k in range(4):
                a, b = i + (k == 0) - (k == 1), j + (k == 2) - (k == 3)
                if a < 0 or b < 0 or a >= h or b >= w or kinds[a, b] != kind or out[a, b] != 0:
                    continue
                e = depth[a, b]
                if not is_whole and d > 0 and e > 0 and abs(d - e) > gap + gap_share * min(d, e):
                    continue
                out[a, b] = number
                stack[top] = a * w + b
                top += 1
        if count < LEAST_PX and not is_whole:
            for k in range(count):
                out[stack[k] // w, stack[k] % w] = -1  # too small, and not to be begun again
            found.pop()
    for i in range(h):
        for j in range(w):
            if out[i, j] < 0:
                out[i, j] = 0
    return found[1:]


def _merge_loops(parts: Labels, depth: NDArray[np.float32], whole: NDArray[np.bool_], number: Labels) -> None:
    """Give parts that are small or within others to those: where each goes, 0 for nowhere, into `number`."""
    h, w = parts.shape
    n = len(whole) + 1
    area, around = np.zeros(n, np.int64), np.zeros(n, np.int64)
    border, flush = np.zeros((n, n), np.int32), np.zeros((n, n), np.int32)
    for i in range(h):
        for j in range(w):
            a = parts[i, j]
            area[a] += 1
            for k in range(2):
                if (k == 0 and i + 1 < h) or (k == 1 and j + 1 < w):
                    b = parts[i + 1 - k, j + k]
                    if a != b:
                        d, e = depth[i, j], depth[i + 1 - k, j + k]
                        level = abs(d - e) <= _FLUSH[0] + _FLUSH[1] * min(d, e)
                        border[a, b] += 1
                        border[b, a] += 1
                        flush[a, b] += level
                        flush[b, a] += level
                        around[a] += 1
                        around[b] += 1
    for k in range(1, n):
        number[k] = k
    for k in np.argsort(area):
        if k == 0 or whole[k - 1] or area[k] >= _WITHIN_PX:
            continue
        small = area[k] < _STILL_PX
        best, one = 0, 0
        for m in range(1, n):
            if m == k or number[m] != m or whole[m - 1]:
                continue
            shared = border[k, m] if small else flush[k, m]
            if shared > best and (small or (shared >= _WITHIN * around[k] and area[m] > area[k])):
                best, one = shared, m
        if one == 0:
            if area[k] < _STILL_LEAST_PX:
                number[k] = 0
            continue
        number[k] = one
        area[one] += area[k]
        around[one] += around[k] - 2 * border[k, one]
        for m in range(1, n):
            border[one, m] += border[k, m]
            border[m, one] += border[m, k]
            flush[one, m] += flush[k, m]
            flush[m, one] += flush[m, k]
        border[one, one] = flush[one, one] = 0
    for k in range(1, n):
        at = k
        while number[at] != at and number[at] != 0:
            at = number[at]
        number[k] = number[at]


def _split_loops(parts: Labels, count: int, near: Planes, way: Planes, out: Labels) -> int:
    """Part connected movable pixels by centers, into `out`; how many segments there are."""
    h, w = parts.shape
    rows, columns = near.shape
    ys, xs, of = [0.0], [0.0], [0]
    for i in range(rows):
        for j in range(columns):
            here = near[i, j]
            if here < _CENTER:
                continue
            peak = True
            for a in range(max(i - 1, 0), min(i + 2, rows)):
                for b in range(max(j - 1, 0), min(j + 2, columns)):
                    peak &= near[a, b] < here or (near[a, b] == here and (a, b) >= (i, j))
            if not peak:
                continue
            y, x = i * CELL_PX + 1.5, j * CELL_PX + 1.5
            part = 0  # that most of the cell shows
            for a in range(i * CELL_PX, min(i * CELL_PX + CELL_PX, h)):
                for b in range(j * CELL_PX, min(j * CELL_PX + CELL_PX, w)):
                    if parts[a, b] > 0:
                        part = parts[a, b]
            if part > 0:
                ys.append(y)
                xs.append(x)
                of.append(part)
    n = len(ys)
    votes, sizes = np.zeros(n, np.int64), np.zeros(count + 1, np.int64)
    nearest = np.zeros((h, w), np.int32)
    kept = np.ones(n, np.bool_)
    for turn in range(2):  # once for all centers, and once for those that many voted for
        if turn == 1:
            for k in range(1, n):
                kept[k] = votes[k] >= max(LEAST_PX, _SHARE * sizes[of[k]])
        for i in range(h):
            for j in range(w):
                part = parts[i, j]
                if part == 0:
                    continue
                sizes[part] += 1 - turn
                a, b = i // CELL_PX, j // CELL_PX
                x = b * CELL_PX + 1.5 + OFFSET_PX * way[a, b, 0]
                y = a * CELL_PX + 1.5 + OFFSET_PX * way[a, b, 1]
                best, one = 1e18, 0
                for k in range(1, n):
                    if of[k] == part and kept[k]:
                        away = (xs[k] - x) ** 2 + (ys[k] - y) ** 2
                        if away < best:
                            best, one = away, k
                nearest[i, j] = one
                if turn == 0:
                    votes[one] += 1
    numbers = np.zeros((count + 1, n), np.int32)
    found = 0
    for i in range(h):
        for j in range(w):
            part = parts[i, j]
            if part > 0:
                if numbers[part, nearest[i, j]] == 0:
                    found += 1
                    numbers[part, nearest[i, j]] = found
                out[i, j] = numbers[part, nearest[i, j]]
    return found


def _sharpen_loops(cells: Labels, allowed: NDArray[np.bool_], depth: NDArray[np.float32], out: Labels) -> None:
    """As `sharpened`, into `out`."""
    h, w = depth.shape
    rows, columns = cells.shape
    deep = np.zeros(cells.shape, np.float32)  # mean depth of the allowed pixels of a cell
    for i in range(rows):
        for j in range(columns):
            total, n = np.float32(0), 0
            for a in range(i * CELL_PX, min(i * CELL_PX + CELL_PX, h)):
                for b in range(j * CELL_PX, min(j * CELL_PX + CELL_PX, w)):
                    if allowed[a, b] and depth[a, b] > 0:
                        total += depth[a, b]
                        n += 1
            deep[i, j] = total / n if n else np.float32(-1)
    for i in range(h):
        for j in range(w):
            if not allowed[i, j]:
                continue
            a, b = i // CELL_PX, j // CELL_PX
            c = min(max(a + (1 if i % CELL_PX >= CELL_PX // 2 else -1), 0), rows - 1)
            e = min(max(b + (1 if j % CELL_PX >= CELL_PX // 2 else -1), 0), columns - 1)
            value, best = cells[a, b], np.float32(1e9)
            if deep[a, b] > 0 and depth[i, j] > 0:
                best = abs(deep[a, b] - depth[i, j])
            if value == 0 or (best < 1e8 and best > _OWN[0] + _OWN[1] * depth[i, j]):
                best *= np.float32(0.5)
                for k in range(1, 4):
                    p, q = (a if k < 2 else c), (b if k % 2 == 0 else e)
                    if cells[p, q] == 0:
                        continue
                    off = abs(deep[p, q] - depth[i, j]) if deep[p, q] > 0 and depth[i, j] > 0 else np.float32(1)
                    if off < best:
                        best, value = off, cells[p, q]
            out[i, j] = value


_components = compiled_later(_components_loops)
_merge = compiled_later(_merge_loops)
_split = compiled_later(_split_loops)
_sharpen = compiled_later(_sharpen_loops)
