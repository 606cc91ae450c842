"""Families of fixtures with doors, lids and drawers: pure functions from dimensions to a description.

Sizes are full lengths [m] along x (depth, without handles), y (width) and z (height); the front faces +x, and "left"
and "right" are as seen by someone who stands before it. Handles are round bars of 1.6 to 2.2 cm, 5 to 6.5 cm clear of
the door, near its free edge: those that a friction grasp has been measured to open.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from mpvi_bt.ground.geometry.solids import Solid, box
from mpvi_bt.house.things.description import Color, Description, Handle, Joint, PartsOfBody, RigidBody, switch
from mpvi_bt.house.things.dimensions import Count, Length, Rgb, Size

Hinge = Literal["left", "right", "bottom", "top"]

_STEEL: Color = (0.62, 0.63, 0.66)
_DARK: Color = (0.2, 0.2, 0.22)
_GLASS: Color = (0.33, 0.4, 0.46)
_WALL = 0.018  # of carcasses and doors
_PANEL = 0.08  # width of a strip with a switch
_GAP = 0.004  # between a door and its neighbors


def cabinet(
    *, size_m: Size, color: Rgb, door_color: Rgb | None = None, hinge: Hinge = "right", doors: Literal[1, 2] = 1,
    shelves_z_m: tuple[Length, ...] = (), plinth_m: float = 0.0, handle_m: Length = 0.16, window: bool = False,
    handle_color: Rgb = _STEEL, panel: Literal["top", "side"] | None = None, closed_only: bool = False,
) -> Description:  # fmt: skip
    """A box with one hinged door, or two that meet in the middle: cabinets, a refrigerator, a microwave, an oven.

    Args:
        size_m: Of the carcass with its doors.
        hinge: Edge that a single door turns about. One at the bottom or the top is sprung, as real ones are.
        shelves_z_m: Heights of the boards inside.
        plinth_m: Height of the closed base below the interior.
        handle_m: Length of the bar.
        window: Whether the door has a pane.
        panel: Where beside a single door a strip with the switch is, if it has one; at the side it is the door's free
            edge.
        closed_only: Whether the switch turns it on only while it is closed, as that of a microwave does.
    """
    x, y, z = size_m
    depth = x - _WALL  # of the carcass; its front is at x / 2 - _WALL
    parts = PartsOfBody()
    middle = -_WALL / 2
    parts.box((-x / 2 + _WALL / 2, 0, (plinth_m + z) / 2), (_WALL, y, z - plinth_m), color)
    for height in (plinth_m + _WALL / 2, z - _WALL / 2):
        parts.box((middle + _WALL / 2, 0, height), (depth - _WALL, y, _WALL), color)
    for sign in (-1, 1):
        center = (middle + _WALL / 2, sign * (y - _WALL) / 2, (plinth_m + z) / 2)
        parts.box(center, (depth - _WALL, _WALL, z - plinth_m - 2 * _WALL), color)
    for height in shelves_z_m:
        parts.box((middle, 0, height), (depth - 0.04, y - 2 * _WALL, 0.016), color)
    if plinth_m > 0:
        parts.box((-0.03, 0, plinth_m / 2), (x - 0.06, y, plinth_m), _DARK)
    low, high = plinth_m + _WALL, z - _WALL
    interior = box((middle + _WALL / 2, 0, (low + high) / 2), (depth - _WALL, y - 2 * _WALL, high - low))
    paint = door_color or color
    if doors == 1:
        free = -1.0 if hinge == "right" else 1.0  # where the door's free edge is, along y
        strip = _PANEL if panel == "side" else 0.0
        top = z - _PANEL if panel == "top" else z
        switches = []
        if panel is not None:
            size = (_WALL, strip or y, top - plinth_m if strip else _PANEL)
            center = (
                x / 2 - _WALL / 2,
                free * (y - strip) / 2 if strip else 0.0,
                (plinth_m + top) / 2 if strip else z - _PANEL / 2,
            )
            parts.box(center, size, color)
            switches.append(switch((x / 2, center[1] if strip else y * 0.3, center[2]), "x", closed_only))
        root = parts.body(volumes=(interior,), switches=tuple(switches))
        opening = (x / 2 - _WALL, y, plinth_m, top)
        door = _door("door", opening, -free * strip / 2, y - strip, hinge, paint, handle_m, window, handle_color)
        return Description((root, door))
    root = parts.body(volumes=(interior,))
    opening = (x / 2 - _WALL, y, plinth_m, z)
    half = y / 2
    return Description(
        (
            root,
            _door("left_door", opening, -half / 2, half, "left", paint, handle_m, window, handle_color),
            _door("right_door", opening, half / 2, half, "right", paint, handle_m, window, handle_color),
        )
    )


def drawers(
    *, size_m: Size, color: Rgb, top_color: Rgb | None = None, count: Count = 3, handle_m: Length = 0.14,
    handle_color: Rgb = _STEEL,
) -> Description:  # fmt: skip
    """A chest of drawers, from the lowest (drawer_1) to the highest."""
    x, y, z = size_m
    parts = PartsOfBody()
    front = 0.02
    depth = x - front
    foot, top = 0.06, 0.025
    parts.box((0, 0, z - top / 2), (x, y, top), top_color or color)
    parts.box((-x / 2 + _WALL / 2, 0, (foot + z - top) / 2), (_WALL, y, z - top - foot), color)
    for sign in (-1, 1):
        center = ((_WALL - front) / 2, sign * (y - _WALL) / 2, (z - top) / 2)
        parts.box(center, (depth - _WALL, _WALL, z - top), color)
    parts.box((-0.01, 0, foot - 0.01), (depth - 0.04, y - 2 * _WALL, 0.02), _DARK)
    pitch = (z - top - foot) / count
    bodies: list[RigidBody] = [parts.body()]
    for k in range(count):
        bodies.append(_drawer(f"drawer_{k + 1}", size_m, foot + k * pitch, pitch, color, handle_m, handle_color))
    return Description(tuple(bodies))


def washer(
    *,
    size_m: Size,
    color: Rgb,
    door_color: Rgb = _GLASS,
    hinge: Literal["left", "right"] = "left",
    plinth_m: float = 0.0,
) -> Description:
    """A front loader: a drum behind a door, a panel above with a dial that is its switch; on a plinth, if any."""
    x, y, z = size_m
    parts = PartsOfBody()
    low, high, inside = plinth_m + 0.2, z - 0.2, y - 0.14
    back = 0.06
    carcass = x - _WALL
    middle = -_WALL / 2
    parts.box((middle, 0, low / 2), (carcass, y, low), color)
    parts.box((middle, 0, (high + z) / 2), (carcass, y, z - high), color)
    for sign in (-1, 1):
        parts.box((middle, sign * (inside + y) / 4, (low + high) / 2), (carcass, (y - inside) / 2, high - low), color)
    parts.box((-x / 2 + back / 2, 0, (low + high) / 2), (back, inside, high - low), _STEEL)
    parts.cylinder((x / 2 - _WALL, 0.16, z - 0.08), 0.07, 0.03, _STEEL, axis="x", collides=False)
    parts.box((x / 2 - _WALL, -0.1, z - 0.08), (0.012, 0.2, 0.06), _DARK, collides=False)
    drum = box(((back - _WALL) / 2, 0, (low + high) / 2), (carcass - back, inside, high - low))
    opening = (x / 2 - _WALL, inside + 0.04, low - 0.02, high + 0.02)
    door = _door("door", opening, 0.0, inside + 0.04, hinge, door_color, 0.12, True, _STEEL)
    dial = switch((x / 2 + 0.002, 0.16, z - 0.08), "x", closed_only=True)
    return Description((parts.body(volumes=(drum,), switches=(dial,)), door))


def car(*, size_m: Size, color: Rgb, boot_m: Size = (0.8, 1.0, 0.6)) -> Description:
    """A small car whose boot, at the front of its frame (+x), has a lid hinged at the top."""
    x, y, z = size_m
    bx, by, _ = boot_m
    parts = PartsOfBody()
    sill, waist = 0.2, z * 0.58
    floor = 0.5
    rear = x / 2
    lid = 0.05
    cabin = rear - lid - bx  # where the boot begins
    parts.box(((-x / 2 + cabin) / 2, 0, (sill + waist) / 2), (cabin + x / 2, y, waist - sill), color)
    parts.box((-x / 2 + 0.03, 0, sill + 0.1), (0.1, y, 0.2), _DARK, collides=False)
    parts.box(((cabin + rear - lid) / 2, 0, (sill + floor) / 2), (rear - lid - cabin, y, floor - sill), color)
    for sign in (-1, 1):
        center = ((cabin + rear - lid) / 2, sign * (by + y) / 4, (floor + z) / 2)
        parts.box(center, (rear - lid - cabin, (y - by) / 2, z - floor), color)
        for at in (-x * 0.31, x * 0.3):
            parts.cylinder((at, sign * (y / 2 - 0.09), 0.3), 0.6, 0.2, _DARK, axis="y")
            parts.cylinder((at, sign * (y / 2 + 0.012), 0.3), 0.34, 0.01, _STEEL, axis="y", collides=False)
        parts.box((-x / 2 + 0.02, sign * y * 0.34, 0.62), (0.08, 0.26, 0.12), (0.97, 0.94, 0.8), collides=False)
        parts.box((rear - lid, sign * (by + y) / 4, 0.85), (0.03, 0.12, 0.22), (0.75, 0.12, 0.1), collides=False)
    parts.box(((cabin + rear - lid) / 2, 0, z - 0.03), (rear - lid - cabin, by, 0.06), color)
    nose = -x * 0.2  # where the windscreen stands
    parts.box(((nose + cabin) / 2, 0, (waist + z) / 2), (cabin - nose, y - 0.1, z - waist - 0.08), _GLASS)
    parts.box(((nose + 0.15 + cabin) / 2, 0, z - 0.03), (cabin - nose - 0.15, y - 0.06, 0.06), color)
    for at in (nose + 0.05, (nose + cabin) / 2):
        parts.box((at, 0, (waist + z) / 2), (0.07, y - 0.08, z - waist - 0.06), color, collides=False)
    boot = box(((cabin + rear - lid) / 2, 0, (floor + z - 0.06) / 2), (rear - lid - cabin, by, z - 0.06 - floor))
    opening = (rear - lid, by + 0.06, floor - 0.05, z)
    door = _door("boot_lid", opening, 0.0, by + 0.06, "top", color, 0.3, True, _DARK, thickness=0.035)
    return Description((parts.body(volumes=(boot,)), door))


def _door(
    name: str,
    opening: tuple[float, float, float, float],
    center_y: float,
    width: float,
    hinge: Hinge,
    color: Color,
    bar: float,
    window: bool,
    handle_color: Color,
    thickness: float = _WALL,
) -> RigidBody:
    """A door before an opening (x of the carcass's front, its full width, lowest and highest z).

    Its frame lies on the hinge, at the door's outer face and, along the hinge, in the door's middle: so an open door
    stays before its own opening and clear of its neighbors.
    """
    front, _, low, high = opening
    w, h = width - _GAP, high - low - _GAP
    across = min(bar, 0.7 * (h if hinge in ("left", "right") else w))
    inset = min(0.055, w / 5)
    clear = 0.058 if min(w, h) > 0.3 else 0.05
    grip = 0.02 if across > 0.2 else 0.017
    sprung = hinge in ("bottom", "top")
    if sprung:
        up = 1.0 if hinge == "bottom" else -1.0
        origin = np.array([front + thickness, center_y, low if hinge == "bottom" else high])
        axis = np.array([0.0, up, 0.0])
        middle = (-thickness / 2, 0.0, up * (high - low) / 2)
        handle = (clear, 0.0, up * (high - low - inset))
        along = np.array([0.0, 1.0, 0.0])
    else:
        side = -1.0 if hinge == "left" else 1.0
        origin = np.array([front + thickness, center_y + side * width / 2, (low + high) / 2])
        axis = np.array([0.0, 0.0, side])
        middle = (-thickness / 2, -side * width / 2, 0.0)
        handle = (clear, -side * (width - inset), 0.0)
        along = np.array([0.0, 0.0, 1.0])
    parts = PartsOfBody()
    parts.box(middle, (thickness, w, h), color)
    if window:
        size = (thickness + 0.004, w - 0.16, h - 0.16) if min(w, h) > 0.25 else (thickness + 0.004, w * 0.6, h * 0.6)
        parts.box(middle, size, _GLASS, collides=False)
    parts.bar(handle, along, across, grip, 0.0, handle_color)
    bar_handle = Handle(np.array(handle), along, np.array([1.0, 0, 0]), across, grip)
    limit = 1.75 if hinge == "top" else 1.57 if hinge == "bottom" else 2.0  # heads pass under what opens upward
    joint = Joint("hinge", origin, axis, limit, sprung=sprung)
    return parts.body(name, handles=(bar_handle,), joint=joint)


def _drawer(
    name: str, size: tuple[float, float, float], low: float, pitch: float, color: Color, bar: float, handle_color: Color
) -> RigidBody:
    """A drawer of the chest of `size`; its frame lies in the middle of its underside, at the chest's middle."""
    x, y, _ = size
    front, side = 0.02, 0.012
    depth, width, height = x - front - _WALL - 0.03, y - 2 * _WALL - 0.012, pitch - 0.05
    middle = x / 2 - front - depth / 2
    parts = PartsOfBody()
    parts.box((x / 2 - front / 2, 0, (pitch - 0.01) / 2), (front, y - 0.006, pitch - 0.01), color)
    parts.box((middle, 0, 0.02), (depth, width, 0.012), color)
    for sign in (-1, 1):
        parts.box((middle, sign * (width - side) / 2, 0.026 + height / 2), (depth, side, height), color)
    parts.box((middle - depth / 2 + side / 2, 0, 0.026 + height / 2), (side, width - 2 * side, height), color)
    center = (x / 2 + 0.05, 0.0, pitch * 0.62)
    along = np.array([0.0, 1.0, 0.0])
    parts.bar(center, along, bar, 0.018, x / 2, handle_color)
    interior = Solid("box", np.array([depth - side, width - 2 * side, height]) / 2)
    handle = Handle(np.array(center), along, np.array([1.0, 0, 0]), bar, 0.018)
    joint = Joint("slide", np.array([0.0, 0.0, low]), np.array([1.0, 0, 0]), min(0.35, depth * 0.8), damping=5.0)
    return parts.body(name, (_at(interior, (middle + side / 2, 0, 0.026 + height / 2)),), (handle,), joint)


def _at(solid: Solid, center: tuple[float, float, float]) -> Solid:
    T = np.eye(4)
    T[:3, 3] = center
    return solid.moved(T)
