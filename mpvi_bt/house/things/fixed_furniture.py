"""Families of fixtures that do not move: pure functions from dimensions to a description.

Sizes are full lengths [m] along x (depth), y (width) and z (height); the front faces +x.
"""

from __future__ import annotations

import itertools

import numpy as np

from mpvi_bt.ground.geometry.solids import box
from mpvi_bt.house.things.description import Color, Description, PartsOfBody, switch
from mpvi_bt.house.things.dimensions import Count, Length, Rgb, Size

_STEEL: Color = (0.78, 0.79, 0.8)
_DARK: Color = (0.2, 0.2, 0.22)
_WHITE: Color = (0.96, 0.95, 0.93)
_GREEN: Color = (0.3, 0.52, 0.26)
_LEAF: Color = (0.36, 0.58, 0.3)
_WOOD: Color = (0.52, 0.36, 0.22)


def table(
    *, size_m: Size, color: Rgb, leg_color: Rgb | None = None, top_m: Length = 0.035, round_top: bool = False,
    leg_m: Length = 0.05, shelf_z_m: Length | None = None,
) -> Description:  # fmt: skip
    """A top on four legs, with a lower shelf if it has one."""
    parts = PartsOfBody()
    x, y, z = size_m
    legs = leg_color or color
    if round_top:
        parts.cylinder((0, 0, z - top_m / 2), min(x, y), top_m, color)
        parts.cylinder((0, 0, (z - top_m) / 2), 0.08, z - top_m, legs)
        parts.cylinder((0, 0, 0.015), min(x, y) * 0.55, 0.03, legs)
        return parts.thing()
    parts.box((0, 0, z - top_m / 2), (x, y, top_m), color)
    for i in (-1, 1):
        for j in (-1, 1):
            center = (i * (x / 2 - leg_m / 2 - 0.015), j * (y / 2 - leg_m / 2 - 0.015), (z - top_m) / 2)
            parts.box(center, (leg_m, leg_m, z - top_m), legs)
    if shelf_z_m is not None:
        parts.box((0, 0, shelf_z_m), (x - 0.06, y - 0.06, 0.02), legs)
    return parts.thing()


def chair(*, size_m: Size, color: Rgb, leg_color: Rgb | None = None, seat_z_m: Length = 0.46) -> Description:
    """A seat on four legs with a back; `size_m` includes the back."""
    parts = PartsOfBody()
    x, y, z = size_m
    legs = leg_color or color
    parts.box((0, 0, seat_z_m - 0.02), (x, y, 0.04), color)
    under = seat_z_m - 0.04
    for i in (-1, 1):
        for j in (-1, 1):
            parts.box((i * (x / 2 - 0.02), j * (y / 2 - 0.02), under / 2), (0.035, 0.035, under), legs)
    for j in (-1, 1):
        parts.box((-x / 2 + 0.015, j * (y / 2 - 0.02), (seat_z_m + z) / 2), (0.03, 0.035, z - seat_z_m), legs)
    parts.box((-x / 2 + 0.015, 0, z - 0.11), (0.025, y - 0.08, 0.2), color)
    return parts.thing()


