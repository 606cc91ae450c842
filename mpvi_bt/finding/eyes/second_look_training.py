"""Trains the second look, which tells the kinds of movable things by crops, with torch.

It learns from what the renderer labels, with outlines as inexact as those that it will be given, and from crops of
nothing in particular.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.eyes.crops import CROP_CHANNELS, CROP_PX, NUMBERS, Crops, crops_of
from mpvi_bt.finding.eyes.inputs import inputs_of
from mpvi_bt.finding.eyes.layers import COVERS, Layer, crop_layers, dense_layers
from mpvi_bt.finding.eyes.picture_file import LabeledPicture, PictureFile
from mpvi_bt.finding.eyes.tiles import cover_of, disturbed
from mpvi_bt.finding.eyes.training import EyesTraining, _kept, _torch, folded
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array

# All our choice.
STEPS = 7_000
_PICTURES = 4  # that are looked at anew in a step,
_MOST = 10  # crops of one of them
_POOL, _BATCH = 50_000, 128  # crops that are kept, and of them those in a step
_LIGHT, _SHIFT_PX = 0.15, 2  # by which crops are changed each time
_LEAST_PX = 10
_NOTHING = 1  # crops of nothing in a picture
_MOVED = 0.6  # of the outlines are a pixel or so off,
_CUT = 0.15  # and of so many a part is missing
_RATE, _DECAY = 2e-3, 1e-2
_WARM_STEPS, _LEAST_RATE = 100, 0.01
_AVERAGED = 0.998
_SMOOTH = 0.02  # of labels
_TOLD_STEPS = 100


def movable_kinds(folder: Path) -> tuple[str, ...]:
    """Kinds of movable things in the pictures of a folder, sorted."""
    kinds = {kind for path in sorted(folder.glob("*.npz")) for kind in PictureFile(path).kinds}
    return tuple(sorted(kind for kind in kinds if COVERS[cover_of(kind)] == "movable"))


def train_second_look(
    job: EyesTraining, kept: Path, tell: Callable[[dict[str, Any]], None], until_s: float = math.inf
) -> tuple[tuple[str, ...], dict[str, Array]]:
    """Train the second look; its kinds and its weights. Arguments and errors are as of `train_eyes`."""
    torch = _torch()
    torch.set_num_threads(1)
    torch.manual_seed(job.seed)
    began = time.perf_counter()
    state = _kept(torch, kept) if kept.exists() else None
    kinds = tuple(state["kinds"]) if state is not None else movable_kinds(job.folder)
    if not kinds:
        raise UserError(f"{job.folder}: there are no pictures; python -m benchmarks.eyes.pictures FOLDER makes some.")
    numbers = {kind: k for k, kind in enumerate(kinds)}
    trained = _SecondLook(torch, len(kinds), job)
    sizes = {"seed": job.seed, "steps": job.steps}
    if state is not None:
        if state["sizes"] != sizes:
            raise UserError(f"{kept}: is of another training, {state['sizes']}, not {sizes}; delete it to begin anew.")
        job.curves[:] = state["curves"]
        trained.restore(state)
    sums: dict[str, float] = {}
    rng, index, pool = np.random.default_rng([job.seed, trained.step]), _index(job.folder), _Pool()
    while trained.step < job.steps and time.perf_counter() - began < until_s:
        for _ in range(_PICTURES if len(pool) >= 4 * _BATCH else 40 * _PICTURES):
            file, k = index[int(rng.integers(len(index)))]
            pool.add(*_crops(file[k], numbers, rng))
        for name, value in trained.learn(*pool.draw(_BATCH, rng)).items():
            sums[name] = sums.get(name, 0.0) + value
        if trained.step % _TOLD_STEPS == 0 or trained.step == job.steps:
            row = {"step": trained.step, "of": job.steps, **{k: round(v / _TOLD_STEPS, 4) for k, v in sums.items()}}
            row["seconds"] = round(time.perf_counter() - began, 1)
            job.curves.append(row)
            tell(row)
            sums, index = {}, _index(job.folder)
            rng = np.random.default_rng([job.seed, trained.step])
            part = kept.with_suffix(".part")
            torch.save({"sizes": sizes, "kinds": list(kinds), "curves": job.curves, **trained.save()}, part)
            part.replace(kept)
    return kinds, trained.weights()


def _index(folder: Path) -> list[tuple[PictureFile, int]]:
    """Every picture of a folder."""
    files = [PictureFile(path) for path in sorted(folder.glob("*.npz"))]
    return [(file, k) for file in files for k in range(len(file))]


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
    picture: LabeledPicture, numbers: Mapping[str, int], rng: np.random.Generator
) -> tuple[Crops, NDArray[np.int64]]:
    """Crops of things in a picture, and the number of each one's kind."""
    h, w = picture.labels.shape
    seen = disturbed(picture, np.arange(h), np.arange(w), rng)
    masks, kinds = _outlines(seen, numbers, rng)
    inputs = inputs_of(seen.rgb, seen.depth, seen.K, seen.T_world_camera)
    crops = crops_of(inputs, seen.depth, masks, len(kinds), seen.K, seen.T_world_camera)
    return crops, np.array(kinds, np.int64)


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


