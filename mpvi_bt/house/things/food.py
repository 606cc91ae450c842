"""Families of food: rounds, and what is left of them when they are cut. Pure functions; all stand on z = 0."""

from __future__ import annotations

import numpy as np

from mpvi_bt.house.things.description import Description, PartsOfBody
from mpvi_bt.house.things.dimensions import Count, Length, Rgb

_GOLDEN = np.pi * (3 - np.sqrt(5))  # turn from one bit to the next, so that they lie evenly


def topped_disc(
    *, diameter_m: Length, height_m: Length, color: Rgb, top_color: Rgb, bit_color: Rgb, bits: Count = 7
) -> Description:
    """A flat round with bits on top, such as a pizza or a chocolate chip cookie; only the round itself collides."""
    parts = PartsOfBody()
    parts.cylinder((0, 0, height_m / 2), diameter_m, height_m, color)
    parts.cylinder((0, 0, height_m), diameter_m * 0.86, 0.002, top_color, collides=False)
    for i in range(bits):
        r, a = diameter_m * 0.36 * np.sqrt((i + 0.5) / bits), i * _GOLDEN
        at = (float(r * np.cos(a)), float(r * np.sin(a)), height_m + 0.001)
        parts.cylinder(at, diameter_m * 0.15, 0.004, bit_color, collides=False)
    return parts.thing()


def half_disc(
    *, diameter_m: Length, height_m: Length, color: Rgb, top_color: Rgb, cut_color: Rgb, strips: Count = 6
) -> Description:
    """One half of a round that was cut through upright, such as half a pie; the cut is its front."""
    parts = PartsOfBody()
    r = diameter_m / 2
    deep = r / strips
    for i in range(strips):
        x = i * deep - r / 2  # of the strip's side that is nearer to the cut
        width = 2 * float(np.sqrt(r**2 - ((i + 0.5) * deep) ** 2))
        parts.box((-(x + deep / 2), 0, height_m / 2), (deep, width, height_m), color)
        inner = max(0.01, width - 0.024)
        parts.box((-(x + deep / 2), 0, height_m), (deep, inner, 0.002), top_color, collides=False)
    parts.box((r / 2, 0, height_m * 0.5), (0.002, diameter_m * 0.9, height_m * 0.7), cut_color, collides=False)
    return parts.thing()


def dome(
    *, diameter_m: Length, height_m: Length, color: Rgb, cut_color: Rgb, stem_color: Rgb, layers: Count = 5
) -> Description:
    """One half of a ball that lies on its cut, such as half an apple with its stem."""
    parts = PartsOfBody()
    tall = height_m / layers
    for i in range(layers):
        share = 1 - ((i + 0.5) / layers) ** 2
        parts.cylinder((0, 0, (i + 0.5) * tall), diameter_m * float(np.sqrt(share)), tall, color)
    parts.cylinder((0, 0, 0.002), diameter_m * 1.002, 0.0035, cut_color, collides=False)
    parts.cylinder((0, 0, height_m + 0.004), 0.006, 0.012, stem_color, collides=False)
    return parts.thing()
