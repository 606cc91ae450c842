"""Prior knowledge of a house: a map with labeled rooms, and the places of its fixtures.

Derived from the house's solids, not drawn by hand (Paper, Navigation appendix: a prior traversability map).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.layout.house import House

RESOLUTION_M = 0.05
BAND_M = (0.05, 1.5)  # heights that the robot's body passes through; lower things it drives over
MARGIN_M = 0.5


def prior_map(house: House, resolution_m: float = RESOLUTION_M, *, loose: bool = True) -> OccupancyMap:
    """Occupancy of walls and fixtures (doors closed) between 0.05 and 1.5 m, and rooms.

    A cell is occupied if any of it lies under a solid of that band. Outside all rooms everything is occupied.

    Args:
        house: The house.
        resolution_m: Edge of a cell.
        loose: With fixtures that can be moved, such as chairs that roll.
    """
    grid = _prior_map(house, resolution_m, loose)
    return replace(grid, occupied=grid.occupied.copy(), rooms=grid.rooms.copy())


@lru_cache(maxsize=4)
def _prior_map(house: House, resolution_m: float, loose: bool) -> OccupancyMap:
    x0, y0, x1, y1 = house.bounds()
    origin = np.floor((np.array([x0, y0]) - MARGIN_M) / resolution_m) * resolution_m
    width, height = (np.ceil((np.array([x1, y1]) + MARGIN_M - origin) / resolution_m)).astype(int)
    rooms = np.full((height, width), -1, np.int16)
    xs = origin[0] + (np.arange(width) + 0.5) * resolution_m
    ys = origin[1] + (np.arange(height) + 0.5) * resolution_m
    for k, room in enumerate(house.rooms.values()):
        u0, v0, u1, v1 = room.rect
        rooms[np.ix_((v0 <= ys) & (ys < v1), (u0 <= xs) & (xs < u1))] = k
    occupied = rooms < 0
    for solid in obstacles(house, loose):
        _mark(occupied, solid, origin, resolution_m)
    return OccupancyMap(occupied, rooms, tuple(house.rooms), resolution_m, origin)


def marked(grid_map: OccupancyMap, solids: Iterable[Solid]) -> OccupancyMap:
    """The map with the footprints of further solids, those that reach into the robot's band of heights."""
    occupied = grid_map.occupied.copy()
    for solid in solids:
        if _in_band(solid):
            _mark(occupied, solid, grid_map.origin_m, grid_map.resolution_m)
    return replace(grid_map, occupied=occupied)


def obstacles(house: House, loose: bool = True) -> Iterator[Solid]:
    """Solids of walls and of fixtures, also of `loose` ones, that reach into the robot's band of heights."""
    for wall in house.walls:
        if _in_band(wall.solid):
            yield wall.solid
    for fixture in house.fixtures.values():
        if fixture.entry.mass_kg is not None and not loose:
            continue
        for solid in fixture.solids():
            if _in_band(solid):
                yield solid


def knowledge(house: House) -> list[Entry]:
    """Rooms and fixtures, as entries of a knowledge base."""
    entries = []
    for room in house.rooms.values():
        x0, y0, x1, y1 = room.rect
        low, high = np.array([x0, y0, 0.0]), np.array([x1, y1, 0.0])
        entries.append(Entry(room.name, room.phrases, "room", low, high, room.name))
    for fixture in house.fixtures.values():
        low, high = fixture.extent()
        fronted = fixture.entry.description.jointed or fixture.entry.mass_kg is not None  # such as a chair that rolls
        front = fixture.T_world_fixture[:2, 0] if fronted else None
        entries.append(Entry(fixture.name, fixture.entry.phrases, "fixture", low, high, fixture.room, front=front))
    return entries


def _in_band(solid: Solid) -> bool:
    (_, _, low), (_, _, high) = solid.aabb()
    return bool(low < BAND_M[1] and high > BAND_M[0])


def _mark(occupied: NDArray[np.bool_], solid: Solid, origin: Array, resolution: float) -> None:
    """Mark every cell that the solid's footprint touches by more than a hair."""
    low, high = solid.aabb()[:, :2]
    first = np.maximum(np.floor((low - origin) / resolution + 1e-6).astype(int), 0)
    last = np.ceil((high - origin) / resolution - 1e-6).astype(int)
    window = occupied[first[1] : last[1], first[0] : last[0]]
    if not window.size:
        return
    rows, columns = np.indices(window.shape)
    centers = origin + (np.stack([columns + first[0], rows + first[1]], -1) + 0.5) * resolution
    window |= _covers(solid, centers, resolution / 2 - 1e-6)


def _covers(solid: Solid, centers: Array, half: float) -> NDArray[np.bool_]:
    """Whether the footprint touches the square of half edge `half` about each center (..., 2).

    Exact for upright boxes, cylinders and spheres; otherwise the box around the solid counts.
    """
    R, p = solid.T[:3, :3], solid.T[:3, 3]
    d = centers - p[:2]
    upright = abs(R[2, 2]) > 1 - 1e-9
    if solid.kind == "sphere" or (solid.kind == "cylinder" and upright):
        gap = np.maximum(np.abs(d) - half, 0.0)
        return np.asarray((gap**2).sum(-1) < solid.half_m[0] ** 2)
    if solid.kind == "box" and upright:
        A = R[:2, :2]  # columns: the box's x and y axes; with the cell's own axes, all that can separate two rectangles
        local = np.abs(matmul(d, A))
        reach = solid.half_m[:2] + half * np.abs(A).sum(0)
        return np.asarray((local < reach).all(-1))
    return np.ones(centers.shape[:-1], bool)
