"""Tiles of labeled pictures, as a network learns from them: what goes in, and what is due."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.eyes.eyes_layers import CELL_PX, COVERS, OFFSET_PX
from mpvi_bt.finding.eyes.inputs import inputs_of
from mpvi_bt.finding.eyes.picture_file import LabeledPicture, PictureFile, pictures_in
from mpvi_bt.finding.perception.detector import ROBOT
from mpvi_bt.finding.perception.segments import FLOOR, FURNITURE
from mpvi_bt.ground.compiled import compiled_later
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE

TILE = (192, 224)  # height and width [px]
# All our choice.
_ZOOM_WHOLE, _ZOOM_NEAR = (0.86, 1.1), (1.1, 2.2)
_NEAR = 0.5  # of the tiles are zoomed at a movable thing
_SMALL = 0.5  # how much more often that is a small one: the power of its area
_NOISY = 0.5  # of the tiles have noise of depth, up to 1.5 times the cameras', and holes
_MOST_HOLES = 0.03
_TILT_RAD, _HIGH_M = 0.015, 0.02  # how far off a camera is thought to be
_LIGHT, _TINT, _GRAIN = 0.2, 0.06, 0.02  # of colors
_LEAST_PX = 10  # a thing of fewer pixels in a tile need not be known
_CELL_PX2 = 3  # movable pixels that make a cell movable
_USUAL_PX = 500.0  # a thing of this area has weight 1
_WEIGHTS = (0.6, 3.0)  # least and most of a movable thing
_STILL_WEIGHT = 0.7  # of furniture, robot and background


@dataclass(frozen=True, eq=False)
class Tile:
    """A tile, or a batch of tiles with one more dimension in front.

    Attributes:
        inputs: (H, W, CHANNELS) float32.
        kinds: (h, w) int64 of each cell, 0 for background, one more than there are kinds for what is movable.
        weight: (h, w) float32 how much that counts; 0 where it is not told.
        covers: (H, W) int64, of `COVERS`.
        near: (h, w) float32, 1 at centers of movable things, falling to 0.
        way: (2, h, w) float32 x and y to the center [`OFFSET_PX`].
        movable: (h, w) float32, 1 where the way counts.
    """

    inputs: NDArray[np.float32]
    kinds: NDArray[np.int64]
    weight: NDArray[np.float32]
    covers: NDArray[np.int64]
    near: NDArray[np.float32]
    way: NDArray[np.float32]
    movable: NDArray[np.float32]


def cover_of(kind: str) -> int:
    """What a kind covers pixels as, an index into `COVERS`."""
    if kind == ROBOT:
        return 3
    return 1 if kind in FURNITURE or kind == FLOOR else 2


class Tiles:
    """Draws tiles from files of pictures.

    Args:
        folder: Of the files.
        kinds: Of what stays where it is; all others are movable things.

    Raises:
        UserError: The folder has no files, or one of them cannot be read.
    """

    def __init__(self, folder: Path, kinds: Sequence[str]) -> None:
        self._pictures = pictures_in(folder)
        self._numbers: Mapping[str, int] = {kind: k + 1 for k, kind in enumerate(kinds)}

    def __len__(self) -> int:
        """How many pictures there are."""
        return len(self._pictures)

    def batch(self, count: int, rng: np.random.Generator) -> Tile:
        """So many tiles of drawn pictures."""
        chosen = rng.integers(len(self), size=count).tolist()
        tiles = [tile_of(self._pictures[k], self._numbers, rng) for k in chosen]
        return Tile(*(np.stack([getattr(tile, field.name) for tile in tiles]) for field in fields(Tile)))


def still_kinds(folder: Path) -> tuple[str, ...]:
    """Kinds of what stays where it is, furniture, floor and robot, in the pictures of a folder, sorted."""
    kinds = {kind for path in sorted(folder.glob("*.npz")) for kind in PictureFile(path).kinds}
    return tuple(sorted(kind for kind in kinds if COVERS[cover_of(kind)] != "movable"))


def tile_of(picture: LabeledPicture, numbers: Mapping[str, int], rng: np.random.Generator) -> Tile:
    """One tile: a part of the picture at a drawn scale, mirrored or not, with noise."""
    areas = np.bincount(picture.labels.ravel(), minlength=len(picture.kinds) + 1).astype(float)
    covers = np.array([0, *(cover_of(kind) for kind in picture.kinds)])
    h, w = picture.labels.shape
    least = max(TILE[0] / h, TILE[1] / w)
    movable = np.flatnonzero((covers == COVERS.index("movable")) & (areas >= _LEAST_PX))
    near = len(movable) > 0 and rng.random() < _NEAR
    zoom = max(least, rng.uniform(*(_ZOOM_NEAR if near else _ZOOM_WHOLE)))
    if near:
        chance = areas[movable] ** -_SMALL
        one = movable[rng.choice(len(movable), p=chance / chance.sum())]
        at = np.argwhere(picture.labels == one).mean(0) + rng.normal(0, 15, 2)
    else:
        at = rng.uniform(0, (h, w))
    size = np.array(TILE) / zoom
    corner = np.clip(at - size / 2, 0, np.array([h, w]) - size)
    rows, columns = (
        np.minimum((corner[k] + (np.arange(TILE[k]) + 0.5) / zoom).astype(np.int64), (h, w)[k] - 1) for k in range(2)
    )
    part = disturbed(picture, rows, columns, rng, zoom, (corner[0], corner[1]))
    return Tile(inputs_of(part.rgb, part.depth, part.K, part.T_world_camera),
                *_due(part.labels, picture.kinds, covers, numbers))  # fmt: skip


def disturbed(
    picture: LabeledPicture, rows: NDArray[np.int64], columns: NDArray[np.int64], rng: np.random.Generator,
    zoom: float = 1.0, corner: tuple[float, float] = (0.0, 0.0),
) -> LabeledPicture:  # fmt: skip
    """A part of a picture, mirrored or not, with other light, with noise, and with a camera that is a little off.

    Args:
        picture: Any.
        rows, columns: Of the picture, those of the part.
        rng: Source of the draws.
        zoom: Pixels of the part for each of the picture's.
        corner: Row and column where the part begins.
    """
    K, T = picture.K.copy(), picture.T_world_camera.copy()
    K[:2] *= zoom
    K[0, 2] -= corner[1] * zoom
    K[1, 2] -= corner[0] * zoom
    T[:3, :3] = matmul(_tilt(rng), T[:3, :3])
    T[2, 3] += rng.normal(0, _HIGH_M)
    if rng.random() < 0.5:
        columns, K[0, 2] = np.ascontiguousarray(columns[::-1]), len(columns) - K[0, 2]
        T[2, 0] = -T[2, 0]
    noisy = rng.random() < _NOISY
    sigma = rng.uniform(0, 1.5) * DEPTH_NOISE.sigma_m if noisy else 0.0
    holes = rng.uniform(0, _MOST_HOLES) if noisy else 0.0
    light = rng.uniform(1 - _LIGHT, 1 + _LIGHT) * rng.uniform(1 - _TINT, 1 + _TINT, 3)
    size = len(rows), len(columns)
    rgb, depth, labels = np.empty((*size, 3), np.uint8), np.empty(size, np.float32), np.empty(size, np.uint8)
    start = int(rng.integers(1 << 62))
    _cut(picture.rgb, picture.depth, picture.labels, rows, columns, light, 255 * rng.uniform(0, _GRAIN), sigma, holes,
         _noise(), start, rgb, depth, labels)  # fmt: skip
    return replace(picture, rgb=rgb, depth=depth, labels=labels, K=K, T_world_camera=T)


@cache
def _noise() -> NDArray[np.float32]:
    """Normal numbers to take noise from."""
    return np.random.default_rng(0).standard_normal(1 << 20, np.float32)


def _cut_loops(
    rgb: NDArray[np.uint8], depth: NDArray[np.float32], labels: NDArray[np.uint8], rows: NDArray[np.int64],
    columns: NDArray[np.int64], light: Array, grain: float, sigma: float, holes: float, noise: NDArray[np.float32],
    start: int, out_rgb: NDArray[np.uint8], out_depth: NDArray[np.float32], out_labels: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Cut rows and columns out, with noise from a place in `noise`; `grain` in steps of color, `sigma` [m] at 1 m."""
    mask, most = len(noise) - 1, np.int64(holes * (1 << 20))
    state = np.uint64(start)
    for i in range(len(rows)):
        for j in range(len(columns)):
            r, c = rows[i], columns[j]
            state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
            at = np.int64(state >> np.uint64(40))
            for k in range(3):
                value = rgb[r, c, k] * light[k] + grain * noise[(at + 7919 * k) & mask]
                out_rgb[i, j, k] = np.uint8(min(max(value, 0.0), 255.0))
            d = depth[r, c]
            d += sigma * d * d * noise[(at + 31337) & mask]
            if np.int64((state >> np.uint64(20)) & np.uint64((1 << 20) - 1)) < most:
                d = 0.0
            out_depth[i, j] = max(d, 0.0)
            out_labels[i, j] = labels[r, c]


