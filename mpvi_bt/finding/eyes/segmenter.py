"""The segmenter that was learned: colors, depth and the camera's pose in, segments with kinds and scores out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.eyes.crops import crops_of
from mpvi_bt.finding.eyes.eyes_layers import CELL_PX, COVERS
from mpvi_bt.finding.eyes.eyes_network import EyesNetwork, softmax
from mpvi_bt.finding.eyes.grouping import MOVABLE, Labels, movable_segments, sharpened, still_segments
from mpvi_bt.finding.eyes.inputs import Planes, inputs_of
from mpvi_bt.finding.perception.detector import ROBOT
from mpvi_bt.finding.perception.segments import FLOOR, Segments
from mpvi_bt.ground.robot.protocol import CameraImage

SHIPPED = Path(__file__).with_name("weights.npz")
_STILL, _ROBOT = COVERS.index("furniture"), COVERS.index("robot")
_LEAST = 1e-4  # probabilities are kept so far from 0 and 1 where their odds are taken
_USUAL_PX = 300.0
_SMOOTH_CELLS = 5  # our choice: kinds of furniture are told by so many cells both ways
_SMOOTH_PX = 3  # and what covers a pixel by so many pixels
EVIDENCE = 4  # numbers of a segment that its score is made of


@dataclass(frozen=True, eq=False)
class Evidence:
    """Segments before their scores.

    Attributes:
        labels: As of `Segments`.
        kinds: As of `Segments`.
        movable: (N,) whether a segment is a movable thing.
        numbers: (N, EVIDENCE): 1, the odds of its kind, how surely it is covered so, its area, as logarithms.
    """

    labels: Labels
    kinds: tuple[str, ...]
    movable: NDArray[np.bool_]
    numbers: NDArray[np.float64]


class LearnedSegmenter:
    """`Segmenter` by the two networks.

    Attributes:
        kinds: All that it knows.
    """

    def __init__(self, network: EyesNetwork) -> None:
        self._network = network
        self.kinds = (*network.still, *network.movable)
        self._whole = np.array([k for k, kind in enumerate(network.still, 1) if kind in (FLOOR, ROBOT)], np.int32)

    @classmethod
    def load(cls, path: Path = SHIPPED) -> LearnedSegmenter:
        """By a file of weights; by default those that ship.

        Raises:
            UserError: It cannot be read.
        """
        return cls(_network(path, path.stat().st_mtime_ns if path.exists() else 0))

    def segment(self, image: CameraImage) -> Segments:
        """As `Segmenter` says."""
        found = self.evidence(image)
        half = len(self._network.calibration) // 2
        weights = np.where(found.movable[:, None], self._network.calibration[half:], self._network.calibration[:half])
        return Segments(found.labels, found.kinds, 1 / (1 + np.exp(-(weights * found.numbers).sum(1))))

    def evidence(self, image: CameraImage) -> Evidence:
        """What the picture shows, and what tells how sure that is."""
        depth = np.ascontiguousarray(np.where(np.isfinite(image.depth), image.depth, 0), np.float32)
        inputs = inputs_of(image.rgb, depth, image.K, image.T_world_camera)
        answers = self._network.look(inputs)
        covers = ndimage.uniform_filter(softmax(answers.covers, 0), (1, _SMOOTH_PX, _SMOOTH_PX), mode="nearest")
        cover = covers.argmax(0)
        things, told, more = self._movable(inputs, depth, covers, cover, answers.near, answers.way, image)
        instead = covers.copy()
        instead[MOVABLE] = 0
        cover = np.where((cover == MOVABLE) & (things == 0), instead.argmax(0), cover)  # what the second look refused
        labels, kinds, numbers = self._still(answers.kinds, covers, cover, depth)
        labels = np.where(things > 0, things + len(kinds), labels).astype(np.int32)
        movable = np.arange(len(kinds) + len(told)) >= len(kinds)
        return Evidence(labels, (*kinds, *told), movable, np.concatenate([numbers, more]))

    def _still(
        self, logits: Planes, covers: Planes, cover: NDArray[np.intp], depth: NDArray[np.float32]
    ) -> tuple[Labels, list[str], NDArray[np.float64]]:
        """Segments of furniture, floor and robot."""
        still = self._network.still
        robot = still.index(ROBOT) if ROBOT in still else -1
        shown = logits[..., 1:-1].copy()
        if robot >= 0:
            shown[..., robot] = -np.inf  # its pixels are told by what covers them
        chances = _smoothed(softmax(shown), cover == _STILL)
        cells = chances.argmax(-1) + 1
        kinds = sharpened(cells.astype(np.int32), cover == _STILL, depth)
        if robot >= 0:
            kinds[cover == _ROBOT] = robot + 1
        labels, found = still_segments(kinds, depth, self._whole)
        names = [still[k - 1] for k in found.tolist()]
        chance = chances.max(-1).repeat(CELL_PX, 0).repeat(CELL_PX, 1)[: depth.shape[0], : depth.shape[1]]
        if robot >= 0:
            chance = np.where(cover == _ROBOT, covers[_ROBOT], chance)
        surely = covers[_STILL] + covers[_ROBOT]
        return labels, names, _numbers(labels, len(names), chance, surely)

    def _movable(
        self, inputs: Planes, depth: NDArray[np.float32], covers: Planes, cover: NDArray[np.intp], near: Planes,
        way: Planes, image: CameraImage,
    ) -> tuple[Labels, list[str], NDArray[np.float64]]:  # fmt: skip
        """Segments of movable things, by a second look at each; what that takes for nothing is left out."""
        things, count = movable_segments(cover == MOVABLE, depth, near, way)
        if not count:
            return things, [], np.zeros((0, EVIDENCE))
        told = self._network.tell(crops_of(inputs, depth, things, count, image.K, image.T_world_camera))
        best = told.argmax(1)
        known = best < len(self._network.movable)
        number = np.zeros(count + 1, np.int32)
        number[1:][known] = np.arange(1, np.count_nonzero(known) + 1)
        things = number[things]
        best, told = best[known], told[known]
        chance = np.concatenate([[0.0], told[np.arange(len(best)), best]])
        names = [self._network.movable[k] for k in best.tolist()]
        return things, names, _numbers(things, len(names), chance[things], covers[MOVABLE])


def _smoothed(chances: Planes, there: NDArray[np.bool_]) -> Planes:
    """(h, w, kinds) means over the cells around, each counted by how much of it is there (H, W)."""
    h, w = chances.shape[:2]
    padded = np.zeros((h * CELL_PX, w * CELL_PX), np.float32)
    padded[: there.shape[0], : there.shape[1]] = there
    share = padded.reshape(h, CELL_PX, w, CELL_PX).mean((1, 3)) + np.float32(1e-3)
    size = (_SMOOTH_CELLS, _SMOOTH_CELLS)
    sums = ndimage.uniform_filter(chances * share[..., None], (*size, 1), mode="nearest")
    return np.asarray(sums / ndimage.uniform_filter(share, size, mode="nearest")[..., None], np.float32)


def _numbers(labels: Labels, count: int, chance: NDArray[np.floating], surely: Planes) -> NDArray[np.float64]:
    """(count, EVIDENCE) of segments, by how likely each pixel is of its kind and covered so."""
    flat = labels.ravel()
    area = np.bincount(flat, minlength=count + 1)[1 : count + 1].astype(float)
    means = [np.bincount(flat, weights=v.ravel(), minlength=count + 1)[1 : count + 1] / np.maximum(area, 1)
             for v in (chance, surely)]  # fmt: skip
    odds = [np.log(p / (1 - p)) for p in (np.clip(mean, _LEAST, 1 - _LEAST) for mean in means)]
    return np.stack([np.ones(count), *odds, np.log(np.maximum(area, 1) / _USUAL_PX)], 1)


@cache
def _network(path: Path, changed: int) -> EyesNetwork:
    """Weights as they were last changed."""
    return EyesNetwork.load(path)
