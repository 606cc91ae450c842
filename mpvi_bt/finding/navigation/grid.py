"""Shortest paths on a grid: exact octile A*, its all-goals form and the nearest of many goals, compiled by numba."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.compiled import compiled_later

Cost = NDArray[np.float32]
Cell = tuple[int, int]

_START = 1e-30  # our choice: the start's cost; not 0, which stands for unreached, and lost in the first sum
# Width [cells] and number of the buckets of open cells: they only change what a search takes; the width was measured.
_BUCKET, _RING = 0.25, 256
_NOWHERE = np.zeros(0, bool)


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
    _, path, total = _run(cost, start, goal[0] * cost.shape[1] + goal[1], _NOWHERE)
    return _cells(path, cost, total)


def nearest_target(cost: Cost, start: Cell, targets: NDArray[np.bool_]) -> tuple[NDArray[np.int64], float] | None:
    """The cheapest path to any of the cells `targets` (H, W), as `shortest_path`; Dijkstra that ends there."""
    if targets.shape != cost.shape:
        raise ValueError(f"targets are {targets.shape}, the grid is {cost.shape}")
    if not _free(cost, start):
        return None
    _, path, total = _run(cost, start, -1, np.ascontiguousarray(targets, bool).ravel())
    return _cells(path, cost, total)


def cost_to_reach(cost: Cost, start: Cell) -> Cost:
    """(H, W) cost in cells of the cheapest path from `start` to every cell, inf where there is none (Dijkstra)."""
    if not _free(cost, start):
        return np.full(cost.shape, np.inf, np.float32)
    reached, _, _ = _run(cost, start, -1, _NOWHERE)
    reached[reached == 0] = np.inf
    field = reached.reshape(cost.shape).astype(np.float32)
    field[start] = 0
    return field


def warm() -> None:
    """Compile the search, or load it from numba's disk cache, before time matters."""
    shortest_path(np.ones((2, 2), np.float32), (0, 0), (1, 1))


def _free(cost: Cost, cell: Cell) -> bool:
    return 0 <= cell[0] < cost.shape[0] and 0 <= cell[1] < cost.shape[1] and bool(np.isfinite(cost[cell]))


def _run(
    cost: Cost, start: Cell, goal: int, targets: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.int64], float]:
    """Costs reached and the path, all flat; see `_search`."""
    flat = np.ascontiguousarray(cost, np.float32).ravel()
    # Zeros come from the system as they are touched: a short search on a large map takes little time and memory.
    reached = np.zeros(flat.size)
    path, total = _search(
        flat, cost.shape[1], int(start[0]) * cost.shape[1] + int(start[1]), int(goal), targets, reached
    )
    return reached, path, total


def _cells(path: NDArray[np.int64], cost: Cost, total: float) -> tuple[NDArray[np.int64], float] | None:
    return (np.stack(np.divmod(path, cost.shape[1]), 1), total) if len(path) else None


