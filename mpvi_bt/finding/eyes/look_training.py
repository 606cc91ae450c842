"""Training of the networks from labeled pictures, with torch: what both have in common.

On a CPU with the instructions for it, convolutions are computed in bfloat16: three times as fast where there is AMX.
One thread, so that the same seed makes the same weights on one machine; a GPU adds up in no fixed order.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.finding.eyes.eyes_layers import CELL_PX, COVERS, Layer
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.torch_training import kept_training, seeded_torch, torch_for_training

# All our choice.
_LEAST_RATE = 0.01
_AVERAGED, _AVERAGED_STEPS = 0.99, 5  # of the weights, each time and how often
_TOLD_STEPS = 100


@dataclass
class EyesTraining:
    """How far the training of one network is.

    Attributes:
        folder: Of the pictures; there may be more of them with time.
        seed: Of all that is drawn.
        steps: Of the whole training; None: as many as are usual for the network.
        device: As torch names it, such as "cpu" or "cuda".
        curves: What was told: step, losses, seconds.
    """

    folder: Path
    seed: int = 0
    steps: int | None = None
    device: str = "cpu"
    curves: list[dict[str, Any]] = field(default_factory=list)


class Look(ABC):
    """A network in training: AdamW, a rate that warms up and falls as a cosine, and an average of the weights.

    Args:
        layers: Of the network.
        kinds: That it tells.
        job: Whose training this is.

    Attributes:
        kinds: As given.
        step, steps: How far it is, of how many.
        net: Torch's modules, by the names of layers with "_" for ".".
        average: Of its state.
    """

    usual_steps = 1000
    rate, decay = 2e-3, 1e-2
    warm_steps = 150

    def __init__(self, layers: Sequence[Layer], kinds: Sequence[str], job: EyesTraining) -> None:
        torch = self.torch = torch_for_training()
        self.kinds, self.device, self.step, self.steps = tuple(kinds), job.device, 0, job.steps or self.usual_steps
        self._layers, nn = tuple(layers), torch.nn
        parts: dict[str, Any] = {}
        for layer in layers:
            convolution = nn.Conv2d(
                layer.into, layer.out, layer.size, layer.stride, layer.size // 2, bias=not layer.rectified
            )
            normal = [nn.BatchNorm2d(layer.out), nn.ReLU(inplace=True)] if layer.rectified else []
            parts[_key(layer)] = nn.Sequential(convolution, *normal)
        self.net = nn.ModuleDict(parts).to(job.device, memory_format=torch.channels_last)
        self.prepare()
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=self.rate, weight_decay=self.decay, fused=True)
        self.average = {k: v.clone() for k, v in self.net.state_dict().items()}

    def prepare(self) -> None:  # noqa: B027  # most begin at random
        """Set what does not begin at random."""

    @abstractmethod
    def refresh(self) -> None:
        """Take in pictures that came meanwhile."""

    @abstractmethod
    def loss(self, rng: np.random.Generator) -> tuple[Any, dict[str, Any]]:
        """Of a drawn batch, and figures to tell."""

    def run(self, layer: Layer, x: Any) -> Any:
        """What a layer answers."""
        y = self.net[_key(layer)](x)
        return x + y if layer.residual else y

    def autocast(self) -> Any:
        """In which convolutions are computed in bfloat16."""
        return self.torch.autocast(self.torch.device(self.device).type, self.torch.bfloat16)

    def tensor(self, array: Any) -> Any:
        """An array of numpy on the device."""
        return self.torch.from_numpy(array).to(self.device)

    def learn(self, rng: np.random.Generator) -> dict[str, float]:
        """One step; figures to tell."""
        fall = 0.5 * (1 + math.cos(math.pi * self.step / self.steps)) * (1 - _LEAST_RATE) + _LEAST_RATE
        for group in self.optimizer.param_groups:
            group["lr"] = self.rate * min(1.0, (self.step + 1) / self.warm_steps) * fall
        loss, figures = self.loss(rng)
        self.optimizer.zero_grad()
        loss.backward()
        self.torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimizer.step()
        self.step += 1
        if self.step % _AVERAGED_STEPS == 0 or self.step == self.steps:
            keep = min(_AVERAGED, self.step / (self.step + 20))
            state = self.net.state_dict()
            mixed = [name for name, value in state.items() if value.dtype.is_floating_point]
            self.torch._foreach_lerp_([self.average[name] for name in mixed], [state[n] for n in mixed], 1 - keep)
        return {name: float(value) for name, value in figures.items()}

    def save(self) -> dict[str, Any]:
        """All of it."""
        return {"step": self.step, "net": self.net.state_dict(), "average": self.average,
                "optimizer": self.optimizer.state_dict()}  # fmt: skip

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        self.step = state["step"]
        self.average = {name: value.to(self.device) for name, value in state["average"].items()}
        self.net.load_state_dict(state["net"])
        self.optimizer.load_state_dict(state["optimizer"])

    def weights(self) -> dict[str, Array]:
        """The average as `EyesNetwork` has it, normalization folded in: (size * size * into, out) and (out,)."""
        out: dict[str, Array] = {}
        for layer in self._layers:
            kept = {name.removeprefix(f"{_key(layer)}."): value.float().cpu().numpy().astype(float)
                    for name, value in self.average.items() if name.startswith(f"{_key(layer)}.")}  # fmt: skip
            w = kept["0.weight"]
            if layer.rectified:
                scale = kept["1.weight"] / np.sqrt(kept["1.running_var"] + self.net[_key(layer)][1].eps)
                w, b = w * scale[:, None, None, None], kept["1.bias"] - kept["1.running_mean"] * scale
            else:
                b = kept["0.bias"]
            if layer.name == "covers":  # torch has all pixels of a cover together, we have all covers of a pixel
                order = np.arange(layer.out).reshape(len(COVERS), CELL_PX**2).T.ravel()
                w, b = w[order], b[order]
            out[f"{layer.name}.weight"] = np.ascontiguousarray(w.transpose(2, 3, 1, 0).reshape(-1, layer.out))
            out[f"{layer.name}.bias"] = b
        return out


def train_look(
    begin: Callable[[Sequence[str] | None], Look],
    job: EyesTraining,
    kept: Path,
    tell: Callable[[dict[str, Any]], None],
) -> Look:
    """Train a network to its end.

    Args:
        begin: Makes it, for kinds as they were kept, or for those in the pictures.
        job: What is trained.
        kept: File of how far it is, written now and then; where it is there, training goes on from it.
        tell: Is told of each row of `job.curves`.

    Raises:
        UserError: torch is not installed or has no such device, there are no pictures, or `kept` is of another
            training.
    """
    torch = seeded_torch(job.device, job.seed)
    state = kept_training(kept) if kept.exists() else None
    look = begin(None if state is None else state["kinds"])
    sizes = {"seed": job.seed, "steps": look.steps}
    if state is not None:
        if state["sizes"] != sizes:
            raise UserError(f"{kept}: is of another training, {state['sizes']}, not {sizes}; delete it to begin anew.")
        job.curves[:] = state["curves"]
        look.restore(state)
    began, sums = time.perf_counter(), dict[str, float]()
    rng = np.random.default_rng([job.seed, look.step])
    while look.step < look.steps:
        for name, value in look.learn(rng).items():
            sums[name] = sums.get(name, 0.0) + value
        if look.step % _TOLD_STEPS == 0 or look.step == look.steps:
            since = look.step % _TOLD_STEPS or _TOLD_STEPS
            row = {"step": look.step, "of": look.steps, **{k: round(v / since, 4) for k, v in sums.items()}}
            row["seconds"] = round(time.perf_counter() - began, 1)
            job.curves.append(row)
            tell(row)
            sums, rng = {}, np.random.default_rng([job.seed, look.step])  # so that what was stopped goes on alike
            look.refresh()
            part = kept.with_suffix(".part")
            torch.save({"sizes": sizes, "kinds": list(look.kinds), "curves": job.curves, **look.save()}, part)
            part.replace(kept)
    return look


def _key(layer: Layer) -> str:
    return layer.name.replace(".", "_")
