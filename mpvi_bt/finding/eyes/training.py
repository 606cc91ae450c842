"""Trains the network from labeled pictures, with torch.

On a CPU with the instructions for it, convolutions are computed in bfloat16: three times as fast where there is AMX.
One thread, so that the same seed makes the same weights on one machine; a GPU adds up in no fixed order.
"""

from __future__ import annotations

import math
import pickle
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.finding.eyes.layers import CELL_PX, COVERS, Layer, answers, head, laterals, layers, smoothing, stages
from mpvi_bt.finding.eyes.tiles import Tile, Tiles, still_kinds
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry.solids import Array

# All our choice.
STEPS = 5_000
_BATCH = 8
_RATE, _DECAY = 2.5e-3, 1e-2
_WARM_STEPS, _LEAST_RATE = 200, 0.01
_AVERAGED = 0.998  # of the weights, in each step
_COVERS, _NEAR, _WAY = 1.0, 1.0, 0.25  # how much these losses count beside that of kinds
_COVER_WEIGHTS = (0.7, 0.7, 2.0, 0.7)
_TOLD_STEPS = 100
_EPSILON = 1e-5  # of normalization


@dataclass
class EyesTraining:
    """How far the training is.

    Attributes:
        folder: Of the pictures.
        seed: Of all that is drawn.
        steps: Of the whole training.
        device: As torch names it, such as "cpu" or "cuda".
        curves: What was told: step, losses, seconds.
    """

    folder: Path
    seed: int = 0
    steps: int = STEPS
    device: str = "cpu"
    curves: list[dict[str, Any]] = field(default_factory=list)


def train_eyes(
    job: EyesTraining, kept: Path, tell: Callable[[dict[str, Any]], None], until_s: float = math.inf
) -> tuple[tuple[str, ...], dict[str, Array]]:
    """Train the network; its kinds and its weights, averaged, by layer.

    Args:
        job: What is trained.
        kept: File of how far it is, written now and then; where it is there, training goes on from it.
        tell: Is told of each row of `curves`.
        until_s: Wall time after which it stops where it is, as if that had been planned.

    Raises:
        UserError: torch is not installed or has no such device, there are no pictures, or `kept` is of another
            training.
    """
    torch = _torch()
    try:
        torch.empty(1, device=job.device)
    except (RuntimeError, AssertionError) as error:
        raise UserError(f"torch cannot use the device {job.device!r}: {str(error).splitlines()[0]}") from None
    torch.set_num_threads(1)
    torch.manual_seed(job.seed)
    began = time.perf_counter()
    state = _kept(torch, kept) if kept.exists() else None
    kinds = tuple(state["kinds"]) if state is not None else still_kinds(job.folder)
    tiles = Tiles(job.folder, kinds)
    trained = _Trained(torch, len(kinds), job)
    sizes = {"seed": job.seed, "steps": job.steps}
    if state is not None:
        if state["sizes"] != sizes:
            raise UserError(f"{kept}: is of another training, {state['sizes']}, not {sizes}; delete it to begin anew.")
        job.curves[:] = state["curves"]
        trained.restore(state)
    rng = np.random.default_rng([job.seed, trained.step])
    sums: dict[str, float] = {}
    while trained.step < job.steps and time.perf_counter() - began < until_s:
        for name, value in trained.learn(tiles.batch(_BATCH, rng)).items():
            sums[name] = sums.get(name, 0.0) + value
        if trained.step % _TOLD_STEPS == 0 or trained.step == job.steps:
            row = {"step": trained.step, "of": job.steps, **{k: round(v / _TOLD_STEPS, 4) for k, v in sums.items()}}
            row["seconds"] = round(time.perf_counter() - began, 1)
            job.curves.append(row)
            tell(row)
            sums = {}
            tiles = Tiles(job.folder, kinds)  # there may be more pictures by now
            rng = np.random.default_rng([job.seed, trained.step])  # so that a training that was stopped goes on alike
            part = kept.with_suffix(".part")
            torch.save({"sizes": sizes, "kinds": list(kinds), "curves": job.curves, **trained.save()}, part)
            part.replace(kept)
    return kinds, trained.weights()


def _torch() -> Any:
    try:
        import torch
    except ImportError as error:
        raise UserError(f"training needs torch: {install('train')}") from error
    return torch


def _kept(torch: Any, path: Path) -> dict[str, Any]:
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError) as error:
        why = str(error).splitlines()[0][:100]
        raise UserError(f"{path}: is no kept training ({why}); delete it to begin anew.") from None
    return state


