"""Laws of the grid search and of inflation."""

from __future__ import annotations

import heapq
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.navigation.grid import cost_to_reach, shortest_path
from mpvi_bt.finding.navigation.traversability import ESCAPE_COST, floor_obstacles, traversability
from tests.navigation_maps import put_box, thing, two_rooms


@st.composite
def grids(draw: st.DrawFn) -> NDArray[np.float32]:
    """Small cost grids with up to half of the cells blocked and two free corners."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = (draw(st.integers(1, 14)), draw(st.integers(2, 14)))
    cost = np.where(rng.random(shape) < 0.5, 1.0, 1.0 + 4.0 * rng.random(shape)).astype(np.float32)
    cost[rng.random(shape) < draw(st.floats(0, 0.5))] = np.inf
    cost[0, 0] = cost[-1, -1] = 1.0
    return cost


def dijkstra(cost: NDArray[np.float32], start: tuple[int, int]) -> NDArray[np.float64]:
    """The plain textbook search, written anew to compare with."""
    best = np.full(cost.shape, np.inf)
    best[start] = 0.0
    queue = [(0.0, start)]
    while queue:
        reached, (r, c) = heapq.heappop(queue)
        if reached > best[r, c]:
            continue
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                rr, cc = r + dr, c + dc
                if (dr, dc) == (0, 0) or not (0 <= rr < cost.shape[0] and 0 <= cc < cost.shape[1]):
                    continue
                if np.isinf(cost[rr, cc]) or np.isinf(cost[r, cc]) or np.isinf(cost[rr, c]):
                    continue
                there = reached + math.hypot(dr, dc) * 0.5 * (float(cost[r, c]) + float(cost[rr, cc]))
                if there < best[rr, cc] - 1e-9:
                    best[rr, cc] = there
                    heapq.heappush(queue, (there, (rr, cc)))
    return best


@settings(max_examples=100, deadline=None)
@given(grids())
def test_astar_finds_the_optimum(cost: NDArray[np.float32]) -> None:
    """A*'s cost equals a plain Dijkstra's on every grid, and there is no path exactly where that finds none."""
    goal = (cost.shape[0] - 1, cost.shape[1] - 1)
    optimum = dijkstra(cost, (0, 0))[goal]
    found = shortest_path(cost, (0, 0), goal)
    assert (found is None) == np.isinf(optimum)
    if found is not None:
        assert math.isclose(found[1], optimum, rel_tol=1e-9)


@settings(max_examples=60, deadline=None)
@given(grids())
def test_a_path_is_connected_free_and_cuts_no_corner(cost: NDArray[np.float32]) -> None:
    """Each step goes to a free neighbor, and a diagonal one passes between free cells."""
    goal = (cost.shape[0] - 1, cost.shape[1] - 1)
    found = shortest_path(cost, (0, 0), goal)
    if found is None:
        return
    path = found[0]
    assert tuple(path[0]) == (0, 0)
    assert tuple(path[-1]) == goal
    assert np.isfinite(cost[path[:, 0], path[:, 1]]).all()
    assert (np.abs(np.diff(path, axis=0)).max(1) == 1).all()
    before, after = path[:-1], path[1:]
    assert np.isfinite(cost[before[:, 0], after[:, 1]]).all()
    assert np.isfinite(cost[after[:, 0], before[:, 1]]).all()


@settings(max_examples=40, deadline=None)
@given(grids())
def test_a_path_costs_what_is_told(cost: NDArray[np.float32]) -> None:
    """The cost of a path is the sum over its steps of length times mean cost."""
    found = shortest_path(cost, (0, 0), (cost.shape[0] - 1, cost.shape[1] - 1))
    if found is None:
        return
    path, told = found
    paid = cost[path[:, 0], path[:, 1]].astype(float)
    steps = np.hypot(*np.diff(path, axis=0).T) * (paid[:-1] + paid[1:]) / 2
    assert math.isclose(told, steps.sum(), rel_tol=1e-9)


@settings(max_examples=20, deadline=None)
@given(grids(), st.floats(20.0, 1e4))
def test_dear_cells_do_not_spoil_the_search(cost: NDArray[np.float32], dear: float) -> None:
    """Costs far beyond what the queue's buckets span at once are sorted as well."""
    cost[1:-1] *= np.float32(dear)
    goal = (cost.shape[0] - 1, cost.shape[1] - 1)
    optimum, found = dijkstra(cost, (0, 0))[goal], shortest_path(cost, (0, 0), goal)
    assert (found is None) == np.isinf(optimum)
    assert found is None or math.isclose(found[1], optimum, rel_tol=1e-9)


def test_a_way_that_winds_through_a_large_map_is_found() -> None:
    """On a map of walls with gaps at alternating ends the queue grows and the path has every turn."""
    cost = np.ones((201, 300), np.float32)
    cost[1::4] = np.inf
    cost[1::8, -1] = cost[5::8, 0] = 1.0
    found = shortest_path(cost, (0, 0), (200, 150))
    assert found is not None
    assert len(found[0]) > 50 * 290
    assert math.isclose(found[1], float(cost_to_reach(cost, (0, 0))[200, 150]), rel_tol=1e-6)