_cut = compiled_later(_cut_loops)


def _tilt(rng: np.random.Generator) -> Array:
    """(3, 3) a small turn about horizontal axes."""
    a, b = rng.normal(0, _TILT_RAD, 2)
    return np.array([[1, 0, b], [0, 1, -a], [-b, a, 1.0]])


@cache
def _middle() -> NDArray[np.float32]:
    """(16,) of the pixels of a cell, those in its middle first."""
    at = np.abs(np.arange(CELL_PX) - (CELL_PX - 1) / 2)
    return np.asarray(0.5 - 0.1 * (at[:, None] + at[None]), np.float32).ravel()


def _due(
    labels: NDArray[np.uint8], kinds: Sequence[str], covers: NDArray[np.int64], numbers: Mapping[str, int]
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64], NDArray[np.float32], NDArray[np.float32],
           NDArray[np.float32]]:  # fmt: skip
    """What is due of a tile's labels, in the order of `Tile`."""
    is_movable = covers == COVERS.index("movable")
    cover = covers[labels]
    h, w = labels.shape[0] // CELL_PX, labels.shape[1] // CELL_PX
    cells = labels.reshape(h, CELL_PX, w, CELL_PX).transpose(0, 2, 1, 3).reshape(h, w, CELL_PX**2)
    lying = is_movable[cells]
    enough = lying.sum(-1) >= _CELL_PX2
    first = (_middle() + np.where(enough[..., None], lying, ~lying)).argmax(-1)
    label = np.take_along_axis(cells, first[..., None], -1)[..., 0]
    number = np.array([0, *(numbers.get(kind, len(numbers) + 1) for kind in kinds)])
    area = np.bincount(labels.ravel(), minlength=len(number)).astype(float)
    each = np.where(is_movable, np.clip(np.sqrt(_USUAL_PX / np.maximum(area, 1)), *_WEIGHTS), _STILL_WEIGHT)
    each[is_movable & (area < _LEAST_PX)] = 0
    weight = each[label].astype(np.float32)
    moves = is_movable[label] & (area[label] >= _LEAST_PX)
    near, way = np.zeros((h, w), np.float32), np.zeros((2, h, w), np.float32)
    ys, xs = np.mgrid[:h, :w].astype(np.float32) * CELL_PX + (CELL_PX - 1) / 2
    rows, columns = np.nonzero(is_movable[labels])
    own = labels[rows, columns]
    sums = [np.bincount(own, weights=v, minlength=len(number)) for v in (columns, rows)]
    for k in np.flatnonzero(is_movable & (area >= _LEAST_PX)):
        x, y = sums[0][k] / area[k], sums[1][k] / area[k]
        sigma = np.clip(0.18 * np.sqrt(area[k]), 3.0, 16.0)
        bump = np.exp(-((xs[0] - x) ** 2) / (2 * sigma**2)) * np.exp(-((ys[:, :1] - y) ** 2) / (2 * sigma**2))
        cell = min(int(y / CELL_PX), h - 1), min(int(x / CELL_PX), w - 1)
        bump[cell] = 1.0
        np.maximum(near, bump, out=near)
        mine = label == k
        way[0][mine], way[1][mine] = (x - xs[mine]) / OFFSET_PX, (y - ys[mine]) / OFFSET_PX
    return (number[label].astype(np.int64), weight, cover.astype(np.int64), near, way,
            moves.astype(np.float32))  # fmt: skip
