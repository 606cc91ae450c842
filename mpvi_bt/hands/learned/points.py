"""What a learned policy sees: points of what it is to work on and of what is around that, remembered for a while."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.perception.detector import ROBOT, Detector
from mpvi_bt.finding.perception.localize import in_world, measured, pixels
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage

# All our choice.
TARGET_POINTS = CONTEXT_POINTS = 64  # of a sample
_LEAST_PX, _LEAST_AROUND_PX = 4, 8  # a look that shows less of the target, of what is around it, tells nothing
_AROUND_M = 0.45  # what is nearer to the target's middle is around it
_CARRIED_M = 0.3  # what is so near to a hand that holds something is in it
_DEEP_M = 0.15  # pixels of the target that lie so far before or behind most of it are of something else
_EVERY_PX = 4  # of what is around it; of the target every pixel counts
_KEPT = 1024  # points of one look
_STALE_LOOKS = 9  # after which what only the other camera saw is forgotten


class PointMemory:
    """The points that each camera saw last of a target and of its surroundings, in the world."""

    def __init__(self, detector: Detector, phrase: str, rng: np.random.Generator) -> None:
        """Look for what `phrase` names through `detector`; `rng` draws the samples."""
        self._detector, self._phrase, self._rng = detector, phrase, rng
        self._target: dict[str, tuple[int, Array]] = {}
        self._context: dict[str, Array] = {}
        self._looks = 0

    @property
    def seen(self) -> bool:
        """Whether the target has been seen."""
        return bool(self._target)

    @property
    def middle(self) -> Array:
        """(3,) the mean of the target's points [m]; it has been seen."""
        return np.concatenate([points for _, points in self._target.values()]).mean(0)

    @property
    def spread_m(self) -> float:
        """Standard deviation of the target's points along x or y, the larger one; it has been seen."""
        return float(np.concatenate([points for _, points in self._target.values()])[:, :2].std(0).max())

    def look(self, *images: CameraImage, carried: Sequence[Array] = ()) -> None:
        """Take in pictures of one moment.

        Args:
            images: Of different cameras.
            carried: (3,) where hands are that hold something: what is there is not looked for, such as a can that lies
                in a carried bin already.

        Raises:
            DetectorError: The detector failed.
        """
        self._looks += 1
        for image in images:
            found = self._detector.detect(image, (self._phrase, ROBOT))
            free = measured(image)
            for detection in found:
                if detection.phrase == ROBOT:
                    free &= ~pixels(detection, image)
            masks = [pixels(d, image) & free for d in found if d.phrase == self._phrase]
            seen = [_points(image, mask) for mask in masks if np.count_nonzero(mask) >= _LEAST_PX]
            seen = [p for p in seen if all(norm(p.mean(0) - hand) > _CARRIED_M for hand in carried)]
            if seen:
                was = self.middle if self.seen else image.T_world_camera[:3, 3]
                nearest = min(seen, key=lambda points: float(norm(points.mean(0) - was)))
                self._target[image.camera] = (self._looks, nearest)
            if self.seen:
                self._look_around(image, free, masks)
        newest = max((k for k, _ in self._target.values()), default=0)
        self._target = {c: v for c, v in self._target.items() if newest - v[0] <= _STALE_LOOKS}

    def sample(self) -> Array:
        """(128, 3) points in the world [m]: 64 of the target, then 64 of what is around it. It has been seen."""
        target = self._drawn([points for _, points in self._target.values()], TARGET_POINTS)
        around = self._drawn(list(self._context.values()), CONTEXT_POINTS) if self._context else target[:1]
        return np.concatenate([target, np.resize(around, (CONTEXT_POINTS, 3))])

    def _look_around(self, image: CameraImage, free: NDArray[np.bool_], masks: Sequence[NDArray[np.bool_]]) -> None:
        other = free[::_EVERY_PX, ::_EVERY_PX].copy()
        for mask in masks:
            other &= ~mask[::_EVERY_PX, ::_EVERY_PX]
        rows, columns = (_EVERY_PX * at for at in np.nonzero(other))
        points = in_world(image, columns + 0.5, rows + 0.5, image.depth[rows, columns].astype(float))
        near = points[norm(points - self.middle) < _AROUND_M]
        if len(near) >= _LEAST_AROUND_PX:
            self._context[image.camera] = near

    def _drawn(self, sets: list[Array], count: int) -> Array:
        """(count, 3) drawn from each set alike."""
        shares = [count // len(sets) + (k < count % len(sets)) for k in range(len(sets))]
        draw = self._rng.choice
        return np.concatenate(
            [points[draw(len(points), n, replace=len(points) < n)] for points, n in zip(sets, shares, strict=True)]
        )


def _points(image: CameraImage, mask: NDArray[np.bool_]) -> Array:
    """(n, 3) in the world [m] of the pixels of a thing, without those that are of something before or behind it."""
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])  # ten times as fast as of two dimensions
    z = image.depth[rows, columns].astype(float)
    half = (len(z) - 1) // 2
    middle = np.partition(z, half)[half]  # a depth that was measured: between two things there is nothing
    (own,) = np.nonzero(np.abs(z - middle) <= _DEEP_M)
    own = own[np.linspace(0, len(own) - 1, min(len(own), _KEPT)).astype(int)]
    return in_world(image, columns[own] + 0.5, rows[own] + 0.5, z[own])
