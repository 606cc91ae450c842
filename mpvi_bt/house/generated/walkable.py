"""Whether a robot gets from each doorway of a room to the floor before each of its fixtures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.house.generated.placement import RoomFloor
from mpvi_bt.house.generated.plane import Rect

CELL_M = 0.05
HALF_WAY_M = 0.42  # half the width of a free way: a robot's radius of 0.31 m, and room to pass by
STAND_M = 0.5  # so near to a fixture's front a robot stands
BASE_M = 0.34  # half the width of a way that the base just fits through
BESIDE_M = 0.7  # so near to what has no front, such as a tree, its middle comes
GROUND_M = 0.95  # before a doorway


def out_of_reach(room: RoomFloor) -> list[str]:
    """Names of fixtures, and doorways, that a robot does not get to from the first doorway."""
    x0, y0, x1, y1 = room.rect
    shape = (round((y1 - y0) / CELL_M), round((x1 - x0) / CELL_M))
    free = np.zeros(shape, bool)
    free[_window(room, room.inside)] = True
    for piece in room.pieces:
        if piece.on_floor:
            free[_window(room, piece.area)] = False
    for opening in room.openings:  # the way through the wall
        free[_window(room, room.before(opening, 0.1))] = True
    clear_m = ndimage.distance_transform_edt(np.pad(free, 1, constant_values=True))[1:-1, 1:-1] * CELL_M
    parts, _ = ndimage.label(clear_m > HALF_WAY_M)
    doors = [_parts(parts, room, room.before(opening, GROUND_M)) for opening in room.openings]
    here = set.intersection(*doors) if doors else set(np.unique(parts)) - {0}
    if not here:
        return [f"doorway {k}" for k in range(len(doors))]
    near, _ = ndimage.label(clear_m > BASE_M)
    cells = np.argwhere(np.isin(near, near[np.isin(parts, list(here))]))
    stands = np.asarray((cells[:, ::-1] + 0.5) * CELL_M + (x0, y0), float)
    missed = []
    for piece in room.pieces:
        if piece.front is not None:
            reached = bool(here & _parts(parts, room, _stand(piece.area, piece.front)))
        else:
            reached = not piece.on_floor or bool((_apart_m(stands, piece.area) < BESIDE_M).any())
        if not reached:
            missed.append(piece.name)
    return missed


def _apart_m(points: NDArray[np.float64], area: Rect) -> NDArray[np.float64]:
    """(n,) how far points (n, 2) are from a rectangle [m]."""
    beyond = np.maximum(np.maximum(area[:2] - points, points - area[2:]), 0.0)
    return np.asarray(np.hypot(beyond[:, 0], beyond[:, 1]))


def _stand(area: Rect, front: Rect) -> Rect:
    """The part of the floor before a thing where one stands to use it."""
    x0, y0, x1, y1 = front
    reach = STAND_M + CELL_M
    if x0 >= area[2] - 1e-6:
        return x0, y0, min(x1, x0 + reach), y1
    if x1 <= area[0] + 1e-6:
        return max(x0, x1 - reach), y0, x1, y1
    if y0 >= area[3] - 1e-6:
        return x0, y0, x1, min(y1, y0 + reach)
    return x0, max(y0, y1 - reach), x1, y1


def _parts(parts: NDArray[np.int_], room: RoomFloor, rect: Rect) -> set[int]:
    return set(np.unique(parts[_window(room, rect)]).tolist()) - {0}


def _window(room: RoomFloor, rect: Rect) -> tuple[slice, slice]:
    """The cells that a rectangle touches."""
    x0, y0, _, _ = room.rect
    low = np.floor((np.array(rect[:2]) - (x0, y0)) / CELL_M + 1e-6).astype(int).clip(0)
    high = np.ceil((np.array(rect[2:]) - (x0, y0)) / CELL_M - 1e-6).astype(int)
    return slice(low[1], high[1]), slice(low[0], high[0])
