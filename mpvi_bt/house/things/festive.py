"""Families of what a house is decorated with for a feast: pure functions from dimensions to a description."""

from __future__ import annotations

import numpy as np

from mpvi_bt.house.things.description import Color, Description, PartsOfBody
from mpvi_bt.house.things.dimensions import Count, Length, Rgb, Size

_STEM: Color = (0.36, 0.42, 0.18)
_BARK: Color = (0.42, 0.29, 0.18)
_RED: Color = (0.78, 0.12, 0.16)
_GOLD: Color = (0.93, 0.76, 0.22)
_BLUE: Color = (0.2, 0.38, 0.75)
_WHITE: Color = (0.96, 0.95, 0.93)
_GOLDEN_ANGLE = 2.4  # between balls that hang around a tree: no two above one another


def pumpkin(*, diameter_m: Length, color: Rgb, lobes: Count = 8) -> Description:
    """Round lobes about a flat foot, with a stem."""
    parts = PartsOfBody()
    lobe = 0.68 * diameter_m
    for angle in np.arange(lobes) * (2 * np.pi / lobes):
        away = (diameter_m - lobe) / 2
        parts.sphere((away * float(np.cos(angle)), away * float(np.sin(angle)), lobe / 2), lobe, color)
    parts.cylinder((0, 0, lobe / 6), 0.75 * diameter_m, lobe / 3, color)
    parts.cylinder((0, 0, lobe + 0.003), 0.16 * diameter_m, 0.24 * diameter_m, _STEM)
    return parts.thing()


def christmas_tree(*, size_m: Size, color: Rgb, pot_color: Rgb, tiers: Count = 9) -> Description:
    """A fir whose branches reach nearly to the ground, in a pot, with balls and a star."""
    parts = PartsOfBody()
    broad, z = min(size_m[:2]), size_m[2]
    pot = 0.045 * z
    parts.cylinder((0, 0, pot / 2), 0.5 * broad, pot, pot_color)
    parts.cylinder((0, 0, pot + 0.02), 0.12 * broad, 0.04, _BARK, collides=False)
    each = (0.96 * z - pot) / tiers
    for k in range(tiers):
        wide = broad * (1 - k / (tiers + 0.3))
        low = pot + k * each
        parts.cylinder((0, 0, low + each / 2), wide * 0.86, each, color)
        parts.cylinder((0, 0, low + each * 0.2), wide, each * 0.4, color)
        for n in range(3):
            angle = _GOLDEN_ANGLE * (3 * k + n)
            at = (0.47 * wide * float(np.cos(angle)), 0.47 * wide * float(np.sin(angle)), low + 0.55 * each)
            parts.sphere(at, 0.045, (_RED, _GOLD, _BLUE)[n], collides=False)
    parts.sphere((0, 0, 0.96 * z + 0.02), min(0.07, 0.08 * z), _GOLD, collides=False)
    parts.cylinder((0, 0, 0.98 * z), 0.02, 0.04 * z, _GOLD)
    return parts.thing()


def wreath(*, diameter_m: Length, thick_m: Length, color: Rgb, sides: Count = 12) -> Description:
    """A ring of twigs, lying, with berries and a bow."""
    parts = PartsOfBody()
    away = (diameter_m - thick_m) / 2
    twig = diameter_m * float(np.tan(np.pi / sides))
    for angle in np.arange(sides) * (2 * np.pi / sides):
        at = (away * float(np.cos(angle)), away * float(np.sin(angle)), thick_m / 2)
        parts.box(at, (thick_m, twig, thick_m), color, yaw=float(angle))
    for k in range(2 * sides):
        angle = (k + 0.5) * np.pi / sides
        at = (away * float(np.cos(angle)), away * float(np.sin(angle)), thick_m)
        parts.sphere(at, 0.3 * thick_m, _RED if k % 2 else _WHITE, collides=False)
    for sign in (-1, 1):
        parts.box((away, 0.022 * sign, thick_m), (0.03, 0.04, 0.012), _RED, yaw=0.5 * sign, collides=False)
    return parts.thing()


def gift_box(*, size_m: Size, color: Rgb, ribbon_color: Rgb) -> Description:
    """A closed box with a ribbon around it both ways and a bow on top."""
    parts = PartsOfBody()
    x, y, z = size_m
    thin, wide = 0.002, 0.2
    parts.box((0, 0, z / 2), size_m, color)
    parts.box((0, 0, z / 2), (x + thin, wide * y, z + thin), ribbon_color, collides=False)
    parts.box((0, 0, z / 2), (wide * x, y + thin, z + thin), ribbon_color, collides=False)
    for yaw in (0.8, -0.8):
        parts.box((0, 0, z + 0.006), (0.55 * x, 0.16 * y, 0.012), ribbon_color, yaw=yaw, collides=False)
    return parts.thing()


def candy_cane(*, length_m: Length, thick_m: Length, color: Rgb, stripe_color: Rgb, stripes: Count = 5) -> Description:
    """A striped stick with a crook at its end, lying."""
    parts = PartsOfBody()
    crook = 1.6 * thick_m
    straight = length_m - thick_m
    each = straight / stripes
    for k in range(stripes):
        paint = stripe_color if k % 2 else color
        parts.cylinder(((k + 0.5) * each - length_m / 2, 0, thick_m / 2), thick_m, each, paint, axis="x")
    end = length_m / 2 - thick_m / 2
    parts.sphere((end, 0, thick_m / 2), thick_m, color)
    parts.cylinder((end, crook / 2, thick_m / 2), thick_m, crook, stripe_color, axis="y")
    parts.sphere((end, crook, thick_m / 2), thick_m, color)
    parts.cylinder((end - thick_m / 2, crook, thick_m / 2), thick_m, thick_m, color, axis="x")
    return parts.thing()
