"""Searches for the cheapest path from one cell to another."""

from __future__ import annotations

import heapq
import importlib.util
import math
from collections.abc import Container, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.grids.timing import Side, Timed
from mpvi_bt.finding.navigation import grid
from mpvi_bt.finding.navigation.grid import Cell, Cost

Path = NDArray[np.int64]
KEPT, CUT = "corners kept", "corners cut"  # whether a diagonal step may pass a blocked cell: two different problems


def sides(cost: Cost, slow_cases: int) -> Iterator[Side]:
    """Takes a start and a goal, gives the path; what each has to prepare of a map beforehand is not counted."""
    yield Side("ours", lambda case: _ours(cost, *case), KEPT)
    if importlib.util.find_spec("tcod"):
        yield from _tcod(cost)
    if importlib.util.find_spec("skimage"):
        yield Side("scikit-image MCP_Geometric", lambda case: _skimage(cost, *case), CUT)
    if importlib.util.find_spec("pyastar2d"):
        import pyastar2d

        yield Side("pyastar2d", lambda case: pyastar2d.astar_path(cost, *case, allow_diagonal=True), CUT)
    flat: list[float] = cost.ravel().astype(float).tolist()
    yield Side("heapq", lambda case: by_heapq(flat, cost.shape, case[0], {case[1]}), KEPT, most=slow_cases)


def cost_of(cost: Cost, path: Path) -> float:
    """Length times mean cost, over the steps of a path."""
    paid = cost[path[:, 0], path[:, 1]].astype(float)
    return float((np.hypot(*np.diff(path, axis=0).T) * (paid[:-1] + paid[1:]) / 2).sum())


def judge(cost: Cost, timed: Sequence[Timed]) -> dict[str, tuple[str, bool | None]]:
    """Of each side: by how much its paths cost more than the best of its group's, and whether it is exact."""
    paid = {one.side.name: [cost_of(cost, path) for path in one.results] for one in timed}
    verdicts: dict[str, tuple[str, bool | None]] = {}
    for one in timed:
        group = [paid[other.side.name] for other in timed if other.side.group == one.side.group]
        worst = max(
            own / min(peer[at] for peer in group if at < len(peer)) for at, own in enumerate(paid[one.side.name])
        )
        alone = len(group) == 1
        verdicts[one.side.name] = f"{one.side.group}, +{100 * (worst - 1):.2f} %", None if alone else worst < 1 + 1e-6
    return verdicts


def _ours(cost: Cost, start: Cell, goal: Cell) -> Path:
    found = grid.shortest_path(cost, start, goal)
    assert found is not None
    return found[0]


def _tcod(cost: Cost) -> Iterator[Side]:
    import tcod.path

    scaled = np.where(np.isfinite(cost), np.round(cost * 20), 0).astype(np.int32)
    graph = tcod.path.SimpleGraph(cost=scaled, cardinal=70, diagonal=99)  # whole numbers only

    def pathfinder(case: tuple[Cell, Cell]) -> Path:
        finder = tcod.path.Pathfinder(graph)
        finder.add_root(case[0])
        return finder.path_to(case[1])

    yield Side("tcod Pathfinder", pathfinder, CUT)
    older = tcod.path.AStar(np.where(np.isfinite(cost), cost, 0).astype(np.float32), diagonal=math.sqrt(2.0))
    yield Side("tcod AStar", lambda case: np.array([case[0], *older.get_path(*case[0], *case[1])]), CUT)


def _skimage(cost: Cost, start: Cell, goal: Cell) -> Path:
    from skimage.graph import MCP_Geometric

    search = MCP_Geometric(cost)
    search.find_costs([start], [goal])
    return np.array(search.traceback(goal))


def by_heapq(flat: list[float], shape: tuple[int, ...], start: Cell, ends: Container[Cell]) -> Path:
    """A* to one end, Dijkstra to the nearest of many, as one writes them in plain Python; the same problem as ours."""
    rows, columns = shape
    goal = next(iter(ends)) if isinstance(ends, set) and len(ends) == 1 else None
    source = start[0] * columns + start[1]
    reached, parent, closed = {source: 0.0}, {source: source}, set[int]()
    queue, estimate = [(0.0, source)], 0.0
    while queue:
        u = heapq.heappop(queue)[1]
        row, column = divmod(u, columns)
        if (row, column) in ends:
            break
        if u in closed:
            continue
        closed.add(u)
        for dr, dc in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)):
            r, c = row + dr, column + dc
            if not (0 <= r < rows and 0 <= c < columns) or math.isinf(flat[v := r * columns + c]):
                continue
            if dr and dc and (math.isinf(flat[row * columns + c]) or math.isinf(flat[r * columns + column])):
                continue
            there = reached[u] + (math.sqrt(2.0) if dr and dc else 1.0) * 0.5 * (flat[u] + flat[v])
            if there < reached.get(v, math.inf):
                reached[v], parent[v] = there, u
                if goal is not None:
                    a, b = abs(r - goal[0]), abs(c - goal[1])
                    estimate = max(a, b) + (math.sqrt(2.0) - 1.0) * min(a, b)
                heapq.heappush(queue, (there + estimate, v))
    path = [u]
    while path[-1] != source:
        path.append(parent[path[-1]])
    return np.stack(np.divmod(path[::-1], columns), 1)