def swivel_chair(*, size_m: Size, color: Rgb, seat_z_m: Length = 0.48) -> Description:
    """An office chair on a star foot."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, seat_z_m - 0.035), (x, y, 0.07), color)
    parts.box((-x / 2 + 0.025, 0, (seat_z_m + z) / 2 + 0.04), (0.05, y * 0.9, z - seat_z_m - 0.08), color)
    parts.cylinder((0, 0, (seat_z_m - 0.07 + 0.05) / 2), 0.06, seat_z_m - 0.12, _DARK)
    for angle in np.arange(5) * (2 * np.pi / 5):
        c, s = float(np.cos(angle)), float(np.sin(angle))
        parts.box((0.12 * c, 0.12 * s, 0.06), (0.24, 0.035, 0.03), _DARK, yaw=float(angle))
        parts.cylinder((0.22 * c, 0.22 * s, 0.0225), 0.05, 0.045, _DARK)
    return parts.thing()


def sofa(*, size_m: Size, color: Rgb, cushion_color: Rgb | None = None, seats: Count = 2) -> Description:
    """A seat with arm rests, a back and one cushion a seat."""
    parts = PartsOfBody()
    x, y, z = size_m
    arm, back, seat = 0.16, 0.2, 0.42
    parts.box((0, 0, 0.15), (x, y, 0.18), color)
    parts.box((-x / 2 + back / 2, 0, (0.24 + z) / 2), (back, y, z - 0.24), color)
    for j in (-1, 1):
        parts.box((back / 2, j * (y - arm) / 2, 0.43), (x - back, arm, 0.38), color)
        for i in (-1, 1):
            parts.box((i * (x / 2 - 0.06), j * (y / 2 - 0.06), 0.03), (0.05, 0.05, 0.06), _DARK)
    width = (y - 2 * arm) / seats
    for k in range(seats):
        center = -(y - 2 * arm) / 2 + (k + 0.5) * width
        parts.box((back / 2, center, (0.24 + seat) / 2), (x - back, width - 0.012, seat - 0.24), cushion_color or color)
        parts.box((-x / 2 + back + 0.05, center, 0.56), (0.1, width - 0.05, 0.26), cushion_color or color)
    return parts.thing()


def bed(*, size_m: Size, color: Rgb, blanket_color: Rgb, pillows: Count = 1, legs_m: Length = 0.08) -> Description:
    """A frame with a mattress, blanket, pillows and a head board at the back; `size_m` z is the mattress's top."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, (z - 0.2 + legs_m) / 2), (x, y, z - 0.2 - legs_m), color)
    parts.box((0.02, 0, z - 0.1), (x - 0.08, y - 0.06, 0.2), _WHITE)
    parts.box((x * 0.15 - 0.006, 0, z - 0.065), (x * 0.7, y - 0.02, 0.135), blanket_color, collides=False)
    parts.box((-x / 2 + 0.02, 0, (z + 0.45) / 2), (0.04, y, z + 0.45), color)
    for i in (-1, 1):
        for j in (-1, 1):
            parts.box((i * (x / 2 - 0.05), j * (y / 2 - 0.05), legs_m / 2), (0.07, 0.07, legs_m), color)
    width = (y - 0.1) / pillows
    for k in range(pillows):
        center = -(y - 0.1) / 2 + (k + 0.5) * width
        parts.box((-x / 2 + 0.26, center, z + 0.045), (0.36, min(0.62, width - 0.06), 0.09), _WHITE)
    return parts.thing()


def shelf(
    *, size_m: Size, color: Rgb, shelves: Count = 4, back_color: Rgb | None = None, wall_m: Length = 0.022,
    open_back: bool = False,
) -> Description:  # fmt: skip
    """An open shelf or bookcase with that many boards, the lowest and the top board among them."""
    parts = PartsOfBody()
    x, y, z = size_m
    for j in (-1, 1):
        parts.box((0, j * (y - wall_m) / 2, z / 2), (x, wall_m, z), color)
    if not open_back:
        parts.box((-x / 2 + 0.006, 0, z / 2), (0.012, y - 2 * wall_m, z), back_color or color)
    heights = np.linspace(min(0.06, z / 8), z - wall_m / 2, max(shelves, 2))
    for height in heights:
        parts.box((0.006, 0, float(height)), (x - 0.012, y - 2 * wall_m, wall_m), color)
    volumes = tuple(
        box((0.006, 0, float(a + b) / 2), (x - 0.012, y - 2 * wall_m, float(b - a) - wall_m))
        for a, b in itertools.pairwise(heights)
    )
    return parts.thing(volumes=volumes)


def hallstand(*, size_m: Size, color: Rgb, back_color: Rgb) -> Description:
    """Two slatted racks for shoes, a back with coat hooks and a hat shelf."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((-x / 2 + 0.01, 0, z / 2), (0.02, y, z), back_color)
    for j in (-1, 1):
        parts.box((0.01, j * (y / 2 - 0.015), 0.25), (x - 0.02, 0.03, 0.5), color)
    for height in (0.12, 0.46):
        parts.box((0.01, 0, height), (x - 0.02, y - 0.06, 0.025), color)
    parts.box((-0.03, 0, z - 0.06), (x - 0.06, y, 0.025), color)
    for k in range(5):
        center = (-x / 2 + 0.055, (k - 2) * y / 5.5, z - 0.25)
        parts.cylinder(center, 0.02, 0.08, _DARK, axis="x")
    return parts.thing()


def countertop(*, size_m: Size, color: Rgb, top_m: Length = 0.04, splash_color: Rgb | None = None) -> Description:
    """A work surface alone, resting on the cabinets and appliances below it; its underside is at z = height - top."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z - top_m / 2), (x, y, top_m), color)
    if splash_color is not None:
        parts.box((-x / 2 + 0.008, 0, z + 0.25), (0.016, y, 0.5), splash_color)
    return parts.thing()


