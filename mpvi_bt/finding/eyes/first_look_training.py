"""Trains the first network, which tells what covers each pixel, furniture, and centers of movable things."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mpvi_bt.finding.eyes.eyes_layers import CELL_PX, COVERS, answers, head, laterals, layers, smoothing, stages
from mpvi_bt.finding.eyes.look_training import EyesTraining, Look
from mpvi_bt.finding.eyes.tiles import Tiles, still_kinds

# All our choice.
_BATCH = 8
_COVERS, _NEAR, _WAY = 1.0, 1.0, 0.25  # how much these losses count beside that of kinds
_COVER_WEIGHTS = (0.7, 0.7, 2.0, 0.7)
_PIXELS = 6  # of the 16 of each cell, drawn in each step, of which it is learned what covers them
_FEW = -3.0  # logit of a center at the start: few cells are one


class FirstLook(Look):
    """The first network in training.

    Args:
        kinds: What stays where it is; None: as in the pictures.
        job: Whose training this is.
    """

    usual_steps = 5_000
    rate, warm_steps = 2.5e-3, 200

    def __init__(self, kinds: Sequence[str] | None, job: EyesTraining) -> None:
        self._folder = job.folder
        kinds = still_kinds(job.folder) if kinds is None else kinds
        super().__init__(layers(len(kinds)), kinds, job)
        self._tiles: Tiles | None = None
        self._cover_weights = self.torch.tensor(_COVER_WEIGHTS, device=job.device)

    def prepare(self) -> None:
        """Begin with few centers."""
        self.torch.nn.init.constant_(self.net["center"][0].bias[0], _FEW)

    def refresh(self) -> None:
        """Take in pictures that came meanwhile."""
        self._tiles = Tiles(self._folder, self.kinds)

    def forward(self, x: Any) -> tuple[Any, Any, Any]:
        """Answers (n, kinds + 2, h, w), (n, covers * 16, h, w) and (n, 3, h, w) to inputs (n, channels, H, W)."""
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
        kinds, covers, center = (self.run(layer, y) for layer in answers(len(self.kinds)))
        return kinds, covers, center

    def loss(self, rng: np.random.Generator) -> tuple[Any, dict[str, Any]]:
        """Of a drawn batch, and figures to tell."""
        torch, functional = self.torch, self.torch.nn.functional
        if self._tiles is None:
            self.refresh()
        assert self._tiles is not None
        tile = self._tiles.batch(_BATCH, rng)
        with self.autocast():
            kinds, covers, center = self.forward(self.tensor(tile.inputs).permute(0, 3, 1, 2))
        wanted, weight = self.tensor(tile.kinds), self.tensor(tile.weight)
        of_kind = functional.cross_entropy(kinds.float(), wanted, reduction="none")
        of_kind = (of_kind * weight).sum() / weight.sum()
        n, _, h, w = covers.shape
        pixels = self.tensor(rng.permutation(CELL_PX**2)[:_PIXELS])
        covers = covers.view(n, len(COVERS), CELL_PX**2, h, w)[:, :, pixels].float()
        covered = self.tensor(tile.covers).view(n, h, CELL_PX, w, CELL_PX).permute(0, 2, 4, 1, 3)
        covered = covered.reshape(n, CELL_PX**2, h, w)[:, pixels]
        of_cover = functional.cross_entropy(covers, covered, weight=self._cover_weights)
        center, near, movable = center.float(), self.tensor(tile.near), self.tensor(tile.movable)
        # penalty-reduced focal loss (CenterNet, Zhou and others 2019)
        p = center[:, 0].sigmoid().clamp(1e-4, 1 - 1e-4)
        peak = (near == 1).float()
        of_near = -(peak * (1 - p) ** 2 * p.log() + (1 - peak) * (1 - near) ** 4 * p**2 * (1 - p).log()).sum()
        of_near = of_near / peak.sum().clamp(min=1)
        off = (center[:, 1:] - self.tensor(tile.way)).abs().sum(1)
        of_way = (off * movable).sum() / movable.sum().clamp(min=1)
        with torch.no_grad():
            right = ((kinds.argmax(1) == wanted) & (movable > 0)).sum() / movable.sum().clamp(min=1)
        figures = {"kinds": of_kind, "covers": of_cover, "near": of_near, "way": of_way, "right": right}
        loss = of_kind + _COVERS * of_cover + _NEAR * of_near + _WAY * of_way
        return loss, {name: value.detach() for name, value in figures.items()}