@compiled_later
def _search(cost, columns, start, goal, targets, reached):  # type: ignore
    """A* to the cell `goal`; if that is -1, Dijkstra to the nearest of `targets`, or everywhere if they are none.

    Every array is flat. Open cells wait in a ring of buckets by their estimated total, the last in first out; within a
    bucket they may come out of order, so a cell is opened again whenever a cheaper way to it is found, and the search
    ends with the bucket whose lower bound is what the best goal costs: the result is as exact as with a sorted queue.

    Args:
        cost: (H * W,) float32.
        columns: W.
        start: Cell.
        goal: Cell, or -1.
        targets: (H * W,) or (0,) bool.
        reached: (H * W,) float64 zeros; on return the cost of reaching each cell, 0 where none was found.

    Returns:
        Cells from start to goal, none if there is no way or no goal, and what that costs.
    """
    rows = cost.size // columns
    half, diagonal = 0.5, 0.5 * math.sqrt(2.0)
    aside = math.sqrt(2.0) - 1.0
    per_bucket = 1.0 / _BUCKET
    goal_row, goal_column = goal // columns, goal % columns
    best, found = np.inf, np.int64(-1)
    free = np.zeros(4, np.bool_)  # of the neighbors above, below, left and right

    # Entries of the buckets are linked lists in three arrays that grow; `spare` heads the list of those not in use.
    heads = np.empty(_RING, np.int32)
    for k in range(_RING):
        heads[k] = -1
    room, used, spare, waiting = 4096, 1, -1, 1
    cells, values, links = np.empty(room, np.int32), np.empty(room, np.float64), np.empty(room, np.int32)
    bucket = 0
    if goal >= 0:
        a, b = abs(start // columns - goal_row), abs(start % columns - goal_column)
        bucket = int((max(a, b) + aside * min(a, b)) * per_bucket)
    reached[start] = _START
    cells[0], values[0], links[0] = start, reached[start], -1
    heads[bucket % _RING] = 0
    if start == goal or (targets.size > 0 and targets[start]):
        best, found, waiting = 0.0, np.int64(start), 0

    while waiting > 0:
        entry = heads[bucket % _RING]
        if entry < 0:
            bucket += 1
            if bucket * _BUCKET >= best:
                break
            continue
        heads[bucket % _RING] = links[entry]
        links[entry] = spare
        spare = entry
        waiting -= 1
        u, value = cells[entry], values[entry]
        if value > reached[u]:
            continue  # a cheaper way was found since
        row, column = u // columns, u % columns
        estimate = 0.0
        if goal >= 0:
            a, b = abs(row - goal_row), abs(column - goal_column)
            estimate = max(a, b) + aside * min(a, b)
        elif targets.size > 0 and targets[u] and value < best:
            best, found = value, np.int64(u)
        if value + estimate >= best:
            continue
        early = (value + estimate) * per_bucket >= bucket + 1  # it belongs beyond the ring and came as far as that went
        own = np.float64(cost[u])
        for k in range(8):
            if early:
                if k > 0:
                    break
                v, through = np.int64(u), value
            else:
                length = half
                if k < 4:
                    r, c = (row - 1 + 2 * k, column) if k < 2 else (row, column - 5 + 2 * k)
                    free[k] = False
                    if r < 0 or c < 0 or r >= rows or c >= columns:
                        continue
                else:
                    below, right = (k - 4) // 2, (k - 4) % 2
                    if not (free[below] and free[2 + right]):
                        continue
                    r, c = row - 1 + 2 * below, column - 1 + 2 * right
                    length = diagonal
                v = np.int64(r * columns + c)
                if cost[v] == np.inf:
                    continue
                if k < 4:
                    free[k] = True
                through = value + length * (own + cost[v])
                if through >= reached[v] and reached[v] > 0:
                    continue
                if goal >= 0:
                    a, b = abs(r - goal_row), abs(c - goal_column)
                    estimate = max(a, b) + aside * min(a, b)
                if through + estimate >= best:
                    continue
                reached[v] = through
                if v == goal:
                    best, found = through, v
                    continue
            at = max(int(min((through + estimate) * per_bucket, bucket + _RING - 1.0)), bucket) % _RING
            if spare >= 0:
                entry = spare
                spare = links[entry]
            else:
                if used == room:
                    room *= 2
                    more_cells, more_values = np.empty(room, np.int32), np.empty(room, np.float64)
                    more_links = np.empty(room, np.int32)
                    for i in range(used):
                        more_cells[i], more_values[i], more_links[i] = cells[i], values[i], links[i]
                    cells, values, links = more_cells, more_values, more_links
                entry = used
                used += 1
            cells[entry], values[entry], links[entry] = v, through, heads[at]
            heads[at] = entry
            waiting += 1

    # Back from the goal, always to the neighbor that it is reached from most cheaply.
    path = np.empty(cost.size if found >= 0 else 0, np.int32)
    count = 0
    u = found
    while u >= 0:
        path[count] = u
        count += 1
        if u == start:
            break
        row, column = u // columns, u % columns
        least, come_from = np.inf, np.int64(-1)
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                v = np.int64(r * columns + c)
                if reached[v] == 0 or reached[v] >= reached[u]:
                    continue
                length = half
                if r != row and c != column:
                    if cost[row * columns + c] == np.inf or cost[r * columns + column] == np.inf:
                        continue
                    length = diagonal
                through = reached[v] + length * (np.float64(cost[u]) + cost[v])
                if through < least:
                    least, come_from = through, v
        u = come_from
    way = np.empty(count, np.int64)
    for i in range(count):
        way[i] = path[count - 1 - i]
    return way, best
