"""Trains the second look, which tells the kinds of movable things by crops, with torch.

It learns from what the renderer labels, with inexact outlines, and from crops of nothing in particular; at the end also
from the first network's outlines, among which some are of nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.eyes.crops import CROP_CHANNELS, CROP_PX, NUMBERS, Crops, crops_of
from mpvi_bt.finding.eyes.eyes_layers import COVERS, crop_layers, dense_layers
from mpvi_bt.finding.eyes.eyes_network import Answers, EyesNetwork
from mpvi_bt.finding.eyes.grouping import MOVABLE, movable_segments
from mpvi_bt.finding.eyes.inputs import inputs_of
from mpvi_bt.finding.eyes.look_training import EyesTraining, Look
from mpvi_bt.finding.eyes.picture_file import LabeledPicture, PictureFile, pictures_in
from mpvi_bt.finding.eyes.segment_overlaps import overlaps
from mpvi_bt.finding.eyes.tiles import cover_of, disturbed
from mpvi_bt.ground.errors import UserError

# All our choice.
_PICTURES = 4  # that are looked at anew in a step,
_MOST = 10  # crops of one of them
_POOL, _BATCH = 50_000, 128  # crops that are kept, and of them those in a step
_LIGHT, _SHIFT_PX = 0.15, 2  # by which crops are changed each time
_LEAST_PX = 10
_NOTHING = 1  # crops of nothing in a picture
_MOVED = 0.6  # of the outlines are a pixel or so off,
_CUT = 0.15  # and of so many a part is missing
_FROM, _PREDICTED = 0.8, 0.4  # of the steps, and from then on of the pictures, that have the first network's outlines
_ALIKE, _UNLIKE = 0.35, 0.15  # of the union: a segment that shares more with a thing is that, one of less is nothing
_SMOOTH = 0.02  # of labels


_FIRST_PICTURES = 160  # that are looked at before the first step
_DROPPED = 0.1  # of the numbers before the last layer


class SecondLook(Look):
    """The second look in training.

    Args:
        kinds: Movable things; None: as in the pictures.
        job: Whose training this is.
        first: The first network, trained; None: all outlines are the renderer's.
    """

    usual_steps = 7_000
    rate, warm_steps = 2e-3, 100

    def __init__(self, kinds: Sequence[str] | None, job: EyesTraining, first: EyesNetwork | None = None) -> None:
        self._folder, self._first = job.folder, first
        kinds = movable_kinds(job.folder) if kinds is None else kinds
        super().__init__([*crop_layers(), *dense_layers(len(kinds))], kinds, job)
        self._numbers = {kind: k for k, kind in enumerate(self.kinds)}
        self._pictures: Sequence[LabeledPicture] = ()
        self._pool: _Pool | None = None

    def refresh(self) -> None:
        """Take in pictures that came meanwhile."""
        self._pictures = pictures_in(self._folder)

    def forward(self, planes: Any, numbers: Any) -> Any:
        """(n, kinds + 1) of planes (n, channels, CROP_PX, CROP_PX) and numbers (n, m)."""
        functional = self.torch.nn.functional
        x = planes
        for layer in crop_layers():
            x = self.run(layer, x)
        inside = functional.avg_pool2d(planes[:, -1:], CROP_PX // x.shape[-1])
        own = (x * inside).sum((2, 3)) / (inside.sum((2, 3)) + 1e-3)
        y = self.torch.cat([own, x.mean((2, 3)), numbers], 1)[..., None, None]
        first, last = dense_layers(len(self.kinds))
        y = functional.dropout(self.run(first, y).relu(), _DROPPED, self.net.training)
        return self.run(last, y)[..., 0, 0]

    def loss(self, rng: np.random.Generator) -> tuple[Any, dict[str, Any]]:
        """Of a drawn batch, and figures to tell."""
        crops, due = self._batch(rng)
        wanted = self.tensor(due)
        with self.autocast():
            told = self.forward(self.tensor(crops.planes).permute(0, 3, 1, 2), self.tensor(crops.numbers)).float()
        loss = self.torch.nn.functional.cross_entropy(told, wanted, label_smoothing=_SMOOTH)
        return loss, {"loss": loss.detach(), "right": (told.argmax(1) == wanted).float().mean()}

    def _batch(self, rng: np.random.Generator) -> tuple[Crops, NDArray[np.int64]]:
        if self._pool is None:
            self.refresh()
            self._pool = _Pool()
        for _ in range(_PICTURES if len(self._pool) else _FIRST_PICTURES):
            picture = self._pictures[int(rng.integers(len(self._pictures)))]
            late = self.step >= _FROM * self.steps and rng.random() < _PREDICTED
            self._pool.add(*_crops(picture, self._numbers, rng, self._first if late else None))
        return self._pool.draw(_BATCH, rng)


def movable_kinds(folder: Path) -> tuple[str, ...]:
    """Kinds of movable things in the pictures of a folder, sorted.

    Raises:
        UserError: There are none, or a file cannot be read.
    """
    kinds = {kind for path in sorted(folder.glob("*.npz")) for kind in PictureFile(path).kinds}
    if not kinds:
        raise UserError(f"{folder}: there are no pictures; python -m benchmarks.eyes.pictures FOLDER makes some.")
    return tuple(sorted(kind for kind in kinds if COVERS[cover_of(kind)] == "movable"))


class _Pool:
    """Crops of the pictures that were looked at last, to learn from several times."""

    def __init__(self) -> None:
        self._planes = np.zeros((_POOL, CROP_PX, CROP_PX, CROP_CHANNELS), np.float16)
        self._numbers = np.zeros((_POOL, NUMBERS), np.float32)
        self._due = np.zeros(_POOL, np.int64)
        self._added = 0

    def __len__(self) -> int:
        return min(self._added, _POOL)

    def add(self, crops: Crops, due: NDArray[np.int64]) -> None:
        """Take crops in, in the place of the oldest."""
        at = (self._added + np.arange(len(due))) % _POOL
        self._planes[at], self._numbers[at], self._due[at] = crops.planes, crops.numbers, due
        self._added += len(due)

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Crops, NDArray[np.int64]]:
        """Some of them, shifted a little and in another light."""
        chosen = rng.integers(len(self), size=count)
        planes = self._planes[chosen].astype(np.float32)
        shift = rng.integers(-_SHIFT_PX, _SHIFT_PX + 1, 2)
        planes = np.roll(planes, shift, (1, 2))
        light = rng.uniform(1 - _LIGHT, 1 + _LIGHT, (count, 1, 1, 1)).astype(np.float32)
        planes[..., :3] = (planes[..., :3] + 1) * light - 1
        return Crops(planes, self._numbers[chosen]), self._due[chosen]


def _crops(
    picture: LabeledPicture, numbers: Mapping[str, int], rng: np.random.Generator, first: EyesNetwork | None
) -> tuple[Crops, NDArray[np.int64]]:
    """Crops of things in a picture, and the number of each one's kind."""
    h, w = picture.labels.shape
    seen = disturbed(picture, np.arange(h), np.arange(w), rng)
    inputs = inputs_of(seen.rgb, seen.depth, seen.K, seen.T_world_camera)
    masks, kinds = _outlines(seen, numbers, rng) if first is None else _predicted(seen, numbers, first.look(inputs))
    crops = crops_of(inputs, seen.depth, masks, len(kinds), seen.K, seen.T_world_camera)
    return crops, np.array(kinds, np.int64)


