"""Paths for a robot with a load, or one that is not round: A* over place and heading, with turns free of collision."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.grid import cost_to_reach, shortest_path
from mpvi_bt.finding.navigation.traversability import ESCAPE_COST, GRAIN, Traversability
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class LoadedCosts:
    """Costs and clearances of heading-aware paths."""

    headings: int = 48  # headings, 7.5 degrees apart; our choice
    turn_m: float = 0.3  # cost of turning by a radian [m of driving]; our choice
    aside: float = 1.0  # added cost of driving sideways [ratio]; of driving backwards twice that; our choice
    swept: float = 2.0  # added cost of sideways driving with a load over furniture; loads come off straight; our choice
    cannot: float = 1e6  # cost of a step that a base without sideways motion cannot make; our choice
    oblique_rad: float = 0.45  # such a step is this far off the base's heading [rad]; our choice
    beside_m: float = 2.0  # width of the search around the way of the base's middle [m]; our choice
    most: int = 1_000_000  # largest number of searched states, which take about a second; our choice
    clear_m: float = 0.02  # clearance of turning parts from obstacles [m]; path following is off by this; our choice
    roomy_m: float = 0.20  # clearance below which a load costs more [m]; our choice
    tight: float = 4.0  # cost factor of a load that touches; our choice
    near_m: float = 0.8  # around start and goal, a load may touch no more than it does there [m]; our choice


_COST = LoadedCosts()
# Our choice: what lies ahead counts so much; ways are at most so much dearer than the cheapest, and found much sooner.
_GREED = 1.5
# Steps to the eight neighboring cells.
_ROW = np.array([-1, 1, 0, 0, -1, -1, 1, 1], np.int64)
_COLUMN = np.array([0, 0, -1, 1, -1, 1, -1, 1], np.int64)


def loaded_path(
    grid: Traversability, footprint: Footprint, start: Array, goal: Array, sideways: bool = True
) -> Array | None:
    """A way from pose to pose on which neither base nor loads touch an obstacle, at most half dearer than the cheapest.

    A step goes to a neighboring cell or turns by 7.5 degrees on the spot. Where a load is too near something at the
    start or at the goal, as above a table, it may be so around there, but not more; rather than swung over what else
    stands there, which no map of the floor shows, it is drawn straight off. The base itself may be so at the start.

    Args:
        grid: Where the base's center may be, and how far obstacles are.
        footprint: What turns with the base.
        start, goal: (3,) x, y [m], yaw [rad].
        sideways: Whether the base can go sideways.

    Returns:
        (N, 3) x, y [m] and yaw [rad], which runs on beyond half a turn; the last is the goal. None if there is no way.
    """
    cells = grid.map.cell(start), grid.map.cell(goal)
    alone = shortest_path(grid.cost, *cells)
    if alone is None:
        return None
    margin = math.ceil(_COST.beside_m / grid.map.resolution_m)
    low = np.maximum(alone[0].min(0) - margin, 0)
    high = np.minimum(alone[0].max(0) + margin + 1, grid.cost.shape)
    cost = grid.cost[low[0] : high[0], low[1] : high[1]]
    first, last = (np.array(cell) - low for cell in cells)
    ahead = cost_to_reach(cost, (int(last[0]), int(last[1])))
    step = 2 * math.pi / _COST.headings
    yaws = np.arange(_COST.headings) * step
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    cell_m = grid.map.resolution_m
    x, y, radii = footprint.loads.T + np.array([[0.0], [0.0], [_COST.clear_m]])
    offsets = np.rint(np.stack([s * x + c * y, c * x - s * y], -1) / cell_m).astype(np.int64)
    u, v, base_radii = footprint.base.T + np.array([[0.0], [0.0], [_COST.clear_m + GRAIN * cell_m]])
    places = np.stack([s * u + c * v, c * u - s * v], -1) / cell_m
    base = np.floor(places).astype(np.int64)
    below, right = np.moveaxis(places - base, -1, 0)
    shares = np.stack([(1 - below) * (1 - right), (1 - below) * right, below * (1 - right), below * right], -1)
    toward = np.arctan2(_ROW, _COLUMN)
    off = toward - yaws[:, None]
    aside = np.stack([1.0 + _COST.aside * (1.0 - np.cos(off)), 1.0 + _COST.swept * np.abs(np.sin(off))])
    if not sideways:
        aside[:, np.abs(np.sin(off)) > math.sin(_COST.oblique_rad)] = _COST.cannot
    farthest_m = np.hypot(np.append(x, u), np.append(y, v)).max()
    turn = np.array([_COST.turn_m, (1.0 + _COST.swept) * farthest_m]) * step / cell_m
    bins = [round(float(pose[2]) / step) % _COST.headings for pose in (start, goal)]
    there = np.array([*grid.points(np.array([cells[0]]))[0], yaws[bins[0]]])  # the state to start from
    stuck = min(0.0, float(footprint.room(grid, there)) - _COST.clear_m) - 1e-6
    states = _search(
        np.ascontiguousarray(cost), np.ascontiguousarray(ahead, np.float32), grid.clearance_m, low, offsets, radii,
        base, shares, base_radii, stuck, aside, turn, np.array([bins[0], *first]), np.array([bins[1], *last]),
        _COST.near_m / cell_m, ESCAPE_COST, _COST.roomy_m, _COST.tight, _COST.most, _ROW, _COLUMN,
    )  # fmt: skip
    if not len(states):
        return None
    yaw = np.unwrap(states[:, 0] * step)
    yaw += 2 * math.pi * round((start[2] - yaw[0]) / (2 * math.pi))
    poses = np.column_stack([grid.points(states[:, 1:] + low), yaw])
    poses[0, :2] = start[:2]
    end = goal[2] + 2 * math.pi * round((yaw[-1] - goal[2]) / (2 * math.pi))
    return np.vstack([poses, [*goal[:2], end]])


@compiled_later
def _search(  # type: ignore
    cost, ahead, clearance, low, offsets, radii, base, shares, base_radii, stuck, aside, turn, start, goal,
    near, dear, roomy, tight, most, row, column,
):  # fmt: skip
    """A* from state to state (heading, row, column); returns the states between, (N, 3), none if there is no way.

    Args:
        cost: (h, w) float32 of the base's cells in a window of the map.
        ahead: (h, w) float32; what the base alone would pay from each cell to the goal.
        clearance: (H, W) float64 [m] of the whole map; `low` (2,) is the window's first cell.
        offsets: (headings, loads, 2) rows and columns from the base's cell to each load's; `radii` (loads,) [m].
        base: (headings, circles, 2) likewise of the base, to the first of four cells whose clearance is interpolated,
            with `shares` (headings, circles, 4); `base_radii` (circles,) [m].
        stuck: The base may be so near to obstacles [m] around the start, negative within.
        aside: (2, headings, 8) by how much each step is dearer with each heading, in the open and where a load touches.
        turn: (2,) what turning by one heading costs, likewise.
        start, goal: (3,) states.
        near: Cells around start and goal within which loads may touch what they touch there; `dear` times the cost.
        roomy: Distance [m] up to which obstacles near a load cost more, up to `tight` times.
        most: States to look at before it is given up.
        row, column: (8,) of the steps.
    """
    headings, height, width = offsets.shape[0], cost.shape[0], cost.shape[1]
    reached = np.zeros((headings, height, width), np.float32)  # 0: not yet
    parent = np.zeros((headings, height, width), np.uint8)  # 1 + the step that led here
    price = np.zeros((headings, height, width), np.float32)  # by how much being there is dearer; 0: not yet known

    slack = np.zeros(2)
    for i in range(2):
        end = start if i == 0 else goal
        b, r, c = end[0], end[1], end[2]
        slack[i] = np.inf
        for k in range(radii.size):
            rr, cc = r + low[0] + offsets[b, k, 0], c + low[1] + offsets[b, k, 1]
            inside = 0 <= rr < clearance.shape[0] and 0 <= cc < clearance.shape[1]
            slack[i] = min(slack[i], clearance[rr, cc] - radii[k] if inside else -np.inf)

    reached[start[0], start[1], start[2]] = 1e-6
    heap = [(np.float64(ahead[start[1], start[2]]), start[0], start[1], start[2])]
    found, looked = False, 0
    while len(heap) > 0 and looked < most:
        _, b, r, c = heapq.heappop(heap)
        if parent[b, r, c] >= 128:
            continue  # was expanded before
        parent[b, r, c] += 128
        looked += 1
        if b == goal[0] and r == goal[1] and c == goal[2]:
            found = True
            break
        for k in range(10):
            b2, r2, c2 = b, r, c
            if k < 8:
                r2, c2 = r + row[k], c + column[k]
                if r2 < 0 or c2 < 0 or r2 >= height or c2 >= width or cost[r2, c2] == np.inf:
                    continue
                if k >= 4 and (cost[r, c2] == np.inf or cost[r2, c] == np.inf):
                    continue
            else:
                b2 = (b + 1) % headings if k == 8 else (b + headings - 1) % headings
            if parent[b2, r2, c2] >= 128 or ahead[r2, c2] == np.inf:
                continue
            if price[b2, r2, c2] == 0:
                least = np.inf
                for j in range(radii.size):
                    rr, cc = r2 + low[0] + offsets[b2, j, 0], c2 + low[1] + offsets[b2, j, 1]
                    if rr < 0 or cc < 0 or rr >= clearance.shape[0] or cc >= clearance.shape[1]:
                        least = -np.inf
                    else:
                        least = min(least, clearance[rr, cc] - radii[j])
                room = np.inf
                for j in range(base_radii.size):
                    rr, cc = r2 + low[0] + base[b2, j, 0], c2 + low[1] + base[b2, j, 1]
                    if rr < 0 or cc < 0 or rr + 1 >= clearance.shape[0] or cc + 1 >= clearance.shape[1]:
                        room = -np.inf
                        break
                    above = shares[b2, j, 0] * clearance[rr, cc] + shares[b2, j, 1] * clearance[rr, cc + 1]
                    below = shares[b2, j, 2] * clearance[rr + 1, cc] + shares[b2, j, 3] * clearance[rr + 1, cc + 1]
                    room = min(room, above + below - base_radii[j])
                at_start = math.hypot(r2 - start[1], c2 - start[2]) <= near and least >= slack[0]
                at_goal = math.hypot(r2 - goal[1], c2 - goal[2]) <= near and least >= slack[1]
                if room < 0.0 and not (at_start and room >= stuck):
                    price[b2, r2, c2] = np.inf
                elif min(least, room) >= 0.0:
                    price[b2, r2, c2] = 1.0 + (tight - 1.0) * max(0.0, 1.0 - min(least, room) / roomy) ** 2
                else:
                    price[b2, r2, c2] = dear if at_start or at_goal else np.inf
            if price[b2, r2, c2] == np.inf:
                continue
            touching = 1 if price[b2, r2, c2] == dear else 0
            if k < 8:
                length = 1.0 if k < 4 else math.sqrt(2.0)
                step = length * 0.5 * (cost[r, c] + cost[r2, c2]) * aside[touching, b, k]
            else:
                step = turn[touching]
            step *= price[b2, r2, c2]
            through = reached[b, r, c] + step
            if reached[b2, r2, c2] == 0 or through < reached[b2, r2, c2]:
                reached[b2, r2, c2] = through
                parent[b2, r2, c2] = 1 + k
                turns = abs(b2 - goal[0])
                left = ahead[r2, c2] + turn[0] * min(turns, headings - turns)
                heapq.heappush(heap, (np.float64(through + _GREED * left), b2, r2, c2))

    states = np.zeros((0, 3), np.int64)
    if not found:
        return states
    count = 1
    for passing in range(2):  # count the states, then write them down
        if passing == 1:
            states = np.zeros((count, 3), np.int64)
        b, r, c = goal[0], goal[1], goal[2]
        i = count - 1
        while True:
            if passing == 1:
                states[i, 0], states[i, 1], states[i, 2] = b, r, c
            if b == start[0] and r == start[1] and c == start[2]:
                break
            k = (parent[b, r, c] & 127) - 1
            if k < 8:
                r, c = r - row[k], c - column[k]
            else:
                b = (b + headings - 1) % headings if k == 8 else (b + 1) % headings
            if passing == 0:
                count += 1
            else:
                i -= 1
    return states
