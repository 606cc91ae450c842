"""A camera of a robot, as a value."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Camera:
    """A camera of the robot: picture size [px], vertical field of view [rad], nearest and farthest depth [m]."""

    width: int
    height: int
    fov_rad: float
    near_m: float
    far_m: float
    link: str
