"""Signs of trees and marks of states that OpenCV's letters lack, drawn as lines in the cell of a letter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mpvi_bt.runs.recording.labels import Color, Picture

Stroke = tuple[tuple[float, float], ...]

_ROUND: Stroke = tuple((0.5 + 0.5 * float(np.cos(a)), 0.5 + 0.5 * float(np.sin(a))) for a in np.linspace(0, 6.2832, 17))
_ARROW: tuple[Stroke, ...] = (((0, 0.5), (1, 0.5)), ((0.6, 0.15), (1, 0.5), (0.6, 0.85)))
# In a square about the middle of a capital letter, x to the right and y down.
_SIGNS: Mapping[str, tuple[Stroke, ...]] = {
    "✓": (((0, 0.55), (0.35, 0.95), (1, 0.05)),),
    "✕": (((0.05, 0.05), (0.95, 0.95)), ((0.05, 0.95), (0.95, 0.05))),
    "○": (_ROUND,),
    "●": (_ROUND,),
    "⊘": (_ROUND, ((0.2, 0.8), (0.8, 0.2))),
    "◇": (((0.5, -0.1), (1.1, 0.5), (0.5, 1.1), (-0.1, 0.5), (0.5, -0.1)),),
    "→": _ARROW,
    "⇉": tuple(tuple((x, y / 2 + shift) for x, y in stroke) for shift in (0.0, 0.5) for stroke in _ARROW),
}
# In the whole cell, so that those of one column join.
_LINES: Mapping[str, tuple[Stroke, ...]] = {
    "│": (((0.5, 0), (0.5, 1)),),
    "├": (((0.5, 0), (0.5, 1)), ((0.5, 0.5), (1, 0.5))),
    "└": (((0.5, 0), (0.5, 0.5), (1, 0.5)),),
    "─": (((0, 0.5), (1, 0.5)),),
}
ICONS = frozenset([*_SIGNS, *_LINES])
_SIDE, _LIFT = 7.5, 4.5  # of the square, and its middle above the base line [px]
_FILLED = "●"


def draw_icon(
    frame: Picture, icon: str, at: tuple[float, float], cell: tuple[float, float], color: Color, scale: float
) -> None:
    """Draw one of `ICONS`.

    Args:
        frame: (H, W, 3) RGB, drawn on in place.
        icon: Which.
        at: Left end of its base line [px].
        cell: Width and height of a letter's cell [px].
        color: Of its lines.
        scale: Of the letters beside it.
    """
    import cv2

    middle = np.array([at[0] + cell[0] / 2, at[1] - _LIFT * scale])
    size = np.array(cell) if icon in _LINES else np.full(2, _SIDE * scale)
    for stroke in _LINES.get(icon) or _SIGNS[icon]:
        points = np.round((middle + (np.array(stroke) - 0.5) * size) * 16).astype(np.int32)  # in sixteenths of a pixel
        if icon in _FILLED:
            cv2.fillPoly(frame, [points], color, cv2.LINE_AA, 4)
        cv2.polylines(frame, [points], False, color, max(1, round(scale)), cv2.LINE_AA, 4)
