"""Primitive solids: what houses, objects, robots and collision checks are made of."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import matmul

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solid:
    """A box, cylinder or sphere.

    Attributes:
        kind: Its shape.
        half_m: (3,) half extents along its own axes. A cylinder stands along its z: (radius, radius, half height);
            a sphere is (radius, radius, radius).
        T: (4, 4) pose, solid to the frame of whoever holds it (body frame in a description, world in a state).
    """

    kind: Literal["box", "cylinder", "sphere"]
    half_m: Array
    T: Array = field(default_factory=lambda: np.eye(4))

    def moved(self, T: Array) -> Solid:
        """The same solid seen from the frame that `T` (4, 4) maps into."""
        return Solid(self.kind, self.half_m, matmul(T, self.T))

    def aabb(self) -> Array:
        """(2, 3) lowest and highest corner of the axis-aligned bounding box, in the frame of `T`; read only."""
        return self._box

    @cached_property
    def _box(self) -> Array:
        R, p = self.T[:3, :3], self.T[:3, 3]
        if self.kind == "sphere":
            reach = self.half_m
        elif self.kind == "cylinder":
            axis = R[:, 2]
            reach = np.abs(axis) * self.half_m[2] + np.sqrt(np.maximum(0.0, 1.0 - axis**2)) * self.half_m[0]
        else:
            reach = matmul(np.abs(R), self.half_m)
        corners = np.stack([p - reach, p + reach])
        corners.flags.writeable = False
        return corners


def bounds(solids: Iterable[Solid]) -> Array:
    """(2, 3) lowest and highest corner of the axis-aligned box about solids, of which there is at least one."""
    boxes = np.stack([solid.aabb() for solid in solids])
    return np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)])


def pose(p: tuple[float, float, float] | Array = (0.0, 0.0, 0.0), yaw: float = 0.0) -> Array:
    """(4, 4) transform that turns by `yaw` [rad] about z, then shifts by `p` [m]."""
    c, s = np.cos(yaw), np.sin(yaw)
    T = np.eye(4)
    T[:2, :2] = [[c, -s], [s, c]]
    T[:3, 3] = p
    return T


def box(center: tuple[float, float, float], size: tuple[float, float, float], yaw: float = 0.0) -> Solid:
    """A box of full `size` [m] about `center` [m], turned by `yaw` [rad] about z."""
    return Solid("box", np.asarray(size, float) / 2, pose(center, yaw))
