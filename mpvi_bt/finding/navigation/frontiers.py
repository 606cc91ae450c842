"""Frontiers between seen and unseen floor, and the cheapest way to one (Paper, Navigation appendix)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.navigation.grid import Cell, Cost, nearest_target
from mpvi_bt.ground.compiled import compiled_later


def frontier(free: NDArray[np.bool_], seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Seen free cells that share an edge with an unseen free cell.

    Our choice: corners do not count; no path that cuts none leads across one without passing an edge.

    Args:
        free: (H, W), where nothing stands as far as is known: cells of which nothing is known count as free.
        seen: (H, W), what was seen; what is known, where there was no map to begin with.

    Returns:
        (H, W) bool.
    """
    if free.shape != seen.shape:
        raise ValueError(f"free is {free.shape}, seen is {seen.shape}")
    out = np.empty(free.shape, np.uint8)
    # As bytes, because loops over them become vector instructions.
    _frontier(np.ascontiguousarray(free, bool).view(np.uint8), np.ascontiguousarray(seen, bool).view(np.uint8), out)
    return out.view(bool)


def nearest_frontier(cost: Cost, start: Cell, targets: NDArray[np.bool_]) -> tuple[NDArray[np.int64], float] | None:
    """The cheapest way to any of `targets` (Paper, Navigation appendix: to the nearest reachable frontier).

    Args:
        cost: (H, W) planning cost, at least 1, inf = blocked.
        start: (row, column).
        targets: (H, W) bool, such as a frontier. Those on blocked cells are not reachable.

    Returns:
        (N, 2) rows and columns from `start` to the target, and the cost in cells; None where none can be reached.
    """
    return nearest_target(cost, start, targets)


def warm() -> None:
    """Compile what finds frontiers, or load it from numba's disk cache, before time matters."""
    frontier(np.ones((2, 2), bool), np.eye(2, dtype=bool))


@compiled_later
def _frontier(free, seen, out):  # type: ignore
    """One pass, with what is free and unseen in three rows at hand; they begin and end with a cell beyond the map."""
    rows, columns = free.shape
    above, here = np.zeros(columns + 2, np.uint8), np.zeros(columns + 2, np.uint8)
    below = np.zeros(columns + 2, np.uint8)
    for r in range(-1, rows):
        above, here, below = here, below, above
        if r + 1 < rows:
            for c in range(columns):
                below[c + 1] = free[r + 1, c] & (seen[r + 1, c] ^ 1)
        else:
            below[:] = 0
        if r >= 0:
            for c in range(columns):
                out[r, c] = free[r, c] & seen[r, c] & (above[c + 1] | below[c + 1] | here[c] | here[c + 2])
