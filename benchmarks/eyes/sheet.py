"""A contact sheet: pictures with the segments that were seen in them, the worst ones last."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.eyes.picture_file import LabeledPicture
from mpvi_bt.finding.eyes.segment_overlaps import without_labels
from mpvi_bt.finding.perception.segments import Segmenter, Segments

_SIZE = (240, 180)  # of a tile [px]
_COLUMNS = 8
_LEAST = 0.3  # a segment of a lower score is drawn without a name
_MOST_NAMES = 5
_QUALITY = 72


def write_sheet(path: Path, eyes: Segmenter, pictures: Sequence[LabeledPicture]) -> None:
    """Draw pictures with their segments in colors, and names of the larger sure ones."""
    tiles = [_tile(picture, eyes.segment(without_labels(picture))) for picture in pictures]
    rows = [np.hstack(tiles[k : k + _COLUMNS]) for k in range(0, len(tiles) - _COLUMNS + 1, _COLUMNS)]
    cv2.imwrite(str(path), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])


def _tile(picture: LabeledPicture, segments: Segments) -> NDArray[np.uint8]:
    colors = np.random.default_rng(3).integers(40, 256, (len(segments.kinds) + 1, 3))
    shown = picture.rgb.astype(float)
    covered = segments.labels > 0
    shown[covered] = 0.45 * shown[covered] + 0.55 * colors[segments.labels[covered]]
    edge = np.zeros(covered.shape, bool)
    edge[:, 1:] |= segments.labels[:, 1:] != segments.labels[:, :-1]
    edge[1:] |= segments.labels[1:] != segments.labels[:-1]
    shown[edge] = 20
    h, w = covered.shape
    tile = np.asarray(cv2.resize(np.ascontiguousarray(shown.astype(np.uint8)), _SIZE))
    areas = np.bincount(segments.labels.ravel(), minlength=len(segments.kinds) + 1)[1:]
    named = [k for k in np.argsort(-areas).tolist() if segments.scores[k] >= _LEAST and segments.kinds[k] != "floor"]
    for k in named[:_MOST_NAMES]:
        rows, columns = np.nonzero(segments.labels == k + 1)
        at = (int(np.median(columns) * _SIZE[0] / w) - 22, int(np.median(rows) * _SIZE[1] / h))
        name = segments.kinds[k].split(".")[0].replace("__", " ").replace("_", " ")
        for color, thick in (((255, 255, 255), 3), ((0, 0, 0), 1)):
            cv2.putText(tile, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.34, color, thick, cv2.LINE_AA)
    return tile
