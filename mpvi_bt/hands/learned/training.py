"""Trains the networks of a learned policy from demonstrations, with torch.

The actor answers with waypoints (L1 to the demonstration's); the proposer's hypotheses compete, and the one that comes
nearest to the demonstrated stance learns from it, as does the likelihood of that one. One thread, so that the same seed
makes the same weights on one machine; a GPU adds up in no fixed order, so there it makes other weights.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.torch_training import kept_training, seeded_torch, torch_for_training
from mpvi_bt.hands.learned.batches import ACTOR_POINTS, PROPOSER_POINTS, Batches
from mpvi_bt.hands.learned.features import HYPOTHESIS_SIZE, SCALE, WAYPOINTS
from mpvi_bt.hands.learned.network import ACTOR, HYPOTHESES, POINT_WIDTHS, PROPOSER, Networks, NetworkSizes
from mpvi_bt.hands.learned.training_set import TrainingSet

# All our choice.
ACTOR_STEPS, PROPOSER_STEPS = 12_000, 3_000
_ACTOR_BATCH, _PROPOSER_BATCH = 256, 192
_ACTOR_RATE, _PROPOSER_RATE = 1e-3, 1.5e-3
_ACTOR_DECAY, _PROPOSER_DECAY = 1e-3, 1e-2
_WARM_STEPS, _LEAST_RATE = 200, 0.02
_DROPOUT = 0.1  # of the proposer
_AVERAGED = 0.998  # of the actor's weights, in each step
_STATISTICS = 4096  # samples that means and deviations are taken from
_LEAST_DEVIATION = 0.02
_HAND = slice(14, 17)  # of a hypothesis, the hand's position
_HAND_M = 0.05
# How much parts of a hypothesis count: base, torso, arm, hand's position, its axes.
_COUNTS = np.repeat([1.0, 0.7, 0.5, 1.5, 1.0], [3, 4, 7, 3, 6])
_SHARED, _SHARED_UNTIL = 0.3, 0.4  # at the start all hypotheses learn a little, so that none is left behind
_LIKELY = 0.3  # how much the likelihoods count
_HELD_BACK = 20  # one episode of so many is not trained on
_TOLD_STEPS, _CHECK = 250, 1024


@dataclass
class Training:
    """How far the training of one skill is.

    Attributes:
        device: As torch names it, such as "cpu" or "cuda".
        curves: What was told: step, network, losses.
    """

    frames: TrainingSet
    seed: int
    actor_steps: int = ACTOR_STEPS
    proposer_steps: int = PROPOSER_STEPS
    device: str = "cpu"
    curves: list[dict[str, Any]] = field(default_factory=list)


def train(job: Training, kept: Path, tell: Callable[[dict[str, Any]], None]) -> Networks:
    """Train both networks of a skill.

    Args:
        job: Of the skill.
        kept: File of how far it is, written now and then; where it is there, training goes on from it.
        tell: Is told of each row of `curves`.

    Raises:
        UserError: torch is not installed or has no such device, or `kept` is of another training.
    """
    torch = seeded_torch(job.device, job.seed)
    episodes = np.random.default_rng(job.seed).permutation(np.unique(job.frames.episode))
    apart = max(len(episodes) // _HELD_BACK, 1)
    batches, check = Batches(job.frames, episodes[apart:]), Batches(job.frames, episodes[:apart])
    actor, proposer = _Actor(batches, check, job), _Proposer(batches, check, job)
    sizes = {"seed": job.seed, "frames": len(job.frames.look), "steps": [job.actor_steps, job.proposer_steps]}
    if kept.exists():
        state = kept_training(kept)
        if state["sizes"] != sizes:
            raise UserError(f"{kept}: is of another training, {state['sizes']}, not {sizes}; delete it to begin anew.")
        job.curves[:] = state["curves"]
        torch.set_rng_state(state["random"])
        actor.restore(state["actor"])
        proposer.restore(state["proposer"])
    for trained in (proposer, actor):
        for row in trained.steps():
            job.curves.append(row)
            tell(row)
            state = {"sizes": sizes, "curves": job.curves, "random": torch.get_rng_state()}
            torch.save({**state, "actor": actor.save(), "proposer": proposer.save()}, kept)
    return Networks({**_named("actor", actor), **_named("proposer", proposer)})


def _network(shape: NetworkSizes, dropout: float) -> Any:
    """As `mpvi_bt.hands.learned.network` runs it."""
    nn = torch_for_training().nn

    def points() -> Any:
        return nn.Sequential(nn.Linear(shape.point, POINT_WIDTHS[0]), nn.ReLU(), nn.Linear(*POINT_WIDTHS))

    layers: list[Any] = []
    size = 2 * POINT_WIDTHS[-1] + shape.told
    for width in shape.widths:
        layers += [nn.Linear(size, width), nn.LayerNorm(width), nn.GELU(), nn.Dropout(dropout)]
        size = width
    trunk = nn.Sequential(*layers, nn.Linear(size, shape.out))
    return nn.ModuleDict({"target": points(), "context": points(), "trunk": trunk})


class _Trained:
    """A network in training: Adam, a rate that warms up and falls as a cosine."""

    name: str
    shape: NetworkSizes
    dropout = 0.0
    rate: float
    decay: float
    targets: int
    averaged = 0.0

    def __init__(self, batches: Batches, check: Batches, job: Training, count: int) -> None:
        self.torch = torch_for_training()
        self.batches, self.check, self.count, self.step = batches, check, count, 0
        self.rng = np.random.default_rng([job.seed, *self.name.encode()])
        self.device = job.device
        self.net = _network(self.shape, self.dropout).to(job.device)
        self.optimizer = self.torch.optim.AdamW(
            self.net.parameters(), lr=self.rate, weight_decay=self.decay, fused=True
        )
        self.mean, self.std = self.statistics()
        self.average = {k: v.clone() for k, v in self.net.state_dict().items()}

    def statistics(self) -> tuple[Array, Array]:
        raise NotImplementedError

    def losses(self, batches: Batches, rng: np.random.Generator, train: bool) -> tuple[Any, dict[str, float]]:
        """The loss, and figures to tell."""
        raise NotImplementedError

    def tensor(self, array: Array) -> Any:
        return self.torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(self.device)

    def answer(self, points: Array, told: Array) -> Any:
        """(n, out) of points (n, m, p) and all else (n, t), standardized already."""
        target, context = (
            self.net[name](self.tensor(p)).max(1).values
            for name, p in (("target", points[:, : self.targets]), ("context", points[:, self.targets :]))
        )
        return self.net["trunk"](self.torch.cat([target, context, self.tensor(told)], 1))

    def steps(self) -> Iterator[dict[str, Any]]:
        """Train to the end; rows of what came of it now and then."""
        began = time.perf_counter()
        while self.step < self.count:
            fall = 0.5 * (1 + math.cos(math.pi * self.step / self.count)) * (1 - _LEAST_RATE) + _LEAST_RATE
            for group in self.optimizer.param_groups:
                group["lr"] = self.rate * min(1.0, self.step / _WARM_STEPS) * fall
            loss, _ = self.losses(self.batches, self.rng, train=True)
            self.optimizer.zero_grad()
            loss.backward()
            self.torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
            self.optimizer.step()
            self.step += 1
            self._average()
            if self.step % _TOLD_STEPS == 0 or self.step == self.count:
                spent = round(time.perf_counter() - began, 1)
                yield {"network": self.name, "step": self.step, "of": self.count, "train": round(loss.item(), 4),
                       **self.checked(), "seconds": spent}  # fmt: skip

    def checked(self) -> dict[str, float]:
        """Figures on episodes that were not trained on."""
        now = {k: v.clone() for k, v in self.net.state_dict().items()}
        self.net.load_state_dict(self.average)
        self.net.eval()
        with self.torch.no_grad():
            loss, more = self.losses(self.check, np.random.default_rng(0), train=False)
        self.net.train()
        self.net.load_state_dict(now)
        return {"check": round(float(loss), 4), **{k: round(v, 4) for k, v in more.items()}}

    def save(self) -> dict[str, Any]:
        return {"step": self.step, "net": self.net.state_dict(), "average": self.average,
                "optimizer": self.optimizer.state_dict(), "rng": self.rng.bit_generator.state}  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        self.step = state["step"]
        self.average = {name: value.to(self.device) for name, value in state["average"].items()}
        self.net.load_state_dict(state["net"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.rng.bit_generator.state = state["rng"]

    def _average(self) -> None:
        keep = min(self.averaged, self.step / (self.step + 50))
        for name, value in self.net.state_dict().items():
            self.average[name].mul_(keep).add_(value, alpha=1 - keep)


class _Actor(_Trained):
    name, shape, rate, decay, targets, averaged = "actor", ACTOR, _ACTOR_RATE, _ACTOR_DECAY, ACTOR_POINTS, _AVERAGED

    def __init__(self, batches: Batches, check: Batches, job: Training) -> None:
        super().__init__(batches, check, job, job.actor_steps)
        self.scale = self.tensor(np.tile(SCALE, WAYPOINTS))

    def statistics(self) -> tuple[Array, Array]:
        told = self.batches.actor(_STATISTICS, self.rng, disturbed=True).told
        return told.mean(0), np.maximum(told.std(0), _LEAST_DEVIATION)

    def losses(self, batches: Batches, rng: np.random.Generator, train: bool) -> tuple[Any, dict[str, float]]:
        batch = batches.actor(_ACTOR_BATCH if train else _CHECK, rng, disturbed=train)
        out = self.answer(batch.points, np.clip((batch.told - self.mean) / self.std, -6, 6))
        off = (out[:, :-1] - self.tensor(batch.wanted) / self.scale).abs()
        progress = (self.torch.sigmoid(out[:, -1]) - self.tensor(batch.progress)).abs().mean()
        loss = (off.mean(1) * self.tensor(batch.weight)).mean() + 0.1 * progress
        if train:
            return loss, {}
        third = (off * self.scale).view(len(off), WAYPOINTS, -1)[:, 2, 14:17].norm(dim=1)
        near = self.tensor(batch.weight) > 1
        return loss, {"hand_mm_near": 1000 * float(third[near].mean()), "progress_off": float(progress)}


class _Proposer(_Trained):
    name, shape, rate, decay, targets = "proposer", PROPOSER, _PROPOSER_RATE, _PROPOSER_DECAY, PROPOSER_POINTS
    dropout = _DROPOUT

    def __init__(self, batches: Batches, check: Batches, job: Training) -> None:
        super().__init__(batches, check, job, job.proposer_steps)
        self.counts = self.tensor(_COUNTS)

    def statistics(self) -> tuple[Array, Array]:
        y = self.batches.proposer(_STATISTICS, self.rng, disturbed=False)[2]
        std = np.maximum(y.std(0), _LEAST_DEVIATION)
        std[_HAND] = _HAND_M
        return y.mean(0), std

    def losses(self, batches: Batches, rng: np.random.Generator, train: bool) -> tuple[Any, dict[str, float]]:
        points, told, wanted = batches.proposer(_PROPOSER_BATCH if train else _CHECK, rng, disturbed=train)
        out = self.answer(points, told).view(-1, HYPOTHESES, HYPOTHESIS_SIZE + 1)
        off = out[..., :-1] - self.tensor((wanted - self.mean) / self.std)[:, None]
        distance = (off.abs() * self.counts).mean(-1)
        best = distance.argmin(1)
        shared = _SHARED * max(0.0, _SHARED_UNTIL - self.step / self.count) if train else 0.0
        loss = distance.gather(1, best[:, None]).mean() + shared * distance.mean()
        loss = loss + _LIKELY * self.torch.nn.functional.cross_entropy(out[..., -1], best)
        if train:
            return loss, {}
        likeliest = off[self.torch.arange(len(off), device=self.device), out[..., -1].argmax(1), _HAND] * _HAND_M
        return loss, {"hand_mm": 1000 * float(likeliest.norm(dim=1).median())}


def _named(network: str, trained: _Trained) -> dict[str, Array]:
    """Weights as `Networks` has them: what goes in along rows."""
    out = {f"{network}.mean": trained.mean, f"{network}.std": trained.std}
    for name, value in trained.average.items():
        array = value.cpu().numpy().astype(float)
        out[f"{network}.{name}"] = np.ascontiguousarray(array.T if array.ndim == 2 else array)
    return out
