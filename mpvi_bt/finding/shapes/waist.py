"""Flat things that are narrow somewhere, such as a racket, a hammer or a ladle: boxes end to end instead of one."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from mpvi_bt.finding.shapes.outlines import Outline, outline
from mpvi_bt.finding.shapes.shape import Shape, upright_box
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array, Solid

# Our choice throughout: what is told apart is what matters to a hand that takes 8.6 cm.
_SLICE_M = 0.015
_NARROW_M, _NARROW = 0.075, 0.6  # a part is narrow that is no wider than this, and than this share of the whole,
_LONG_M = 0.045  # over such a length: a hand's fingers are 2 cm wide
_ENOUGH = 4  # points of a slice


def waisted(xy: Array, seen: Outline, support: float, top: float) -> Shape:
    """The box of an outline between two heights, or the boxes of its wide and its narrow parts.

    Only its long way is looked along. A slice that shows too little counts as wide.

    Args:
        xy: (n, 2) its points seen from above [m].
        seen: Their outline.
        support, top: Heights [m].

    Returns:
        A shape in the frame of the whole outline; its largest solid is the first.
    """
    whole = upright_box(seen, support, top)
    long, short = seen.sides
    if short < _NARROW_M:
        return whole
    local = seen.local(xy)
    count = max(1, int(long / _SLICE_M))
    at = np.clip(((local[:, 0] / long + 0.5) * count).astype(int), 0, count - 1)
    most = min(_NARROW_M, _NARROW * float(short))
    slices = [local[at == k, 1] for k in range(count)]
    slim = [len(y) >= _ENOUGH and float(np.ptp(percentile(y, [2, 98]))) < most for y in slices]
    narrow = [all(slim[max(k - 1, 0) : k + 2]) for k in range(count)]  # beside what is wide a slice has a little of it
    runs = [(is_narrow, [k for k, _ in run]) for is_narrow, run in groupby(enumerate(narrow), lambda n: n[1])]
    if not any(is_narrow and len(run) * long / count >= _LONG_M for is_narrow, run in runs):
        return whole
    solids: list[Solid] = []
    for _, run in runs:
        part = xy[np.isin(at, run)]
        if len(part) >= _ENOUGH:
            solids += upright_box(outline(part), support, top).solids
    solids.sort(key=lambda solid: -float(np.prod(solid.half_m)))
    return Shape("box", whole.T, tuple(solids), support)