def counter(
    *, size_m: Size, color: Rgb, top_color: Rgb, units: Count = 2, top_m: Length = 0.04, splash_color: Rgb | None = None
) -> Description:
    """A work surface on a closed base whose fronts are only drawn."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z - top_m / 2), (x, y, top_m), top_color)
    parts.box((-0.02, 0, (0.1 + z - top_m) / 2), (x - 0.04, y, z - top_m - 0.1), color)
    parts.box((-0.04, 0, 0.05), (x - 0.08, y, 0.1), _DARK)
    _fronts(parts, x / 2 - 0.04, y, 0.1, z - top_m, units, color)
    if splash_color is not None:
        parts.box((-x / 2 + 0.008, 0, z + 0.25), (0.016, y, 0.5), splash_color)
    return parts.thing()


def sink(*, size_m: Size, color: Rgb, top_color: Rgb, basin_m: Size, pedestal: bool = False) -> Description:
    """A basin in a work surface, with a tap at the back that is turned on at its top.

    It stands on a closed base, or on a slim `pedestal` with free floor around it.
    """
    parts = PartsOfBody()
    x, y, z = size_m
    bx, by, bz = basin_m
    top, wall = 0.04, 0.012
    front, side = (x - bx) / 2, (y - by) / 2
    deep, middle = bz + wall - top, (bz + wall + top) / 2  # the basin's walls hang below the top
    for sign in (-1, 1):
        parts.box((sign * (bx + front) / 2, 0, z - top / 2), (front, y, top), top_color)
        parts.box((0, sign * (by + side) / 2, z - top / 2), (bx, side, top), top_color)
        parts.box((sign * (bx + wall) / 2, 0, z - middle), (wall, by + 2 * wall, deep), _STEEL)
        parts.box((0, sign * (by + wall) / 2, z - middle), (bx, wall, deep), _STEEL)
    parts.box((0, 0, z - bz - wall / 2), (bx, by, wall), _STEEL)
    low = z - bz - wall - 0.001
    if pedestal:
        parts.box((-x / 4, 0, low / 2), (x * 0.3, 0.18, low), color)
    else:
        parts.box((-0.02, 0, (0.1 + low) / 2), (x - 0.04, y, low - 0.1), color)
        parts.box((-0.04, 0, 0.05), (x - 0.08, y, 0.1), _DARK)
        parts.box((x / 2 - 0.03, 0, (low + z - top) / 2), (0.018, y, z - top - low), color)
        _fronts(parts, x / 2 - 0.04, y, 0.1, z - top, 1, color)
    parts.cylinder((-x / 2 + front / 2, 0, z + 0.13), 0.026, 0.26, _STEEL)
    parts.cylinder((-x / 2 + front / 2 + 0.08, 0, z + 0.26), 0.022, 0.17, _STEEL, axis="x")
    basin = box((0, 0, z - bz / 2), (bx, by, bz))
    return parts.thing(volumes=(basin,), switches=(switch((-x / 2 + front / 2, 0, z + 0.272), "z"),))


def stove(*, size_m: Size, color: Rgb, burner_color: Rgb = _DARK) -> Description:
    """A cooktop with four burners and knobs at its front, one of which is its switch."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z / 2), size_m, color)
    for i, j in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        parts.cylinder((i * x * 0.21 - 0.02, j * y * 0.23, z + 0.002), 0.18, 0.004, burner_color, collides=False)
        parts.cylinder((i * x * 0.21 - 0.02, j * y * 0.23, z + 0.004), 0.09, 0.004, color, collides=False)
    for k in range(4):
        parts.cylinder((x / 2 - 0.03, (k - 1.5) * 0.1, z + 0.006), 0.03, 0.012, _STEEL, collides=False)
    return parts.thing(switches=(switch((x / 2 - 0.03, -0.05, z + 0.012), "z"),))


