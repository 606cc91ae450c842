"""Families of movable objects: pure functions from dimensions to a description. All stand on z = 0.

Sizes that a gripper can manage are a matter of the catalogue, not of the family: graspable width 2.5 to 8.5 cm or a lip
of 2.2 cm and more.
"""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.solids import Solid, box, pose
from mpvi_bt.house.things.description import Color, Description, Handle, PartsOfBody, switch
from mpvi_bt.house.things.dimensions import Count, Length, Rgb, Size
from mpvi_bt.house.things.pieces import Button, Piece

_STEEL: Color = (0.75, 0.76, 0.78)
_INK: Color = (0.18, 0.18, 0.2)


def can(*, diameter_m: Length, height_m: Length, color: Rgb, lid_color: Rgb = _STEEL) -> Description:
    """A closed cylinder with bright ends, such as a can of soda or a candle."""
    parts = PartsOfBody()
    rim = min(0.008, height_m / 8)
    parts.cylinder((0, 0, height_m / 2), diameter_m, height_m, color)
    for z in (rim / 2 - 0.0002, height_m - rim / 2 + 0.0002):
        parts.cylinder((0, 0, z), diameter_m * 0.94, rim, lid_color, collides=False)
    return parts.thing()


def block(*, size_m: Size, color: Rgb, label_color: Rgb | None = None) -> Description:
    """A closed box, such as a carton, with a label on the front and back if it has one."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z / 2), size_m, color)
    if label_color is not None:
        parts.box((0, 0, z * 0.55), (x + 0.001, y * 0.7, z * 0.45), label_color, collides=False)
    return parts.thing()


def radio(*, size_m: Size, color: Rgb, grille_color: Rgb = _INK) -> Description:
    """A box with a grille at its front and its switch on top."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z / 2), size_m, color)
    parts.box((x / 2, -y * 0.12, z * 0.45), (0.002, y * 0.6, z * 0.6), grille_color, collides=False)
    parts.cylinder((x / 2, y * 0.34, z * 0.55), min(0.035, z / 4), 0.008, _STEEL, axis="x", collides=False)
    return parts.thing(switches=(switch((0, y * 0.3, z), "z"),))


def book(*, size_m: Size, color: Rgb, page_color: Rgb = (0.95, 0.93, 0.86)) -> Description:
    """A closed book, lying: covers above and below, the spine at the back, pages between."""
    parts = PartsOfBody()
    x, y, z = size_m
    parts.box((0, 0, z / 2), size_m, color)
    parts.box((0.002, 0, z / 2), (x, y + 0.001, z * 0.7), page_color, collides=False)
    return parts.thing()


def ball(*, diameter_m: Length, color: Rgb) -> Description:
    """A sphere, such as a tennis ball or an apple."""
    parts = PartsOfBody()
    parts.sphere((0, 0, diameter_m / 2), diameter_m, color)
    return parts.thing()


def bottle(*, diameter_m: Length, height_m: Length, color: Rgb, cap_color: Rgb = _INK) -> Description:
    """A round body with a narrow neck and a cap."""
    parts = PartsOfBody()
    neck = min(0.03, diameter_m / 2)
    body = height_m * 0.7
    parts.cylinder((0, 0, body / 2), diameter_m, body, color)
    parts.cylinder((0, 0, (body + height_m) / 2), neck, height_m - body, color)
    parts.cylinder((0, 0, body), (diameter_m + neck) / 2, height_m * 0.08, color, collides=False)
    parts.cylinder((0, 0, height_m - 0.012), neck * 1.15, 0.024, cap_color, collides=False)
    return parts.thing()


def bowl(
    *, diameter_m: Length, height_m: Length, color: Rgb, wall_m: Length = 0.008, sides: Count = 12,
    feet_m: Length | None = None,
) -> Description:  # fmt: skip
    """A round dish with an upright wall that fingers can pinch: bowls, plates with a lip, saucers, pans.

    A caldron is one, too, on three feet.
    """
    parts = PartsOfBody()
    low = feet_m or 0.0
    if feet_m is not None:
        for angle in np.arange(3) * (2 * np.pi / 3):
            at = (0.35 * diameter_m * float(np.cos(angle)), 0.35 * diameter_m * float(np.sin(angle)), feet_m / 2)
            parts.cylinder(at, 0.15 * diameter_m, feet_m, color)
    parts.cylinder((0, 0, low + wall_m / 2), diameter_m - wall_m, wall_m, color)
    _ring(parts, diameter_m, low + wall_m / 2, height_m, wall_m, color, sides)
    return parts.thing(volumes=(_tube(diameter_m - 2 * wall_m, low + wall_m, height_m),))


def cup(*, diameter_m: Length, height_m: Length, color: Rgb, wall_m: Length = 0.006) -> Description:
    """A mug: a bowl with an ear at its front."""
    parts = PartsOfBody()
    parts.cylinder((0, 0, wall_m / 2), diameter_m - wall_m, wall_m, color)
    _ring(parts, diameter_m, wall_m / 2, height_m, wall_m, color, 10)
    r, ear = diameter_m / 2, 0.028
    parts.box((r + ear, 0, height_m / 2), (0.008, 0.012, height_m * 0.6), color)
    for z in (0.24, 0.76):
        parts.box((r + ear / 2, 0, height_m * z), (ear, 0.012, 0.009), color)
    return parts.thing(volumes=(_tube(diameter_m - 2 * wall_m, wall_m, height_m),))


