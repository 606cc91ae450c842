"""Surroundings remembered across instructions: walls beside the robot, and things hidden by its arm."""

from __future__ import annotations

import mmap
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.field import CELL_M, kernels
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage


@dataclass(frozen=True)
class Grid:
    """The grid on which surfaces are remembered.

    Our choice: as fine as the field of obstacles, as wide as a room.
    """

    cell_m: float = CELL_M  # edge of a cell [m]
    cells: int = 512  # cells about the robot each way: 12.8 m
    up: int = 78  # cells upward: 1.95 m
    low_m: float = 0.05  # lowest height of the grid, above the floor [m]
    moved_m: float = 3.0  # distance from its middle at which the grid moves along [m]
    range_m: float = 2.5  # a surface farther off is seen again from nearby [m]
    sure: int = 3  # pictures of a place as it is now that outweigh any number of older ones
    twice: int = 2  # pictures that have to show a low surface; one alone may be noise
    tall_m: float = 1.0  # height of a tall thing [m]
    whole: float = 0.6  # part of its height seen for a tall thing to stand there [ratio]
    overhead_m: float = 1.2  # movable things, such as chairs and things on desks, end below this [m]


_GRID = Grid()


class Remembered:
    """Grid of surfaces seen earlier: furniture, and things not asked for by name. The grid moves with the robot.

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
        """Add a picture. `fixed` (H, W) marks the pixels to remember, for example none of the robot."""
        self._come_along(image.T_world_camera[:2, 3])
        depth = np.where(fixed, image.depth, -image.depth).astype(np.float32)
        begin = np.floor((image.T_world_camera[:2, 3] - _GRID.range_m - self._low) / _GRID.cell_m).astype(int)
        begin, end = (np.clip(n, 0, _GRID.cells) for n in (begin, begin + round(2 * _GRID.range_m / _GRID.cell_m) + 2))
        near = self._score[begin[0] : end[0], begin[1] : end[1]]
        first = np.append(self._low + _GRID.cell_m * (begin + 0.5), _GRID.low_m + _GRID.cell_m / 2)
        T = matmul(kin.inverse(image.T_world_camera), kin.transform(np.eye(3), first))
        camera = np.array([image.K[0, 0], image.K[1, 1], image.K[0, 2], image.K[1, 2]])
        kernels()["score"](near, depth, T, camera, _GRID.cell_m, _GRID.range_m, _GRID.sure)

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
            low = np.append(self._low, _GRID.low_m)
            cells = [np.floor((c - o) / _GRID.cell_m).astype(int) for c, o in zip((x, y, z), low, strict=True)]
            kernels()["recall"](
                self._score, *cells, z, _GRID.cell_m, _GRID.low_m, _GRID.twice, _GRID.tall_m, _GRID.whole,
                _GRID.overhead_m, stays, shown,
            )  # fmt: skip
        return stays, shown

    def forget(self, low: Array, high: Array) -> None:
        """Forget what was seen between two corners (3,) of a box in the world: it has been taken away."""
        if not np.isnan(self._low).any():
            corners = [
                np.floor((p - np.append(self._low, _GRID.low_m)) / _GRID.cell_m).astype(int) for p in (low, high)
            ]
            begin, end = (np.clip(n, 0, self._score.shape) for n in (corners[0], corners[1] + 1))
            self._score[tuple(slice(*ends) for ends in zip(begin, end, strict=True))] = 0

    def _come_along(self, xy: Array) -> None:
        """Keep the grid about a place (2,); what falls off its edge is forgotten."""
        middle = self._low + _GRID.cell_m * _GRID.cells / 2
        if (np.abs(xy - middle) < _GRID.moved_m).all():
            return
        low = (np.round(xy / _GRID.cell_m) - _GRID.cells // 2) * _GRID.cell_m
        score = _grid()
        if not np.isnan(self._low).any():
            shift = np.round((low - self._low) / _GRID.cell_m).astype(int)
            if (np.abs(shift) < _GRID.cells).all():
                new, old = (tuple(slice(max(0, s), _GRID.cells + min(0, s)) for s in sign * shift) for sign in (-1, 1))
                score[new] = self._score[old]
        self._score, self._low = score, low


def _grid() -> NDArray[np.int8]:
    """(512, 512, 78) zeros in memory of its own, 20 MB, which goes back to the system as a whole.

    What malloc has once given back in such pieces it takes from its heap from then on, where they leave holes: a
    process grew by the most of one with each policy that was made and dropped. Pages that nobody writes take none.
    """
    private = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    return np.frombuffer(mmap.mmap(-1, _GRID.cells * _GRID.cells * _GRID.up, private), np.int8).reshape(
        _GRID.cells, _GRID.cells, _GRID.up
    )
