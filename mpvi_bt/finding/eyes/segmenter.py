"""The segmenter that was learned: colors, depth and the camera's pose in, segments with kinds and scores out."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
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
# For who asks for a kind, it is so many times as likely as in the pictures of the training. Our choice: of things asked
# for in held-out pictures more are found so, and of those that are not there 2 % (5 % of furniture) are seen.
EXPECTED_MOVABLE, EXPECTED_STILL = 30.0, 10.0
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
        return self._segments(self._looked(image), ())

    def evidence(self, image: CameraImage) -> Evidence:
        """What the picture shows, and what tells how sure that is."""
        return self._evidence(self._looked(image), ())

    def _segments(self, looked: _Looked, expected: Collection[str], outlines: Labels | None = None) -> Segments:
        """As `Segments.expecting` says."""
        sight = looked
        count = 0 if outlines is None else int(outlines.max(initial=0))
        if outlines is not None and count:
            told = np.concatenate([looked.told, self._told(looked, outlines, count)])
            things = np.where(outlines > 0, len(looked.told) + outlines, looked.things).astype(np.int32)
            sight = replace(looked, things=things, told=told)
        found = self._evidence(sight, expected)
        half = len(self._network.calibration) // 2
        weights = np.where(found.movable[:, None], self._network.calibration[half:], self._network.calibration[:half])
        odds = (weights * found.numbers).sum(1)
        if outlines is not None and count:  # of an outline that is given, only the kind can be wrong
            given = np.setdiff1d(found.labels[outlines > 0], 0) - 1
            given = given[found.movable[given]]
            odds[given] = found.numbers[given, 1]
        return _LearnedSegments(found.labels, found.kinds, 1 / (1 + np.exp(-odds)), self, looked)

    def _looked(self, image: CameraImage) -> _Looked:
        """What the networks tell of a picture."""
        depth = np.ascontiguousarray(np.where(np.isfinite(image.depth), image.depth, 0), np.float32)
        inputs = inputs_of(image.rgb, depth, image.K, image.T_world_camera)
        answers = self._network.look(inputs)
        covers = ndimage.uniform_filter(softmax(answers.covers, 0), (1, _SMOOTH_PX, _SMOOTH_PX), mode="nearest")
        things, count = movable_segments(covers.argmax(0) == MOVABLE, depth, answers.near, answers.way)
        looked = _Looked(image, inputs, depth, answers.kinds, covers, things, np.zeros(0, np.float32))
        return replace(looked, told=self._told(looked, things, count))

    def _told(self, looked: _Looked, things: Labels, count: int) -> Planes:
        """(count, kinds + 1) what the second look tells of outlines, counted from 1."""
        if not count:
            return np.zeros((0, len(self._network.movable) + 1), np.float32)
        image = looked.image
        return self._network.tell(crops_of(looked.inputs, looked.depth, things, count, image.K, image.T_world_camera))

    def _evidence(self, looked: _Looked, expected: Collection[str]) -> Evidence:
        things, told, more = self._movable(looked, expected)
        covers = looked.covers
        cover = covers.argmax(0)
        instead = covers.copy()
        instead[MOVABLE] = 0
        cover = np.where((cover == MOVABLE) & (things == 0), instead.argmax(0), cover)  # what the second look refused
        labels, kinds, numbers = self._still(looked, cover, expected)
        labels = np.where(things > 0, things + len(kinds), labels).astype(np.int32)
        movable = np.arange(len(kinds) + len(told)) >= len(kinds)
        return Evidence(labels, (*kinds, *told), movable, np.concatenate([numbers, more]))

    def _still(
        self, looked: _Looked, cover: NDArray[np.intp], expected: Collection[str]
    ) -> tuple[Labels, list[str], NDArray[np.float64]]:
        """Segments of furniture, floor and robot."""
        still, depth, covers = self._network.still, looked.depth, looked.covers
        robot = still.index(ROBOT) if ROBOT in still else -1
        shown = looked.kinds[..., 1:-1] + np.log(_prior(still, expected, EXPECTED_STILL))
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
        self, looked: _Looked, expected: Collection[str]
    ) -> tuple[Labels, list[str], NDArray[np.float64]]:  # fmt: skip
        """Segments of movable things, by a second look at each; what that takes for nothing is left out."""
        told = looked.told * np.append(_prior(self._network.movable, expected, EXPECTED_MOVABLE), np.float32(1))
        told /= told.sum(1, keepdims=True)
        best = told.argmax(1)
        known = best < len(self._network.movable)
        number = np.zeros(len(told) + 1, np.int32)
        number[1:][known] = np.arange(1, np.count_nonzero(known) + 1)
        things = number[looked.things]
        best, told = best[known], told[known]
        chance = np.concatenate([[0.0], told[np.arange(len(best)), best]])
        names = [self._network.movable[k] for k in best.tolist()]
        return things, names, _numbers(things, len(names), chance[things], looked.covers[MOVABLE])


@dataclass(frozen=True, eq=False)
class _Looked:
    """What the networks tell of a picture: `kinds` as of `Answers`, `covers` as chances, smoothed.

    `inputs` and `depth` are of the picture; `things` are the (H, W) outlines that the second look was at, and `told`
    (n, kinds + 1) its chances.
    """

    image: CameraImage
    inputs: Planes
    depth: NDArray[np.float32]
    kinds: Planes
    covers: Planes
    things: Labels
    told: Planes


@dataclass(frozen=True, eq=False)
class _LearnedSegments(Segments):
    """Segments that can be seen again by who expects something."""

    eyes: LearnedSegmenter
    looked: _Looked

    def expecting(self, kinds: Collection[str], outlines: Labels | None = None) -> Segments:
        """By Bayes' rule, these kinds that much likelier before; nothing but `outlines` is looked at again."""
        return self.eyes._segments(self.looked, kinds, outlines) if kinds or outlines is not None else self


def _prior(kinds: tuple[str, ...], expected: Collection[str], times: float) -> Planes:
    """(n,) how much more likely kinds are where some are expected."""
    return np.array([times if kind in expected else 1.0 for kind in kinds], np.float32)


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
