"""All that is seen of something large, not only its faces: upright boxes, layer by layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.shapes.outlines import Outline, main_cluster, outline, thinned, trimmed
from mpvi_bt.finding.shapes.shape import upright_box
from mpvi_bt.ground.geometry.solids import Array, Solid


@dataclass(frozen=True)
class Layers:
    """How the body of a large thing is built of layers.

    Our choice: a trunk and its crown, or legs and their top, come apart.
    """

    layer_m: float = 0.10  # height of a layer [m]
    cell_m: float = 0.04  # cell of the grid in which points of a layer are joined [m]
    thin_m: float = 0.01  # edge of a cube in which one point is kept [m]
    smaller: float = 0.9  # a turned rectangle is used if it covers less than this part of the upright one [ratio]
    least: int = 5  # fewer points make no solid
    same_m: float = 0.04  # parts of two layers whose outlines differ by less are joined [m]
    foot_m: float = 0.25  # a thing seen down to this height stands on the floor [m]; its foot is hidden or out of view


_LAYER = Layers()


def layers(points: Array, lowest_m: float = np.inf) -> list[Solid]:
    """Upright boxes about what hangs together in each layer; those alike one above the other are one.

    What is seen lowest is taken to go on down to where the thing stands.

    Args:
        points: (n, 3) of one thing that stands, in the world.
        lowest_m: How far down it was seen before [m].
    """
    points = thinned(main_cluster(points), _LAYER.thin_m)
    if not len(points):
        return []
    lowest = float(points[:, 2].min())
    foot = min(lowest, lowest_m)
    foot = 0.0 if 0.0 < foot < _LAYER.foot_m else foot
    number = np.floor((points[:, 2] - lowest) / _LAYER.layer_m).astype(int)
    boxes: list[tuple[Array, Array]] = []  # box (2, 3), and its points (n, 3)
    for k in range(int(number.max()) + 1):
        for part in _parts(points[number == k]):
            box = np.stack([part.min(0), part.max(0)])
            below = [i for i, (b, _) in enumerate(boxes) if _goes_on(b, box)]
            if below:
                i = below[0]
                boxes[i] = (np.stack([boxes[i][0][0], box[1]]), np.concatenate([boxes[i][1], part]))
            else:
                boxes.append((box, part))
    out: list[Solid] = []
    for box, part in boxes:
        low = foot if box[0, 2] < lowest + _LAYER.layer_m else float(box[0, 2])
        out += upright_box(_around(trimmed(part[:, :2])), low, max(float(box[1, 2]), low + _LAYER.thin_m)).solids
    return out


def _around(xy: Array) -> Outline:
    """A rectangle about points (n, 2), along the axes if it is hardly larger then: a round thing has no heading."""
    low, high = xy.min(0), xy.max(0)
    smallest = outline(xy)
    if np.prod(smallest.sides) < _LAYER.smaller * np.prod(high - low):
        return smallest
    return Outline((low + high) / 2, high - low, 0.0, smallest.fill)


def _parts(points: Array) -> list[Array]:
    """Points (n, 3) of one layer, those apart that do not hang together as seen from above."""
    if len(points) < _LAYER.least:
        return []
    cells: NDArray[np.int64] = np.floor((points[:, :2] - points[:, :2].min(0)) / _LAYER.cell_m).astype(np.int64)
    grid = np.zeros(cells.max(0) + 1, bool)
    grid[tuple(cells.T)] = True
    parts, count = ndimage.label(grid, np.ones((3, 3)))
    own = parts[tuple(cells.T)]
    return [part for k in range(1, count + 1) if len(part := points[own == k]) >= _LAYER.least]


def _goes_on(below: Array, above: Array) -> bool:
    """Whether a box (2, 3) goes on into the next layer's."""
    near = bool((np.abs(below[:, :2] - above[:, :2]) < _LAYER.same_m).all())
    return near and abs(float(above[0, 2] - below[1, 2])) < _LAYER.layer_m