def open_box(
    *, size_m: Size, color: Rgb, wall_m: Length = 0.008, rim_color: Rgb | None = None, bail_m: Length | None = None
) -> Description:
    """A box without a lid, such as a basket, a crate or a tray; `bail_m` adds a handle that high above its rim."""
    parts = PartsOfBody()
    x, y, z = size_m
    _walls(parts, size_m, wall_m, color)
    if rim_color is not None:
        for sign in (-1, 1):
            parts.box((sign * x / 2, 0, z - 0.01), (0.006, y + 0.006, 0.02), rim_color, collides=False)
            parts.box((0, sign * y / 2, z - 0.01), (x + 0.006, 0.006, 0.02), rim_color, collides=False)
    interior = box((0, 0, (wall_m + z) / 2), (x - 2 * wall_m, y - 2 * wall_m, z - wall_m))
    handles = () if bail_m is None else (_bail(parts, z, bail_m, y / 2, rim_color or color),)
    return parts.thing(volumes=(interior,), handles=handles)


def trash_can(
    *, size_m: Size, color: Rgb, handle_color: Rgb = _INK, wall_m: Length = 0.006, bail_m: Length = 0.07
) -> Description:
    """An open box with a bail: a bar along y above the middle, on two posts on the walls.

    Our choice: a real pedal bin has no bar, but a hand must be able to carry the bin upright, and the opening on either
    side of the bar stays wide enough for a can.
    """
    parts = PartsOfBody()
    x, y, z = size_m
    _walls(parts, size_m, wall_m, color)
    for sign in (-1, 1):
        parts.box((sign * x / 2, 0, z - 0.012), (0.004, y + 0.004, 0.024), handle_color, collides=False)
        parts.box((0, sign * y / 2, z - 0.012), (x + 0.004, 0.004, 0.024), handle_color, collides=False)
    handle = _bail(parts, z, bail_m, y / 2, handle_color)
    interior = box((0, 0, (wall_m + z) / 2), (x - 2 * wall_m, y - 2 * wall_m, z - wall_m))
    return parts.thing(volumes=(interior,), handles=(handle,))


def compound(*, pieces: tuple[Piece, ...], color: Rgb, buttons: tuple[Button, ...] = ()) -> Description:
    """Solids that are stuck together, such as a hammer: whatever has no family of its own; with switches, if any."""
    parts = PartsOfBody()
    for piece in pieces:
        piece.add_to(parts, color)
    handles = tuple(piece.handle for piece in pieces if piece.grip)
    blades = tuple(piece.solid for piece in pieces if piece.blade)
    return parts.thing(handles=handles, switches=tuple(button.switch for button in buttons), blades=blades)


def _walls(parts: PartsOfBody, size: tuple[float, float, float], wall: float, color: Color) -> None:
    """Bottom and four sides of an open box."""
    x, y, z = size
    parts.box((0, 0, wall / 2), (x, y, wall), color)
    for sign in (-1, 1):
        parts.box((sign * (x - wall) / 2, 0, (z + wall) / 2), (wall, y, z - wall), color)
        parts.box((0, sign * (y - wall) / 2, (z + wall) / 2), (x - 2 * wall, wall, z - wall), color)


def _bail(parts: PartsOfBody, rim: float, above: float, reach: float, color: Color) -> Handle:
    """A bar along y, `above` [m] over the rim, on posts at y = +-`reach` that stand on the walls."""
    thick, tall = 0.016, 0.02
    post = above - tall / 2
    for sign in (-1, 1):
        parts.box((0, sign * (reach - thick / 4), rim + post / 2), (thick, thick / 2, post), color)
    parts.box((0, 0, rim + above), (thick, 2 * reach, tall), color)
    return Handle(
        center=np.array([0, 0, rim + above]),
        axis=np.array([0.0, 1, 0]),
        outward=np.array([0.0, 0, 1]),
        length_m=2 * reach - thick,
        thickness_m=thick,
    )


def _ring(parts: PartsOfBody, diameter: float, z0: float, z1: float, wall: float, color: Color, sides: int) -> None:
    """An upright wall of flat staves between heights `z0` and `z1`."""
    middle = diameter / 2 - wall / 2
    stave = diameter * np.tan(np.pi / sides)
    for angle in np.arange(sides) * (2 * np.pi / sides):
        center = (middle * np.cos(angle), middle * np.sin(angle), (z0 + z1) / 2)
        parts.box(center, (wall, stave, z1 - z0), color, yaw=float(angle))


def _tube(diameter: float, z0: float, z1: float) -> Solid:
    """The upright cylinder between heights `z0` and `z1`."""
    return Solid("cylinder", np.array([diameter / 2, diameter / 2, (z1 - z0) / 2]), pose((0, 0, (z0 + z1) / 2)))
