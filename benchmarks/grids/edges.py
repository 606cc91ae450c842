"""Frontiers between seen and unseen floor, and the way to the nearest one."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.grids.paths import CUT, KEPT, by_heapq
from benchmarks.grids.timing import Side, Timed
from mpvi_bt.finding.navigation.frontiers import frontier, nearest_frontier
from mpvi_bt.finding.navigation.grid import Cell, Cost

Mask = NDArray[np.bool_]


def frontier_sides() -> Iterator[Side]:
    """Takes what is free and what was seen of a whole map, gives the frontier; tcod has nothing for it."""
    yield Side("ours", lambda case: frontier(*case))
    yield Side("numpy", lambda case: _shifted(*case))
    if importlib.util.find_spec("cv2"):
        yield Side("OpenCV dilate", lambda case: _dilated(*case))
    if importlib.util.find_spec("skimage"):
        yield Side("scikit-image dilation", lambda case: _grown(*case))


def judge_frontiers(timed: Sequence[Timed]) -> dict[str, tuple[str, bool]]:
    """Of each side: how many cells it has that numpy has not, or the other way round."""
    (truth,) = (one.results for one in timed if one.side.name == "numpy")
    verdicts = {}
    for one in timed:
        wrong = sum(int((a != b).sum()) for a, b in zip(truth, one.results, strict=True))
        verdicts[one.side.name] = (f"{int(truth[0].sum())} cells, {wrong} wrong", wrong == 0)
    return verdicts


def nearest_sides(cost: Cost, targets: Mask, slow_cases: int) -> Iterator[Side]:
    """Takes a start, gives the path to the cheapest of the targets to reach; OpenCV has nothing for it."""
    yield Side("ours", lambda start: _ours(cost, start, targets), KEPT)
    if importlib.util.find_spec("tcod"):
        import tcod.path

        scaled = np.where(np.isfinite(cost), np.round(cost * 20), 0).astype(np.int32)
        graph = tcod.path.SimpleGraph(cost=scaled, cardinal=70, diagonal=99)

        def onward(start: Cell) -> NDArray[np.int64]:
            finder = tcod.path.Pathfinder(graph)
            finder.add_root(start)
            finder.resolve()
            return finder.path_to(np.unravel_index(np.where(targets, finder.distance, 2**31 - 1).argmin(), cost.shape))

        def backward(start: Cell) -> NDArray[np.int64]:
            finder = tcod.path.Pathfinder(graph)
            finder.distance[targets] = 0
            finder.rebuild_frontier()
            return finder.path_from(start)

        yield Side("tcod Pathfinder, all", onward, CUT)
        yield Side("tcod Pathfinder, back", backward, CUT)
    if importlib.util.find_spec("skimage"):
        from skimage.graph import MCP_Geometric

        def ending(start: Cell) -> NDArray[np.int64]:
            search, ends = MCP_Geometric(cost), np.argwhere(targets)
            reached, _ = search.find_costs([start], ends, find_all_ends=False)
            return np.array(search.traceback(ends[reached[tuple(ends.T)].argmin()]))

        yield Side("scikit-image MCP_Geometric", ending, CUT)
    flat: list[float] = cost.ravel().astype(float).tolist()
    ends = {(int(row), int(column)) for row, column in np.argwhere(targets)}
    yield Side("heapq", lambda start: by_heapq(flat, cost.shape, start, ends), KEPT, most=slow_cases)


def _ours(cost: Cost, start: Cell, targets: Mask) -> NDArray[np.int64]:
    found = nearest_frontier(cost, start, targets)
    assert found is not None
    return found[0]


def _shifted(free: Mask, seen: Mask) -> Mask:
    unseen = free & ~seen
    beside = np.zeros_like(unseen)
    beside[1:] |= unseen[:-1]
    beside[:-1] |= unseen[1:]
    beside[:, 1:] |= unseen[:, :-1]
    beside[:, :-1] |= unseen[:, 1:]
    return beside & free & seen


def _dilated(free: Mask, seen: Mask) -> Mask:
    import cv2

    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return cv2.dilate((free & ~seen).view(np.uint8), cross).view(bool) & free & seen


def _grown(free: Mask, seen: Mask) -> Mask:
    from skimage.morphology import diamond, dilation

    return dilation(free & ~seen, diamond(1)) & free & seen
