"""Shortest paths on a grid: exact octile A* and its all-goals form, compiled by numba on first use."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Cost = NDArray[np.float32]
Cell = tuple[int, int]

_NO_PARENT = 255
_STEP_ROW = np.array([-1, 1, 0, 0, -1, -1, 1, 1], np.int64)
_STEP_COLUMN = np.array([0, 0, -1, 1, -1, 1, -1, 1], np.int64)


def shortest_path(cost: Cost, start: Cell, goal: Cell) -> tuple[NDArray[np.int64], float] | None:
    """The cheapest 8-connected path, by A* (Paper, Navigation appendix).

    A step costs its length times the mean of the two cells' costs; a diagonal step needs both of the cells beside it
    to be free, so that no corner is cut. The octile heuristic is admissible because no cell costs less than 1: the
    path is optimal.

    Args:
        cost: (H, W) at least 1, inf = blocked.
        start: (row, column).
        goal: (row, column).

    Returns:
        (N, 2) rows and columns from start to goal, and the cost in cells; None where there is no path.
    """
    if not (_free(cost, start) and _free(cost, goal)):
        return None
    reached, parent = _run(cost, start, goal)
    if not np.isfinite(reached[goal]):
        return None
    cells, cell = [goal], goal
    while cell != start:
        step = parent[cell]
        cell = (cell[0] - int(_STEP_ROW[step]), cell[1] - int(_STEP_COLUMN[step]))
        cells.append(cell)
    return np.array(cells[::-1], np.int64), float(reached[goal])


def cost_to_reach(cost: Cost, start: Cell) -> Cost:
    """(H, W) cost in cells of the cheapest path from `start` to every cell, inf where there is none (Dijkstra)."""
    if not _free(cost, start):
        return np.full(cost.shape, np.inf, np.float32)
    return _run(cost, start, None)[0]


def segment_free(blocked: NDArray[np.bool_], start: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
    """Whether the straight line between two points, (2,) row and column with fractions, stays on free cells."""
    n = int(np.ceil(np.abs(end - start).max() * 4)) + 1  # four samples a cell
    cells = np.floor(start + np.linspace(0, 1, n)[:, None] * (end - start)).astype(int)
    if cells.min() < 0 or (cells >= blocked.shape).any():
        return False
    return not bool(blocked[cells[:, 0], cells[:, 1]].any())


def warm() -> None:
    """Compile the search, or load it from numba's disk cache, before time matters."""
    shortest_path(np.ones((2, 2), np.float32), (0, 0), (1, 1))


def _free(cost: Cost, cell: Cell) -> bool:
    return 0 <= cell[0] < cost.shape[0] and 0 <= cell[1] < cost.shape[1] and bool(np.isfinite(cost[cell]))


def _run(cost: Cost, start: Cell, goal: Cell | None) -> tuple[Cost, NDArray[np.uint8]]:
    flat = np.ascontiguousarray(cost, np.float32).ravel()
    columns, size = cost.shape[1], cost.size
    reached = np.full(size, np.inf, np.float32)
    parent = np.full(size, _NO_PARENT, np.uint8)
    closed = np.zeros(size, np.uint8)
    # A cell is pushed at most once by each neighbor; memory that is never touched is never paid for.
    keys, items = np.empty(8 * size + 1, np.float32), np.empty(8 * size + 1, np.int64)
    target = -1 if goal is None else goal[0] * columns + goal[1]
    start_index = start[0] * columns + start[1]
    _search(flat, columns, start_index, target, reached, parent, closed, keys, items, _STEP_ROW, _STEP_COLUMN)
    return reached.reshape(cost.shape), parent.reshape(cost.shape)


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, compiled by numba on its first call; it takes positional arguments only.

    numba keeps the result beside the function's file or, where that is read-only, in the user's cache folder.
    """

    @cache
    def kernel() -> Callable[..., Any]:
        import numba

        try:
            made: Any = numba.njit(cache=True, error_model="numpy")(function)
        except RuntimeError:  # no folder that can be written: compile anew in each process
            made = numba.njit(error_model="numpy")(function)
        return made

    return lambda *arguments: kernel()(*arguments)


@compiled
def _search(cost, columns, start, target, reached, parent, closed, keys, items, step_row, step_column):  # type: ignore
    """Dijkstra (target < 0) or A* with a binary heap. Writes `reached` and `parent` in place; every array is flat."""
    rows = cost.size // columns
    diagonal = np.float32(math.sqrt(2.0))
    target_row, target_column = target // columns, target % columns
    reached[start] = 0
    keys[0] = 0
    items[0] = start
    n = 1
    while n > 0:
        u = items[0]
        n -= 1  # pop: move the last to the top and sift it down
        key, item = keys[n], items[n]
        hole = 0
        while True:
            child = 2 * hole + 1
            if child >= n:
                break
            if child + 1 < n and keys[child + 1] < keys[child]:
                child += 1
            if keys[child] >= key:
                break
            keys[hole] = keys[child]
            items[hole] = items[child]
            hole = child
        keys[hole] = key
        items[hole] = item

        if closed[u]:
            continue
        closed[u] = 1
        if u == target:
            break
        row, column = u // columns, u % columns
        for k in range(8):
            r, c = row + step_row[k], column + step_column[k]
            if r < 0 or c < 0 or r >= rows or c >= columns:
                continue
            v = r * columns + c
            if closed[v] or cost[v] == np.inf:
                continue
            length = np.float32(1.0)
            if k >= 4:
                if cost[row * columns + c] == np.inf or cost[r * columns + column] == np.inf:
                    continue
                length = diagonal
            through = reached[u] + length * np.float32(0.5) * (cost[u] + cost[v])
            if through < reached[v]:
                reached[v] = through
                parent[v] = k
                key = through
                if target >= 0:
                    a, b = abs(r - target_row), abs(c - target_column)
                    key += np.float32(max(a, b)) + (diagonal - np.float32(1.0)) * np.float32(min(a, b))
                hole = n  # push: sift up
                n += 1
                while hole > 0:
                    above = (hole - 1) // 2
                    if keys[above] <= key:
                        break
                    keys[hole] = keys[above]
                    items[hole] = items[above]
                    hole = above
                keys[hole] = key
                items[hole] = v
