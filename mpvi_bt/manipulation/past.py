"""What pictures showed under earlier prompts: walls and furniture that are out of view now stand there still."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.manipulation.frames import Frame
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.solids import Array

_CELL_M = 0.02  # of the points in one such cell one is kept
_STRIDE_PX = 2
_CARRIED_M, _FAR_M = 0.5, 2.5  # from the head: what is nearer is carried, mostly; what is farther is seen coarsely
_DEEPER_M = 0.05  # a point so far behind what is seen now is hidden, and may be there still
_NEAR_M = 1.6  # to each side of a place, as far as fields reach
_GROWN_PX = 2  # the edges of masks are never exact


class Past:
    """Points of surfaces, without what hands may have moved since, until a newer picture shows their place."""

    def __init__(self) -> None:
        """Remember nothing."""
        self._points = np.empty((0, 3))
        self._of = np.empty(0, object)  # what phrase each was asked for by; "" for the rest

    def keep(self, frames: Iterable[Frame], movable: Collection[str]) -> None:
        """Remember what frames show, the newest last, but for what the phrases `movable` name in them."""
        for frame in frames:
            if frame.image.camera != "head":
                continue
            old = ~_shows(frame, self._points)
            depth, of = frame.image.depth, np.full(frame.image.depth.shape, "", object)
            kept = frame.measured & ~frame.floor & (depth > _CARRIED_M) & (depth < _FAR_M)
            for shown in frame.detections:
                mask = ndimage.binary_dilation(shown.mask, iterations=_GROWN_PX)
                of[mask] = shown.phrase
                if shown.phrase in movable:
                    kept &= ~mask
            every = (slice(None, None, _STRIDE_PX),) * 2
            new = kept[every]
            points = np.concatenate([self._points[old], frame.points[every][new]])
            of = np.concatenate([self._of[old], of[every][new]])
            _, first = np.unique(np.floor(points / _CELL_M).astype(np.int32), axis=0, return_index=True)
            self._points, self._of = points[first], of[first]

    def surfaces(self, xy: Array, asked: Collection[str], frames: Iterable[Frame]) -> Array:
        """(n, 3) points [m] near a place (2,) that none of the `frames` shows the place of.

        Without what is asked for now: that is looked at anew, and its doors may have moved.
        """
        near = (np.abs(self._points[:, :2] - xy) < _NEAR_M).all(1) & ~np.isin(self._of, list(asked))
        points = self._points[near]
        for frame in frames:
            points = points[~_shows(frame, points)]
        return points


def _shows(frame: Frame, p_world: Array) -> NDArray[np.bool_]:
    """(n,) bool: whether a frame shows what is at points (n, 3) now: a surface there, or one behind them."""
    T, K, depth = kin.inverse(frame.image.T_world_camera), frame.image.K, frame.image.depth
    p = p_world @ T[:3, :3].T + T[:3, 3]
    before = p[:, 2] > 0.05
    z = np.where(before, p[:, 2], 1.0)
    u, v = (np.floor(K[i, i] * p[:, i] / z + K[i, 2]).astype(int) for i in range(2))
    height, width = depth.shape
    inside = before & (u >= 0) & (v >= 0) & (u < width) & (v < height)
    u, v = np.where(inside, u, 0), np.where(inside, v, 0)
    return np.asarray(inside & frame.measured[v, u] & (p[:, 2] < depth[v, u] + _DEEPER_M))
