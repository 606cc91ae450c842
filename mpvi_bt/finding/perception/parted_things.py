"""Segments that are pieces of one thing: a network parts what an arm or a handle is seen before."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage

# Our choice. Of 102 pairs of sure segments of one kind in pictures that were not trained on, all 22 that are no larger
# together are of one thing, and 76 of the 80 that are larger are of two.
_LARGER = 1.2  # pieces are together no larger than a thing of their kind by more than this [ratio]
_POINTS = 500  # a piece's size is measured by about so many of its points


def wholes(image: CameraImage, kinds: Mapping[int, str], sizes: Mapping[str, float]) -> dict[int, int]:
    """The label of each segment that is a piece of another one, to the label of that.

    Args:
        image: With labels.
        kinds: Of segments that are looked at, by label.
        sizes: How long things of a kind are at most [m]; of other kinds no two segments are taken for one thing.
    """
    of_kind: dict[str, list[int]] = {}
    for label, kind in kinds.items():
        if kind in sizes:
            of_kind.setdefault(kind, []).append(label)
    several = {kind: labels for kind, labels in of_kind.items() if len(labels) > 1}
    if not several:
        return {}
    assert image.labels is not None
    points, known = image.points_world(), image.depth > 0
    piece_of: dict[int, int] = {}
    for kind, labels in several.items():
        shown = {label: points[known & (image.labels == label)] for label in labels}
        groups: dict[int, list[Array]] = {}
        for label in sorted(labels, key=lambda label: -len(shown[label])):
            here = shown[label][:: max(1, len(shown[label]) // _POINTS)]
            if not len(here):
                continue
            whole = next((w for w, own in groups.items() if _long([*own, here]) < _LARGER * sizes[kind]), label)
            groups.setdefault(whole, []).append(here)
            if whole != label:
                piece_of[label] = whole
    return piece_of


def _long(pieces: Iterable[Array]) -> float:
    """About the largest distance between points (n, 3) of some pieces [m]."""
    points = np.concatenate(list(pieces))
    end = points[((points - points.mean(0)) ** 2).sum(1).argmax()]
    other = points[((points - end) ** 2).sum(1).argmax()]
    return float(np.sqrt(((points - other) ** 2).sum(1).max()))
