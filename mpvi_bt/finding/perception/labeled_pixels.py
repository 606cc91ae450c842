"""Things by the label image of a picture: which of its pixels are whose."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.perception.detector import ROBOT
from mpvi_bt.ground.geometry.solids import Array

_TABLE = 1 << 20  # label ids below this are looked up in a table


@dataclass(frozen=True, eq=False)
class LabeledPixels:
    """A thing in a picture.

    Attributes:
        label: What it is.
        box: (4,) left, top, right, bottom [px], the last ones exclusive.
        mask: (bottom - top, right - left) bool, within it.
        score: How surely it is detected, 0 to 1.
    """

    label: str
    box: NDArray[np.intp]
    mask: NDArray[np.bool_]
    score: float = 1.0

    def spread(self, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """(H, W) bool: the mask of the whole picture."""
        mask = np.zeros(shape, bool)
        left, top, right, bottom = self.box
        mask[top:bottom, left:right] = self.mask
        return mask

    def stretched(self, edges: Array, shape: tuple[int, ...]) -> LabeledPixels | None:
        """With its box's edges moved by (4,) [px], as far as it is in the picture; None if nothing of it is."""
        left, top, right, bottom = np.rint(self.box + edges).astype(int).tolist()
        right, bottom = max(right, left + 1), max(bottom, top + 1)
        height, width = self.mask.shape
        rows = (np.arange(max(top, 0), min(bottom, shape[0])) - top) * height // (bottom - top)
        columns = (np.arange(max(left, 0), min(right, shape[1])) - left) * width // (right - left)
        mask = self.mask[np.ix_(rows, columns)]
        (inside,) = ndimage.find_objects(mask.astype(np.uint8), 1)
        if inside is None:
            return None
        tall, wide = inside
        corner = np.array([max(left, 0), max(top, 0)] * 2)
        box = corner + [wide.start, tall.start, wide.stop, tall.stop]
        return replace(self, box=box, mask=mask[tall, wide])


def visible(
    labels: NDArray[np.int32], names: Mapping[int, str], wanted: Set[str], least_px: int
) -> list[LabeledPixels]:
    """Each of the wanted things that enough of is seen, in the order of their names.

    Args:
        labels: (H, W) ids.
        names: Id to name.
        wanted: Names.
        least_px: A thing of fewer pixels is left out, but for the robot's own parts.
    """
    known = sorted(wanted & set(names.values()))
    index = {name: k + 1 for k, name in enumerate(known)}
    last = int(labels.max(initial=0))
    if last < _TABLE and labels.min(initial=0) >= 0:
        table = np.zeros(last + 1, np.uint8 if len(known) < 256 else np.int32)
        for id_, name in names.items():
            if 0 <= id_ <= last and name in index:
                table[id_] = index[name]
        shown = np.take(table, labels)
    else:  # ids that come from elsewhere may be any numbers
        ids, places = np.unique(labels, return_inverse=True)
        table = np.array([index.get(names.get(id_, ""), 0) for id_ in ids.tolist()], np.int32)
        shown = table[places].reshape(labels.shape)
    lit = shown > 0
    if not lit.any():
        return []
    tall, wide = (np.flatnonzero(lit.any(axis)) for axis in (1, 0))
    top, left = int(tall[0]), int(wide[0])  # in most pictures it is little that counts
    shown = shown[top : tall[-1] + 1, left : wide[-1] + 1]
    corner, found = np.array([left, top] * 2), []
    for k, box in enumerate(ndimage.find_objects(shown, len(known)), start=1):
        if box is None:
            continue
        (rows, columns), mask = box, shown[box] == k
        if np.count_nonzero(mask) >= (1 if known[k - 1] == ROBOT else least_px):
            edges = [columns.start, rows.start, columns.stop, rows.stop]
            found.append(LabeledPixels(known[k - 1], corner + edges, mask))
    return found
