"""Scores that mean what they say: of segments with a score of 0.8 four of five are right."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.eyes.eyes_network import EyesNetwork
from mpvi_bt.finding.eyes.picture_file import LabeledPicture
from mpvi_bt.finding.eyes.segment_overlaps import right_ones, without_labels
from mpvi_bt.finding.eyes.segmenter import EVIDENCE, LearnedSegmenter
from mpvi_bt.finding.eyes.tiles import disturbed
from mpvi_bt.ground.geometry.linear_algebra import least_squares
from mpvi_bt.ground.geometry.solids import Array

# All our choice.
_ROUNDS = 25
_HELD = 1.0  # how strongly weights are held near 0, as so many segments


def calibrated(network: EyesNetwork, pictures: Iterable[LabeledPicture], seed: int = 0) -> EyesNetwork:
    """The network with scores that fit pictures it was not trained on, by logistic regression (Platt 1999).

    Args:
        network: Any.
        pictures: At least some hundred; noise is added to them as in training.
        seed: Of the noise.
    """
    eyes, rng = LearnedSegmenter(network), np.random.default_rng(seed)
    numbers, right, movable = [], [], []
    for picture in pictures:
        h, w = picture.labels.shape
        seen = disturbed(picture, np.arange(h), np.arange(w), rng)
        found = eyes.evidence(without_labels(seen))
        numbers.append(found.numbers)
        right.append(right_ones(found.labels, found.kinds, seen))
        movable.append(found.movable)
    all_numbers, all_right, moves = np.concatenate(numbers), np.concatenate(right), np.concatenate(movable)
    both = [_fitted(all_numbers[part], all_right[part]) for part in (~moves, moves)]
    weights = tuple(float(number) for part in both for number in part)
    return EyesNetwork(network.still, network.movable, network.weights, weights, network.about)


def _fitted(numbers: Array, right: NDArray[np.bool_]) -> Array:
    """(EVIDENCE,) weights by which the odds follow from numbers (n, EVIDENCE), by Newton's method."""
    w = np.zeros(EVIDENCE)
    hold = np.sqrt(_HELD) * np.eye(EVIDENCE)
    for _ in range(_ROUNDS):
        odds = (numbers * w).sum(1)
        p = 1 / (1 + np.exp(-odds))
        root = np.sqrt(np.maximum(p * (1 - p), 1e-6))
        rows = np.concatenate([numbers * root[:, None], hold])
        wanted = np.concatenate([(right - p) / root, -np.sqrt(_HELD) * w])
        w = w + least_squares(rows, wanted)
    return w
