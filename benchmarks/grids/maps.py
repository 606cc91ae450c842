"""Maps like houses: rooms, doorways and furniture, the same in every run."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.navigation.grid import Cell, Cost
from mpvi_bt.finding.navigation.traversability import traversability
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap

RES_M, FOOTPRINT_M = 0.05, 0.33
_SMALLEST, _WALL, _DOOR = 60, 2, 18  # cells: side of a room, thickness, doorway
_CLEAR, _AISLE = 8, 16  # cells: free before and behind doorways, and between furniture and what it does not stand at


def house(rows: int, columns: int, seed: int = 0) -> OccupancyMap:
    """Rooms of 3 to 6 m, walls of 0.1 m, doorways of 0.9 m, one to four pieces of furniture a room; cells of 5 cm."""
    rng = np.random.default_rng([seed, rows, columns])
    occupied = np.zeros((rows, columns), bool)
    doors: list[tuple[slice, slice]] = []
    rooms, waiting = [], [(0, 0, rows, columns)]
    while waiting:
        r0, c0, r1, c1 = waiting.pop()
        if max(r1 - r0, c1 - c0) < 2 * _SMALLEST:
            rooms.append((r0, c0, r1, c1))
        elif r1 - r0 > c1 - c0:
            at = int(rng.integers(r0 + _SMALLEST - 2, r1 - _SMALLEST + 2))
            occupied[at : at + _WALL, c0:c1] = True
            doors += [np.s_[at - _CLEAR : at + _WALL + _CLEAR, c : c + _DOOR] for c in _doorways(rng, c0, c1)]
            waiting += [(r0, c0, at, c1), (at + _WALL, c0, r1, c1)]
        else:
            at = int(rng.integers(c0 + _SMALLEST - 2, c1 - _SMALLEST + 2))
            occupied[r0:r1, at : at + _WALL] = True
            doors += [np.s_[r : r + _DOOR, at - _CLEAR : at + _WALL + _CLEAR] for r in _doorways(rng, r0, r1)]
            waiting += [(r0, c0, r1, at), (r0, at + _WALL, r1, c1)]
    for r0, c0, r1, c1 in rooms:
        for height, width in rng.integers(6, 30, (int(rng.integers(1, 5)), 2)):
            r = int(rng.integers(r0 + _AISLE, max(r1 - height - _AISLE, r0 + _AISLE + 1)))
            c = int(rng.integers(c0 + _AISLE, max(c1 - width - _AISLE, c0 + _AISLE + 1)))
            occupied[r : r + height, c : c + width] = True
    for door in doors:
        occupied[door] = False
    occupied[[0, 1, -2, -1]] = occupied[:, [0, 1, -2, -1]] = True
    return OccupancyMap(occupied, np.zeros((rows, columns), np.int16), ("house",), RES_M, np.zeros(2))


def costs(grid_map: OccupancyMap) -> dict[str, Cost]:
    """What a step costs where the robot's footprint fits: 1 everywhere ("octile"), or more near obstacles."""
    clearance = traversability(grid_map, FOOTPRINT_M).cost
    return {"octile": np.where(np.isinf(clearance), clearance, np.float32(1.0)), "clearance": clearance}


def reachable(cost: Cost) -> NDArray[np.int64]:
    """(n, 2) the cells of the largest part that hangs together."""
    parts, _ = ndimage.label(np.isfinite(cost))
    return np.argwhere(parts == 1 + np.bincount(parts[parts > 0] - 1).argmax())


def cell(given: Iterable[Any]) -> Cell:
    """A row and a column, as Python's own numbers."""
    row, column = (int(c) for c in given)
    return row, column


def _doorways(rng: np.random.Generator, low: int, high: int) -> list[int]:
    """Where doorways begin in a wall from `low` to `high`: one in about 6 m."""
    count = max(1, (high - low) // (2 * _SMALLEST))
    ends = np.linspace(low, high, count + 1).astype(int)
    return [int(rng.integers(a + 12, max(b - 30, a + 13))) for a, b in itertools.pairwise(ends)]
