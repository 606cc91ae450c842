"""The noise of the robot's depth cameras, which grows with the square of the range."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DepthNoise:
    """Sizes of the noise at 1 m [m]; at z m they are z**2 times as large, as of every stereo camera.

    Our choice throughout: the tolerances are three standard deviations, rounded up.

    Attributes:
        sigma_m: Standard deviation of a pixel, as the simulated cameras have it where errors are asked for.
        pixel_m: How far a pixel may be off its neighbors and still belong to one surface.
        ray_m: How far a pixel of a raw picture may be before or behind a surface.
        smoothed_m: Likewise after a 3 x 3 median, which leaves 0.41 of the standard deviation (of nine normal values).
        grain_m: Standard deviation of the surface that many smoothed pixels show.
    """

    sigma_m: float = 0.003
    pixel_m: float = 0.009
    ray_m: float = 0.01
    smoothed_m: float = 0.004
    grain_m: float = 0.0008


DEPTH_NOISE = DepthNoise()
