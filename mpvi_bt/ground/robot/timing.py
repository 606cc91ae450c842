"""When a path is where: as fast as speed and acceleration limits allow, corners rounded, with no jerks.

A path is a row of points (n, J), joined by straight legs; its columns are whatever has limits: joints [rad], a lift or
a hand's travel [m], a base. Along the path the speed is the highest that every column's limits leave, found by one pass
forward and one backward over a fine grid (Bobrow et al. 1985, discretized); a short moving average of the result
bounds the jerk without leaving the path.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mpvi_bt.ground.geometry import kernels
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ

_ROUNDING = 0.02  # how far a rounded corner keeps from the point [rad or m]
_GRID = 0.004  # of the longest column
_SMOOTHED = 5  # control steps of the moving average: a sixth of a second from rest to full acceleration


def timed(points: Sequence[Array] | Array, speed: Array, acceleration: Array) -> Array:
    """A path at the control rate, from rest to rest.

    Args:
        points: (n, J) the path; its corners are rounded by at most 2 cm or 0.02 rad.
        speed: (J,) highest speed of each column, its unit a second.
        acceleration: (J,) highest acceleration of each column.

    Returns:
        (m, J) where to be at each step from the first on, the last being the end of the path; m is 0 if it has no
        length.
    """
    path = _fine(_rounded(np.asarray(points, float)))
    if len(path) < 2:
        return np.zeros((0, path.shape[1]))
    places = schedule(path, speed, acceleration)
    return np.stack([np.interp(places, np.arange(len(path)), column) for column in path.T], 1)


def schedule(path: Array, speed: Array, acceleration: Array) -> Array:
    """(m,) at which of the points of a fine path (n, J) to be at each step, with fractions; ends at n - 1."""
    lengths = norm(np.diff(path, axis=0) / speed, axis=1)
    at = np.concatenate([[0.0], np.cumsum(np.maximum(lengths, 1e-9))])
    first = np.gradient(path, at, axis=0, edge_order=1)
    second = np.gradient(first, at, axis=0, edge_order=1)
    times = kernels.fastest(at, first, second, np.asarray(speed, float), np.asarray(acceleration, float))
    for _ in range(4):
        places = _sampled(times)
        done = np.stack([np.interp(places, np.arange(len(path)), column) for column in path.T], 1)
        velocity = np.diff(np.concatenate([path[:1], done, path[-1:]]), axis=0) * CONTROL_HZ
        change = np.diff(velocity, axis=0) * CONTROL_HZ
        over = max(float((np.abs(velocity) / speed).max()), float(np.sqrt((np.abs(change) / acceleration).max())))
        if over <= 1.005:
            break
        times = times * min(over, 1.5)  # what the grid was too coarse for
    return places


def _sampled(times: Array) -> Array:
    steps = int(np.ceil(times[-1] * CONTROL_HZ))
    rough = np.interp(np.arange(-_SMOOTHED, steps + _SMOOTHED) / CONTROL_HZ, times, np.arange(len(times)))
    even = sliding_window_view(rough, _SMOOTHED).mean(1)[2:]
    end = int(np.argmax(even >= len(times) - 1 - 1e-6))
    return np.append(even[:end], len(times) - 1.0)


def _rounded(points: Array) -> Array:
    """The path with a parabola in place of each corner, tangent to both legs."""
    kept = np.ones(len(points), bool)
    kept[1:] = np.abs(np.diff(points, axis=0)).max(1) > 1e-9
    points = points[kept]
    out = [points[0]]
    u = np.linspace(0, 1, 9)[:, None]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        a, b = corner - before, after - corner
        la, lb = float(norm(a)), float(norm(b))
        bend = float(np.abs(b / lb - a / la).max())
        reach = min(la / 2, lb / 2, 4 * _ROUNDING / max(bend, 1e-9))
        start, end = corner - a / la * reach, corner + b / lb * reach
        out.extend((1 - u) ** 2 * start + 2 * u * (1 - u) * corner + u**2 * end)
    return np.array([*out, points[-1]])


def _fine(points: Array) -> Array:
    """The same path in even, short steps."""
    at = np.concatenate([[0.0], np.cumsum(norm(np.diff(points, axis=0), axis=1))])
    if at[-1] < 1e-6:
        return points[-1:]
    n = int(np.clip(np.ceil(at[-1] / _GRID), 20, 1500))
    return np.stack([np.interp(np.linspace(0, at[-1], n + 1), at, column) for column in points.T], 1)
