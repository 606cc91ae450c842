"""The noise of the robot's depth cameras, which grows with the square of the range."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DepthNoise:
    """Sizes of the depth noise at 1 m [m]; at z m they are z**2 times as large, as of every stereo camera.

    Our choice: the tolerances are three standard deviations, rounded up.
    """

    sigma_m: float = 0.003  # standard deviation of a pixel of the simulated cameras, where errors are asked for
    pixel_m: float = 0.009  # largest step between neighboring pixels of one surface
    ray_m: float = 0.01  # largest distance of a raw pixel before or behind its surface
    smoothed_m: float = 0.004  # the same after a 3 x 3 median, with 0.41 of the standard deviation (nine normal values)
    grain_m: float = 0.0008  # standard deviation of a surface of many smoothed pixels


DEPTH_NOISE = DepthNoise()
