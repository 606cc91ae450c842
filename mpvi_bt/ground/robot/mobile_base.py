"""A mobile base from above, as a value: a disc, or a convex polygon that turns with it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mpvi_bt.ground.geometry.kinematics import rot_z
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array

_BEYOND_M = 0.02  # Our choice: so far circles reach beyond the polygon that they cover: some 16 of them
_SAMPLE_M = 0.01  # between points that are to be covered; circles are half a diagonal smaller while they are chosen


@dataclass(frozen=True, eq=False)
class MobileBase:
    """The base, in its frame: x forward, y left.

    Attributes:
        radius_m: Of the largest circle about its origin that is within its outline: all of a base that is round.
        folded_m: Of the circle about its origin that is kept clear while it drives with folded arms; where there is
            no such way, `radius_m` is, and arms are heeded as what is carried is.
        turn_m: Turning by a radian counts as driving so far: as far as its wheels roll.
        own_m: What its head sees nearer to the origin than this is the robot itself, its arms folded.
        corners: (n, 2) of its convex outline [m], counter-clockwise; none if it is round.
    """

    radius_m: float
    folded_m: float
    turn_m: float
    own_m: float
    corners: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @cached_property
    def outline(self) -> Array:
        """(n, 2) corners of it, also of one that is round: to be drawn [m]."""
        if len(self.corners):
            return self.corners
        angles = np.arange(48) * (2 * math.pi / 48)
        return self.radius_m * np.stack([np.cos(angles), np.sin(angles)], 1)

    def reach(self, yaw: float) -> float:
        """How far it reaches from its origin toward a direction in its frame [rad]; round ones as far as `folded_m`."""
        if not len(self.corners):
            return self.folded_m
        return float(matmul(self.corners, [math.cos(yaw), math.sin(yaw)]).max())

    def covers(self, place: Array, radius_m: float) -> bool:
        """Whether a circle about a place (2,) in its frame is over a base with corners, wherever it turns."""
        return bool(len(self.corners)) and float(self._depth(place[None])[0]) >= radius_m

    @cached_property
    def circles(self) -> Array:
        """(n, 3) x, y, radius [m]: they cover all of the outline that is beyond `radius_m`, and little besides."""
        if not len(self.corners):
            return np.zeros((0, 3))
        inside = self._samples
        edges = [
            a + (b - a) * np.linspace(0, 1, math.ceil(float(norm(b - a)) / _SAMPLE_M), endpoint=False)[:, None]
            for a, b in zip(self.corners, np.roll(self.corners, -1, 0), strict=True)
        ]
        left = np.concatenate([inside, *edges])
        left = left[norm(left, axis=1) > self.radius_m - _SAMPLE_M]
        middles = np.concatenate([inside[::3], *edges])  # with these even an acute corner is covered
        radii = self._depth(middles) + _BEYOND_M
        away2 = sum(np.subtract.outer(left[:, k], middles[:, k]) ** 2 for k in range(2))
        covered = away2 <= np.maximum(radii - _SAMPLE_M * math.sqrt(0.5), 0.0) ** 2
        chosen: list[int] = []
        while len(covered):
            chosen.append(int(covered.sum(0).argmax()))
            covered = covered[~covered[:, chosen[-1]]]
        return np.column_stack([middles, radii])[chosen]

    @cached_property
    def core(self) -> tuple[float, float]:
        """Of the largest circle within its outline: how far its middle is from the origin, and its radius [m]."""
        if not len(self.corners):
            return 0.0, self.radius_m
        places = self._samples
        depth = self._depth(places)
        best = int(depth.argmax())
        return float(norm(places[best])), float(depth[best])

    @cached_property
    def _samples(self) -> Array:
        """(n, 2) places all over the outline."""
        low, high = self.corners.min(0), self.corners.max(0)
        axes = [np.arange(a, b + _SAMPLE_M, _SAMPLE_M) for a, b in zip(low, high, strict=True)]
        inside = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
        return np.asarray(inside[self._depth(inside) >= 0])

    def _depth(self, places: Array) -> Array:
        """(n,) how far [m] places (n, 2) are within the outline, negative outside."""
        along = np.roll(self.corners, -1, 0) - self.corners
        inward = np.stack([-along[:, 1], along[:, 0]], 1) / norm(along, axis=1)[:, None]
        depth: Array = (matmul(places, inward.T) - (self.corners * inward).sum(1)).min(1)
        return depth


def placed(points: Array, pose: Array) -> Array:
    """(n, 2) in the world where points (n, 2) in the base frame are with the base at a pose (3,) [m, m, rad]."""
    return np.asarray(matmul(points, rot_z(float(pose[2]))[:2, :2].T) + pose[:2])
