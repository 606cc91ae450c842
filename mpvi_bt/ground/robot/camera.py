"""A camera of a robot, as a value."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class Camera:
    """A camera of the robot: picture size [px], vertical field of view [rad], nearest and farthest depth [m].

    Attributes:
        link: That it is fixed to.
        intrinsics: fx, fy, cx, cy [px]; None: square pixels about the middle, by the field of view.
        depth: Whether it measures depth.
    """

    width: int
    height: int
    fov_rad: float
    near_m: float
    far_m: float
    link: str
    intrinsics: tuple[float, float, float, float] | None = None
    depth: bool = True

    @property
    def K(self) -> Array:  # noqa: N802
        """(3, 3) intrinsics [px]."""
        f = self.height / 2 / math.tan(self.fov_rad / 2)
        fx, fy, cx, cy = self.intrinsics or (f, f, self.width / 2, self.height / 2)
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def angles_rad(self) -> tuple[float, float]:
        """How wide and how high it sees."""
        K = self.K
        return 2 * math.atan(self.width / 2 / K[0, 0]), 2 * math.atan(self.height / 2 / K[1, 1])
