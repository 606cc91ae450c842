"""A contact sheet: houses from above, side by side."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.views import look_at
from mpvi_bt.house.sim.world import SimWorld

FOV_RAD = 0.5
TOP_M = 2.2
LABEL_PX = 22
WIDE = 1.5  # of a sheet, its columns over its rows
JPEG_QUALITY = 80


def seen_from_above(house: House, size: tuple[int, int]) -> NDArray[np.uint8]:
    """A picture (height, width, 3) of a house, straight from above, north up; hoods and crowns hide what is below."""
    x0, y0, x1, y1 = house.bounds()
    half = max((y1 - y0) / 2, (x1 - x0) / 2 * size[1] / size[0]) + 0.4
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    eye = (*middle, TOP_M + half / np.tan(FOV_RAD / 2))
    free = np.argwhere(~prior_map(house).occupied)
    at = prior_map(house).center(*free[len(free) // 2])
    world = SimWorld(house, {}, np.array([*at, 0.0]))
    return world.look_from(look_at(eye, (*middle, 0.0)), size, FOV_RAD).rgb


def write_sheet(names: list[str], path: Path, size: tuple[int, int]) -> None:
    """Draw houses into one picture."""
    tiles = []
    for name in names:
        picture = np.ascontiguousarray(seen_from_above(load_house(name), size))
        cv2.putText(picture, name, (6, LABEL_PX), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (20, 20, 20), 2)
        tiles.append(picture)
    columns = math.ceil(math.sqrt(WIDE * len(tiles)))
    while len(tiles) % columns:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)]
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
