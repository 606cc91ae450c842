"""Furniture by the points that are seen of it: its level faces, openings in them, and the compartments between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from mpvi_bt.finding.shapes.outlines import Outline, outline, trimmed
from mpvi_bt.finding.shapes.shape import Shape, upright_box
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array, Solid, pose


@dataclass(frozen=True)
class Boards:
    """How boards of furniture are found.

    Our choice, by shelves of the simulated houses.
    """

    slab_m: float = 0.025  # thickness of a board [m]
    least_m: float = 0.004  # thickness of a board with something right below it [m]
    headroom_m: float = 0.12  # furniture that rises this high above a board makes a compartment of it [m]
    hole_cell_m: float = 0.02  # cell of the grid that finds openings [m]
    sunk_m: float = 0.05  # points this much lower than a board are seen through a hole in it [m]
    cell_m: float = 0.03  # cell of the grid that finds faces [m]
    along: float = 0.5  # least part of a half's outline that is seen [ratio], as of a rim its far two sides
    strip_cell_m: float = 0.02  # a face narrower than three of these is an edge, not a place for things [m]
    mostly: float = 0.5  # a face keeps its strips if less of it is broad, such as a drawer's rim seen in part [ratio]
    level: float = 0.5  # share of the points near a face's height that are on it [ratio]
    under_m: float = 0.05  # an overhang below this is not above the board, such as the edge of an open door [m]
    walled: float = 0.4  # share of a side along which furniture has to rise for a wall [ratio]


_BOARD = Boards()


def furniture(points: Array, support: float = -np.inf) -> Shape:
    """Slabs under the large horizontal faces, above what they stand on [m], and the frame of the largest."""
    slabs: list[tuple[int, Solid]] = []
    faces: list[Array] = []
    z = points[:, 2]
    counts, edges = np.histogram(z, np.arange(z.min() - 0.01, z.max() + 0.03, 0.01))
    level = counts.astype(float)
    for _ in range(4):
        k = int(level.argmax())
        if level[k] < 40:
            break
        height = float(np.median(z[(z > edges[k] - 0.01) & (z < edges[k + 1] + 0.01)]))
        level[max(k - 3, 0) : k + 4] = 0
        face = _broad(_level(points, height))
        if len(face) < 40:
            continue
        around = outline(trimmed(face[:, :2]))
        if around.sides[1] > 0.1 and not _strewn(face, around):
            if slabs:  # what is seen of a face in part may be a triangle: boards lie as the largest one does
                around = _along(trimmed(face[:, :2]), float(np.arctan2(*slabs[0][1].T[1::-1, 0])))
            thick = min(_BOARD.slab_m, max(_BOARD.least_m, height - support))
            T = pose((*around.middle, height - thick / 2), around.heading)
            slabs.append((len(face), Solid("box", np.array([*around.sides / 2, thick / 2]), T)))
            faces.append(face)
    if not slabs:
        around = outline(trimmed(points[:, :2]))
        low, high = percentile(z, [1, 99])
        box = upright_box(around, float(low), float(high))
        return replace(box, kind="furniture", extent=_extent(points))
    order = sorted(range(len(slabs)), key=lambda k: -slabs[k][0])
    boards, faces = [slabs[k][1] for k in order], [faces[k] for k in order]
    solids: list[Solid] = []
    volumes: list[Solid] = []
    for board, face in zip(boards, faces, strict=True):
        below = points[z < board.T[2, 3] - _BOARD.sunk_m]
        if (found := _hole(board, face, below)) is None:
            solids.append(board)
        else:
            rest, basin = _cut_out(board, *found)
            solids += rest
            volumes.append(basin)
    for board in boards:
        if (volume := _compartment(board, boards, points)) is not None:
            volumes.append(volume)
    return Shape("furniture", boards[0].T, tuple(solids), float(z.min()), tuple(volumes), extent=_extent(points))


def _level(points: Array, height: float) -> Array:
    """The points (n, 3) of a level face: where walls are seen as many points lie above and below it as on it."""
    near = points[np.abs(points[:, 2] - height) < 0.04]
    cells = np.floor((near[:, :2] - near[:, :2].min(0)) / _BOARD.cell_m).astype(np.int64)
    own = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    on = np.abs(near[:, 2] - height) < 0.012
    share = np.bincount(own, on) / np.maximum(np.bincount(own), 1)
    return np.asarray(near[on & (share[own] > _BOARD.level)])


def _broad(face: Array) -> Array:
    """The points (n, 3) of a face without its thin strips, such as the edge of a door that stands open."""
    if not len(face):
        return face
    cells = np.floor((face[:, :2] - face[:, :2].min(0)) / _BOARD.strip_cell_m).astype(np.int64) + 2
    grid = np.zeros(cells.max(0) + 3, bool)
    grid[tuple(cells.T)] = True
    grid = ndimage.binary_fill_holes(ndimage.binary_closing(grid, np.ones((3, 3), bool)))  # a rim is no strip
    broad = ndimage.binary_opening(grid, np.ones((3, 3), bool))[tuple(cells.T)]
    return face[broad] if broad.mean() > _BOARD.mostly else face


def _strewn(face: Array, around: Outline) -> bool:
    """Whether points (n, 3) only lie here and there in their outline, such as where a wall ceases to be in view."""
    cells = len(np.unique(np.floor(face[:, :2] / _BOARD.cell_m).astype(np.int64), axis=0))
    return cells * _BOARD.cell_m < _BOARD.along * float(around.sides.sum())


def _hole(board: Solid, face: Array, below: Array) -> tuple[Array, float] | None:
    """Find an opening in the middle of a board, such as for a basin in a counter, by points seen through it.

    Args:
        board: The board.
        face: (n, 3) points of its face.
        below: (m, 3) points lower than that.

    Returns:
        (2, 2) its lowest and highest corner in the board's axes, and the height down to which is seen; None if there
        is none.
    """
    half, axes = board.half_m[:2], board.T[:2, :2]
    size = np.maximum(np.ceil(2 * half / _BOARD.hole_cell_m).astype(int), 1)
    closed = np.zeros(size, bool)
    local = [matmul(p[:, :2] - board.T[:2, 3], axes) + half for p in (face, below)]
    cells = [np.floor(p / _BOARD.hole_cell_m).astype(int) for p in local]
    on, under = (((c >= 0) & (c < size)).all(1) for c in cells)
    closed[tuple(cells[0][on].T)] = True
    parts, count = ndimage.label(~(closed | ndimage.binary_closing(closed)))
    own = parts[tuple(cells[1][under].T)]
    counts = np.bincount(own, minlength=count + 1)
    edge = np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]])
    counts[np.append(edge, 0)] = 0  # at the edge: what is below is beside the board
    part = int(counts.argmax())
    if counts[part] < 40:
        return None
    at = np.argwhere(parts == part)
    low, high = at.min(0) * _BOARD.hole_cell_m - half, (at.max(0) + 1) * _BOARD.hole_cell_m - half
    filled = len(at) * _BOARD.hole_cell_m**2 / float(np.prod(high - low))
    if filled < 0.7 or (high - low).min() < 0.1:
        return None
    return np.stack([low, high]), float(percentile(below[under][own == part, 2], 3))


def _cut_out(board: Solid, hole: Array, bottom: float) -> tuple[list[Solid], Solid]:
    """The rest of a board around an opening, and the volume below the opening down to a height [m]."""
    (x0, y0), (x1, y1) = hole
    a, b, thick = board.half_m
    parts = [(-a, x0, -b, b), (x1, a, -b, b), (x0, x1, -b, y0), (x0, x1, y1, b)]
    rest = [
        Solid("box", np.array([(right - left) / 2, (far - near) / 2, thick]),
              matmul(board.T, pose(((left + right) / 2, (near + far) / 2, 0.0))))
        for left, right, near, far in parts if right - left > 0.01 and far - near > 0.01
    ]  # fmt: skip
    deep = (float(board.aabb()[1, 2]) - bottom) / 2
    middle = pose(((x0 + x1) / 2, (y0 + y1) / 2, thick - deep))
    return rest, Solid("box", np.array([(x1 - x0) / 2, (y1 - y0) / 2, deep]), matmul(board.T, middle))


def _along(xy: Array, heading: float) -> Outline:
    """The rectangle of a heading around points (n, 2)."""
    axes = Outline(np.zeros(2), np.zeros(2), heading, 1.0).frame
    low, high = matmul(xy, axes).min(0), matmul(xy, axes).max(0)
    return Outline(matmul(axes, low + high) / 2, high - low, heading, 1.0)


def _extent(points: Array) -> Solid:
    low, high = percentile(points, [1, 99])
    return Solid("box", np.maximum((high - low) / 2, 0.01), pose((low + high) / 2))


def _compartment(board: Solid, boards: Sequence[Solid], points: Array) -> Solid | None:
    """The space above a board, up to the next one or as high as the furniture rises; None if it has no two walls."""
    face = float(board.aabb()[1, 2])
    at = matmul(points[:, :2] - board.T[:2, 3], board.T[:2, :2])
    risen = (np.abs(at) < board.half_m[:2] + 0.05).all(1) & (points[:, 2] > face + _BOARD.headroom_m)
    around, at = points[risen, 2], at[risen]
    walls = 0
    for axis in (0, 1):
        for sign in (-1, 1):
            wall = at[sign * at[:, axis] > board.half_m[axis] - 0.05, 1 - axis]
            bins = max(3, round(2 * float(board.half_m[1 - axis]) / 0.06))
            counts, _ = np.histogram(wall, bins, (-board.half_m[1 - axis], board.half_m[1 - axis]))
            walls += int((counts > 2).mean() > _BOARD.walled)
    if len(around) < 20 or walls < 2:
        return None
    low, up, high = -board.half_m[:2], board.half_m[:2], float(percentile(around, 98))
    for roof in sorted(boards, key=lambda b: float(b.T[2, 3])):
        if roof.aabb()[0, 2] < face + _BOARD.headroom_m:
            continue
        half = matmul(np.abs(matmul(board.T[:2, :2].T, roof.T[:2, :2])), roof.half_m[:2])
        middle = matmul(roof.T[:2, 3] - board.T[:2, 3], board.T[:2, :2])
        below = np.maximum(low, middle - half), np.minimum(up, middle + half)
        if (below[1] - below[0] > _BOARD.under_m).all():  # only what is under it: a thing falls past what is before it
            (low, up), high = below, min(high, float(roof.aabb()[0, 2]))
            break
    T = matmul(board.T, pose((*(low + up) / 2, 0.0)))
    T[2, 3] = (face + high) / 2
    half = np.append((up - low) / 2, (high - face) / 2)
    return Solid("box", half, T)
