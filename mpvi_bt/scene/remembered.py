"""What stands around, remembered from one instruction to the next: walls beside, and what the arm before it hides."""

from __future__ import annotations

import mmap

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul
from mpvi_bt.robot.protocol import CameraImage
from mpvi_bt.robot.solids import Array
from mpvi_bt.scene.field import kernels

_CELL_M = 0.025
_CELLS, _UP = 512, 78  # 12.8 m about the robot, and 1.95 m up
_LOW_M = 0.05  # the floor is none
_MOVED_M = 3.0  # so far from its middle the grid comes along
_RANGE_M = 2.5  # what is farther off is seen again from near
_SURE = 3  # pictures that show a place as it is now outweigh any number of older ones
_TWICE = 2  # what one picture alone shows may be noise, but for what is tall
_TALL_M, _WHOLE = 1.0, 0.6  # what is at least so tall, seen in that share of its height, is taken to stand there
_OVERHEAD_M = 1.2  # things that are moved, chairs and what stands on desks among them, do not reach as high as that


class Remembered:
    """Where surfaces of furniture and of what no name was asked for were seen, on a grid that goes with the robot.

    Our choice: it serves where pictures from the present place have nothing to tell. A base that is led along a wall
    which is out of view by now would run into it, and an arm that carries something hides from the head the very edge
    that it then meets. Of what is out of view only what is tall or overhead counts: other things may
    have moved since.
    """

    def __init__(self) -> None:
        """Know of none."""
        self._score = np.zeros((0, 0, 0), np.int8)  # until there is a picture
        self._low = np.full(2, np.nan)

    def see(self, image: CameraImage, fixed: NDArray[np.bool_]) -> None:
        """Take in a picture; `fixed` (H, W) is where it shows what is to be remembered, and not the robot, say."""
        self._come_along(image.T_world_camera[:2, 3])
        depth = np.where(fixed, image.depth, -image.depth).astype(np.float32)
        begin = np.floor((image.T_world_camera[:2, 3] - _RANGE_M - self._low) / _CELL_M).astype(int)
        begin, end = (np.clip(n, 0, _CELLS) for n in (begin, begin + round(2 * _RANGE_M / _CELL_M) + 2))
        near = self._score[begin[0] : end[0], begin[1] : end[1]]
        first = np.append(self._low + _CELL_M * (begin + 0.5), _LOW_M + _CELL_M / 2)
        T = matmul(kin.inverse(image.T_world_camera), kin.transform(np.eye(3), first))
        camera = np.array([image.K[0, 0], image.K[1, 1], image.K[0, 2], image.K[1, 2]])
        kernels()["score"](near, depth, T, camera, _CELL_M, _RANGE_M, _SURE)

    def around(self, x: Array, y: Array, z: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """What is at the crossings of three ranges of coordinates [m].

        Returns:
            stays: (len(x), len(y), len(z)) what is there though it be out of view: up to its top what is tall, and what
                hangs overhead.
            shown: Likewise every surface that was seen, and not to be gone since.
        """
        shape = len(x), len(y), len(z)
        stays, shown = np.zeros(shape, bool), np.zeros(shape, bool)
        if not np.isnan(self._low).any():
            low = np.append(self._low, _LOW_M)
            cells = [np.floor((c - o) / _CELL_M).astype(int) for c, o in zip((x, y, z), low, strict=True)]
            within = [(n >= 0) & (n < count) for n, count in zip(cells, self._score.shape, strict=True)]
            i, j, k = (n[w] for n, w in zip(cells, within, strict=True))
            score = self._score[np.ix_(i, j)]
            solid = score > 0
            top = np.where(solid.any(-1), _UP - solid[..., ::-1].argmax(-1), 0)
            tall = top - solid.argmax(-1)
            whole = (tall * _CELL_M >= _TALL_M) & (solid.sum(-1) >= _WHOLE * tall)
            top_m = np.where(whole, _LOW_M + _CELL_M * top, 0.0)
            shown[np.ix_(*within)] = score[..., k] >= _TWICE
            stays[np.ix_(*within[:2])] = (z < top_m[..., None]) & (top_m[..., None] > _OVERHEAD_M)
            stays |= shown & (z > _OVERHEAD_M)
        return stays, shown

    def forget(self, low: Array, high: Array) -> None:
        """Forget what was seen between two corners (3,) of a box in the world: it has been taken away."""
        if not np.isnan(self._low).any():
            corners = [np.floor((p - np.append(self._low, _LOW_M)) / _CELL_M).astype(int) for p in (low, high)]
            begin, end = (np.clip(n, 0, self._score.shape) for n in (corners[0], corners[1] + 1))
            self._score[tuple(slice(*ends) for ends in zip(begin, end, strict=True))] = 0

    def _come_along(self, xy: Array) -> None:
        """Keep the grid about a place (2,); what falls off its edge is forgotten."""
        middle = self._low + _CELL_M * _CELLS / 2
        if (np.abs(xy - middle) < _MOVED_M).all():
            return
        low = (np.round(xy / _CELL_M) - _CELLS // 2) * _CELL_M
        score = _grid()
        if not np.isnan(self._low).any():
            shift = np.round((low - self._low) / _CELL_M).astype(int)
            if (np.abs(shift) < _CELLS).all():
                new, old = (tuple(slice(max(0, s), _CELLS + min(0, s)) for s in sign * shift) for sign in (-1, 1))
                score[new] = self._score[old]
        self._score, self._low = score, low


def _grid() -> NDArray[np.int8]:
    """(512, 512, 78) zeros in memory of its own, 20 MB, which goes back to the system as a whole.

    What malloc has once given back in such pieces it takes from its heap from then on, where they leave holes: a
    process grew by the most of one with each policy that was made and dropped. Pages that nobody writes take none.
    """
    private = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    return np.frombuffer(mmap.mmap(-1, _CELLS * _CELLS * _UP, private), np.int8).reshape(_CELLS, _CELLS, _UP)
