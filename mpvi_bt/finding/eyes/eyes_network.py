"""The networks, run in numpy, and the file of their weights.

Convolutions are products of matrices by a BLAS, in single precision: loops as elsewhere in mpvi_bt would take far
longer. So a picture is always seen alike on one machine, but on another processor scores may differ in the last digits.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.eyes.crops import CROP_PX, Crops
from mpvi_bt.finding.eyes.eyes_layers import (
    CELL_PX,
    COVERS,
    MULTIPLE_PX,
    VERSION,
    Layer,
    answers,
    crop_layers,
    dense_layers,
    head,
    laterals,
    layers,
    smoothing,
    stages,
)
from mpvi_bt.finding.eyes.inputs import Planes
from mpvi_bt.ground.errors import UserError


@dataclass(frozen=True, eq=False)
class Answers:
    """What the first network answers to a picture of H x W px, h = H / 4 and w = W / 4 rounded up.

    Attributes:
        kinds: (h, w, kinds + 2) logits of background, of each kind that stays where it is, of movable things.
        covers: (4, H, W) logits of `COVERS`.
        near: (h, w) logit of how near the center of a movable thing is.
        way: (h, w, 2) x and y to it, in `OFFSET_PX`.
    """

    kinds: Planes
    covers: Planes
    near: Planes
    way: Planes


@dataclass(frozen=True, eq=False)
class EyesNetwork:
    """Both networks.

    Attributes:
        still: Kinds that the first one tells.
        movable: Kinds that the second look tells.
        weights: By layer: (size * size * into, out) of rows, columns and channels, and (out,); float32.
        calibration: (4,) from what a segment looks like to the logarithm of its odds to be right; see `segmenter`.
        about: How they were made.
    """

    still: tuple[str, ...]
    movable: tuple[str, ...]
    weights: Mapping[str, Planes]
    calibration: tuple[float, ...]
    about: Mapping[str, Any]

    def look(self, inputs: Planes) -> Answers:
        """Answers to inputs (H, W, channels)."""
        h, w = inputs.shape[:2]
        tall, wide = (-(-n // MULTIPLE_PX) * MULTIPLE_PX for n in (h, w))
        padded = np.zeros((1, tall, wide, inputs.shape[2]), np.float32)
        padded[0, :h, :w] = inputs
        x, seen = padded, []
        for stage in stages():
            for layer in stage:
                x = self._run(layer, x)
            seen.append(x)
        y: Planes | None = None
        for lateral, smooth, x in reversed(list(zip(laterals(), smoothing(), seen, strict=True))):
            side = self._run(lateral, x)
            if y is not None:
                n, a, b, c = y.shape
                doubled = side.reshape(n, a, 2, b, 2, c)  # a view: what is added to it is added to `side`
                doubled += y[:, :, None, :, None]
            y = self._run(smooth, side)
        assert y is not None
        cells = self._run(head(), y)[:, : -(-h // CELL_PX), : -(-w // CELL_PX)]
        kinds, covers, center = (self._run(layer, np.ascontiguousarray(cells))[0] for layer in answers(len(self.still)))
        a, b = covers.shape[:2]
        covers = covers.reshape(a, b, CELL_PX, CELL_PX, len(COVERS)).transpose(4, 0, 2, 1, 3)
        covers = covers.reshape(len(COVERS), a * CELL_PX, b * CELL_PX)[:, :h, :w]
        return Answers(kinds, covers, center[..., 0], center[..., 1:])

    def tell(self, crops: Crops) -> Planes:
        """(n, kinds + 1) probabilities of the movable kinds, and of nothing, of n crops."""
        x = crops.planes
        for layer in crop_layers():
            x = self._run(layer, x)
        n, side = len(x), x.shape[1]
        step = CROP_PX // side
        inside = crops.planes[..., -1].reshape(n, side, step, side, step).mean((2, 4))[..., None]
        own = (x * inside).sum((1, 2)) / (inside.sum((1, 2)) + np.float32(1e-3))
        y = np.concatenate([own, x.mean((1, 2)), crops.numbers], 1)
        first, last = dense_layers(len(self.movable))
        y = np.maximum(y @ self.weights[f"{first.name}.weight"] + self.weights[f"{first.name}.bias"], 0)
        return softmax(y @ self.weights[f"{last.name}.weight"] + self.weights[f"{last.name}.bias"])

    def _run(self, layer: Layer, x: Planes) -> Planes:
        weight, bias = self.weights[f"{layer.name}.weight"], self.weights[f"{layer.name}.bias"]
        if layer.size == 1:
            y = x.reshape(-1, layer.into) @ weight
            y += bias
            y = y.reshape(*x.shape[:3], layer.out)
        else:
            y = _convolved(x, weight, bias, layer.stride)
        if layer.rectified:
            np.maximum(y, 0, out=y)
        if layer.residual:
            y += x
        return y

    def save(self, path: Path) -> None:
        """Write them, in half precision."""
        head_ = {"version": VERSION, "still": list(self.still), "movable": list(self.movable),
                 "calibration": list(self.calibration), "about": dict(self.about)}  # fmt: skip
        arrays = {name: array.astype(np.float16) for name, array in self.weights.items()}
        np.savez_compressed(path, head=np.array(json.dumps(head_)), **arrays)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path) -> EyesNetwork:
        """Read a file of weights.

        Raises:
            UserError: There is none, it is cut off or no such file, or its weights are of another version.
        """
        try:
            with np.load(path, allow_pickle=False) as kept:
                told = json.loads(str(kept["head"]))
                if told["version"] != VERSION:
                    raise UserError(
                        f"{path}: weights of version {told['version']!r:.20}; this mpvi_bt runs version {VERSION}."
                    )
                still, movable = (tuple(map(str, told[name])) for name in ("still", "movable"))
                all_layers = [*layers(len(still)), *crop_layers(), *dense_layers(len(movable))]
                weights = dict(_read(kept, all_layers, path))
                calibration = tuple(float(number) for number in told["calibration"])
                return cls(still, movable, weights, calibration, dict(told["about"]))
        except FileNotFoundError:
            raise UserError(f"{path}: there is no such file of weights.") from None
        except UserError:
            raise
        except Exception as error:  # whatever zipfile, zlib, numpy and JSON make of broken bytes
            raise UserError(f"{path}: no whole file of weights ({' '.join(str(error).split())[:120]}).") from error


def _read(kept: Mapping[str, NDArray[np.float16]], order: Iterable[Layer], path: Path) -> Iterable[tuple[str, Planes]]:
    for layer in order:
        for part, shape in (("weight", (layer.size**2 * layer.into, layer.out)), ("bias", (layer.out,))):
            name = f"{layer.name}.{part}"
            array = np.ascontiguousarray(kept[name], np.float32)
            if array.shape != shape or not np.isfinite(array).all():
                raise UserError(f"{path}: {name} is {array.shape}, not {shape} finite numbers.")
            yield name, array


def softmax(logits: Planes, axis: int = -1) -> Planes:
    """Probabilities along an axis."""
    out = np.exp(logits - logits.max(axis, keepdims=True))
    out /= out.sum(axis, keepdims=True)
    return np.asarray(out, np.float32)


def _convolved(x: Planes, weight: Planes, bias: Planes, stride: int) -> Planes:
    """(n, H / stride, W / stride, out) a 3 x 3 convolution of (n, H, W, into), zeros around; H and W are even."""
    n, h, w, into = x.shape
    kernel = weight.reshape(9, into, -1)
    padded = np.zeros((n, h + 2, w + 2, into), np.float32)
    padded[:, 1:-1, 1:-1] = x
    if stride == 2:
        columns = np.empty((n, h // 2, w // 2, 9, into), np.float32)
        for k in range(9):
            columns[..., k, :] = padded[:, k // 3 : k // 3 + h : 2, k % 3 : k % 3 + w : 2]
        y = columns.reshape(-1, 9 * into) @ weight
        y += bias
        return y.reshape(n, h // 2, w // 2, -1)
    # Rows of pixels in one line: each of the nine is the line, shifted. What runs over the edges is cut off.
    line = padded.reshape(-1, into)
    count = len(line) - 2 * (w + 2) - 2
    y = line[:count] @ kernel[0]
    more = np.empty_like(y)
    for k in range(1, 9):
        at = (k // 3) * (w + 2) + k % 3
        np.matmul(line[at : at + count], kernel[k], out=more)
        y += more
    y += bias
    out = np.empty((n * (h + 2) * (w + 2), y.shape[1]), np.float32)
    out[:count] = y
    return np.ascontiguousarray(out.reshape(n, h + 2, w + 2, -1)[:, :h, :w])
