"""What the network is given of a picture: colors, and geometry that says how large, how high and how level things are.

Nothing depends on which way the camera is turned about the vertical, and a mirrored picture has mirrored inputs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.solids import Array

CHANNELS = 12
# All our choice.
_NEAR_M, _WIDE_M = 0.03, 0.15  # scales of relief
_NEAR_PX, _WIDE_PX = 3, 12  # half the windows that relief is taken against
_STEP_PX = 2  # to the neighbors that a normal is taken by
_PIXEL_M = 0.005  # a usual size of a pixel where it meets what it shows
_MOST = 3.0

Planes = NDArray[np.float32]


def inputs_of(rgb: NDArray[np.uint8], depth: NDArray[np.float32], K: Array, T_world_camera: Array) -> Planes:
    """(H, W, CHANNELS) the inputs, about within -2 to 2.

    Red, green, blue; nearness; height; height and depth against their surroundings, narrow and wide; how level the
    surface is; size of a pixel; whether there is depth.

    Args:
        rgb: (H, W, 3).
        depth: (H, W) [m], 0 where nothing is seen.
        K: (3, 3) [px].
        T_world_camera: (4, 4), with z up from the floor.
    """
    out = np.empty((*depth.shape, CHANNELS), np.float32)
    lens = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]], np.float64)
    up = np.ascontiguousarray(T_world_camera[2], np.float64)
    _inputs(np.ascontiguousarray(rgb), np.ascontiguousarray(depth, np.float32), lens, up, out)
    return out


def _loops(
    rgb: NDArray[np.uint8], depth: NDArray[np.float32], lens: NDArray[np.float64], up: NDArray[np.float64], out: Planes
) -> None:
    """As `inputs_of`, into `out`. `lens`: fx, fy, cx, cy; `up`: the third row of T_world_camera."""
    h, w = depth.shape
    one, most = np.float32(1), np.float32(_MOST)
    filled, height = np.zeros((h, w), np.float32), np.zeros((h, w), np.float32)
    # sums of all above and to the left: how many are seen, their height, their depth
    seen, high, deep = np.zeros((h + 1, w + 1)), np.zeros((h + 1, w + 1)), np.zeros((h + 1, w + 1))
    xs = ((np.arange(w) + 0.5 - lens[2]) / lens[0]).astype(np.float32)
    ys = ((np.arange(h) + 0.5 - lens[3]) / lens[1]).astype(np.float32)
    up0, up1, up2, up3 = np.float32(up[0]), np.float32(up[1]), np.float32(up[2]), np.float32(up[3])
    for i in range(h):
        n, a, b = 0.0, 0.0, 0.0
        for j in range(w):
            d = depth[i, j]
            if d <= 0:  # a hole is filled from around it
                for y in range(max(i - 1, 0), min(i + 2, h)):
                    for x in range(max(j - 1, 0), min(j + 2, w)):
                        d = max(d, depth[y, x])
            if d > 0:
                filled[i, j] = d
                height[i, j] = d * (up0 * xs[j] + up1 * ys[i] + up2) + up3
                n, a, b = n + 1.0, a + height[i, j], b + d
            seen[i + 1, j + 1], high[i + 1, j + 1] = seen[i, j + 1] + n, high[i, j + 1] + a
            deep[i + 1, j + 1] = deep[i, j + 1] + b
    scale, pixel = np.float32(1 / 127.5), np.float32(1 / (lens[0] * _PIXEL_M))
    s = _STEP_PX
    for i in range(h):
        t, u = max(i - s, 0), min(i + s, h - 1)
        for j in range(w):
            out[i, j, 0] = rgb[i, j, 0] * scale - one
            out[i, j, 1] = rgb[i, j, 1] * scale - one
            out[i, j, 2] = rgb[i, j, 2] * scale - one
            out[i, j, 11] = one if depth[i, j] > 0 else np.float32(0)
            d, z = filled[i, j], height[i, j]
            if d <= 0:
                for k in range(3, 11):
                    out[i, j, k] = 0
                continue
            out[i, j, 3] = one / (d + np.float32(0.25)) - one
            out[i, j, 4] = min(max(z, -one), most) - one
            for k in range(2):
                half, wide = (_NEAR_PX, 1 / _NEAR_M) if k == 0 else (_WIDE_PX, 1 / _WIDE_M)
                a, b, e, f = max(i - half, 0), min(i + half + 1, h), max(j - half, 0), min(j + half + 1, w)
                share = 1 / (seen[b, f] - seen[a, f] - seen[b, e] + seen[a, e])
                rise = np.float32((z - (high[b, f] - high[a, f] - high[b, e] + high[a, e]) * share) * wide)
                sink = np.float32((d - (deep[b, f] - deep[a, f] - deep[b, e] + deep[a, e]) * share) * wide)
                out[i, j, 5 + 2 * k] = min(max(rise, -most), most)
                out[i, j, 6 + 2 * k] = min(max(sink, -most), most)
            left, right = max(j - s, 0), min(j + s, w - 1)
            dl, dr, dt, du = filled[i, left], filled[i, right], filled[t, j], filled[u, j]
            out[i, j, 9] = 0
            if dl > 0 and dr > 0 and dt > 0 and du > 0:
                ax, ay, az = xs[right] * dr - xs[left] * dl, ys[i] * (dr - dl), dr - dl
                bx, by, bz = xs[j] * (du - dt), ys[u] * du - ys[t] * dt, du - dt
                nx, ny, nz = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
                size = np.sqrt(nx * nx + ny * ny + nz * nz) + np.float32(1e-12)
                out[i, j, 9] = (up0 * nx + up1 * ny + up2 * nz) / size
            out[i, j, 10] = min(max(np.log(max(d, np.float32(0.02)) * pixel), -most), most)


_inputs = compiled_later(_loops)
