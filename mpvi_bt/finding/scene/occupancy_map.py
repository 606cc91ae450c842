"""The map of a place: occupancy with labeled rooms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """Occupancy of the floor, with rooms (Paper, Navigation appendix: a traversability map with labeled rooms).

    Attributes:
        occupied: (H, W) bool; row = y, column = x.
        rooms: (H, W) int16 index into `room_names`, -1 where no room is.
        room_names: Such as "living_room".
        resolution_m: Edge of a cell.
        origin_m: (2,) world x, y of the outer corner of cell (0, 0).
    """

    occupied: NDArray[np.bool_]
    rooms: NDArray[np.int16]
    room_names: tuple[str, ...]
    resolution_m: float
    origin_m: Array

    def cell(self, xy: Array | tuple[float, float]) -> tuple[int, int]:
        """(row, column) of the cell at world `xy` [m]; may lie outside the map."""
        c, r = np.floor((np.asarray(xy, float)[:2] - self.origin_m) / self.resolution_m).astype(int)
        return int(r), int(c)

    def center(self, row: int, column: int) -> Array:
        """(2,) world x, y [m] of a cell's center."""
        return self.origin_m + (np.array([column, row]) + 0.5) * self.resolution_m

    def inside(self, row: int, column: int) -> bool:
        """Whether the cell is on the map."""
        return 0 <= row < self.occupied.shape[0] and 0 <= column < self.occupied.shape[1]

    def room_at(self, xy: Array | tuple[float, float]) -> str | None:
        """Name of the room at world `xy` [m], or None."""
        row, column = self.cell(xy)
        if not self.inside(row, column) or self.rooms[row, column] < 0:
            return None
        return self.room_names[self.rooms[row, column]]