def fireplace(*, size_m: Size, color: Rgb, mantel_color: Rgb, hearth_m: Size, hearth_z_m: Length = 0.08) -> Description:
    """A chimney breast with an open hearth, `hearth_z_m` above the floor, and a mantel shelf."""
    parts = PartsOfBody()
    x, y, z = size_m
    hx, hy, hz = hearth_m
    side, floor = (y - hy) / 2, hearth_z_m
    for sign in (-1, 1):
        parts.box((0, sign * (hy + side) / 2, z / 2), (x, side, z), color)
    parts.box((0, 0, (floor + hz + z) / 2), (x, hy, z - floor - hz), color)
    parts.box((-hx / 2, 0, floor + hz / 2), (x - hx, hy, hz), _DARK)
    parts.box((0, 0, floor / 2), (x, hy, floor), _DARK)
    parts.box((x / 2 + 0.05, 0, floor + hz + 0.25), (0.1, y + 0.1, 0.06), mantel_color)
    for sign in (-1, 1):
        parts.cylinder((x / 2 - hx / 2, sign * 0.05, floor + 0.04), 0.07, hy * 0.6, _WOOD, axis="y", collides=False)
    hearth = box(((x - hx) / 2, 0, floor + hz / 2), (hx, hy, hz))
    return parts.thing(volumes=(hearth,))


def bathtub(*, size_m: Size, color: Rgb) -> Description:
    """A tub with a deep basin."""
    parts = PartsOfBody()
    x, y, z = size_m
    wall, floor = 0.07, 0.16
    parts.box((0, 0, floor / 2), (x, y, floor), color)
    for sign in (-1, 1):
        parts.box((sign * (x - wall) / 2, 0, (floor + z) / 2), (wall, y, z - floor), color)
        parts.box((0, sign * (y - wall) / 2, (floor + z) / 2), (x - 2 * wall, wall, z - floor), color)
    parts.cylinder((-x / 2 + wall / 2, 0, z + 0.06), 0.03, 0.12, _STEEL)
    return parts.thing(volumes=(box((0, 0, (floor + z) / 2), (x - 2 * wall, y - 2 * wall, z - floor)),))