class _SecondLook:
    """The second look in training."""

    def __init__(self, torch: Any, kinds: int, job: EyesTraining) -> None:
        self.torch, self.kinds, self.count, self.device, self.step = torch, kinds, job.steps, job.device, 0
        nn, parts = torch.nn, {}
        for layer in [*crop_layers(), *dense_layers(kinds)]:
            convolution = nn.Conv2d(
                layer.into, layer.out, layer.size, layer.stride, layer.size // 2, bias=not layer.rectified
            )
            normal = [nn.BatchNorm2d(layer.out), nn.ReLU()] if layer.rectified else []
            parts[layer.name.replace(".", "_")] = nn.Sequential(convolution, *normal)
        self.net = nn.ModuleDict(parts).to(job.device, memory_format=torch.channels_last)
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=_RATE, weight_decay=_DECAY, fused=True)
        self.average = {k: v.clone() for k, v in self.net.state_dict().items()}

    def run(self, layer: Layer, x: Any) -> Any:
        y = self.net[layer.name.replace(".", "_")](x)
        return x + y if layer.residual else y

    def forward(self, planes: Any, numbers: Any) -> Any:
        """(n, kinds + 1) of planes (n, channels, CROP_PX, CROP_PX) and numbers (n, m)."""
        functional = self.torch.nn.functional
        x = planes
        for layer in crop_layers():
            x = self.run(layer, x)
        inside = functional.avg_pool2d(planes[:, -1:], CROP_PX // x.shape[-1])
        own = (x * inside).sum((2, 3)) / (inside.sum((2, 3)) + 1e-3)
        y = self.torch.cat([own, x.mean((2, 3)), numbers], 1)[..., None, None]
        first, last = dense_layers(self.kinds)
        return self.run(last, functional.dropout(self.run(first, y).relu(), 0.1, self.net.training))[..., 0, 0]

    def learn(self, crops: Crops, due: NDArray[np.int64]) -> dict[str, float]:
        """One step; the loss, and the share that was told right."""
        torch = self.torch
        fall = 0.5 * (1 + math.cos(math.pi * self.step / self.count)) * (1 - _LEAST_RATE) + _LEAST_RATE
        for group in self.optimizer.param_groups:
            group["lr"] = _RATE * min(1.0, (self.step + 1) / _WARM_STEPS) * fall
        planes = torch.from_numpy(crops.planes).to(self.device).permute(0, 3, 1, 2)
        wanted = torch.from_numpy(due).to(self.device)
        with torch.autocast(torch.device(self.device).type, torch.bfloat16):
            told = self.forward(planes, torch.from_numpy(crops.numbers).to(self.device)).float()
        loss = torch.nn.functional.cross_entropy(told, wanted, label_smoothing=_SMOOTH)
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.step += 1
        keep = min(_AVERAGED, self.step / (self.step + 20))
        for name, value in self.net.state_dict().items():
            if value.dtype.is_floating_point:
                self.average[name].mul_(keep).add_(value, alpha=1 - keep)
            else:
                self.average[name].copy_(value)
        right = float((told.argmax(1) == wanted).float().mean())
        return {"loss": float(loss.detach()), "right": right}

    def save(self) -> dict[str, Any]:
        return {"step": self.step, "net": self.net.state_dict(), "average": self.average,
                "optimizer": self.optimizer.state_dict()}  # fmt: skip

    def restore(self, state: Mapping[str, Any]) -> None:
        self.step = state["step"]
        self.average = {name: value.to(self.device) for name, value in state["average"].items()}
        self.net.load_state_dict(state["net"])
        self.optimizer.load_state_dict(state["optimizer"])

    def weights(self) -> dict[str, Array]:
        return folded(self.average, [*crop_layers(), *dense_layers(self.kinds)])
