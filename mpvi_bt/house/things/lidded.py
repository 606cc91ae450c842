"""Families of movable things with a lid: pure functions from dimensions to a description.

A lid turns about the back edge, at -x, and stays where it is left, by the friction of its hinge: it is balanced against
gravity and damped. Whoever opens it stands before it, at +x.
"""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.solids import box
from mpvi_bt.house.things.description import Color, Description, Handle, Joint, PartsOfBody, RigidBody
from mpvi_bt.house.things.dimensions import Length, Rgb, Size

_STEEL: Color = (0.62, 0.63, 0.66)
_SCREEN: Color = (0.1, 0.12, 0.16)
_OPEN_RAD, _SCREEN_RAD = 1.9, 1.75  # a little past upright
_BAR_M = 0.014  # thickness of a lid's bar: those that hands open doors by are hardly thicker
_CLEAR_M = 0.035  # from the lid's front edge to the middle of its bar, so that a finger gets behind it
_FRICTION, _DAMPING = 0.02, 0.05  # of hinges that a finger moves, on things so light that they would slide


def lidded_box(
    *, size_m: Size, color: Rgb, lid_color: Rgb | None = None, wall_m: Length = 0.006, lid_m: Length = 0.015,
    bar_m: Length = 0.12, bar_color: Rgb = _STEEL,
) -> Description:  # fmt: skip
    """A box whose lid has a bar along its front edge: a jar with a clasp, a toolbox, a pencil box.

    Args:
        size_m: With the lid, closed, but without the bar.
        color: Of the box.
        lid_color: None for the same.
        wall_m: Thickness of its walls.
        lid_m: Thickness of its lid.
        bar_m: Length of the bar. Our choice: it stands for the clasp or the latch that a real lid is opened by, which
            is too small for fingers as thick as a robot's.
        bar_color: Of the bar.
    """
    x, y, z = size_m
    rim = z - lid_m
    parts = PartsOfBody()
    parts.box((0, 0, wall_m / 2), (x, y, wall_m), color)
    for sign in (-1, 1):
        parts.box((sign * (x - wall_m) / 2, 0, (wall_m + rim) / 2), (wall_m, y, rim - wall_m), color)
        parts.box((0, sign * (y - wall_m) / 2, (wall_m + rim) / 2), (x - 2 * wall_m, wall_m, rim - wall_m), color)
    interior = box((0, 0, (wall_m + rim) / 2), (x - 2 * wall_m, y - 2 * wall_m, rim - wall_m))
    lid = PartsOfBody()
    lid.box((x / 2, 0, lid_m / 2), (x, y, lid_m), lid_color or color)
    at = (x + _CLEAR_M, 0.0, lid_m / 2)
    along = np.array([0.0, 1.0, 0.0])
    lid.bar(at, along, bar_m, _BAR_M, x, bar_color)
    handle = Handle(np.array(at), along, np.array([1.0, 0, 0]), bar_m, _BAR_M)
    return Description((parts.body(volumes=(interior,)), _lid(lid, x, rim, (handle,))))


def laptop(*, size_m: Size, color: Rgb, screen_m: Length = 0.014) -> Description:
    """A laptop computer: its screen is its lid, `screen_m` thick; `size_m` is that of the closed one."""
    x, y, z = size_m
    base = z - screen_m
    parts = PartsOfBody()
    parts.box((0, 0, base / 2), (x, y, base), color)
    parts.box((-x * 0.12, 0, base), (x * 0.5, y * 0.86, 0.002), _SCREEN, collides=False)
    parts.box((x * 0.32, 0, base), (x * 0.22, y * 0.34, 0.002), _STEEL, collides=False)
    lid = PartsOfBody()
    lid.box((x / 2, 0, screen_m / 2), (x, y, screen_m), color)
    lid.box((x / 2, 0, 0.0), (x * 0.9, y * 0.94, 0.001), _SCREEN, collides=False)
    return Description((parts.body(), _lid(lid, x, base, limit=_SCREEN_RAD)))


def _lid(
    parts: PartsOfBody, depth: float, rim: float, handles: tuple[Handle, ...] = (), limit: float = _OPEN_RAD
) -> RigidBody:
    """A lid whose frame lies on the hinge: at the back, at the height of the rim."""
    joint = Joint(
        "hinge", np.array([-depth / 2, 0.0, rim]), np.array([0.0, -1.0, 0.0]), limit, _FRICTION, _DAMPING,
        sprung=True,
    )  # fmt: skip
    return parts.body("lid", handles=handles, joint=joint)