@settings(max_examples=40, deadline=None)
@given(grids())
def test_cost_to_reach_equals_dijkstra_everywhere(cost: NDArray[np.float32]) -> None:
    """The all-goals search agrees with a plain Dijkstra in every cell."""
    np.testing.assert_allclose(cost_to_reach(cost, (0, 0)), dijkstra(cost, (0, 0)), rtol=1e-5)


def test_a_start_or_goal_off_the_grid_or_blocked_has_no_path() -> None:
    """What is outside or blocked is not reached, without an error."""
    cost = np.ones((3, 3), np.float32)
    cost[1, 1] = np.inf
    assert shortest_path(cost, (0, 0), (1, 1)) is None
    assert shortest_path(cost, (1, 1), (0, 0)) is None
    assert shortest_path(cost, (0, 0), (3, 0)) is None
    assert np.isinf(cost_to_reach(cost, (-1, 0))).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 0.5))
def test_inflation_keeps_the_footprint_off_every_obstacle(seed: int, radius: float) -> None:
    """No free cell's center is closer than the radius to the edge of an occupied cell, within half a cell's corner."""
    grid_map = two_rooms()
    rng = np.random.default_rng(seed)
    grid_map.occupied[rng.integers(0, 80, 12), rng.integers(0, 160, 12)] = True
    grid = traversability(grid_map, radius)
    free, walls = np.argwhere(~grid.blocked), np.argwhere(grid_map.occupied)
    if not len(free):
        return
    some = free[rng.integers(0, len(free), 50)]
    gap = np.maximum(np.abs(some[:, None] - walls[None]) - 0.5, 0.0)
    corner = (math.sqrt(2) - 1) / 2 * grid_map.resolution_m
    assert (np.hypot(gap[..., 0], gap[..., 1]).min(1) * grid_map.resolution_m >= radius - corner - 1e-9).all()


def test_a_doorway_of_0_9_m_lets_the_robot_through_and_one_of_0_6_m_does_not() -> None:
    """A footprint of 0.33 m needs 0.66 m and some."""
    for door_m, passes in ((0.9, True), (0.6, False)):
        grid = traversability(two_rooms(door_m), 0.33)
        path = shortest_path(grid.cost, grid.map.cell((1.0, 1.0)), grid.map.cell((7.0, 3.0)))
        assert (path is not None) == passes


def test_a_robot_too_near_an_obstacle_may_leave_but_nobody_may_enter() -> None:
    """From beside a counter a dear way out opens; cells nearer to the counter stay blocked."""
    grid_map = two_rooms()
    put_box(grid_map, (0.05, 1.0), (0.65, 3.0))
    grid = traversability(grid_map, 0.33)
    beside = np.array([0.88, 2.0])
    assert np.isinf(grid.cost[grid_map.cell(beside)])
    escaping = grid.escaping(beside)
    assert escaping.cost[grid_map.cell(beside)] == ESCAPE_COST
    assert np.isinf(escaping.cost[grid_map.cell((0.72, 2.0))])
    assert shortest_path(escaping.cost, grid_map.cell(beside), grid_map.cell((3.0, 2.0))) is not None
    assert grid.escaping(np.array([2.0, 2.0])) is grid


def test_only_loose_things_on_the_floor_are_obstacles() -> None:
    """Fixtures are in the map already; what is carried, put away or on furniture blocks no floor."""
    things = [
        thing("can", (1, 1, 0.06), (0.07, 0.07, 0.12)),
        thing("carried_can", (1, 1, 0.06), (0.07, 0.07, 0.12), held=True),
        thing("binned_can", (1, 1, 0.06), (0.07, 0.07, 0.12), inside="bin"),
        thing("cup", (1, 1, 0.9), (0.07, 0.07, 0.12)),
        thing("sofa", (1, 1, 0.4), (2, 1, 0.8), kind="fixture"),
    ]
    assert len(floor_obstacles(things)) == 1


def test_numba_loads_only_with_the_first_search() -> None:
    """Importing the grids does not import numba: what never plans does not wait for it."""
    code = (
        "import sys\nfrom mpvi_bt.finding.navigation import frontiers, grid\n"
        "from mpvi_bt.finding.scene import occupancy, visibility\n"
        "print('numba' in sys.modules)\ngrid.warm()\nprint('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_clearance_is_that_of_the_whole_map(seed: int) -> None:
    """However little of it is free: what is beyond the map, and what is not known, counts as occupied."""
    rng = np.random.default_rng(seed)
    occupied = np.ones((50, 70), bool)
    for _ in range(int(rng.integers(0, 4))):
        row, column = rng.integers(0, [50, 70])
        occupied[row : row + rng.integers(1, 30), column : column + rng.integers(1, 30)] = False
    grid_map = replace(two_rooms(), occupied=occupied, rooms=np.zeros(occupied.shape, np.int16))
    grid = traversability(grid_map, 0.1)
    whole = ndimage.distance_transform_edt(np.pad(~occupied, 1))[1:-1, 1:-1] * grid_map.resolution_m
    expected = np.maximum(whole - grid_map.resolution_m / 2, 0.0)
    np.testing.assert_allclose(grid.clearance_m, expected, atol=1e-6)
    np.testing.assert_array_equal(grid.blocked, grid.clearance_m < 0.1)