class _Trained:
    """The network in training: AdamW, a rate that warms up and falls as a cosine, and an average of the weights."""

    def __init__(self, torch: Any, kinds: int, job: EyesTraining) -> None:
        self.torch, self.kinds, self.count, self.device, self.step = torch, kinds, job.steps, job.device, 0
        nn = torch.nn
        parts: dict[str, Any] = {}
        for layer in layers(kinds):
            convolution = nn.Conv2d(
                layer.into, layer.out, layer.size, layer.stride, layer.size // 2, bias=not layer.rectified
            )
            normal = [nn.BatchNorm2d(layer.out, eps=_EPSILON), nn.ReLU()] if layer.rectified else []
            parts[layer.name.replace(".", "_")] = nn.Sequential(convolution, *normal)
        self.net = nn.ModuleDict(parts).to(job.device, memory_format=torch.channels_last)
        nn.init.constant_(self.net["center"][0].bias[0], -3.0)  # few cells are centers
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=_RATE, weight_decay=_DECAY, fused=True)
        self.average = {k: v.clone() for k, v in self.net.state_dict().items()}
        self.cover_weights = torch.tensor(_COVER_WEIGHTS, device=job.device)

    def run(self, layer: Layer, x: Any) -> Any:
        y = self.net[layer.name.replace(".", "_")](x)
        return x + y if layer.residual else y

    def forward(self, x: Any) -> tuple[Any, Any, Any]:
        """Answers (n, kinds + 2, h, w), (n, covers, H, W) and (n, 3, h, w) to inputs (n, channels, H, W)."""
        functional = self.torch.nn.functional
        seen = []
        for stage in stages():
            for layer in stage:
                x = self.run(layer, x)
            seen.append(x)
        y = None
        for lateral, smooth, x in reversed(list(zip(laterals(), smoothing(), seen, strict=True))):
            side = self.run(lateral, x)
            y = self.run(smooth, side if y is None else side + functional.interpolate(y, scale_factor=2))
        y = self.run(head(), y)
        kinds, covers, center = (self.run(layer, y) for layer in answers(self.kinds))
        return kinds, functional.pixel_shuffle(covers, CELL_PX), center

    def learn(self, tile: Tile) -> dict[str, float]:
        """One step; the losses."""
        torch, functional = self.torch, self.torch.nn.functional
        fall = 0.5 * (1 + math.cos(math.pi * self.step / self.count)) * (1 - _LEAST_RATE) + _LEAST_RATE
        for group in self.optimizer.param_groups:
            group["lr"] = _RATE * min(1.0, (self.step + 1) / _WARM_STEPS) * fall
        told = {name: torch.from_numpy(getattr(tile, name)).to(self.device) for name in
                ("inputs", "kinds", "weight", "covers", "near", "way", "movable")}  # fmt: skip
        x = told["inputs"].permute(0, 3, 1, 2)
        with torch.autocast(torch.device(self.device).type, torch.bfloat16):
            kinds, covers, center = self.forward(x)
        of_kind = functional.cross_entropy(kinds.float(), told["kinds"], reduction="none")
        of_kind = (of_kind * told["weight"]).sum() / told["weight"].sum()
        of_cover = functional.cross_entropy(covers.float(), told["covers"], weight=self.cover_weights)
        center = center.float()
        # penalty-reduced focal loss (CenterNet, Zhou and others 2019)
        p = center[:, 0].sigmoid().clamp(1e-4, 1 - 1e-4)
        peak = (told["near"] == 1).float()
        of_near = -(peak * (1 - p) ** 2 * p.log() + (1 - peak) * (1 - told["near"]) ** 4 * p**2 * (1 - p).log()).sum()
        of_near = of_near / peak.sum().clamp(min=1)
        off = (center[:, 1:] - told["way"]).abs().sum(1)
        of_way = (off * told["movable"]).sum() / told["movable"].sum().clamp(min=1)
        loss = of_kind + _COVERS * of_cover + _NEAR * of_near + _WAY * of_way
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimizer.step()
        self.step += 1
        keep = min(_AVERAGED, self.step / (self.step + 20))
        for name, value in self.net.state_dict().items():
            if value.dtype.is_floating_point:
                self.average[name].mul_(keep).add_(value, alpha=1 - keep)
            else:
                self.average[name].copy_(value)
        with torch.no_grad():
            inside = told["movable"] > 0
            right = (kinds.argmax(1) == told["kinds"]) & inside
            share = float(right.sum()) / max(float(inside.sum()), 1.0)
        names = {"kinds": of_kind, "covers": of_cover, "near": of_near, "way": of_way}
        return {**{name: float(value.detach()) for name, value in names.items()}, "right": share}

    def save(self) -> dict[str, Any]:
        return {"step": self.step, "net": self.net.state_dict(), "average": self.average,
                "optimizer": self.optimizer.state_dict()}  # fmt: skip

    def restore(self, state: Mapping[str, Any]) -> None:
        self.step = state["step"]
        self.average = {name: value.to(self.device) for name, value in state["average"].items()}
        self.net.load_state_dict(state["net"])
        self.optimizer.load_state_dict(state["optimizer"])

    def weights(self) -> dict[str, Array]:
        """As `mpvi_bt.finding.eyes.network` has them, normalization folded in: (size * size * into, out) and (out,)."""
        return folded(self.average, layers(self.kinds))


def folded(state: Mapping[str, Any], order: Iterable[Layer]) -> dict[str, Array]:
    """Weights of torch's layers as `Network` has them."""
    out: dict[str, Array] = {}
    for layer in order:
        key = layer.name.replace(".", "_")
        w = state[f"{key}.0.weight"].float().cpu().numpy().astype(float)
        b = np.zeros(layer.out) if layer.rectified else state[f"{key}.0.bias"].float().cpu().numpy().astype(float)
        if layer.rectified:
            scale, shift, mean, var = (state[f"{key}.1.{name}"].float().cpu().numpy().astype(float) for name in
                                       ("weight", "bias", "running_mean", "running_var"))  # fmt: skip
            scale = scale / np.sqrt(var + _EPSILON)
            w, b = w * scale[:, None, None, None], shift - mean * scale
        if layer.name == "covers":  # from torch's order of shuffled pixels to ours: a pixel's covers together
            pixels = np.arange(layer.out).reshape(len(COVERS), CELL_PX**2).T.ravel()
            w, b = w[pixels], b[pixels]
        out[f"{layer.name}.weight"] = np.ascontiguousarray(w.transpose(2, 3, 1, 0).reshape(-1, layer.out))
        out[f"{layer.name}.bias"] = b
    return out
