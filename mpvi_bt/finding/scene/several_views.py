"""One shape from several views of a thing.

Shapes are fitted to the points of pictures from one standing place: between two places lies a drive, and odometry that
drifts on the way would smear them. Older views help only where something now hides a part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mpvi_bt.finding.scene.frames import SEEN_PX, Frame
from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.outlines import main_cluster
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.percentiles import percentile
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class Agreement:
    """When views agree.

    Our choice: a fit to depth pictures is off by less than a centimeter at 1 m.
    """

    drifted_m: float = 0.006  # views may differ by less without an error of the odometry [m]
    alone_px: int = 150  # a wrist's mask of this many pixels is believed against all others


_AGREEMENT = Agreement()

View = tuple[Frame, NDArray[np.bool_]]  # a picture, and the mask of the thing in it


def fitted(views: Sequence[View], support_m: float) -> Shape | None:
    """Fit one shape to several views of a thing. A near view by a wrist camera corrects the position.

    Args:
        views: Not empty, the newest last.
        support_m: Height of what it stands on, for views that do not show it.

    Returns:
        The shape, or None if there is too little to see.
    """
    views = [(f, m) for f, m in views if len(f.of(m)) >= SEEN_PX]  # what turned out to be in hand is no view of it
    if not views:
        return None
    newest = views[-1][0].stand
    whole = [(f, m) for f, m in views if not f.cut(m)]
    whole = whole if any(f.stand == newest or f.image.camera == "head" for f, _ in whole) else list(views)
    head = [(f, m) for f, m in whole if f.image.camera == "head"]
    wrist = [(f, m) for f, m in whole if f.image.camera != "head" and f.stand == newest][-1:]
    parts = [main_cluster(f.of(m)) for f, m in head]
    fresh = [p for p, (f, _) in zip(parts, head, strict=True) if f.stand == newest]
    if fresh and len(fresh) < len(parts):  # what the odometry has done to older views is undone
        shift = _shift(np.concatenate(parts[: -len(fresh)]), np.concatenate(fresh))
        if shift is not None and norm(shift) > _AGREEMENT.drifted_m:
            parts = [*(p + shift for p in parts[: -len(fresh)]), *fresh]
    support, around = None if head else support_m, _around(head or wrist)
    if wrist:
        near = main_cluster(wrist[0][0].of(wrist[0][1]))
        shift = _shift(np.concatenate(parts), near) if head and len(near) >= SEEN_PX else np.zeros(3)
        before = fit(np.concatenate(parts), around, head[-1][0].eye) if head else None
        if before is not None:
            support = before.support_m + (shift[2] if shift is not None else 0.0)
        if shift is not None:
            parts = [*(p + shift for p in parts), near]
        elif len(near) >= _AGREEMENT.alone_px and not wrist[0][0].cut(wrist[0][1]):
            parts = [near]  # it was bumped since the head saw it
    eye = head[-1][0].eye if head else wrist[0][0].eye
    return fit(np.concatenate(parts), around, eye, support)


def _around(views: Sequence[View]) -> Array:
    return np.concatenate([f.points[f.measured & ~m] for f, m in views])


def _shift(points: Array, onto: Array) -> Array | None:
    """The translation (3,) that brings points (n, 3) onto others of the same thing; None if it is none of a few cm."""
    tree, total = cKDTree(onto), np.zeros(3)
    sample = points[:: max(1, len(points) // 300)]
    for _ in range(8):
        gap, nearest = tree.query(sample + total)
        close = gap <= percentile(gap, 60)  # the wrist does not see all that the head sees
        step = np.median(onto[nearest[close]] - (sample + total)[close], axis=0)
        total += step
        if norm(step) < 2e-4:
            break
    return total if norm(total) < 0.04 else None
