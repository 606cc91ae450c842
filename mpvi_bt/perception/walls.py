"""Walls, and what else stands fixed and tall: remembered while they are out of view, for the head can't turn aside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.perception.field import kernels
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.protocol import CameraImage
from mpvi_bt.robot.solids import Array

_CELL_M, _BAND_M = 0.025, 0.1  # of the grid, along the floor and up
_CELLS, _BANDS = 512, 20  # 12.8 m about the robot, and 2 m up
_LOW_M = 0.1  # the floor is none
_MOVED_M = 3.0  # so far from its middle the grid comes along
_RANGE_M = 2.5  # what is farther off is seen again from near
_SURE = 3  # pictures that show a place as it is now outweigh any number of older ones
_TALL_M, _WHOLE = 1.0, 0.7  # what is at least so tall, seen in that share of its height, is taken to stand there


class Walls:
    """Where something tall was seen to stand that no name was asked for, on a grid that goes with the robot.

    Our choice: of all that earlier pictures showed only this is remembered from one instruction to the next. A base
    that is led along a wall it no longer sees runs into it, while things and doors that have moved since bar the way.
    """

    def __init__(self) -> None:
        """Know of none."""
        self._score = np.zeros((_CELLS, _CELLS, _BANDS), np.int8)
        self._low = np.full(2, np.nan)

    def see(self, image: CameraImage, fixed: NDArray[np.bool_]) -> None:
        """Take in a picture; `fixed` (H, W) is where it shows what may be a wall, and not the robot, say."""
        self._come_along(image.T_world_camera[:2, 3])
        depth = np.where(fixed, image.depth, -image.depth).astype(np.float32)
        begin = np.floor((image.T_world_camera[:2, 3] - _RANGE_M - self._low) / _CELL_M).astype(int)
        begin, end = (np.clip(n, 0, _CELLS) for n in (begin, begin + round(2 * _RANGE_M / _CELL_M) + 2))
        near = self._score[begin[0] : end[0], begin[1] : end[1]]
        first = np.append(self._low + _CELL_M * (begin + 0.5), _LOW_M + _BAND_M / 2)
        T = kin.inverse(image.T_world_camera) @ kin.transform(np.eye(3), first)
        camera = np.array([image.K[0, 0], image.K[1, 1], image.K[0, 2], image.K[1, 2]])
        kernels()["score"](near, depth, T, camera, _CELL_M, _BAND_M, _RANGE_M, _SURE)

    def tops(self, xy: Array) -> Array:
        """(...,) how high [m] what stands at places (..., 2) reaches; 0 where none is known to."""
        out = np.zeros(xy.shape[:-1])
        if np.isnan(self._low).any():
            return out
        i, j = np.moveaxis(np.floor((xy - self._low) / _CELL_M).astype(int), -1, 0)
        known = (i >= 0) & (j >= 0) & (i < _CELLS) & (j < _CELLS)
        solid = self._score[i[known], j[known]] > 0
        top = _BANDS - solid[:, ::-1].argmax(1)
        tall = top - solid.argmax(1)
        stands = solid.any(1) & (tall * _BAND_M >= _TALL_M) & (solid.sum(1) >= _WHOLE * tall)
        out[known] = np.where(stands, _LOW_M + _BAND_M * top, 0.0)
        return out

    def _come_along(self, xy: Array) -> None:
        """Keep the grid about a place (2,); what falls off its edge is forgotten."""
        middle = self._low + _CELL_M * _CELLS / 2
        if (np.abs(xy - middle) < _MOVED_M).all():
            return
        low = (np.round(xy / _CELL_M) - _CELLS // 2) * _CELL_M
        score = np.zeros_like(self._score)
        if not np.isnan(self._low).any():
            shift = np.round((low - self._low) / _CELL_M).astype(int)
            if (np.abs(shift) < _CELLS).all():
                new, old = (tuple(slice(max(0, s), _CELLS + min(0, s)) for s in sign * shift) for sign in (-1, 1))
                score[new] = self._score[old]
        self._score, self._low = score, low
