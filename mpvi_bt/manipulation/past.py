"""What pictures showed under earlier prompts: walls and furniture that are out of view now stand there still."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np
from scipy import ndimage

from mpvi_bt.manipulation.frames import Frame
from mpvi_bt.perception.field import View
from mpvi_bt.robot.solids import Array

_KEPT = 24  # pictures
_TOLD = 8  # of them, at the most, tell of one place
_NEAR_M = 1.8  # from where a picture was taken, that it tells of
_SAME_M, _SAME_RAD = 0.15, 0.25  # a picture from there that looks there shows what an earlier one showed
_CARRIED_M = 0.5  # from the head: what is nearer is carried, mostly


class Past:
    """Pictures of the head, without what hands may have moved since, until newer ones show the same."""

    def __init__(self) -> None:
        """Remember nothing."""
        self._views: list[View] = []

    def keep(self, frames: Iterable[Frame], movable: Collection[str]) -> None:
        """Remember frames, the newest last, but for what the phrases `movable` name in them."""
        for frame in frames:
            if frame.image.camera != "head":
                continue
            through = frame.robot | frame.floor | (frame.image.depth < _CARRIED_M)
            for shown in frame.detections:
                if shown.phrase in movable:
                    through |= ndimage.binary_dilation(shown.mask, iterations=2)
            view = View(frame.image, through)
            self._views = [*(v for v in self._views if not _same(v, view)), view][-_KEPT:]

    def near(self, xy: Array) -> list[View]:
        """Those that tell of a place (2,), the newest last."""
        there = [v for v in self._views if np.linalg.norm(v.image.T_world_camera[:2, 3] - xy) < _NEAR_M]
        return there[-_TOLD:]


def _same(one: View, other: View) -> bool:
    T, U = one.image.T_world_camera, other.image.T_world_camera
    return bool(np.linalg.norm(T[:3, 3] - U[:3, 3]) < _SAME_M and T[:3, 2] @ U[:3, 2] > np.cos(_SAME_RAD))