def toilet(*, size_m: Size, color: Rgb) -> Description:
    """A bowl with a lid and a cistern at the back."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((-x / 2 + 0.08, 0, (0.38 + z) / 2), (0.16, y, z - 0.38), color)
    parts.box((-0.06, 0, 0.19), (x - 0.2, y * 0.55, 0.38), color)
    parts.cylinder((x / 2 - 0.24, 0, 0.39), y * 0.98, 0.06, color)
    parts.cylinder((x / 2 - 0.24, 0, 0.425), y * 0.9, 0.01, _STEEL, collides=False)
    return parts.thing()


def lamp(*, size_m: Size, color: Rgb, pole_color: Rgb = _DARK) -> Description:
    """A floor lamp with a switch at the front of its pole."""
    parts = PartsOfBody()
    x, _, z = size_m
    parts.cylinder((0, 0, 0.015), x * 0.8, 0.03, pole_color)
    parts.cylinder((0, 0, z / 2), 0.03, z - 0.04, pole_color)
    parts.cylinder((0, 0, z - 0.15), x, 0.3, color)
    return parts.thing(switches=(switch((0.016, 0, z * 0.6), "x"),))


def television(*, size_m: Size, color: Rgb = _DARK, screen_color: Rgb = (0.1, 0.12, 0.16)) -> Description:
    """A screen on a low foot, with its switch at the lower right of the frame."""
    parts = PartsOfBody()
    x, y, z = size_m
    foot, frame, thick = 0.06, 0.03, 0.035
    parts.box((0, 0, 0.01), (x, y * 0.4, 0.02), color)
    parts.box((0, 0, foot / 2 + 0.01), (0.04, 0.1, foot), color)
    parts.box((0, 0, (foot + z) / 2), (thick, y, z - foot), color)
    size = (0.002, y - 2 * frame, z - foot - 2 * frame)
    parts.box((thick / 2, 0, (foot + z) / 2 + 0.01), size, screen_color, collides=False)
    return parts.thing(switches=(switch((thick / 2, y / 2 - 0.05, foot + frame / 2), "x"),))


def plant(*, size_m: Size, color: Rgb, leaf_color: Rgb = _GREEN) -> Description:
    """A pot with a bushy plant."""
    parts = PartsOfBody()
    x, _, z = size_m
    pot = min(0.35, z * 0.35)
    parts.cylinder((0, 0, pot / 2), x * 0.7, pot, color)
    parts.cylinder((0, 0, (pot + z) / 2), 0.03, (z - pot) * 0.6, _WOOD)
    parts.sphere((0, 0, z - x / 2), x, leaf_color)
    for k, angle in enumerate((0.4, 2.5, 4.6)):
        center = (x * 0.22 * float(np.cos(angle)), x * 0.22 * float(np.sin(angle)), z - x * (0.75 + 0.1 * k))
        parts.sphere(center, x * 0.6, _LEAF, collides=False)
    return parts.thing()


def tree(*, height_m: Length, trunk_m: Length, crown_m: Length, color: Rgb, leaf_color: Rgb = _GREEN) -> Description:
    """A trunk under a round crown."""
    parts = PartsOfBody()
    trunk = height_m - crown_m * 0.6
    parts.cylinder((0, 0, trunk / 2), trunk_m, trunk, color)
    parts.sphere((0, 0, height_m - crown_m / 2), crown_m, leaf_color)
    for k, angle in enumerate((0.3, 2.2, 4.4)):
        center = (crown_m * 0.3 * float(np.cos(angle)), crown_m * 0.3 * float(np.sin(angle)))
        tone = _LEAF if k % 2 else leaf_color
        parts.sphere((*center, height_m - crown_m * 0.55), crown_m * 0.62, tone, collides=False)
    return parts.thing()


def slab(*, size_m: Size, color: Rgb) -> Description:
    """A flat plate on the ground, such as a lawn or a driveway."""
    parts = PartsOfBody()
    parts.box((0, 0, size_m[2] / 2), size_m, color)
    return parts.thing()


def nail(*, length_m: Length, diameter_m: Length, color: Rgb = _DARK) -> Description:
    """A peg out of a wall, with its origin at the wall's surface."""
    parts = PartsOfBody()
    parts.cylinder((length_m / 2, 0, 0), diameter_m, length_m, color, axis="x")
    parts.cylinder((length_m, 0, 0), diameter_m * 2, 0.004, color, axis="x", collides=False)
    return parts.thing()


def rug(*, size_m: Size, color: Rgb, border_color: Rgb | None = None, collides: bool = False) -> Description:
    """A thin carpet that is only seen: things stand on the floor below it."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z / 2), size_m, border_color or color, collides=collides)
    if border_color is not None:
        parts.box((0, 0, z / 2 + 0.0015), (x - 0.16, y - 0.16, z + 0.003), color, collides=collides)
    return parts.thing()


def panel(
    *, size_m: Size, color: Rgb, frame_color: Rgb = _WHITE, frame_m: Length = 0.05, panes: Count = 1
) -> Description:
    """A framed panel on a wall that is only seen: a window, a picture, a mirror, a door to the street."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z / 2), (x * 0.6, y, z), frame_color, collides=False)
    width = (y - frame_m * (panes + 1)) / panes
    for k in range(panes):
        center = -y / 2 + frame_m + width / 2 + k * (width + frame_m)
        parts.box((x * 0.15, center, z / 2), (x * 0.7, width, z - 2 * frame_m), color, collides=False)
    return parts.thing()


def hood(*, size_m: Size, color: Rgb) -> Description:
    """An extractor over a stove; its underside is at z = 0."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, 0.05), (x, y, 0.1), color)
    parts.box((-x / 4, 0, (0.1 + z) / 2), (x / 2, y * 0.45, z - 0.1), color)
    return parts.thing()


def _fronts(parts: PartsOfBody, x: float, width: float, low: float, high: float, units: int, color: Color) -> None:
    """Doors that are only drawn, at depth `x`."""
    each = width / units
    lighter = (min(1.0, color[0] * 1.08), min(1.0, color[1] * 1.08), min(1.0, color[2] * 1.08))
    for k in range(units):
        center = -width / 2 + (k + 0.5) * each
        size = (0.012, each - 0.02, high - low - 0.03)
        parts.box((x + 0.004, center, (low + high) / 2), size, lighter, collides=False)
        parts.cylinder((x + 0.02, center, high - 0.08), 0.014, each * 0.35, _STEEL, axis="y", collides=False)