def _predicted(
    picture: LabeledPicture, numbers: Mapping[str, int], answers: Answers
) -> tuple[NDArray[np.int32], list[int]]:
    """As `_outlines`, those of the first network."""
    things, count = movable_segments(answers.covers.argmax(0) == MOVABLE, picture.depth, answers.near, answers.way)
    shared = overlaps(things, count, picture.labels, len(picture.kinds))
    place, kinds = np.zeros(count + 1, np.int32), []
    for k in range(count):
        best = int(shared[k].argmax()) if len(picture.kinds) else 0
        most = float(shared[k, best]) if len(picture.kinds) else 0.0
        number = numbers.get(picture.kinds[best], len(numbers)) if most > _ALIKE else len(numbers)
        if most > _ALIKE or most < _UNLIKE:
            kinds.append(number)
            place[k + 1] = len(kinds)
    return place[things], kinds


def _outlines(
    picture: LabeledPicture, numbers: Mapping[str, int], rng: np.random.Generator
) -> tuple[NDArray[np.int32], list[int]]:
    """(H, W) inexact outlines of some movable things and of nothing, counted from 1, and the numbers of their kinds."""
    labels = picture.labels
    area = np.bincount(labels.ravel(), minlength=len(picture.kinds) + 1)
    known = [k for k, kind in enumerate(picture.kinds, 1) if kind in numbers and area[k] >= _LEAST_PX]
    chosen = rng.permutation(known)[:_MOST].tolist()
    masks, kinds = np.zeros(labels.shape, np.int32), []
    places = ndimage.find_objects(labels, len(picture.kinds))
    for k in chosen:
        rows, columns = places[k - 1]
        window = (slice(max(rows.start - 2, 0), rows.stop + 2), slice(max(columns.start - 2, 0), columns.stop + 2))
        mask = labels[window] == k
        if rng.random() < _MOVED:
            change = rng.random()
            if change < 0.35:
                mask = ndimage.binary_dilation(mask)
            elif change < 0.65 and area[k] > 60:
                mask = ndimage.binary_erosion(mask)
            else:
                mask = np.roll(mask, rng.integers(-1, 2, 2), (0, 1))
        if rng.random() < _CUT:
            y, x = np.mgrid[: mask.shape[0], : mask.shape[1]] - np.array(mask.shape)[:, None, None] / 2
            turn = rng.uniform(0, 2 * np.pi)
            mask = mask & (x * np.cos(turn) + y * np.sin(turn) < rng.uniform(0, 0.4) * max(mask.shape))
        mask = mask & (masks[window] == 0)
        if np.count_nonzero(mask) >= _LEAST_PX:
            kinds.append(numbers[picture.kinds[k - 1]])
            masks[window][mask] = len(kinds)
    movable = np.array([False, *(kind in numbers for kind in picture.kinds)])
    for _ in range(_NOTHING):
        h, w = labels.shape
        y, x, size = rng.uniform(0, h), rng.uniform(0, w), np.exp(rng.uniform(np.log(4), np.log(45)))
        rows = np.arange(max(int(y - size), 0), min(int(y + size) + 1, h))
        columns = np.arange(max(int(x - size), 0), min(int(x + size) + 1, w))
        one = labels[min(int(y), h - 1), min(int(x), w - 1)]
        if movable[one]:
            continue
        part = np.ix_(rows, columns)
        oval = ((rows - y) / rng.uniform(0.3, 1) / size)[:, None] ** 2 + ((columns - x) / size)[None] ** 2 < 1
        mask = oval & ~movable[labels[part]] & (masks[part] == 0)
        if rng.random() < 0.5:
            mask &= labels[part] == one
        if np.count_nonzero(mask) >= _LEAST_PX:
            kinds.append(len(numbers))
            masks[part] = np.where(mask, len(kinds), masks[part])
    return masks, kinds
